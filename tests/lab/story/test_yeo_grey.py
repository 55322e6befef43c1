"""A measured wing: physics corrected by half of the cycles predicts the other half."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from patagium.aerodynamics import Air
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.learning.stream import stream
from patagium.report import write_page
from patagium_lab.measured.yeo_case import load_yeo_case
from patagium_lab.measured.yeo_grey import (
    _halves,
    _log,
    yeo_grey_box,
    yeo_grey_section,
    yeo_stand,
)


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


def test_the_default_network_predicts_the_half_that_it_was_not_taught() -> None:
    """Better than its physics untaught; with a broad prior it expects negative added mass."""
    case, robot = load_yeo_case(), yeo_stand()
    air = Air(density=case.density, wind=(-case.airspeed, 0.0, 0.0))
    network = LinearStripNetwork(robot, air, ["z"])
    log, hidden = _log(case, robot, 5), _halves(len(case.lift))[0]
    seen = np.tile(~hidden, 5)
    learner = ExtendedLearner(network)
    stream(learner, log.time, log.x, np.where(seen[:, None], log.lift, np.nan), every=1)
    error = network.evaluate(log.x[:100], learner.weights) - log.lift[:100]
    untaught = network.evaluate(log.x[:100], network.initial(0)) - log.lift[:100]
    assert np.abs(error[hidden]).mean() < 0.7 * np.abs(untaught[hidden]).mean()
    assert np.abs(error[~hidden]).mean() < 0.005
