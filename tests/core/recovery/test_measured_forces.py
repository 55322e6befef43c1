"""The air's force from measurements by two ways, each within its stated errors of the truth."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

import patagium as pt
from patagium.cli.main import run
from patagium.errors import FlightError, LogError, ParameterError, ShapeError
from patagium.learning import identify, stream
from patagium.robot import load_robot_text
from patagium.sensing.force.flown_force import motion_and_force, write_motion
from patagium.sensing.force.measured_force import Measured

S, P = pt.sensors, pt.sensors.presets
AMPLIFIER = P.ina226(torque_constant=1.5e-3, gear_ratio=50.0, rate=500.0)
SENSORS = (
    P.icm_42688_p("body", rate=500.0),
    P.as5600(rate=500.0),
    replace(P.prime_x_13("body"), delay=0.0),
    replace(P.nano17("body", rate=500.0), position=(0.01, 0.0, -0.02), force_std=2e-3),
    AMPLIFIER,
)
LOUD = ("x", "z", "pitch", "left_plunge", "right_plunge", "left_elbow")


@pytest.fixture(scope="module")
def robot() -> pt.Robot:
    return pt.load_robot("aerobat")


@pytest.fixture(scope="module")
def flight(robot: pt.Robot) -> xr.Dataset:
    """Held in the wind, so that a load cell has something to say."""
    aero = pt.QuasiSteady(robot, pt.Air(wind=(-3.0, 0.0, 0.0)))
    gait = pt.gaits.linkage(robot, frequency=5.0)
    held = {"mount": pt.mounts.fixed(), "q": robot.coordinates(z=0.3, yaw=0.2)}
    return pt.simulate(robot, aero, gait, duration=0.3, time_step=2e-4, **held)


@pytest.fixture(scope="module")
def log(flight: xr.Dataset) -> pt.sensing.SensorLog:
    return pt.sense(flight, SENSORS).without_truth()


@pytest.fixture(scope="module")
def motion(log: pt.sensing.SensorLog) -> xr.Dataset:
    return pt.estimate_motion(log)


@pytest.fixture(scope="module")
def found(log: pt.sensing.SensorLog, motion: xr.Dataset) -> dict[str, pt.sensing.ForceSamples]:
    known = {
        "joints": pt.sensing.motor_forces(log, motion, "ina226"),
        "mount": pt.sensing.cell_wrench(log, motion, "nano17"),
    }
    return {
        "inverse dynamics": pt.inverse_dynamics_force(motion, **known),
        "load cell": pt.sensing.load_cell_force(motion, known["mount"]),
    }


def compared(samples: pt.sensing.ForceSamples, flight: xr.Dataset) -> tuple[np.ndarray, ...]:
    """True forces, errors and deviations but for the ends, (N, n) each."""
    at = np.searchsorted(flight["time"].values, samples.time - 1e-9)
    inner = slice(len(at) // 8, -len(at) // 8)
    true = flight["aero_force"].values[at]
    return true[inner], (samples.force - true)[inner], samples.std[inner]


@pytest.mark.parametrize("source", ["inverse dynamics", "load cell"])
def test_every_source_finds_the_force(
    source: str, found: dict[str, pt.sensing.ForceSamples], flight: xr.Dataset, robot: pt.Robot
) -> None:
    samples = found[source]
    assert samples.source == source
    true, error, std = compared(samples, flight)
    for name in LOUD:
        k = robot.index(name)
        if name not in samples.measured:
            assert source == "load cell" and k in robot.actuated
            continue
        # 0.5 deg of the cameras turn the weight by 2 mN: 2e-2 of x, 3e-4 to 3e-3 of the others
        assert np.mean(error[:, k] ** 2) < 0.03 * true[:, k].var(), name
        ratio = np.mean(error[:, k] ** 2 / std[:, k] ** 2)
        assert 0.05 < ratio < 4, (name, ratio)  # few independent errors in 0.2 s
    measured = np.isfinite(error).all(axis=0)
    inside = np.abs(error[:, measured]) < 1.96 * std[:, measured]
    assert 0.88 < inside.mean() <= 1.0


def test_noise_that_is_not_stated_is_that_of_the_spectrum(
    log: pt.sensing.SensorLog, motion: xr.Dataset, flight: xr.Dataset
) -> None:
    cell = replace(SENSORS[3], force_std=5e-2, moment_std=2e-3, bandwidth=None)
    amplifier = replace(AMPLIFIER, std=0.02)
    noisy = pt.sense(flight, [cell, amplifier]).without_truth()
    untold = {
        cell.name: cell.scaled(0.0),
        amplifier.name: amplifier.scaled(0.0),
    }
    noisy = replace(noisy, sensors=untold)
    wrench = pt.sensing.cell_wrench(noisy, motion, cell.name).measured
    joints = pt.sensing.motor_forces(noisy, motion, amplifier.name)
    np.testing.assert_allclose(wrench.noise, cell.sample_std, rtol=0.5)
    np.testing.assert_allclose(joints.noise, amplifier.sample_std, rtol=0.5)
    at = np.searchsorted(flight["time"].values, motion["time"].values - 1e-9)
    actuated = list(log.robot.actuated)
    error = (joints.values - flight["u1"].values[at])[:, actuated]
    inside = np.abs(error) < 2.5 * np.sqrt(joints.variance[:, actuated])
    assert inside.mean() > 0.85


@pytest.mark.parametrize("width", [100.0, 50.0])
def test_the_low_pass_of_a_sensor_is_undone(
    motion: xr.Dataset, flight: xr.Dataset, width: float
) -> None:
    """The delay of the sensor's low-pass stayed in the forces: 4 % of the intervals held them."""
    slow = [replace(one, bandwidth=width) for one in SENSORS[3:]]
    log = pt.sense(flight, slow).without_truth()
    joints = pt.sensing.motor_forces(log, motion, "ina226")
    wrench = pt.sensing.cell_wrench(log, motion, "nano17").measured
    sharp = pt.sense(flight, [replace(SENSORS[3].scaled(0.0), rate=5000.0)])["nano17"]
    at = np.searchsorted(flight["time"].values, motion["time"].values - 1e-9)
    columns = [log.robot.index(name) for name in ("left_plunge", "left_elbow")]
    for signal, true, chosen in (
        (joints, flight["u1"].values[at], columns),
        (wrench, sharp["wrench"].values[at], [2, 4]),
    ):
        error = (signal.values - true)[20:-20, chosen]
        assert (np.abs(error) < 1.96 * np.sqrt(signal.variance[20:-20, chosen])).mean() > 0.9
        assert (np.mean(error**2, axis=0) < 2e-3 * true[:, chosen].var(axis=0)).all()


