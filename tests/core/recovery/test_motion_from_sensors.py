"""Coordinates, velocities and accelerations found from sensors, with errors of the size stated."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

import patagium as pt
from patagium.arrays import count_noise
from patagium.errors import LogError, ParameterError, ShapeError
from patagium.robot import load_robot_text
from patagium.sensing.motion.estimate_motion import (
    SmoothedMotion,
    fit_motion,
    in_coordinates,
    initial_estimate,
)
from patagium.sensing.motion.frame_model import with_euler_angles
from patagium.sensing.motion.motion_filter import MotionFilter
from patagium.sensing.motion.sensor_streams import (
    EncoderModel,
    Observation,
    common_times,
    streams_of,
)
from patagium.sensing.motion.smoothers import merged_times

S, P = pt.sensors, pt.sensors.presets
SENSORS = (
    P.icm_42688_p("body", rate=500.0),
    P.as5600(rate=500.0),
    replace(P.prime_x_13("body"), delay=0.0, dropout=0.1),
)


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    """A quarter of a second, nose to the rear at first, so that yaw passes 180 degrees."""
    robot = pt.load_robot("aerobat")
    aero = pt.QuasiSteady(robot, pt.Air())
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5, feather=0.2)
    start = {"q": robot.coordinates(yaw=np.pi - 1e-3), "v": robot.coordinates(x=-3.0)}
    return pt.simulate(robot, aero, gait, duration=0.25, time_step=2e-4, **start)


def errors(motion: xr.Dataset, flight: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Errors of [q, v, a] but for the ends, (N, 3 n), and their covariances."""
    at = np.searchsorted(flight["time"].values, motion["time"].values - 1e-9)
    apart = {name: motion[name].values - flight[name].values[at] for name in "qva"}
    apart["q"] = (apart["q"] + np.pi) % (2 * np.pi) - np.pi  # whole turns are no error
    whole = np.hstack([apart[name] for name in "qva"])
    inner = slice(len(at) // 8, -len(at) // 8)
    return whole[inner], motion["covariance"].values[inner]


def normalized(motion: xr.Dataset, flight: xr.Dataset) -> np.ndarray:
    """Mean squared error over stated variance of each of q, v, a, (3, n)."""
    error, covariance = errors(motion, flight)
    variance = np.einsum("nii->ni", covariance)
    return (error**2 / variance).mean(axis=0).reshape(3, -1)


def filtered(
    log: pt.sensing.SensorLog, density: np.ndarray | None = None, times: np.ndarray | None = None
) -> xr.Dataset:
    """Motion by the filter from first to last sample: only what comes before a time counts."""
    robot, n = with_euler_angles(log.robot), log.robot.dof
    streams = streams_of(log, robot, {})
    wanted = common_times(streams) if times is None else times
    if density is None:
        density = fit_motion(robot, streams, 4, wanted).density()
    filter_ = MotionFilter(robot, range(n), density, 4, {s.name: s.model for s in streams})
    grid, places = merged_times(np.concatenate([s.time for s in streams]), wanted)
    events: list[list[Observation]] = [[] for _ in grid]
    for s in streams:
        seen = np.isfinite(s.rows)
        usable = seen.any(axis=1) if isinstance(s.model, EncoderModel) else seen.all(axis=1)
        at = np.searchsorted(grid, s.time - 1e-9)
        for k in np.flatnonzero(usable).tolist():
            events[at[k]].append(Observation(s.name, s.rows[k]))
    estimates = [initial_estimate(filter_, streams)]
    for k, observations in enumerate(events):
        now = estimates[-1]
        if k:
            now, _ = filter_.predict(now, float(grid[k] - grid[k - 1]))
        estimates.append(filter_.update(now, observations).estimate if observations else now)
    kept = [estimates[k + 1] for k in places.tolist()]
    found = SmoothedMotion(
        np.array([one.motion.levels[:3] for one in kept]),
        Rotation.from_matrix(np.array([one.motion.attitude for one in kept])),
        np.array([one.covariance[: 3 * n, : 3 * n] for one in kept]),
    )
    levels, covariance = in_coordinates(robot, found)
    parts = {name: (("time", "dof"), levels[:, k]) for k, name in enumerate("qva")}
    parts["covariance"] = (("time", "part", "other_part"), covariance)
    return xr.Dataset(parts, {"time": wanted})


@pytest.fixture(scope="module")
def motion(flight: xr.Dataset) -> xr.Dataset:
    return pt.estimate_motion(pt.sense(flight, SENSORS).without_truth())


def test_errors_are_of_the_size_stated(motion: xr.Dataset, flight: xr.Dataset) -> None:
    ratio = normalized(motion, flight)
    # single quantities over so short a time have few independent errors
    assert ratio.max() < 8 and 0.1 < ratio.mean() < 1.8
    robot = pt.load_robot("aerobat")
    error, _ = errors(motion, flight)
    acceleration = error[:, 2 * robot.dof :].std(axis=0)
    flapping = flight["a"].values.std(axis=0)
    for name in ("z", "left_plunge", "right_plunge", "left_feather"):
        k = robot.index(name)
        assert acceleration[k] < 0.05 * flapping[k], name


def test_attitude_is_found_across_half_a_turn(motion: xr.Dataset, flight: xr.Dataset) -> None:
    robot = pt.load_robot("aerobat")
    yaw = motion["q"].values[:, robot.index("yaw")]
    assert np.abs(np.diff(yaw)).max() < 0.01  # no jump by a whole turn
    assert np.abs(np.abs(yaw) - np.pi).max() < 0.02
    rate = motion["v"].values[:, robot.index("yaw")]
    assert np.abs(rate).max() < 0.2  # rad/s: differences of wrapped angles would be 6 / dt


def test_inertial_units_sharpen_what_cameras_see(flight: xr.Dataset, motion: xr.Dataset) -> None:
    log = pt.sense(flight, SENSORS[1:])
    alone = pt.estimate_motion(log, times=motion["time"].values)
    robot = pt.load_robot("aerobat")
    columns = [robot.index(name) + 2 * robot.dof for name in ("z", "pitch")]
    with_unit, without = (errors(m, flight)[0][:, columns].std(axis=0) for m in (motion, alone))
    assert (with_unit < 0.5 * without).all()


@pytest.mark.parametrize("factor", [5.0, 50.0])
def test_noise_of_an_inertial_unit_is_found_where_none_is_stated(
    flight: xr.Dataset, factor: float
) -> None:
    unit = SENSORS[0].scaled(factor)
    log = pt.sense(flight, [unit, *SENSORS[1:]]).without_truth()
    untold = replace(unit, accelerometer_density=0.0, gyroscope_density=0.0)
    untold = replace(untold, accelerometer_step=0.0, gyroscope_step=0.0)
    found = pt.estimate_motion(replace(log, sensors={**log.sensors, unit.name: untold}))
    facts = json.loads(found.attrs["findings"])
    learned = [one["std"] for one in facts["noise"] if one["sensor"] == unit.name]
    true = [unit.accelerometer_std.mean(), unit.gyroscope_std.mean()]
    np.testing.assert_allclose(learned, true, rtol=0.4)
    assert not any("least value" in note for note in facts["notes"])
    error, covariance = errors(found, flight)
    std = np.sqrt(np.einsum("nii->ni", covariance))
    base = slice(2 * flight.sizes["dof"], 2 * flight.sizes["dof"] + 6)  # accelerations of the body
    assert (np.abs(error) < 1.96 * std)[:, base].mean() > 0.75


def test_noise_on_its_floor_is_said(flight: xr.Dataset) -> None:
    log = pt.sense(flight, [sensor.scaled(0.0) for sensor in SENSORS])
    notes = json.loads(pt.estimate_motion(log).attrs["findings"])["notes"]
    assert any(
        "as5600, angle: the noise lies on its least value of 1e-05 rad" in one for one in notes
    )


SLIDE = """
name: slide
gravity: 9.81
bodies:
  sled:
    joints: [{name: heave, type: prismatic, axis: z}]
    mass: 1
    inertia: {xx: 0.01, yy: 0.01, zz: 0.01}
  crank:
    parent: sled
    joints: [{name: crank, type: revolute, axis: y}]
    mass: 1
    inertia: {xx: 0.01, yy: 0.01, zz: 0.01}
"""


@pytest.mark.parametrize("joints", [("heave",), ()])
def test_a_slide_is_measured_in_metres(joints: tuple[str, ...]) -> None:
    """A laser of 10 nm on a slide of 100 um was given the 1e-5 and the unit of an angle."""
    robot, time = load_robot_text(SLIDE, "slide"), np.arange(2000) * 1e-4
    levels = [
        np.outer((200 * np.pi) ** k * np.sin(200 * np.pi * time + k * np.pi / 2), [1e-4, 0.2])
        for k in range(3)
    ]
    parts = {name: (("time", "dof"), x) for name, x in zip("qva", levels, strict=True)}
    facts = {"robot": robot.source, "robot_name": robot.name}
    moved = xr.Dataset(parts, {"time": time, "dof": list(robot.dof_names)}, facts)
    sensors = [S.Encoder(name="laser", rate=1e4, std=1e-8, joints=joints)]
    sensors += [S.Encoder(name="turns", rate=5e3, std=1e-4, joints=("crank",))] * bool(joints)
    motion = pt.estimate_motion(pt.sense(moved, sensors))
    noise = json.loads(motion.attrs["findings"])["noise"]
    assert [(one["part"], one["unit"]) for one in noise] == [("travel", "m"), ("angle", "rad")]
    assert noise[0]["std"] == pytest.approx(1e-8, rel=0.1)
    assert 0.3 < np.sqrt(normalized(motion, moved)[:, 0]).max() < 1.5


def test_a_slide_of_a_log_has_the_rounding_of_its_own(tmp_path: Path) -> None:
    """Its noise had the rounding of the angle encoders, 1 mrad, as a lower limit: 1 mm."""
    (tmp_path / "slide.yaml").write_text(SLIDE, "utf-8")
    time = np.arange(300) * 1e-3
    columns = {
        "q.crank": ("time", np.sin(30 * time), {"units": "rad", "rounding_in_log": 1e-3}),
        "q.heave": ("time", 1e-4 * np.sin(30 * time), {"units": "m", "rounding_in_log": 1e-7}),
    }
    log = pt.sensor_log(xr.Dataset(columns, {"time": time}), str(tmp_path / "slide.yaml"))
    streams = streams_of(log, log.robot, {})
    found = {s.name: (s.rounding, *(part.name for part in s.model.parts)) for s in streams}
    assert found == {"encoders": ((1e-3,), "angle"), "slides": ((1e-7,), "travel")}


def test_a_log_without_noise_has_deviations_of_its_rounding(tmp_path: Path) -> None:
    """They were 14 times too large: no sensor was taken to be more exact than 2e-6 m."""
    text = "name: brick\ngravity: 9.8 m/s^2\nbodies: {body: {floating: true, mass: 0.05, "
    text += "shape: {type: box, size: [0.1, 0.06, 0.04]}}}"
    (tmp_path / "brick.yaml").write_text(text, "utf-8")
    t = 0.005 * np.arange(300)
    place = np.column_stack([np.pi * t, 0.1 * np.sin(9 * t), 0.3 * np.cos(6 * t)])
    angles = np.column_stack([0.2 * np.sin(8 * t), 0.3 * np.cos(7 * t), 0.4 * t])
    turns = S.as_quaternion(Rotation.from_euler("ZYX", angles[:, ::-1]))
    log = xr.Dataset(
        {
            "position": (("time", "axis"), np.round(place, 6), {"units": "m"}),
            "attitude": (("time", "quaternion"), np.round(turns, 6), {"units": "1"}),
        },
        {"time": t},
    )
    motion = pt.estimate_motion(pt.sensor_log(log, str(tmp_path / "brick.yaml")))
    std = np.sqrt(np.einsum("nii->ni", motion["covariance"].values))[:, :6]
    error = (motion["q"].values - np.hstack([place, angles])) / std
    assert 0.3 < np.sqrt((error[15:-15, :3] ** 2).mean()) < 2.0 > np.abs(error).max() / 3
    assert not json.loads(motion.attrs["findings"])["notes"]


@pytest.mark.parametrize("upright", [True, False])
def test_a_unit_that_is_mounted_otherwise_than_stated_is_said(
    flight: xr.Dataset, *, upright: bool
) -> None:
    log = pt.sense(flight, SENSORS).without_truth()
    turn = np.array([1.0, 1.0, 1.0] if upright else [1.0, -1.0, -1.0])
    unit = {name: turn * log["icm_42688_p"][name] for name in ("specific_force", "angular_rate")}
    log = replace(log, readings={**log.readings, "icm_42688_p": log["icm_42688_p"].assign(unit)})
    notes = json.loads(pt.estimate_motion(log).attrs["findings"])["notes"]
    assert any("off what the other sensors say" in one for one in notes) != upright


@pytest.mark.parametrize("factor", [1.0, 0.1])
def test_positions_in_another_unit_are_not_taken_for_jitter(
    flight: xr.Dataset, *, factor: float
) -> None:
    """Positions in a wrong unit were taken for jitter of 35 ms of the stamps, without a warning."""
    log = pt.sense(flight, SENSORS).without_truth()
    seen = log["prime_x_13"]
    seen = seen.assign(position=factor * seen["position"])
    log = replace(log, readings={**log.readings, "prime_x_13": seen})
    notes = json.loads(pt.estimate_motion(log).attrs["findings"])["notes"]
    assert any("prime_x_13, position: its samples" in one for one in notes) == (factor != 1)


@pytest.mark.parametrize(("factor", "stated"), [(1.0, 1.0), (1.0, 0.1), (1.2, 1.0)])
def test_a_bias_that_takes_up_a_wrong_scale_is_said(factor: float, stated: float) -> None:
    """A wrong scale of an accelerometer was taken for its bias, without a warning."""
    text = "bodies: {body: {floating: true, mass: 1, shape: {type: box, size: [0.1, 0.06, 0.04]}}}"
    robot, time = (
        load_robot_text("name: ball\ngravity: 9.81\n" + text, "ball"),
        np.arange(500) / 1e3,
    )
    parts = {name: (("time", "dof"), np.zeros((500, 6))) for name in "qva"}
    facts = {"robot": robot.source, "robot_name": robot.name}
    rest = xr.Dataset(parts, {"time": time, "dof": list(robot.dof_names)}, facts)
    log = pt.sense(rest, [SENSORS[0], replace(SENSORS[2], dropout=0.0)]).without_truth()
    shown = log["icm_42688_p"]
    shown = shown.assign(specific_force=factor * shown["specific_force"])
    unit = replace(SENSORS[0], accelerometer_bias=stated * SENSORS[0].accelerometer_bias)
    log = replace(
        log,
        readings={**log.readings, "icm_42688_p": shown},
        sensors={**log.sensors, "icm_42688_p": unit},
    )
    notes = json.loads(pt.estimate_motion(log).attrs["findings"])["notes"]
    assert any("its bias is" in one for one in notes) == (factor != 1)
    assert factor != 1 or not notes


def test_an_accelerometer_on_a_robot_without_gravity_is_told() -> None:
    """A unit in water, whose file has no gravity as it has no buoyancy, had a bias of 9.8 m/s^2."""
    text = "bodies: {body: {floating: true, mass: 1, shape: {type: box, size: [0.1, 0.06, 0.04]}}}"
    robot = load_robot_text("name: ball\ngravity: 0\n" + text, "ball")
    parts = {name: (("time", "dof"), np.zeros((500, 6))) for name in "qva"}
    facts = {"robot": robot.source, "robot_name": robot.name}
    rest = xr.Dataset(parts, {"time": np.arange(500) / 1e3, "dof": list(robot.dof_names)}, facts)
    with pytest.warns(UserWarning, match="gravity is 0 in the robot file"):
        log = pt.sense(rest, [SENSORS[0], replace(SENSORS[2], dropout=0.0)]).without_truth()
    for fall in (0.0, 9.81):
        shown = log["icm_42688_p"]
        shown = shown.assign(specific_force=shown["specific_force"] + [0.0, 0.0, fall])
        told = replace(log, readings={**log.readings, "icm_42688_p": shown})
        notes = json.loads(pt.estimate_motion(told).attrs["findings"])["notes"]
        assert any("gravity is 0 in the robot file" in one for one in notes) == (fall > 0), notes


def test_a_unit_on_one_wing_of_a_held_robot_contradicts_nothing() -> None:
    """An inertial unit on one wing was compared with the other wing: a false alarm of 6 rad/s."""
    held = SLIDE.replace("parent: sled\n    ", "").replace("type: prismatic, axis: z", "axis: x")
    robot, time = load_robot_text(held, "held"), np.arange(1000) * 5e-4
    levels = [np.outer(30.0**k * np.sin(30 * time + k * np.pi / 2), [0.5, 0.2]) for k in range(3)]
    parts = {name: (("time", "dof"), x) for name, x in zip("qva", levels, strict=True)}
    facts = {"robot": robot.source, "robot_name": robot.name}
    moved = xr.Dataset(parts, {"time": time, "dof": list(robot.dof_names)}, facts)
    sensors = [S.Encoder(rate=500.0, std=1e-3), P.bmi270("sled", rate=500.0)]
    findings = json.loads(pt.estimate_motion(pt.sense(moved, sensors)).attrs["findings"])
    assert not findings["notes"]
    assert [one["sensor"] for one in findings["noise"]].count("bmi270") == 2  # force and rate


def test_accelerations_converge_as_noise_falls(flight: xr.Dataset) -> None:
    robot = pt.load_robot("aerobat")
    columns = [robot.index(name) + 2 * robot.dof for name in ("z", "left_plunge")]
    sizes = []
    for factor in (4.0, 1.0, 0.1):  # so that 1 is that of the data sheets
        log = pt.sense(flight, [sensor.scaled(factor) for sensor in SENSORS])
        sizes.append(errors(pt.estimate_motion(log), flight)[0][:, columns].std(axis=0))
    assert (sizes[1] < 0.7 * sizes[0]).all() and (sizes[2] < 0.5 * sizes[1]).all()


def test_a_robot_by_quaternion_is_found_by_its_angles(
    flight: xr.Dataset, motion: xr.Dataset
) -> None:
    log = pt.sense(flight, SENSORS).without_truth()
    turned = replace(log, robot=log.robot.with_attitude("quaternion"))
    found = pt.estimate_motion(turned)
    assert found["q"].shape == motion["q"].shape
    apart = np.exp(1j * found["q"].values) / np.exp(1j * motion["q"].values)  # but whole turns
    np.testing.assert_allclose(np.angle(apart), 0, atol=1e-6)


def test_what_comes_later_helps(flight: xr.Dataset, motion: xr.Dataset) -> None:
    log = pt.sense(flight, SENSORS)
    online = filtered(log)
    smoothed = np.einsum("nii->ni", motion["covariance"].values)
    before = np.einsum("nii->ni", online["covariance"].values)
    # on average: the filter takes the noise as stated, the smoother as it was
    assert (smoothed.mean(axis=0) < before.mean(axis=0)).all()
    ratio = normalized(online, flight)
    assert 0.05 < np.median(ratio) < 2.0


def test_shifted_stamps_are_taken_into_account(flight: xr.Dataset) -> None:
    late = [replace(SENSORS[1], clock_offset=0.1), *SENSORS[::2]]
    log = pt.sense(flight, late)
    name = SENSORS[1].name
    mended = pt.estimate_motion(log, shifts={name: 0.1}, order=3)
    plunge = pt.load_robot("aerobat").index("left_plunge")
    error, _ = errors(mended, flight)
    assert np.abs(error[:, plunge]).max() < 5e-3
    with pytest.raises(ParameterError, match="shifts: expected sensors among"):
        pt.estimate_motion(log, shifts={"gps": 0.1})


def test_what_no_sensor_sees_is_named(flight: xr.Dataset) -> None:
    some = S.Encoder(joints=("left_plunge",), rate=500.0, std=1e-3)
    with pytest.raises(LogError, match="see left_mediolateral, .*right_feather, found none"):
        pt.estimate_motion(pt.sense(flight, [some, SENSORS[2]]))
    with pytest.raises(LogError, match="see x, y, z, roll"):
        pt.estimate_motion(pt.sense(flight, [SENSORS[1]]))
    with pytest.raises(LogError, match="encoders, inertial units or cameras"):
        pt.estimate_motion(pt.sense(flight, [P.nano17("body")]))
    log = pt.sense(flight, SENSORS)
    with pytest.raises(ShapeError, match="times"):
        pt.estimate_motion(log, times=[[0.01, 0.02], [0.03, 0.04]])
    for none in ([], [np.nan]):  # they ended in tracebacks
        with pytest.raises(ParameterError, match="times"):
            pt.estimate_motion(log, times=none)
    with pytest.raises(ParameterError, match="order"):
        pt.estimate_motion(log, order=2)


def test_a_tracker_is_the_filter_and_takes_late_samples(flight: xr.Dataset) -> None:
    robot = pt.load_robot("aerobat")
    names = [sensor.name for sensor in SENSORS]
    log = pt.sense(flight.isel(time=slice(0, 251)), SENSORS)  # 50 ms
    density = np.concatenate([np.full(6, 1e8), np.full(8, 1e10)])
    online = filtered(log, density)
    samples = []
    for name in names:
        reading = log[name]
        parts = [reading[k].values for k in ("position", "quaternion") if k in reading]
        parts += [reading[k].values for k in ("specific_force", "angular_rate") if k in reading]
        samples += list(zip(reading["time"].values, [name] * 1000, np.hstack(parts), strict=False))
    samples.sort(key=lambda sample: (sample[0], names.index(sample[1])))
    shuffled = list(samples)
    for k in range(20, len(shuffled) - 3, 5):  # each fifth comes after the three behind it
        shuffled[k : k + 4] = shuffled[k + 1 : k + 4] + shuffled[k : k + 1]
    states = []
    for order in (samples, shuffled):
        tracker = pt.sensing.MotionTracker(robot, log.sensors, density)
        with pytest.raises(LogError, match="expected a sample of as5600, prime_x_13 first"):
            tracker.now()
        for stamp, name, values in order:
            tracker.push(name, stamp, values)
        assert tracker.started and tracker.late == 0
        states.append(tracker.now())
    k = int(np.searchsorted(online["time"].values, states[0].time - 1e-9))
    for part in "qva":
        one, other = (getattr(state, part) for state in states)
        scale = np.abs(one).max()
        np.testing.assert_allclose(one, other, atol=1e-6 * scale)  # rounding of the covariance
    error = (states[0].q - online["q"].values[k] + np.pi) % (2 * np.pi) - np.pi
    std = np.sqrt(np.diagonal(states[0].covariance))[: robot.dof]
    assert (np.abs(error) < std).all()  # it starts from other first samples
    later = tracker.now(states[1].time + 1e-3)
    assert (np.diagonal(later.covariance) >= np.diagonal(states[1].covariance)).all()
    tracker.push(names[1], -1.0, np.zeros(8))
    assert tracker.late == 1
    with pytest.raises(LogError, match="or later"):
        tracker.now(0.0)
    with pytest.raises(ParameterError, match="time"):
        tracker.now(float("nan"))
    with pytest.raises(LogError, match="expected soon after"):
        tracker.now(1e60)
    with pytest.raises(ParameterError, match="name: expected one of"):
        tracker.push("gps", 0.0, np.zeros(3))


@pytest.mark.parametrize("estimate", [pt.estimate_motion, filtered])
def test_sensors_without_any_noise_are_believed_to_their_floors(
    flight: xr.Dataset, estimate: Callable[[pt.sensing.SensorLog], xr.Dataset]
) -> None:
    units = (
        replace(P.icm_42688_p("body", rate=500.0), name="unit"),
        replace(P.icm_42688_p("left_humerus", rate=500.0), name="wing_unit"),
    )
    exact = [sensor.scaled(0.0) for sensor in (*units, *SENSORS[1:])]
    found = estimate(pt.sense(flight, exact))
    covariance = found["covariance"].values
    std = np.sqrt(np.einsum("nii->ni", covariance))
    assert (std > 0).all()
    correlation = covariance / std[:, :, None] / std[:, None, :]
    assert np.linalg.eigvalsh(correlation).min() > -1e-12  # rounding of the product of its roots
    error, _ = errors(found, flight)
    assert np.abs(error[:, : flight.sizes["dof"]]).max() < 1e-3  # m, rad; noisy sensors: 1e-2


def arriving(log: pt.sensing.SensorLog) -> list[tuple[float, str, np.ndarray]]:
    """Samples of a log as they come in."""
    found = []
    for name, reading in log.readings.items():
        rows = np.hstack([reading[part].values for part in reading.data_vars])
        found += [(t, name, row) for t, row in zip(reading["time"].values, rows, strict=True)]
    return sorted(found, key=lambda sample: sample[0])


def test_a_tracker_smooths_what_lies_a_little_behind(flight: xr.Dataset) -> None:
    log = pt.sense(flight.isel(time=slice(0, 751)), SENSORS)  # 150 ms
    # as lively in its attitude as a fit of flapping flight finds it
    density = np.concatenate([np.full(3, 1e8), np.full(3, 1e11), np.full(8, 1e10)])
    tracker = pt.sensing.MotionTracker(pt.load_robot("aerobat"), log.sensors, density)
    for stamp, name, row in arriving(log):
        tracker.push(name, stamp, row)
    last = tracker.now()
    np.testing.assert_allclose(tracker.past([last.time])[0], [last.q, last.v, last.a], rtol=1e-9)
    times = np.arange(100, 126) * 1e-3  # 25 to 50 ms behind
    found = tracker.past(times)
    true = flight.sel(time=times, method="nearest")
    online = filtered(log, density, times)
    squares = {"past": np.zeros(3), "now": np.zeros(3)}
    for level, part in enumerate("qva"):
        for name, values in (("past", found[:, level]), ("now", online[part].values)):
            error = values - true[part].values
            if part == "q":
                error = (error + np.pi) % (2 * np.pi) - np.pi
                assert np.abs(error[:, 3:6]).max() < 0.02  # 5 mrad to be expected: never lost
            squares[name][level] = (error[:, 6:] ** 2).mean()
    assert (squares["past"] < 0.3 * squares["now"]).all()  # the samples since tell more
    with pytest.raises(LogError, match="times: expected times from"):
        tracker.past([0.0])
    for times in ([], [np.nan], [last.time, last.time - 0.01]):
        with pytest.raises(LogError, match="time"):
            tracker.past(times)
    with pytest.raises(ShapeError, match="times"):
        tracker.past(last.time)


def test_a_tracker_raises_noise_that_is_too_small_for_the_motion(flight: xr.Dataset) -> None:
    fast = replace(SENSORS[1], rate=4000.0)
    log = pt.sense(flight, [SENSORS[0], fast, SENSORS[2]])
    robot = pt.load_robot("aerobat")
    density = np.concatenate([np.full(3, 1e8), np.full(3, 1e11), np.full(8, 1.0)])
    tracker = pt.sensing.MotionTracker(robot, log.sensors, density)
    for stamp, name, row in arriving(log):
        tracker.push(name, stamp, row)
    assert tracker.raised > 3
    time = tracker.now().time - 0.02
    k = robot.index("left_plunge")
    true = float(flight["a"].sel(time=time, method="nearest")[k])
    assert tracker.past([time])[0, 2, k] == pytest.approx(true, abs=20.0)  # of 490 rad/s^2


@pytest.mark.parametrize(
    ("word", "given"),
    [
        ("shifts", {"angels": 0.0}),
        ("shifts", 0.0),
        ("variances", {"load_cell": np.ones(8)}),
        ("variances", {"angles": np.ones(3)}),
        ("memory", "long"),
    ],
)
def test_a_tracker_refuses_numbers_of_sensors_that_it_has_not(word: str, given: object) -> None:
    robot = pt.load_robot("aerobat")
    sensors = {"angles": P.as5600(), "camera": P.prime_x_13("body")}
    with pytest.raises((ParameterError, ShapeError), match=word):
        pt.sensing.MotionTracker(robot, sensors, np.full(robot.dof, 1e6), **{word: given})


def test_samples_of_a_wrong_size_or_kind_are_refused() -> None:
    """A sample of another size is refused, since the filter in C reads a fixed count of numbers."""
    robot = pt.load_robot("aerobat")
    sensors = {"angles": P.as5600(), "camera": P.prime_x_13("body")}
    tracker = pt.sensing.MotionTracker(robot, sensors, np.full(robot.dof, 1e6))
    for values in ([0.1], np.zeros(9), np.zeros((2, 4)), 1.0):
        with pytest.raises(ShapeError, match=r"values: expected shape \(8,\)"):
            tracker.push("angles", 0.0, values)
    with pytest.raises(ParameterError, match="values"):
        tracker.push("angles", 0.0, "all")  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="stamp"):
        tracker.push("angles", "now", np.zeros(8))  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="name"):
        tracker.push(["angles"], 0.0, np.zeros(8))  # type: ignore[arg-type]


