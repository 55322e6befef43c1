"""A measured wing: physics corrected by half of the cycles predicts the other half."""

from __future__ import annotations

from pathlib import Path

import pytest

from patagium.report import write_page
from patagium_lab.measured.yeo_grey import yeo_grey_box, yeo_grey_section, yeo_stand


def test_the_other_half_is_predicted_and_the_interval_holds_it(tmp_path: Path) -> None:
    result = yeo_grey_box("DeLaurier's strips", cycles=4, strips=3)
    assert result.untuned == pytest.approx(0.0225, abs=1e-3)  # as the validation has it
    assert result.learned < 0.0267 / 4 and result.unseen < result.unseen_untuned / 2
    assert result.coverage > 0.85 and result.unseen_coverage > 0.85
    values, priors = result.scores["parameter_value"], result.scores["parameter_prior"]
    assert 0.5 < values["added_mass.factor"] < priors["added_mass.factor"]
    page = tmp_path / "page.html"
    write_page(page, "Yeo", [yeo_grey_section({"strips": result})])
    text = page.read_text(encoding="utf-8")
    assert "untaught half" in text and "added_mass.factor" in text


def test_the_stand_carries_the_wings() -> None:
    robot = yeo_stand(3)
    assert robot.dof_names[:3] == ("x", "y", "z") and len(robot.strips) == 6
    assert len(robot.actuated) == 2