def test_all_covariances_are_definite(found: dict[str, pt.sensing.ForceSamples]) -> None:
    for samples in found.values():
        columns = [samples.robot.index(name) for name in samples.measured]
        block = samples.covariance[:, columns][:, :, columns]
        assert np.linalg.eigvalsh(block).min() > 0
        np.testing.assert_allclose(block, np.swapaxes(block, 1, 2), rtol=1e-9, atol=1e-18)


def test_exact_measurements_give_the_exact_force(flight: xr.Dataset, robot: pt.Robot) -> None:
    n = robot.dof
    motion = flight[["q", "v", "a"]].isel(time=slice(None, None, 5))
    nothing = np.zeros((len(motion["time"]), 3 * n, 3 * n))
    motion = motion.assign(covariance=(("time", "part", "other_part"), nothing))
    exact = pt.sense(flight, [SENSORS[3].scaled(0.0), AMPLIFIER.scaled(0.0)])
    force = flight["u1"].values[::5]
    joints = replace(pt.sensing.motor_forces(exact, motion, "ina226"), values=force)
    mount = pt.sensing.cell_wrench(exact, motion, "nano17")
    true = flight["aero_force"].values[::5]
    samples = pt.inverse_dynamics_force(motion, joints=joints, mount=mount)
    # the wrench comes through a smoother of samples at 500 Hz
    np.testing.assert_allclose(samples.force[5:-5, :6], true[5:-5, :6], atol=2e-3)
    np.testing.assert_allclose(samples.force[:, 6:], true[:, 6:], atol=1e-9)