ARM = (
    "{name: arm, gravity: 0, bodies: {arm: {parent: world, joints: [{name: turn, axis: x}], "
    "mass: 1, shape: {type: box, size: [0.1, 0.1, 0.1]}}}}"
)


@pytest.mark.parametrize("step", [0.01, 0.002])
def test_an_encoder_in_coarse_counts_has_deviations_of_their_size(step: float) -> None:
    """Errors were up to 180 times the stated deviation where the robot rests before it moves."""
    arm = load_robot_text(ARM, "arm")
    time = 0.004 * np.arange(500)
    angle = 0.03 * np.clip(time - 0.5, 0.0, 1.0) ** 2 * np.sin(2 * np.pi * (time - 0.5))
    counts = step * np.round(angle[:, None] / step)
    readings = {"encoder": xr.Dataset({"position": (("time", "joint"), counts)}, {"time": time})}
    sensors: dict[str, S.Sensor] = {"encoder": S.Encoder(name="encoder", rate=250.0)}
    found = pt.estimate_motion(pt.sensing.SensorLog(readings, sensors, {}, arm, ""))
    error = found["q"].values[150:, 0] - angle[150:]
    std = np.sqrt(found["covariance"].values[150:, 0, 0])
    assert 0.2 < np.sqrt(np.mean((error / std) ** 2)) < 3.0  # errors of slow counts are not white
    assert count_noise(counts[:, 0]) == pytest.approx(step / np.sqrt(12.0))
    assert count_noise(angle) == 0.0


