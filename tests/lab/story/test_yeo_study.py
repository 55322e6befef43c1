from pathlib import Path

import numpy as np
import pytest

from patagium.report import write_page
from patagium_lab.measured.yeo import (
    YeoStudy,
    lift_balance,
    quasi_steady_lift,
    yeo_sections,
    yeo_study,
)
from patagium_lab.measured.yeo_case import load_yeo_case


@pytest.fixture(scope="module")
def study() -> YeoStudy:
    return yeo_study(cycles=6)


def test_the_quasi_steady_prediction_is_that_of_the_literature(study: YeoStudy) -> None:
    # Dickinson's polar, untuned: .0270 N by an independent program with other stations
    assert study.scores["quasi-steady"] == pytest.approx(0.0270, abs=6e-4)
    # a softer bound: the other reading of the flap angle changes little
    assert study.scores["quasi-steady, digitized flap angle"] == pytest.approx(0.0270, abs=2e-3)


def test_blade_elements_alone_have_no_mean_lift() -> None:
    case = load_yeo_case()
    lift = quasi_steady_lift(case, case.flap_angle)
    assert abs(lift.mean()) < 1e-12 < case.lift.mean()  # symmetric section, incidence zero


@pytest.mark.parametrize("model", ["strip network", "dense network"])
def test_learning_beats_no_learning_and_all_published_figures(study: YeoStudy, model: str) -> None:
    reached = study.scores[f"{model}: last cycle"]
    assert reached < 0.25 * study.scores["quasi-steady"]
    assert reached < 0.25 * min(study.scores["published"].values())


def test_a_warm_start_is_better_than_no_learning_from_the_second_cycle_on(study: YeoStudy) -> None:
    warm = "strip network, quasi-steady taught first"
    baseline = study.scores["quasi-steady"]
    assert study.scores[f"{warm}: first cycle"] == pytest.approx(baseline, rel=0.2)
    assert study.scores[f"{warm}: second cycle"] < 0.5 * baseline


def test_what_was_learned_holds_in_a_quarter_that_was_not_taught(study: YeoStudy) -> None:
    for model in study.record["model"].values:
        assert study.scores[f"{model}: unseen quarter"] < 0.5 * study.scores["quasi-steady"]


def test_a_cycle_is_predicted_before_it_is_learned(study: YeoStudy) -> None:
    errors = study.record["cycle_error"].sel(model="strip network").values
    # nothing was taught before the first cycle: worse than the quasi-steady model
    assert errors[0] > study.scores["quasi-steady"]
    last = study.record["predicted"].sel(model="strip network") - study.record["measured"]
    assert float(np.abs(last).mean()) == pytest.approx(errors[-1], rel=1e-12)


def test_the_lift_balance_reads_vertical_forces_only() -> None:
    from patagium.robot import load_robot

    row = lift_balance(load_robot("yeo-wing"))[0].reshape(-1, 3)
    assert row[:, 2].tolist() == [1.0] * 24 and not row[:, :2].any()


def test_the_study_is_a_page(study: YeoStudy, tmp_path: Path) -> None:
    write_page(tmp_path / "yeo.html", "Yeo", yeo_sections(study))
    text = (tmp_path / "yeo.html").read_text(encoding="utf-8")
    for words in ("PteraSoftware", "quasi-steady, ours, no learning", "unseen quarter"):
        assert words in text