def test_a_force_in_one_sensor_is_a_force_of_the_air(
    log: pt.sensing.SensorLog, motion: xr.Dataset, robot: pt.Robot
) -> None:
    mount = pt.sensing.cell_wrench(log, motion, "nano17")
    base = pt.sensing.load_cell_force(motion, mount).force
    pulled = replace(mount.measured, values=mount.measured.values + np.eye(6)[2])  # 1 N up
    other = pt.sensing.load_cell_force(motion, replace(mount, measured=pulled)).force
    lift = (other - base)[:, robot.index("z")]
    np.testing.assert_allclose(lift, -1.0, atol=1e-3)  # more mount, less air; attitude to 0.5 deg
    # the cell sits 1 cm before and 2 cm below the origin: up there turns the nose up
    np.testing.assert_allclose((other - base)[:, robot.index("pitch")], 0.01, atol=2e-4)


def test_in_free_flight_only_what_is_measured_is_known(robot: pt.Robot) -> None:
    aero = pt.QuasiSteady(robot, pt.Air())
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    flown = pt.simulate(robot, aero, gait, duration=0.2, time_step=2e-4, v=robot.coordinates(x=3.0))
    log = pt.sense(flown, SENSORS[:3])
    samples = pt.inverse_dynamics_force(pt.estimate_motion(log))
    assert samples.measured == ("x", "y", "z", "roll", "pitch", "yaw")
    true, error, _ = compared(samples, flown)
    k = robot.index("z")
    assert np.mean(error[:, k] ** 2) < 0.01 * true[:, k].var()


def test_a_body_that_stands_without_a_load_cell_is_told(
    log: pt.sensing.SensorLog, flight: xr.Dataset, robot: pt.Robot
) -> None:
    """The force of a stand, the weight on average, was taken for that of the air."""

    def held(one: pt.sensing.SensorLog) -> bool:
        notes = json.loads(motion_and_force(one)[0].attrs["findings"])["notes"]
        return any("the body never moves" in note for note in notes)

    silent = pt.sense(flight, SENSORS[:3]).without_truth()
    assert held(replace(silent, mount="")) and not held(silent) and not held(log)
    gait = pt.gaits.linkage(robot, frequency=5.0)
    free = pt.simulate(robot, pt.QuasiSteady(robot), gait, duration=0.3, time_step=2e-4)
    assert not held(pt.sense(free, SENSORS[:3]))


def test_added_mass_that_is_known_is_taken_off() -> None:
    text = re.sub(r"strips: \d+", "strips: 1", pt.load_robot("yeo-wing").source)
    wing, air = load_robot_text(text), pt.Air(wind=(-3.0, 0.0, 0.0))
    aero, added = pt.QuasiSteady(wing, air), pt.AddedMass(wing, air)
    gait = pt.gaits.sinusoidal(wing, frequency=3.0, plunge=0.4)
    flown = pt.simulate(wing, aero, gait, duration=0.02, time_step=1e-3, added_mass=added)
    count, n = len(flown["time"]), wing.dof
    motion = flown[["q", "v", "a"]].assign(
        covariance=(("time", "part", "other_part"), np.zeros((count, 3 * n, 3 * n)))
    )
    joints = Measured(flown["u1"].values, np.zeros((count, n)))
    whole = pt.inverse_dynamics_force(motion, joints=joints).force
    known = pt.inverse_dynamics_force(motion, joints=joints, added_mass=added).force
    np.testing.assert_allclose(known, flown["aero_force"], atol=1e-10)  # rounding
    both = flown["aero_force"] + flown["added_mass_force"]
    np.testing.assert_allclose(whole, both, atol=1e-10)
    assert np.abs(known - whole).max() > 1e-4  # N m


