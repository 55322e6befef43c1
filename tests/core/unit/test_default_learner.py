"""Default learner: what is taken where nobody chose, and the words for it."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.robots import FLAPPER

import patagium as pt
from patagium.arrays import usual_step
from patagium.cli.identify import flight_network
from patagium.cli.learner_options import LearnerChoice, NetworkKind
from patagium.learning.default_learner import (
    chosen_every,
    default_learner,
    learner_choices,
    update_time,
)
from patagium.learning.learners.registry import learner_from_description, load_learner
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.live.pipeline import Pipeline
from patagium.native import compiler_name
from patagium.robot.files import load_robot_text
from patagium.robot.model import Robot
from patagium.sensing.force.air_force import packet_columns
from patagium.simulation import air_of
from patagium.viewer.predicted_forces import predict_flight

STILL = pt.Air()


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    robot = pt.load_robot("aerobat")
    return pt.simulate(
        robot,
        pt.QuasiSteady(robot),
        pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5),
        duration=1.0,
        time_step=1e-3,
        q=robot.coordinates(pitch=0.1),
        v=robot.coordinates(x=4.0),
    )


def test_a_flight_is_learned_without_any_choice(flight: xr.Dataset) -> None:
    result = pt.identify(flight)
    # the held sample errs by 4e-2 there, one in ten used
    assert result.scores["nmse_second_half_mean"] < 4e-3
    assert result.scores["every"] == 10
    chosen = result.scores["chosen"]
    assert all(word in chosen["learner"] for word in ("extended", "default"))
    assert chosen["noise"].endswith("[unit of the output]; from the samples and the innovations")
    json.dumps(chosen)
    again = pt.identify(flight)
    assert np.array_equal(again.learner.weights, result.learner.weights)


def test_intervals_hold_errors_that_vanish(flight: xr.Dataset) -> None:
    """Below a millionth of an output the interval ends; it fell on, and held 15 % of the errors."""
    found = pt.identify(flight, every=1)
    late = found.prediction["predicted_std"].values[-100:]
    assert found.scores["coverage_second_half"] > 0.9  # of 95 %, less four deviations of a share
    scale = found.learner.network.output_scale  # outputs are compared in it
    largest = (found.prediction["measurement"].values.std(0) / scale).max()
    assert (late / scale).min() > 0.9e-6 * largest


@pytest.mark.parametrize(("seed", "estimated"), [(1, False), (2, False), (1, True)])
def test_noise_of_angles_spoils_no_force_of_a_symmetric_flight(seed: int, estimated: bool) -> None:
    """With 2 mrad of noise the final weights left .85 of the lift, and physics alone .08.

    Side force, roll and yaw were noise times the weights: fitting them drew weights to zero.
    """
    robot, draw = pt.load_robot("ornithopter"), np.random.default_rng(seed)
    aero, gait = pt.QuasiSteady(robot, pt.Air(wind=(-5.0, 0.0, 0.0))), pt.gaits.cruise(robot)
    given = {"duration": 1.5, "time_step": 1e-3, "mount": pt.mounts.fixed()}
    log = pt.simulate(robot, aero, gait, **given)
    for name, std in (("q", 2e-3), ("v", 2e-2)):
        values, joints = log[name].values, list(robot.actuated)
        values[:, joints] += std * draw.standard_normal((len(values), len(joints)))
    network = LinearStripNetwork(robot, aero.air)
    memory = pt.learning.NoiseEstimation()
    learner = pt.ExtendedLearner(network, noise_estimation=memory) if estimated else None
    scores = pt.identify(log, learner).scores
    for name in ("x", "z", "left_plunge"):
        # 4e-5 at most here; with the lateral forces left out 5e-6
        assert scores["frozen_second_half"][name] < 1e-3
        assert scores["nmse_second_half"][name] < 1e-3


@pytest.mark.parametrize("size", [1, 1 / 64])
def test_a_small_robot_refuses_a_wild_torque_as_a_large_one_does(size: float) -> None:
    """Torques were compared with forces by their numbers: at 1 mm of chord nothing was too much."""

    def scaled(found: re.Match[str]) -> str:
        return f"{float(found[1]) * size ** (3 if found[2] == 'g' else 1)} {found[2]}"

    text = re.sub(r"([\d.]+) (cm|mm|g)\b", scaled, FLAPPER).replace("9.81", str(9.81 / size))
    robot = load_robot_text(text)
    aero = pt.QuasiSteady(robot, pt.Air(wind=(-8.0, 0.0, 0.0)))
    gait = pt.gaits.sinusoidal(
        robot, frequency=4 / size, plunge=0.6, feather=0.2, phase={"feather": -1.5}
    )
    given = {"duration": 1.5 * size, "time_step": size / 1024, "mount": pt.mounts.fixed()}
    log = pt.simulate(robot, aero, gait, **given)
    joint = robot.index("left_plunge")
    log["u1"].values[720, joint] += 100 * np.abs(log["aero_force"].values[:, joint]).max()
    scores = pt.identify(log, every=12).scores
    assert scores["events"]["out_of_range"] == 1
    assert scores["nmse_second_half"]["left_plunge"] < 1e-3


def test_intervals_soon_forget_the_errors_of_a_learner_that_knew_nothing(
    flight: xr.Dataset,
) -> None:
    """From the tenth to the fortieth sample; the mean of all errors was fifteen times too wide."""
    found = pt.identify(flight).prediction
    errors = (found["measurement"] - found["prediction"]).sel(time=found["check_time"])
    over = (errors / found["predicted_std"]).sel(check_time=slice(0.1, 0.4)).values
    moving = found["measurement"].values.std(0)
    over = over[:, moving > 1e-6 * moving.max()]
    assert (over**2).mean() > 0.2**2  # 1 where the interval is right; .5 here, .06 before
    assert (np.abs(over) < 1.96).mean() > 0.9


def test_a_motion_without_accelerations_is_refused_in_words() -> None:
    robot = pt.load_robot("aerobat")
    learner = pt.ExtendedLearner(LinearStripNetwork(robot), measurement_std=1e-3)
    q, v = robot.coordinates(), robot.coordinates(x=3.0)
    with pytest.raises(pt.errors.ShapeError, match=r"\(42,\) of np.concatenate\(\[q, v, a\]\)"):
        learner.predict([q, v])


def test_a_step_longer_than_a_wingbeat_is_told_by_its_time(flight: xr.Dataset) -> None:
    """A flight in ms had one sample in its first wingbeat and was asked to be longer."""
    late = flight.assign_coords(time=flight["time"].values * 1e3)
    with pytest.raises(
        pt.errors.LogError, match=r"time: .* wingbeat of 0.2 s, found a step of 1 s"
    ):
        default_learner(late)


def test_the_first_wingbeat_says_whether_flow_is_attached(
    flight: xr.Dataset, tmp_path: Path
) -> None:
    """In a lifting line's air its own physics is learned, and holds for another gait."""
    robot = pt.load_robot("aerobat")
    wind = pt.Air(wind=(-5.0, 0.0, -0.5))
    attached, other = (
        pt.simulate(
            robot,
            pt.LiftingLine(robot, wind),
            pt.gaits.sinusoidal(
                robot, frequency=beats, plunge=0.5, feather=0.3, phase={"feather": 1.5}
            ),
            duration=1.0,
            time_step=1e-3,
            added_mass=pt.AddedMass(robot, wind),
            mount=pt.mounts.fixed(),
        )
        for beats in (5.0, 4.0)
    )
    assert not default_learner(flight).network.attached
    assert not default_learner(robot).network.attached  # nothing is known yet
    result = pt.identify(attached)
    assert result.learner.network.attached
    assert result.scores["chosen"]["flow"].endswith("the first wingbeat")
    plain = pt.ExtendedLearner(LinearStripNetwork(robot, air_of(attached)))
    known = pt.identify(attached, plain).scores["nmse_second_half_worst"]
    ours, theirs = (pt.evaluate(other, one).scores["nmse_worst"] for one in (result.learner, plain))
    assert result.scores["nmse_second_half_worst"] < known / 20  # a hundredth and fiftieth
    assert ours < theirs / 20
    state = result.learner.save(tmp_path / "state")
    again = load_learner(state, like=plain)  # with its own network
    assert again.network.attached and np.array_equal(again.weights, result.learner.weights)


