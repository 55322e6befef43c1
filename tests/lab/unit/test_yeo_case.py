from pathlib import Path

import numpy as np
import pytest

from patagium.errors import LogError
from patagium_lab.measured.yeo_case import (
    digitized_flap_angle,
    load_yeo_case,
    measured_lift,
    planform_area,
)

RAW = Path(__file__).parents[3].parent / "shared" / "data" / "yeo2011"
needs_raw = pytest.mark.skipif(
    not RAW.is_dir(), reason="the raw record of Yeo et al. is not beside the repository"
)


@needs_raw
def test_the_shipped_lift_is_computed_from_the_raw_pressures() -> None:
    case = load_yeo_case()
    # seven digits are shipped
    np.testing.assert_allclose(case.lift, measured_lift(RAW, case.flap_angle), atol=6e-8)


@needs_raw
def test_the_shipped_flap_angle_is_fitted_to_the_raw_positions() -> None:
    shipped, fitted = load_yeo_case().digitized_flap_angle, digitized_flap_angle(RAW)
    for part in ("mean", "cosine", "sine"):
        # nine digits are shipped
        np.testing.assert_allclose(getattr(shipped, part), getattr(fitted, part), rtol=1e-8)


@needs_raw
def test_the_shipped_area_is_that_of_the_outline() -> None:
    # the robot preset and the literature say .02461 m^2
    assert load_yeo_case().area == pytest.approx(planform_area(RAW), abs=1e-6)
    assert load_yeo_case().area == pytest.approx(0.02461, abs=1e-5)


def test_the_two_flap_angles_agree_as_far_as_the_record_does() -> None:
    case = load_yeo_case()
    difference = case.digitized_flap_angle(case.phase) - case.flap_angle(case.phase)
    assert np.sqrt(np.mean(difference**2)) < 0.03  # rad; the record does not close by .05 rad


def test_lift_is_up_on_the_way_down_and_down_on_the_way_up() -> None:
    case = load_yeo_case()
    rate = np.gradient(case.flap_angle(case.phase), case.phase)
    assert case.lift[rate < -0.3].min() > 0.0
    assert case.lift[rate > 0.3].max() < 0.0
    assert np.sqrt(np.mean(case.lift**2)) == pytest.approx(0.07145, abs=1e-5)  # N


def test_a_missing_record_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="measured_wing_positions.csv: no such file"):
        digitized_flap_angle(tmp_path)


def test_a_short_pressure_record_is_refused(tmp_path: Path) -> None:
    (tmp_path / "blue_leading_point_experimental_pressures.csv").write_text("0,1\n0.5,2\n")
    with pytest.raises(LogError, match="blue leading: expected 100 phases"):
        measured_lift(tmp_path, load_yeo_case().flap_angle)