def test_measured_forces_teach_a_network(
    found: dict[str, pt.sensing.ForceSamples], flight: xr.Dataset, robot: pt.Robot
) -> None:
    samples = found["load cell"]
    outputs = ("x", "z", "pitch")

    def learner() -> pt.CubatureLearner:
        wind = pt.Air(wind=(-3.0, 0.0, 0.0))
        network = pt.StripNetwork(robot, (4,), wind, measured=outputs)
        return pt.CubatureLearner(network, prior_std=0.3, measurement_std=2e-3)

    taught = learner()
    result = identify(samples, taught, every=4)
    columns = [robot.index(name) for name in outputs]
    again = learner()
    stream(
        again, samples.time, samples.state, samples.force[:, columns], every=4,
        std=samples.std[:, columns],
    )  # fmt: skip
    np.testing.assert_array_equal(taught.weights, again.weights)
    assert result.scores["updates"] > 30
    ignorant = learner()
    stream(ignorant, samples.time, samples.state, samples.force[:, columns], every=4)
    assert not np.array_equal(taught.weights, ignorant.weights)
    part = samples.where(slice(10, 20))
    assert len(part.time) == 10 and part.covariance.shape == (10, robot.dof, robot.dof)


def test_what_does_not_fit_is_refused(
    log: pt.sensing.SensorLog, motion: xr.Dataset, robot: pt.Robot
) -> None:
    with pytest.raises(ParameterError, match="a motor current of the log"):
        pt.sensing.motor_forces(log, motion, "nano17")
    with pytest.raises(ParameterError, match="a load cell of the log"):
        pt.sensing.cell_wrench(log, motion, "as5600")
    with pytest.raises(FlightError, match="expected a, but it holds"):
        pt.inverse_dynamics_force(motion.drop_vars("a"))
    joints = pt.sensing.motor_forces(log, motion, "ina226")
    with pytest.raises(ShapeError, match="joints"):
        pt.inverse_dynamics_force(motion.isel(time=slice(5)), joints=joints)
    with pytest.raises(ShapeError, match="force"):
        n = robot.dof
        empty = np.zeros((1, n))
        pt.sensing.ForceSamples(
            np.zeros(1), empty, empty, np.zeros((2, n)), np.zeros((1, n, n)), robot, "none"
        )


def test_a_cell_within_the_robot_holds_nothing(log: pt.sensing.SensorLog) -> None:
    """The last load cell of a log was taken as the mount, even one in the root of a wing."""
    inner = replace(log.sensors["nano17"], name="root", wrench="load_cell_wrench", at="left_plunge")
    both = replace(
        log,
        readings={**log.readings, "root": log["nano17"].assign(wrench=5.0 * log["nano17"].wrench)},
        sensors={**log.sensors, "root": inner},
    )
    motion, forces = motion_and_force(both)
    np.testing.assert_array_equal(forces.force, motion_and_force(log)[1].force)
    notes = json.loads(motion.attrs["findings"])["notes"]
    assert "load cell 'root': not used, for it is within the robot" in notes
    with pytest.raises(ParameterError, match="without `at`"):
        pt.sensing.cell_wrench(both, motion, "root")
    under = replace(both, sensors={**log.sensors, "root": replace(inner, at=None)})
    with pytest.raises(LogError, match="expected one that holds the robot, found 'root' too"):
        motion_and_force(under)


