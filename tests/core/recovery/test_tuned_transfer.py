"""Tuning rewards what carries over to other kinematics, and refuses what errs there."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray as xr
from tests.robots import half_wing

import patagium as pt
from patagium.aerodynamics.delaurier import DeLaurier
from patagium.errors import LogError, ParameterError
from patagium.learning import DenseNetwork, Tuned, tune
from patagium.learning.learners.registry import make_learner
from patagium.learning.settings import Alternatives
from patagium.learning.tuning.left_out import Kinematics, stretches_of
from patagium.learning.tuning.tune import Trial
from patagium.sensing import LogTable

SEARCHED = {
    "spread": 1.0,
    "forgetting_factor": 1.0,
    "noise_estimation": None,
    "prior_share": Alternatives((0.0, 1e-3, 1e-2)),
}
AIR = pt.Air(wind=(-4.0, 0.0, 0.0))


@cache
def wing() -> pt.Robot:
    """A wing that plunges and feathers on a stand."""
    return half_wing(6)


@cache
def flown(frequency: float, plunge: float, feather: float) -> xr.Dataset:
    """A gait in air that strips cannot represent: their memory, suction and stall."""
    gait = pt.gaits.sinusoidal(wing(), frequency=frequency, plunge=plunge, feather=feather)
    return pt.simulate(wing(), DeLaurier(wing(), AIR), gait, duration=1.0, time_step=5e-4)


LEARNED, OTHER, UNSEEN = (4.0, 0.5, 0.15), (4.0, 0.3, 0.4), (5.0, 0.3, 0.3)


@cache
def network() -> pt.StripNetwork:
    return pt.StripNetwork(wing(), (6,), AIR)


def tuned(flight: Any, **options: Any) -> Tuned:
    asked = {"every": 10, "trials": 24, "jobs": 1, "covariance": ["node"], "settings": SEARCHED}
    return tune(flight, network(), **(asked | {"learner": "cubature"} | options))


@cache
def with_left_out_flight() -> Tuned:
    return tuned(flown(*LEARNED), hold_out={"other.nc": flown(*OTHER)})


def error_on_unseen_gait(found: Tuned, trial: Trial) -> float:
    """NMSE of the worst output on a gait that no search has seen, by weights that stay."""
    learner = make_learner("cubature", network(), trial.values, found.best.learner.seed)
    pt.identify(flown(*LEARNED), learner, every=10)
    return float(pt.evaluate(flown(*UNSEEN), learner).scores["nmse_worst"])


def test_the_error_on_one_gait_picks_what_errs_on_the_next_and_transfer_does_not() -> None:
    found = with_left_out_flight()
    old = min(found.trials, key=lambda one: one.prediction.nmse_second_half)
    by_error, by_transfer = (error_on_unseen_gait(found, t) for t in (old, found.trials[0]))
    assert by_error > 5.0  # of the variance: several times worse than zero
    assert by_transfer < 0.6  # blade elements without memory reach 0.4
    assert old.prediction.score == -np.inf
    assert old.prediction.reason.startswith("other.nc, left out: the mean square error, ")


def test_the_result_says_rule_and_scores_on_known_and_left_out() -> None:
    found = with_left_out_flight()
    assert found.rule == "left-out flights: other.nc"
    assert found.best.search["rule"] == found.rule
    assert 0 < found.best.search["refused"] < found.best.search["trials"]
    scores = found.best.prediction
    assert {"nmse_second_half", "left_out_nmse", "left_out_coverage", "crps"} <= {*scores}
    assert scores["crps"] == pytest.approx(
        (scores["crps_second_half"] + scores["left_out_crps"]) / 2, rel=1e-5
    )  # six digits


def test_two_gaits_are_left_out_in_turn_without_a_word() -> None:
    found = tuned([flown(*LEARNED), flown(*OTHER)], trials=8)
    assert found.rule.startswith("wingbeats of other kinematics left out in turn: 2 groups of 4, 4")
    assert np.isfinite(found.trials[0].prediction.left_out_nmse)


def test_where_all_wingbeats_are_alike_it_says_so_and_moves_weights_least() -> None:
    found = tuned(flown(*LEARNED), trials=8)
    assert "the 4 wingbeats are alike" in found.rule
    assert "cannot be judged" in found.rule and "--hold-out" in found.rule
    first, *others = (one.prediction for one in found.trials)
    most = min(one.crps for one in others) + first.left_out_error
    alike = [one for one in others if one.crps <= most and not one.reason]
    assert all(first.moved <= one.moved for one in alike if one.crps <= first.crps)
    ahead = tuned(flown(*LEARNED), trials=8, horizon="50ms")
    assert ahead.trials[0].prediction.crps != first.crps
    with pytest.raises(ParameterError, match="horizon: expected a positive time such as '100 ms'"):
        tuned(flown(*LEARNED), horizon="fast")


def test_a_search_of_which_nothing_carries_over_is_refused() -> None:
    settings = {"spread": 1.0, "prior_std": 0.5, "prior_share": 1e-2, "noise_estimation": None}
    settings |= {"forgetting_factor": 1.0, "measurement_std": Alternatives((1e-5, 1e-4))}
    with pytest.raises(LogError, match=r"all 8 were refused; the first one: other\.nc, left out"):
        tuned(flown(*LEARNED), trials=8, settings=settings, hold_out={"other.nc": flown(*OTHER)})


def kinematics(time: np.ndarray, x: np.ndarray, period: float | None = None) -> Kinematics:
    used = np.arange(len(time))
    return Kinematics(time, x, ("a", "b"), ("1", "1"), period, used[:0], used)


def test_wingbeats_are_grouped_by_amplitude_and_not_by_noise(rng: np.random.Generator) -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    wave = np.column_stack([np.sin(10 * np.pi * time), 0.3 * np.cos(10 * np.pi * time)])
    noisy = wave + 0.02 * rng.standard_normal(wave.shape)
    assert not stretches_of([kinematics(time, noisy)])[0].any()
    larger = noisy * np.where(time > 2.0, 1.5, 1.0)[:, None]
    group, words = stretches_of([kinematics(time, larger, 0.2)])
    assert {*group} == {0, 1} and "of 10, 10 wingbeats" in words
    first, second = group[time < 1.95], group[time > 2.05]
    assert len({*first}) == len({*second}) == 1 and first[0] != second[0]


def test_a_table_is_left_out_by_its_own_kinematics(rng: np.random.Generator) -> None:
    time = np.arange(0.0, 4.0, 1e-2)
    wave = np.column_stack([np.sin(16 * time), np.cos(16 * time)])
    x = wave * np.where(time > 2.0, 1.0, 0.5)[:, None]
    teacher = DenseNetwork(2, (4,), 1, "tanh")
    y = teacher.evaluate(x, 1.5 * teacher.initial(5)) + 0.01 * rng.standard_normal((400, 1))
    bounds = np.array([[-1.0, 1.0]] * 2)
    table = LogTable(
        time=time, x=x, y=y,
        input_names=("a", "b"), output_names=("c",), input_units=("1", "1"), output_units=("1",),
        input_range=bounds, output_range=bounds[:1],
        gaps=np.empty(0, np.int64), gap=3.0, source="log.csv",
    )  # fmt: skip
    found = tune(table, DenseNetwork(2, (4,), 1, "tanh"), every=1, trials=8, jobs=1)
    assert found.rule.startswith("wingbeats of other kinematics left out in turn: 2 groups")
