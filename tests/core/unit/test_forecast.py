"""Forecasts: nothing of the future in them, closed forms, and rivals that know as much."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.errors import ParameterError
from patagium.learning import forecast
from patagium.learning.forecast import (
    METHODS,
    Forecaster,
    ForecastSums,
    FrozenModel,
    Motion,
    Repetition,
    named_horizons,
)
from patagium.learning.models.memory import ModelMemory
from patagium.learning.propagation import robot_motion
from patagium.learning.stream import stream
from patagium.learning.wingbeats import wingbeat_period
from patagium.simulation import gait_period

Array = np.ndarray
OMEGA, STEP = 2 * np.pi * 5.0, 1e-3


def waves(count: int = 2000) -> tuple[Array, Array, Array]:
    """Two inputs of 5 Hz, one that drifts, and two outputs linear in them."""
    time = np.arange(count) * STEP
    x = np.column_stack([np.sin(OMEGA * time), np.cos(OMEGA * time), 3.0 * time])
    return time, x, x @ np.array([[1.0, 0.5, 0.0], [0.0, 2.0, 0.0]]).T


def linear(inputs: int = 3, outputs: int = 2) -> pt.ExtendedLearner:
    network = pt.DenseNetwork(inputs, (), outputs)
    return pt.ExtendedLearner(network, prior_std=10.0, measurement_std=1e-3)


class Kept(ForecastSums):
    """Sums that keep each forecast."""

    def __init__(self, seconds: float, outputs: int) -> None:
        super().__init__("h", seconds, [f"y{k}" for k in range(outputs)])
        self.found: list[dict[str, Array]] = []

    def add(self, y: Array, guesses: Any, weights: Array, late: bool) -> None:
        self.found.append(dict(guesses))
        super().add(y, guesses, weights, late)


def forecasts(
    log: tuple[Array, Array, Array], learner: Any, every: int, motion: Motion | None = None
) -> list[dict[str, Array]]:
    """Forecasts 20 ms ahead from the samples used for an update, in order."""
    sums = Kept(0.02, log[2].shape[1])
    used = np.arange(0, len(log[0]), every)
    watch = Forecaster(sums, learner, log, used, used[:0], motion, None, 0)
    stream(learner, *log, every=every, watches=[watch])
    return sums.found


def assert_nothing_after(before: list[Any], after: list[Any], known: int) -> None:
    """Forecasts made before a time do not depend on the samples after it; later ones do."""
    assert known > 3
    for one, other in zip(before[:known], after[:known], strict=True):
        for name in METHODS:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)
    last = zip(before[-1].items(), after[-1].values(), strict=True)
    assert any((one != other).any() for (_, one), other in last)


@pytest.mark.parametrize("cut", [401, 799, 1000])
def test_a_forecast_sees_no_sample_after_its_time(cut: int, rng: np.random.Generator) -> None:
    time, x, y = waves()
    other, seen = y.copy(), x.copy()
    other[cut + 1 :] += 50.0 * rng.standard_normal(other[cut + 1 :].shape)
    seen[cut + 1 :] = 1e6 * rng.standard_normal(seen[cut + 1 :].shape)
    found = [forecasts((time, *log), linear(), 20) for log in ((x, y), (seen, other))]
    skipped = (len(time) - 1) // 20 - len(found[0])
    assert_nothing_after(*found, known=cut // 20 - skipped)


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    """A free flight in air without memory, 3 m/s forward."""
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    aero = pt.QuasiSteady(robot)
    start = robot.velocities(x=3.0)
    return pt.simulate(robot, aero, gait, duration=0.7, time_step=5e-4, v=start)


def strips(flight: xr.Dataset) -> pt.CubatureLearner:
    robot = pt.load_robot("aerobat")
    network = pt.StripNetwork(robot, (8, 8))
    return pt.CubatureLearner(network, prior_std=0.3, measurement_std=3e-4, spread=1.7)


def test_a_propagated_flight_sees_no_sample_after_its_time(flight: xr.Dataset) -> None:
    cut, robot = 900, pt.load_robot("aerobat")
    changed = flight.copy(deep=True)
    for name in ("q", "v", "a"):
        changed[name][cut + 1 :] = 7.0
    found = []
    for one in (flight, changed):
        learner = strips(one)
        time, x, y = pt.training_data(one)
        motion = robot_motion(one, robot, learner.network, None, gait_period(one))
        found.append(forecasts((time, x, y), learner, 50, motion))
    skipped = (len(flight["time"]) - 1) // 50 - len(found[0])
    assert_nothing_after(*found, known=cut // 50 - skipped)


def test_a_forecast_in_own_air_beats_all_rivals(flight: xr.Dataset) -> None:
    scores = pt.identify(flight, strips(flight), every=5, horizons=["20ms", "100ms"]).scores
    for label in ("20ms", "100ms"):
        found = {name: scores[f"forecast_{label}_{name}_second_half_mean"] for name in METHODS}
        assert found["nmse"] < 0.05 * found["held"], label  # 1/150 and less measured
        assert found["nmse"] < 0.5 * min(found[name] for name in METHODS[1:]), label
        assert "propagated by the robot's equations" in scores[f"forecast_{label}_rule"]
        assert scores[f"forecast_{label}_lost"] == 0
    assert not any(key.startswith("forecast") for key in pt.identify(flight, strips(flight)).scores)


def test_a_robot_in_no_air_falls(flight: xr.Dataset) -> None:
    """z(t) = z + v t - g t^2 / 2 where the network says that there is no force."""
    robot = pt.load_robot("aerobat")
    still = pt.gaits.still(robot)
    start = robot.velocities(x=2.0, z=1.0)
    vacuum = pt.QuasiSteady(robot, pt.Air(density=1e-9))
    fallen = pt.simulate(robot, vacuum, still, duration=0.1, time_step=2.5e-4, v=start)
    network = pt.DenseNetwork(28, (), robot.dof_names)
    motion = robot_motion(fallen, robot, network, None, None)
    assert motion is not None
    model = FrozenModel(network, np.zeros(network.size), ModelMemory(network))
    ahead = 2.5e-3 * np.arange(1, 31)
    path = motion.path(50, ahead, model)
    z, fall = fallen["q"].values[50, 2], fallen["v"].values[50, 2]
    exact = z + fall * ahead - 0.5 * robot.gravity * ahead**2
    np.testing.assert_allclose(path[:, 2], exact, atol=1e-9)  # m; air of 1e-9 kg/m^3
    expected = fallen["q"].values[50 + np.arange(10, 301, 10)]
    np.testing.assert_allclose(path[:, :14], expected, atol=1e-9)  # the same


def test_waves_are_forecast_and_their_rivals_err_as_they_must() -> None:
    time, x, y = waves()
    scores = stream(linear(), time, x, y, every=10, horizons={"h": 0.03}).scores
    assert scores["forecast_h_samples"] == 30 and scores["forecast_h_seconds"] == 0.03
    assert scores["forecast_h_nmse_second_half_worst"] < 1e-4  # prior and period as found
    assert scores["forecast_h_last_beat_second_half_worst"] < 1e-4
    held = 2.0 * (1.0 - np.cos(OMEGA * 0.03))  # mean of (sin(a + h) - sin(a))^2 over var sin
    assert scores["forecast_h_held_second_half_mean"] == pytest.approx(held, rel=0.1)
    assert scores["forecast_h_average_second_half_mean"] == pytest.approx(1.0, rel=0.1)
    assert scores["forecast_h_least_squares_second_half_worst"] < 1e-4  # exact but for its ridge
    assert scores["forecast_h_rule"].startswith("last wingbeat of the inputs repeated")


def test_the_joints_alone_show_the_wingbeat_of_a_body_that_drifts(flight: xr.Dataset) -> None:
    """The drift of the body spoiled the wingbeat that a forecast found in a free flight."""
    robot, network = pt.load_robot("aerobat"), strips(flight).network
    motion = robot_motion(flight, robot, network, None, None)
    assert motion is not None
    time, x, _ = pt.training_data(flight)
    found = Repetition(time, x, None, motion.beating).period(len(time) - 1)
    assert found == pytest.approx(0.2, rel=1e-3)


def test_no_equation_propagates_a_body_that_another_force_holds(flight: xr.Dataset) -> None:
    """The body of an imported log on a mount, whose forces are in u1, was forecast to fall."""
    robot, network = pt.load_robot("aerobat"), strips(flight).network
    imported = flight.copy(deep=True)
    del imported.attrs["mount"]
    held = imported.copy(deep=True)
    held["u1"][:, 2] = 0.1  # N
    imported["u1"][:, 2] = 1e-14  # N, rounding
    assert robot_motion(held, robot, network, None, None) is None
    assert robot_motion(imported, robot, network, None, None) is not None


def test_errors_before_the_first_wingbeat_choose_no_way(flight: xr.Dataset) -> None:
    """The joints are held until then; for a second outputs went a way that errs by far more."""
    scores = pt.identify(flight, horizons=["20ms"]).scores
    assert scores["forecast_20ms_nmse_second_half_worst"] < 1e-4


def test_what_does_not_repeat_itself_is_held(rng: np.random.Generator) -> None:
    time = np.arange(600) * 0.01
    x = np.cumsum(rng.standard_normal((600, 1)), axis=0)
    assert wingbeat_period(time, x) is None
    scores = stream(linear(1, 1), time, x, 2.0 * x, every=5, horizons="50ms").scores
    assert scores["forecast_50ms_rule"].startswith("inputs held")
    found, held = (scores[f"forecast_50ms_{name}_mean"] for name in ("nmse", "held"))
    assert found == pytest.approx(held, rel=0.02)  # y is twice x, once that is learned


def test_a_wingbeat_is_known_as_soon_as_it_shows() -> None:
    """Before, the next search came after 25 % more samples, even if none had been found."""
    time, x, _ = waves(800)
    inputs = Repetition(time, x[:, :2])
    assert inputs.period(550) is None
    assert inputs.period(660) == pytest.approx(0.2, rel=0.01)


@pytest.mark.parametrize(
    ("frequency", "rate", "length"), [(8, 1e3, 250), (200, 5e3, 20), (0.3, 1e3, 60)]
)
def test_wingbeats_of_long_logs_are_found(frequency: float, rate: float, length: float) -> None:
    """Every n-th sample was looked at: 20 s of 200 Hz gave 24 beats for one."""
    phase = 2 * np.pi * frequency * np.arange(0.0, length, 1 / rate)
    x = np.stack([np.sin(phase), np.cos(phase) + 0.3 * np.sin(2 * phase)], axis=1)
    assert wingbeat_period(phase / (2 * np.pi * frequency), x) == pytest.approx(
        1 / frequency, rel=1e-3
    )


def test_a_forecast_motion_has_forty_steps_a_wingbeat() -> None:
    """Steps of 2 ms, a quarter of a bee's wingbeat, forecast it worse than its mean."""
    time = np.arange(4000) * 2e-4
    x = np.sin(2 * np.pi * 150.0 * time)[:, None]
    steps = []

    class Seen(Repetition):
        def path(self, last: int, ahead: Array, model: FrozenModel | None = None) -> Array:
            steps.append(float(np.diff(ahead, prepend=0.0).max()))
            return super().path(last, ahead, model)

    forecasts((time, x, 2.0 * x), linear(1, 1), 50, Seen(time, x))
    assert max(steps[-20:]) <= 2.1e-4  # the step of the log, more than 1 / 40 of a beat