def test_several_motor_currents_are_all_used(log: pt.sensing.SensorLog) -> None:
    """Only the last current sensor was used: joints of the others had no force."""
    wings = ("left_plunge", "right_plunge")
    joints = [log.robot.dof_names[k] for k in log.robot.actuated]
    groups = {"wings": [*wings], "others": [name for name in joints if name not in wings]}
    whole, readings, sensors = log["ina226"], {**log.readings}, {**log.sensors}
    del readings["ina226"], sensors["ina226"]
    for name, parts in groups.items():
        readings[name] = whole.sel(joint=parts)
        sensors[name] = replace(log.sensors["ina226"], name=name, joints=tuple(parts))
    motion, forces = motion_and_force(replace(log, readings=readings, sensors=sensors))
    np.testing.assert_allclose(forces.force, motion_and_force(log)[1].force, rtol=1e-9, atol=1e-12)
    told = json.loads(motion.attrs["findings"])["noise"]
    assert {one["part"]: one["sensor"] for one in told}.items() >= {"left_plunge": "wings"}.items()
    twice = replace(sensors["others"], joints=tuple(joints))
    both = replace(
        log, readings={**readings, "others": whole}, sensors={**sensors, "others": twice}
    )
    with pytest.raises(LogError, match="expected one for each joint, found 'others' too"):
        motion_and_force(both)


def test_the_stand_of_a_robot_that_does_not_float_does_no_work() -> None:
    """A load cell under the hinge of a wing was taken as a force on the wing."""
    plate = "{type: plate, axis: y, chord: 9 cm, span: 20 cm, thickness: 1 mm}"
    joint = "{name: plunge, axis: x}"
    edge = "leading: 2 cm, trailing: -7 cm"
    stations = f"[{{span: 0 cm, {edge}}}, {{span: 20 cm, {edge}}}]"
    segment = f"{{body: wing, strips: 3, stations: {stations}}}"
    wing = load_robot_text(
        f"{{name: half, gravity: 9.81, bodies: {{wing: {{joints: [{joint}], mass: 3 g, "
        f"center_of_mass: [-1 cm, 9 cm, 0], shape: {plate}}}}}, "
        f"wings: [{{name: wing, segments: [{segment}]}}]}}"
    )
    aero = pt.QuasiSteady(wing, pt.Air(wind=(-3.0, 0.0, 0.0)))
    gait = pt.gaits.sinusoidal(wing, frequency=3.0, plunge=0.4)
    flown = pt.simulate(wing, aero, gait, duration=0.4, time_step=1e-3)
    parts = [S.Encoder(rate=500.0, std=1e-5), AMPLIFIER, S.LoadCell(rate=500.0)]
    log = pt.sense(flown, parts)
    motion, forces = motion_and_force(log)
    true, error, _ = compared(forces, flown)
    assert np.mean(error**2) < 0.01 * true.var()
    mount = pt.sensing.cell_wrench(log, motion, "loadcell")
    for refused in (pt.sensing.load_cell_force, pt.inverse_dynamics_force):
        with pytest.raises(ParameterError, match="one with a floating body"):
            refused(motion, mount=mount)