def test_air_that_no_network_knows_is_said() -> None:
    robot = pt.load_robot("aerobat")
    for air, told in ((pt.Air(ground=-1.0), True), (pt.Air(), False)):
        words = learner_choices(default_learner(robot, air), given=["learner"])
        assert words["learner"] == "extended; set by you"
        assert words["network"].endswith("; the default")  # it was "set by you" too
        assert ("ground" in words) is told


def other_flight(robot: pt.Robot, air: pt.Air = STILL) -> xr.Dataset:
    gait = pt.gaits.sinusoidal(robot, frequency=4.0, plunge=0.4)
    start = robot.coordinates(x=3.0)
    aero = pt.QuasiSteady(robot, air)
    return pt.simulate(robot, aero, gait, duration=0.3, time_step=1e-3, v=start)


def test_a_model_is_evaluated_in_the_air_of_the_flight(flight: xr.Dataset) -> None:
    """Learned in still air, it predicts a head wind of thinner air: 3 times the variance before."""
    robot = pt.load_robot("aerobat")
    windy = other_flight(robot, pt.Air(density=0.9, wind=(-2.0, 0.0, 0.0)))
    grey = pt.GreyBox(pt.QuasiSteady(robot), {"polar.lift_amplitude": 0.5})
    for learner in (pt.identify(flight).learner, pt.ExtendedLearner(grey)):
        scores = pt.evaluate(windy, learner).scores
        assert scores["nmse_worst"] < 1e-4, scores["nmse"]
        assert "learned in wind (0.0, 0.0, 0.0) m/s at 1.225" in scores["verdict"][-1]
    shown = predict_flight(windy, robot, learner, np.arange(len(windy.time)))
    np.testing.assert_allclose(shown.generalized[:, 2], windy.aero_force[:, 2], rtol=1e-6)
    own = pt.ExtendedLearner(pt.GreyBox(pt.QuasiSteady(robot), {"wind.x": 0.5}))
    assert pt.evaluate(windy, own).scores["nmse_worst"] > 0.1  # what it says of the wind stays
    fresh = default_learner(flight)
    assert "not that of the flight" in pt.identify(windy, fresh).scores["chosen"]["air"]