def test_counts_are_known_behind_the_interpolation_of_an_import(tmp_path: Path) -> None:
    """At 250 Hz the counts of 200 Hz were no longer seen: deviations of .62 of their own."""
    time = 0.005 * np.arange(1000)
    angle = 0.6 / (1 + np.exp(6 * (2 - time))) * np.sin(6 * np.pi * time) + 0.123
    columns = np.column_stack([time, 0.01 * np.round(angle / 0.01)])
    header = "t [s],turn [rad]"
    np.savetxt(tmp_path / "log.csv", columns, delimiter=",", header=header, comments="")
    (tmp_path / "arm.yaml").write_text(ARM)
    words: dict[str, object] = {"about": "Coarse counts.", "robot": str(tmp_path / "arm.yaml")}
    words["channels"] = [{"column": "turn", "unit": "rad", "name": "q.turn"}]
    stds = []
    for rate in ("200 Hz", "250 Hz", "137 Hz"):
        (tmp_path / "map.yaml").write_text(
            json.dumps(words | {"time": {"column": "t", "unit": "s", "rate": rate}})
        )
        pt.import_log(tmp_path / "log.csv", tmp_path / "map.yaml", tmp_path / "log.nc")
        found = pt.estimate_motion(pt.sensor_log(tmp_path / "log.nc"))
        stds.append(float(np.sqrt(found["covariance"].values[:, 0, 0]).mean()))
    assert 0.85 < min(stds) / stds[0] and max(stds) / stds[0] < 1.25, stds