def scores_of(words: list[str], capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    with pytest.raises(SystemExit) as left:
        run([*words, "--json"])
    told = capsys.readouterr()
    assert not left.value.code, told.err
    return json.loads(told.out)


def test_a_file_of_motion_is_learned_and_tells_the_air_of_the_flight(
    log: pt.sensing.SensorLog,
    flight: xr.Dataset,
    robot: pt.Robot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The command refused the file that `motion` wrote, and forces were learned in still air."""
    monkeypatch.chdir(tmp_path)
    pt.sensing.save_sensor_log(log, "log.nc")
    kept = pt.sensing.load_sensor_log("log.nc")
    assert kept.air == log.air == pt.Air(wind=(-3.0, 0.0, 0.0))
    motion, forces = motion_and_force(kept)
    write_motion(motion, forces, "motion.nc")
    told = scores_of(["identify", "motion.nc"], capsys)
    by_hand = pt.identify(forces).scores
    again = pt.identify(pt.load_log("motion.nc")).scores
    for name in ("nmse_second_half_worst", "coverage", "updates", "nmse"):
        assert told[name] == by_hand[name] == again[name], name
    for word in ("left_plunge", "inverse dynamics", "standard deviation"):
        assert word in told["chosen"]["forces"]
    pt.save_flight(flight, "flight.nc")
    unseen = scores_of(["evaluate", "model.json", "flight.nc"], capsys)
    assert unseen["nmse_worst"] < 0.02  # 0.8 of x if the air is taken for still
    assert scores_of(["evaluate", "model.json", "motion.nc"], capsys)["gaps"] == 0


def test_samples_without_a_known_motion_are_left_out_and_are_a_gap(
    found: dict[str, pt.sensing.ForceSamples], motion: xr.Dataset, tmp_path: Path
) -> None:
    lost = found["inverse dynamics"].where(slice(0, None))
    lost.force[40:70] = np.nan
    scores = pt.identify(lost).scores
    assert (
        f"; 30 of {len(lost.time)} samples, whose motion is not known"
        in (scores["chosen"]["forces"])
    )
    assert scores["samples"] == len(lost.time) - 30 and scores["gaps"] == 1
    log = pt.load_log(write_motion(motion, lost, tmp_path / "motion.nc"))
    assert pt.identify(log).scores["nmse"] == scores["nmse"]
    lost.force[:] = np.nan
    with pytest.raises(LogError, match="forces: expected samples with a known force, found none"):
        pt.identify(lost)


@pytest.mark.parametrize("network", ["dense", "strip"])
def test_networks_learn_what_of_a_motion_was_measured(
    network: str, flight: xr.Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without motor currents the base alone has forces."""
    motion, forces = motion_and_force(pt.sense(flight, SENSORS[:4]))
    file = write_motion(motion, forces, tmp_path / "motion.nc")
    told = scores_of(["identify", str(file), "--network", network], capsys)
    assert told["chosen"]["forces"].startswith("of x, y, z, roll, pitch, yaw by inverse")
    assert {"x", "z"} <= {name for name, one in told["nmse"].items() if one is not None}
    assert told["nmse"].get("left_plunge") is None


def test_the_air_of_a_mapping_comes_with_the_motion(robot: pt.Robot) -> None:
    count, still = 40, np.tile([1.0, 0, 0, 0], (40, 1))
    angles = {
        f"q.{name}": ("time", np.zeros(count), {"units": "rad"}) for name in robot.dof_names[6:]
    }
    log = xr.Dataset(
        {
            "attitude": (("time", "quaternion"), still, {"units": "1"}),
            "position": (("time", "axis"), np.zeros((count, 3)), {"units": "m"}),
            **angles,
        },
        coords={"time": 0.01 * np.arange(count)},
        attrs={"air": json.dumps({"density": 1.1, "wind": [-2.0, 0.0, 0.0]})},
    )
    motion = pt.estimate_motion(pt.sensor_log(log, robot))
    assert pt.inverse_dynamics_force(motion).air == pt.Air(1.1, (-2.0, 0.0, 0.0))


@pytest.mark.parametrize("sign", [1.0, -1.0, np.nan])
def test_a_load_cell_of_the_other_sign_is_asked_for(rng: np.random.Generator, sign: float) -> None:
    """A body at rest weighs on its cell: nothing else tells the sign.

    A cell without a complete row ended in an `IndexError`.
    """
    body = "{floating: true, mass: 0.05, shape: {type: box, size: [0.1, 0.06, 0.04]}}"
    brick = load_robot_text(f"{{name: brick, gravity: 9.81, bodies: {{body: {body}}}}}", "brick")
    time = 0.005 * np.arange(80)
    place = 2e-4 * rng.standard_normal((80, 3))
    turns = S.as_quaternion(Rotation.from_rotvec(3e-3 * rng.standard_normal((80, 3))))
    wrench = 2e-3 * rng.standard_normal((80, 6)) + 0.05 * 9.81 * np.eye(6)[2]
    wrench[:, 2] *= sign
    parts = {"cameras": {"position": place, "quaternion": turns}, "cell": {"wrench": wrench}}
    readings = {
        name: xr.Dataset({k: (("time", k), v) for k, v in held.items()}, {"time": time})
        for name, held in parts.items()
    }
    sensors = {
        "cameras": S.MotionCapture(name="cameras", body="body", rate=200.0),
        "cell": S.LoadCell(name="cell", body="body", rate=200.0),
    }
    motion, forces = motion_and_force(
        pt.sensing.SensorLog(readings, sensors, {}, brick, "load cell")
    )
    notes = json.loads(motion.attrs["findings"])["notes"]
    assert any("`negated: true`" in one for one in notes) == (sign < 0), forces.force.mean(axis=0)
    assert any("no two samples have a force" in one for one in notes) == np.isnan(sign)


def test_a_load_cell_by_which_air_drives_the_wings_is_asked_for() -> None:
    """The lift over the weight alone did not tell the sign: it was 1 either way."""
    robot = pt.load_robot("ornithopter")
    aero = pt.QuasiSteady(robot, pt.Air(wind=(-5.0, 0.0, 0.0)))
    gait = pt.gaits.sinusoidal(robot, frequency=3.0, plunge=0.5)
    held = pt.mounts.fixed()
    flight = pt.simulate(robot, aero, gait, duration=0.7, time_step=1e-3, mount=held)
    parts = [S.Encoder(rate=250.0, std=1e-3), S.MotionCapture(body="body", rate=250.0)]
    log = pt.sense(flight, [*parts, S.LoadCell(rate=250.0, force_std=1e-2)]).without_truth()
    for sign in (1.0, -1.0):
        wrench = log["loadcell"].assign(wrench=sign * log["loadcell"].wrench)
        told = replace(log, readings={**log.readings, "loadcell": wrench})
        notes = json.loads(motion_and_force(told)[0].attrs["findings"])["notes"]
        assert any("`negated: true`" in one for one in notes) == (sign < 0), notes
        assert not any("N mm" in one for one in notes), notes
    wrench = log["loadcell"].wrench * [1.0, 1.0, 1.0, 1e3, 1e3, 1e3]
    told = replace(
        log, readings={**log.readings, "loadcell": log["loadcell"].assign(wrench=wrench)}
    )
    notes = json.loads(motion_and_force(told)[0].attrs["findings"])["notes"]
    assert any("rather in N mm" in one for one in notes), notes


@pytest.mark.parametrize("gravity", [9.81, 0.0])
@pytest.mark.parametrize(
    ("offset", "drift", "wind", "words"),
    [
        ((0.0, 0.0, 0.0), 0.0, 0.0, []),
        ((0.02, 0.0, -0.06), 0.0, 0.0, ["it shows (0.0", "-0.06) N"]),
        ((0.02, 0.0, -0.06), 0.0, -3.0, []),  # which the wind may do
        ((0.02, 0.0, 0.0), 0.0, 3.0, ["against the wind (3.0"]),
        ((0.0, 0.0, 0.0), 0.06, 0.0, ["from the rest at", "its zero drifts"]),
        ((0.0, 0.0, 0.0), 0.06, (0.0, -3.0), []),  # which the wind may do
        ((0.0, 0.0, 0.0), 0.06, (-3.0, -3.0), ["from the rest at", "its zero drifts"]),
        ((0.02, 0.0, -0.06), 0.0, (0.0, -3.0), ["it shows (0.0", "-0.06) N"]),
        ((0.02, 0.0, 0.0), 0.0, (3.0, 0.0), ["against the wind (3.0"]),
    ],
)
def test_a_load_cell_that_shows_more_than_the_weight_at_rest_is_asked_for_its_zero(
    rng: np.random.Generator,
    offset: tuple[float, ...],
    drift: float,
    wind: float | tuple[float, float],
    words: list[str],
    gravity: float,
) -> None:
    """A wrong zero of the cell was not reported, or a tunnel that starts was taken for its drift.

    Two winds are that of the first rest and that of the last, as the log recorded them. Without
    gravity, as in water, it ended in a `ZeroDivisionError`.
    """
    body = "{floating: true, mass: 0.05, shape: {type: box, size: [0.1, 0.06, 0.04]}}"
    text = f"{{name: brick, gravity: {gravity}, bodies: {{body: {body}}}}}"
    brick = load_robot_text(text, "brick")
    time, count = 0.005 * np.arange(401), 401
    phase = np.clip((time - 0.6) / 0.8, 0.0, 1.0)
    path = 0.1 * np.outer(np.sin(np.pi * phase) ** 4, [1.0, 0.0, 0.5])
    fall = np.gradient(np.gradient(path, time, axis=0), time, axis=0) + [0, 0, gravity]
    pull = 0.05 * fall
    place = path + 1e-4 * rng.standard_normal((count, 3))
    turns = S.as_quaternion(Rotation.from_rotvec(1e-3 * rng.standard_normal((count, 3))))
    wrench = 2e-3 * rng.standard_normal((count, 6))
    wrench[:, :3] += pull + offset
    wrench[:, 1] += drift * time / time[-1]
    parts = {"cameras": {"position": place, "quaternion": turns}, "cell": {"wrench": wrench}}
    readings = {
        name: xr.Dataset({k: (("time", k), v) for k, v in held.items()}, {"time": time})
        for name, held in parts.items()
    }
    sensors = {
        "cameras": S.MotionCapture(name="cameras", body="body", rate=200.0),
        "cell": S.LoadCell(name="cell", body="body", rate=200.0),
    }
    if isinstance(wind, tuple):
        ahead = np.interp(time, [0.9, 1.1], wind)
        air = pt.Air(gust=pt.air.RecordedGust(time, np.outer(ahead, np.eye(3)[0])))
    else:
        air = pt.Air(wind=(wind, 0.0, 0.0))
    log = pt.sensing.SensorLog(readings, sensors, {}, brick, "load cell", air)
    notes = json.loads(motion_and_force(log)[0].attrs["findings"])["notes"]
    told = [one for one in notes if one.startswith("Warning: load cell")]
    assert len(told) == bool(words), told
    assert all(word in told[0] for word in words), told


@pytest.mark.parametrize(
    ("drift", "count"), [(0.0, 1000), (1e-3, 1000), (0.0, 520), (1e-3, 520), (-2e-3, 520)]
)
def test_a_load_cell_whose_clock_drifts_from_the_motion_is_told(
    rng: np.random.Generator, drift: float, count: int
) -> None:
    """At 5 Hz the force was wrong by a tenth of the inertia after 4 s, without a word.

    In 13 beats nothing was told, or that the cell has the wrong sign.
    """
    body = "{floating: true, mass: 0.05, shape: {type: box, size: [0.1, 0.06, 0.04]}}"
    brick = load_robot_text(f"{{name: brick, gravity: 9.81, bodies: {{body: {body}}}}}", "brick")
    time, rate = 0.005 * np.arange(count), 10 * np.pi
    place = 1e-4 * rng.standard_normal((count, 3))
    place[:, 0] += 0.02 * np.sin(rate * time)
    turns = S.as_quaternion(Rotation.from_rotvec(1e-3 * rng.standard_normal((count, 3))))
    wrench = 2e-3 * rng.standard_normal((count, 6)) + 0.05 * 9.81 * np.eye(6)[2]
    wrench[:, 0] -= 0.05 * 0.02 * rate**2 * np.sin(rate * time * (1 - drift))
    parts = {"cameras": {"position": place, "quaternion": turns}, "cell": {"wrench": wrench}}
    readings = {
        name: xr.Dataset({k: (("time", k), v) for k, v in held.items()}, {"time": time})
        for name, held in parts.items()
    }
    sensors = {
        "cameras": S.MotionCapture(name="cameras", body="body", rate=200.0),
        "cell": S.LoadCell(name="cell", body="body", rate=200.0),
    }
    log = pt.sensing.SensorLog(readings, sensors, {}, brick, "load cell")
    notes = json.loads(motion_and_force(log)[0].attrs["findings"])["notes"]
    told = [one for one in notes if one.startswith("Warning: load cell")]
    assert len(told) == bool(drift), told
    if drift:
        found = re.search(r"drifts by about (-?\d+) ppm", told[0])
        assert found is not None and int(found[1]) == pytest.approx(1e6 * drift, rel=0.1), told