def test_a_learner_goes_on_in_the_air_of_the_next_flight(
    flight: xr.Dataset, tmp_path: Path
) -> None:
    """It learned the head wind as still air: .2 of the variance, and its model erred in both."""
    robot = pt.load_robot("aerobat")
    windy = other_flight(robot, pt.Air(density=0.9, wind=(-2.0, 0.0, 0.0)))
    learner = pt.identify(flight).learner
    learned = learner.count
    learner.save(tmp_path / "learner.state")
    result = pt.identify(windy, learner)
    assert result.learner is learner and learner.count > learned
    assert result.scores["nmse_second_half_worst"] < 1e-4, result.scores["nmse_second_half"]
    assert "that of the flight, wind (-2.0, 0.0, 0.0)" in result.scores["chosen"]["air"]
    assert pt.evaluate(flight, learner).scores["nmse_worst"] < 1e-3
    resumed = pt.learning.load_learner(tmp_path / "learner.state", like=default_learner(windy))
    resumed.restart_clock()
    again = pt.identify(windy, resumed)
    assert "air" not in again.scores["chosen"]
    np.testing.assert_allclose(resumed.weights, learner.weights, rtol=1e-6, atol=1e-9)


def test_other_wings_than_those_learned_are_said() -> None:
    text = pt.load_robot("aerobat").source
    wide = load_robot_text(text.replace("trailing: -5 cm", "trailing: -9 cm"))
    heavy = load_robot_text(text.replace("mass: 10 g", "mass: 15 g"))
    learner = default_learner(pt.load_robot("aerobat"))
    for robot, told in ((wide, True), (heavy, False)):
        verdict = pt.evaluate(other_flight(robot), learner).scores["verdict"]
        assert any("wings of aerobat are not" in one for one in verdict) is told


def test_what_is_set_by_hand_is_said(flight: xr.Dataset) -> None:
    network = pt.StripNetwork(pt.load_robot("aerobat"), (3,))
    learner = pt.CubatureLearner(network, prior_std=0.3, measurement_std=1e-3)
    chosen = pt.identify(flight, learner, every=50).scores["chosen"]
    assert all(words.endswith("set by you") for words in chosen.values()), chosen


def test_the_share_of_the_samples_follows_rate_wingbeat_and_size() -> None:
    robot = pt.load_robot("aerobat")
    learner = default_learner(robot)
    assert update_time(learner.network) < 1e-3
    assert chosen_every(learner, 1e-4) == 100 and chosen_every(learner, 1e-3) == 10
    day = np.arange(300) * 1e-3 + 1.7e9  # stamps of seconds since 1970 are rounded to 0.24 us
    assert chosen_every(learner, usual_step(day)) == 10
    assert chosen_every(learner, 0.02) == 1  # a log slower than that is used whole
    assert chosen_every(learner, 1e-4, period=0.05) == 25  # twenty a wingbeat of 20 Hz
    assert chosen_every(learner, 1e-4, period=1e-3) >= 10  # never above 1 kHz
    for frequency in (200.0, 220.0, 250.0, 333.0):  # always the same four phases were learned
        every = chosen_every(learner, 1e-5, 1 / frequency)
        phases = np.sort(np.arange(100) * every * 1e-5 * frequency % 1.0)
        assert np.diff(phases).max() < 0.18, frequency
    large = pt.ExtendedLearner(pt.DenseNetwork(20, (60, 60), 14))
    assert chosen_every(large, 1e-3) > 100  # as far as a computer keeps up
    nodes = pt.ExtendedLearner(pt.DenseNetwork(20, (60, 60), 14), covariance="node")
    assert chosen_every(nodes, 1e-3) == 10