def test_a_wingbeat_that_is_not_there_is_looked_for_rarely(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A search uses all samples so far; one search a forecast takes hours on a long log."""
    seen: list[int] = []
    monkeypatch.setattr(forecast, "wingbeat_period", lambda time, _: seen.append(len(time)))
    time = np.arange(5000) * 1e-3
    inputs = Repetition(time, np.cumsum(rng.normal(size=(5000, 2)), axis=0))
    assert {inputs.period(last) for last in range(5000)} == {None}
    assert len(seen) < 20 + np.log(5000 / 20) / np.log(1.05) and seen[-1] > 4700


def test_each_input_goes_on_as_it_did_best() -> None:
    time, x, _ = waves()
    steps = np.column_stack([x[:, 0], np.floor(time / 0.37)])  # held between its jumps
    ahead = np.array([0.01, 0.1])
    path = Repetition(time, steps, 0.2).path(1500, ahead)
    np.testing.assert_allclose(path[:, 0], np.sin(OMEGA * (1.5 + ahead)), atol=1e-6)
    assert path[:, 1].tolist() == [4.0, 4.0]


def test_no_forecast_reaches_across_a_gap() -> None:
    time, x, y = waves(1000)
    time = time + np.where(np.arange(1000) >= 500, 1.0, 0.0)
    options: dict[str, Any] = {"every": 10, "horizons": {"h": 0.1}}
    whole = stream(linear(), time, x, y, **options).scores["forecast_h_count"]
    split = stream(linear(), time, x, y, gaps=[500], **options).scores["forecast_h_count"]
    assert whole - split == 10


def test_horizons_are_times() -> None:
    assert named_horizons("100ms") == {"100ms": 0.1}
    assert named_horizons([0.01, "2 s"]) == {"10ms": 0.01, "2s": 2.0}
    assert named_horizons({"beat": 0.2}) == {"beat": 0.2}
    assert named_horizons(None) == {}
    assert named_horizons(np.float32(0.5)) == {"500ms": 0.5}
    assert named_horizons(np.array([0.01, 0.02])) == {"10ms": 0.01, "20ms": 0.02}
    for wrong in ("fast", "-1 s", "3 m", 0.0):
        with pytest.raises(ParameterError, match="horizon: expected a positive time"):
            named_horizons(wrong)


def test_what_the_network_misses_each_wingbeat_is_no_error_of_the_forecast() -> None:
    time, x, y = waves()
    other = y + np.column_stack([np.sin(2 * OMEGA * time), 3 * np.cos(3 * OMEGA * time)])
    scores = stream(linear(), time, x, other, every=10, horizons={"h": 0.03}).scores
    assert scores["nmse_second_half_worst"] > 0.2  # lines cannot follow it
    assert scores["forecast_h_nmse_second_half_worst"] < 0.02
    assert scores["forecast_h_rule"] == "last wingbeat of the inputs repeated"


@pytest.mark.parametrize("rival", ["last_beat", "least_squares"])
def test_what_the_network_cannot_know_is_forecast_as_by_the_best_rival(rival: str) -> None:
    """Outputs that are no function of the inputs; the network alone errs by far more."""
    time, x, _ = waves(3000)
    y = {
        "last_beat": np.sign(np.sin(np.outer([3.0, 4.0], OMEGA * time) + 0.5)),
        "least_squares": np.sin(np.outer([23.0, 31.0], time)),  # exact by two lags
    }[rival].T
    scores = stream(linear(), time, x, y, every=10, horizons={"h": 0.02}).scores
    found = {name: scores[f"forecast_h_{name}_second_half_worst"] for name in METHODS}
    assert found["nmse"] <= 1.1 * min(found[name] for name in forecast.RIVALS) + 1e-12
    for counts in scores["forecast_h_ways"].values():
        assert sum(counts.values()) in (49, 50)  # forecasts of the second half
        assert rival == "last_beat" or counts[forecast.RIVALS[rival]] > 40  # network corrected


def test_least_squares_of_a_log_that_begins_at_rest(rng: np.random.Generator) -> None:
    """A regressor that was rounding so far and begins to move has no slope yet."""
    time = np.arange(1600) * 5e-3
    moved = np.sin(25.0 * time) * np.clip(2.0 * (time - 2.0), 0.0, 1.0)
    late = 0.1 * np.sin(9.0 * time) * (time > 5.0)
    x = np.column_stack([moved, late]) + 1e-17 * rng.normal(size=(1600, 2))
    y = x @ np.array([[1.0, 0.5], [1.0, 1.0]])
    rival = forecast._LeastSquares(x, y, 20, 5)
    errors = [rival.at(last) - y[last + 20] for last in range(100, 1500, 15)]
    assert np.mean(np.square(errors)) < 0.1 * y.var()  # 1e24 with slopes of rounding