def test_the_pipeline_finds_in_c_what_python_finds(flight: xr.Dataset) -> None:
    robot = pt.load_robot("aerobat")
    columns = len(packet_columns(robot))
    parts = [flight[name].transpose("time", ...).values for name in ("q", "v", "a", "u1")]
    packets = np.hstack([flight.time.values[:, None], *parts])[::5]
    assert packets.shape[1] == columns
    fast, plain = default_learner(robot), default_learner(robot)
    pipeline = Pipeline(fast, robot)
    pipeline.run(packets)
    assert pipeline.compiled == (compiler_name() is not None)
    form = pipeline.form
    cuts = 1 + np.cumsum([0, robot.coordinate_count, robot.dof, robot.dof])
    for row in packets:
        x, y = form.function(*np.split(row, cuts)[1:], form.parameters)
        plain.update(np.atleast_1d(x), np.atleast_1d(y), row[0])
    assert np.array_equal(fast.weights, plain.weights)  # the same kernel
    assert fast.describe()["found"] == plain.describe()["found"]
    made = learner_from_description(fast.describe())  # before any sample
    assert np.isnan(made.measurement_std).all()


def test_identify_knows_the_ranges_of_a_record_beforehand(flight: xr.Dataset) -> None:
    learner = pt.learning.default_learner(flight)
    begin = flight.isel(time=slice(0, 40))
    pt.identify(begin, learner, every=20)
    low, high = (learner._screen.bounds.arrays[f"bound_{end}"] for end in ("low", "high"))
    v = begin.v.sel(dof="left_plunge").values
    place = flight.sizes["dof"] + list(flight.dof).index("left_plunge")
    assert high[place] - low[place] >= 0.9 * (np.quantile(v, 0.99) - np.quantile(v, 0.01))


def test_attached_flow_is_found_in_a_log_that_begins_at_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot, wind = pt.load_robot("aerobat"), pt.Air(wind=(-5.0, 0.0, -0.5))
    rest, beats = (
        pt.simulate(
            robot,
            pt.LiftingLine(robot, wind),
            pt.gaits.sinusoidal(
                robot, frequency=5.0, plunge=size, feather=0.6 * size, phase={"feather": 1.5}
            ),
            duration=0.3,
            time_step=1e-3,
            added_mass=pt.AddedMass(robot, wind),
            mount=pt.mounts.fixed(),
        )
        for size in (0.0, 0.5)
    )
    names = ["q", "v", "a", "u1", "aero_force"]
    later = beats[names].isel(time=slice(1, None))
    later = later.assign_coords(time=later.time + float(rest.time[-1]))
    log = xr.concat([rest[names], later], "time").assign_attrs(rest.attrs)
    module = sys.modules[update_time.__module__]
    monkeypatch.setattr(module, "gait_period", lambda log: None)
    monkeypatch.setattr(module, "_LOOK", 0.2)
    assert default_learner(log).network.attached


def test_a_dense_network_is_scaled_by_the_first_second_of_motion(
    one_wing: Callable[..., Robot],
) -> None:
    """A dense network was scaled by the first .01 s of a log, in which the robot is at rest."""
    robot = one_wing("name: plunge, axis: x")
    rest, beats = (
        pt.simulate(
            robot,
            pt.QuasiSteady(robot),
            pt.gaits.sinusoidal(robot, frequency=2.0, plunge=size),
            duration=1.5,
            time_step=5e-3,
        )
        for size in (1e-9, 0.5)
    )
    later = beats.isel(time=slice(1, None))
    later = later.assign_coords(time=later.time + float(rest.time[-1]))
    log = xr.concat([rest, later], "time").assign_attrs(rest.attrs, gait="{}")
    log["u1"] = log.u1.where(np.arange(len(log.time))[:, None] % 2 == 1)
    network = flight_network(log, LearnerChoice(network=NetworkKind.DENSE))
    np.testing.assert_allclose(network.input_scale, [0.5, 0.5 * 4 * np.pi], rtol=0.01)
    force = pt.training_data(beats)[2]
    np.testing.assert_allclose(network.output_scale, np.ptp(force, axis=0) / 2, rtol=0.05)
