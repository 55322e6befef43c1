"""Clocks and delays that were shifted on purpose are found, to within a millisecond and better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.errors import LogError, ParameterError
from patagium.robot import load_robot_text
from patagium.sensing.motion.clock_shifts import drift_notes, found_shifts

S, P = pt.sensors, pt.sensors.presets
ROD = """
name: rod
gravity: 9.81
bodies:
  post:
    joints: [{name: turn, type: revolute, axis: z}]
    mass: 1
    inertia: {xx: 0.01, yy: 0.01, zz: 0.01}
  rod:
    parent: post
    joints: [{name: swing, type: revolute, axis: y}]
    mass: 2
    center_of_mass: [0, 0, -0.5]
    inertia: {xx: 0.01, yy: 0.02, zz: 0.03}
"""

TWINS = """
name: twins
gravity: 9.81
bodies:
  stand:
    mass: 1
    inertia: {xx: 0.01, yy: 0.01, zz: 0.01}
  left:
    parent: stand
    joints: [{name: left_swing, type: revolute, axis: x}]
    mass: 2
    inertia: {xx: 0.01, yy: 0.02, zz: 0.03}
  right:
    parent: stand
    joints: [{name: right_swing, type: revolute, axis: y}]
    mass: 2
    inertia: {xx: 0.01, yy: 0.02, zz: 0.03}
"""


def moved(
    robot: pt.Robot, duration: float = 0.8, beat: float = 0.0, fade: float = 0.0
) -> xr.Dataset:
    """A recorded motion of joints, with several frequencies or with a beat [Hz] that fades."""
    time = np.arange(0.0, duration + 1e-9, 1e-4 if beat else 1e-3)
    rates = 2 * np.pi * (np.array([beat, beat]) if beat else np.array([3.0, 5.0]))
    second = 2.0 if beat else 2.3
    q = 0.4 * np.sin(time[:, None] * rates) + 0.1 * np.sin(second * time[:, None] * rates + 1.0)
    q *= np.exp(-fade * time[:, None])
    v = np.gradient(q, time, axis=0, edge_order=2)
    a = np.gradient(v, time, axis=0, edge_order=2)
    parts = {name: (("time", "dof"), x) for name, x in zip("qva", (q, v, a), strict=True)}
    return xr.Dataset(
        parts,
        coords={"time": time, "dof": list(robot.dof_names)},
        attrs={"robot": robot.source, "robot_name": robot.name},
    )


@pytest.fixture(scope="module")
def rod() -> xr.Dataset:
    return moved(load_robot_text(ROD, "rod"))


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    robot = pt.load_robot("aerobat")
    aero = pt.QuasiSteady(robot, pt.Air())
    gait = pt.gaits.linkage(robot, frequency=5.0)
    start = robot.coordinates(x=3.0)
    return pt.simulate(robot, aero, gait, duration=0.4, time_step=2e-4, v=start)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_late_camera_and_a_shifted_clock_are_found(flight: xr.Dataset, seed: int) -> None:
    imu = replace(P.icm_42688_p("body"), clock_offset=0.012)
    camera = replace(P.prime_x_13("body"), delay=7.3e-3)
    log = pt.sense(flight, [imu, camera, P.as5600()], seed=seed)
    found = pt.sensing.estimate_shifts(log.without_truth())
    assert found.seconds["icm_42688_p"] == 0.0
    assert found.seconds["prime_x_13"] == pytest.approx(7.3e-3 - 0.012, abs=1e-3)
    assert found.std["prime_x_13"] < 5e-4
    assert found.unlinked == ("as5600",)  # no unit feels the wings alone
    by_camera = pt.sensing.estimate_shifts(log, reference="prime_x_13")
    assert by_camera.seconds["icm_42688_p"] == pytest.approx(0.012 - 7.3e-3, abs=1e-3)


def test_encoders_with_different_delays_are_found_against_a_unit(rod: xr.Dataset) -> None:
    encoder = S.Encoder(name="post", joints=("turn",), rate=500.0, resolution=1e-3, delay=4e-3)
    other = S.Encoder(name="rod", joints=("swing",), rate=300.0, resolution=1e-3, delay=15e-3)
    imu = replace(P.bmi270("rod", rate=800.0), clock_offset=-0.012)
    found = pt.sensing.estimate_shifts(pt.sense(rod, [encoder, other, imu]), reference="post")
    assert found.seconds == pytest.approx({"post": 0.0, "rod": 0.011, "bmi270": -0.016}, abs=2e-4)
    assert found.unlinked == ()


def test_stated_deviations_are_those_of_the_errors(rod: xr.Dataset) -> None:
    imu = S.Imu(body="rod", rate=500.0, gyroscope_density=2e-3, accelerometer_density=2e-3)
    both = S.Encoder(rate=500.0, std=1e-4, delay=5e-3)
    ratios = []
    for seed in range(6):
        found = pt.sensing.estimate_shifts(pt.sense(rod, [imu, both], seed=seed))
        error = found.seconds["encoder"] - 5e-3
        ratios.append(error / found.std["encoder"])
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 2.5  # six of them


def test_deviations_hold_where_errors_are_correlated(flight: xr.Dataset) -> None:
    """As white errors, those of smoothed cameras gave deviations 1.7 times too small."""
    ratios = []
    for seed in range(8):
        imu, camera = P.icm_42688_p("body"), replace(P.prime_x_13("body"), delay=7e-3)
        found = pt.sensing.estimate_shifts(pt.sense(flight, [imu, camera], seed=seed))
        ratios.append((found.seconds["prime_x_13"] - 7e-3) / found.std["prime_x_13"])
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.4  # eight of them: 1.4 is three deviations


@pytest.mark.parametrize(("beat", "late"), [(20.0, 0.003), (150.0, 0.0021)])
@pytest.mark.parametrize("seed", [0, 1])
def test_of_beats_that_look_alike_the_nearest_is_taken(beat: float, late: float, seed: int) -> None:
    """Shifts were off by whole beats, 50 ms in a dragonfly, with deviations of microseconds."""
    rod = moved(load_robot_text(ROD, "rod"), 0.6, beat)
    noise = {"accelerometer_density": 1e-2, "gyroscope_density": 1e-3}
    parts = [S.Encoder(rate=4000.0, std=1e-3, delay=late), S.Imu(body="rod", rate=2000.0, **noise)]
    log = pt.sense(rod, parts, seed=seed).without_truth()
    found = pt.sensing.estimate_shifts(log)
    assert found.seconds["encoder"] == pytest.approx(late, abs=3e-5)
    assert found.repeat == pytest.approx(1 / beat, abs=3e-5)
    assert f" repeats every {1e3 / beat:.3g} ms: " in found_shifts(log)[1]


def test_a_shift_of_more_than_half_a_beat_is_found_where_beats_differ() -> None:
    rod = moved(load_robot_text(ROD, "rod"), 0.6, 20.0, 2.0)
    parts = [S.Encoder(rate=500.0, std=1e-3, delay=0.03), S.Imu(body="rod", rate=400.0)]
    found = pt.sensing.estimate_shifts(pt.sense(rod, parts))
    assert found.seconds["encoder"] == pytest.approx(0.03, abs=1e-4)
    assert found.repeat == np.inf


def test_a_shift_as_large_as_was_searched_is_told(rod: xr.Dataset) -> None:
    """What `largest` allowed beyond 50 ms was found, and left out of `told` without a word."""
    parts = [S.Encoder(rate=500.0, std=1e-3, delay=0.08), P.bmi270("rod", rate=400.0)]
    found = pt.sensing.estimate_shifts(pt.sense(rod, parts), largest=0.09)
    assert found.told["encoder"] == pytest.approx(0.08, abs=1e-3)


@pytest.mark.parametrize("beat", [0.0, 20.0])
@pytest.mark.parametrize(("drift", "words"), [(0.0, None), (1e-3, " ppm from that of bmi270 (")])
def test_a_clock_that_drifts_is_told(drift: float, words: str | None, beat: float) -> None:
    """One shift for the whole log left half of the drift on either side, without a word.

    Where beats look alike, two of them made a drift of perfect clocks.
    """
    encoder = S.Encoder(rate=500.0, std=1e-3, clock_drift=drift)
    rod = moved(load_robot_text(ROD, "rod"), 3.0, beat)
    log = pt.sense(rod, [encoder, P.bmi270("rod", rate=400.0)], seed=3)
    notes = drift_notes(log.without_truth())
    assert len(notes) == (words is not None), notes
    assert not words or words in notes[0], notes


def test_a_shift_that_the_motion_does_not_tell_is_not_taken() -> None:
    """A unit at rest gave its cameras a shift of up to a quarter of a second."""
    rest = moved(load_robot_text(ROD, "rod"))
    rest = rest.assign({name: 0.0 * rest[name] for name in "qva"})
    encoder = S.Encoder(rate=500.0, std=1e-3)
    log = pt.sense(rest, [encoder, P.bmi270("rod", rate=400.0)]).without_truth()
    late, note = found_shifts(log)
    assert late.keys() == {"bmi270"} and "does not tell them: encoder" in note


def test_units_that_share_no_motion_leave_the_others_their_clocks() -> None:
    """Clocks stayed uncorrected where an inertial unit on the stand came first in the log.

    Of two groups that share no motion, the second was left uncorrected.
    """
    twins = moved(load_robot_text(TWINS, "twins"))
    places = {"stand": "stand", "left": "left", "right": "right"}
    units = [S.Imu(body=body, name=name, rate=500.0) for name, body in places.items()]
    late = {"left": 0.012, "right": -0.007}
    encoders = [
        S.Encoder(joints=(f"{side}_swing",), rate=500.0, std=1e-3, clock_offset=by, name=f"{side}s")
        for side, by in late.items()
    ]
    log = pt.sense(twins, [*units, *encoders]).without_truth()
    found = pt.sensing.estimate_shifts(log, reference="lefts")
    assert found.unlinked == ("stand",)
    expected = {"left": -0.012, "lefts": 0.0, "right": 0.0, "rights": -0.007}
    assert found.seconds == pytest.approx(expected, abs=2e-4)
    with pytest.raises(LogError, match="on a body that encoders or cameras see"):
        pt.sensing.estimate_shifts(pt.sense(twins, [units[0], *encoders]))


def test_what_cannot_tell_is_named(rod: xr.Dataset) -> None:
    encoder = S.Encoder(rate=500.0, std=1e-3)
    with pytest.raises(LogError, match="expected an inertial unit, found encoder"):
        pt.sensing.estimate_shifts(pt.sense(rod, [encoder]))
    log = pt.sense(rod, [encoder, S.Imu(body="rod", rate=500.0)])
    with pytest.raises(ParameterError, match="reference: expected one of"):
        pt.sensing.estimate_shifts(log, reference="gps")
    with pytest.raises(LogError, match="more than 1 s in common"):
        pt.sensing.estimate_shifts(log, largest=0.5)
    with pytest.raises(ParameterError, match="largest"):
        pt.sensing.estimate_shifts(log, largest=0.0)


def test_stamps_that_are_not_seconds_are_refused(rod: xr.Dataset) -> None:
    """Their grid of 1 ms would take gigabytes."""
    log = pt.sense(rod, [S.Encoder(rate=500.0, std=1e-3), S.Imu(body="rod", rate=500.0)])

    def stamped(change) -> pt.sensing.SensorLog:
        found = {k: r.assign_coords(time=change(r["time"].values)) for k, r in log.readings.items()}
        return replace(log, readings=found)

    for factor, words in ((1e3, "in milliseconds"), (1e6, "in microseconds"), (30.0, "true rate")):
        with pytest.raises(LogError, match=f"found .* s: .*{words}"):
            pt.sensing.estimate_shifts(stamped(lambda time, factor=factor: factor * time))
    with pytest.raises(LogError, match="expected samples without long gaps"):
        pt.sensing.estimate_shifts(stamped(lambda time: np.r_[time[:-1], 1e6]))


BRICK = """
name: brick
gravity: 9.81
bodies:
  body: {floating: true, mass: 0.05, shape: {type: box, size: [0.1, 0.06, 0.04]}}
  markers: {parent: body, at: [-2 cm, 1 cm, 3 cm], orientation: [10 deg, -20 deg, 30 deg],
            massless: true}
  unit: {parent: body, at: [3 cm, -1 cm, 1 cm], orientation: [180 deg, 0, 45 deg], massless: true}
"""


def test_cameras_are_found_to_a_tenth_of_their_step_where_their_noise_is_not_stated() -> None:
    """Cameras on fixed frames; with too little noise assumed, clocks were off by half a step."""
    robot = load_robot_text(BRICK, "brick")
    time = np.arange(0.0, 0.4 + 1e-9, 1e-3)
    rate, size = 2 * np.pi * np.array([1, 2, 4, 3, 4, 2]), np.array([0.1, 0.1, 0.05, 0.3, 0.2, 0.4])
    levels = [size * rate**k * np.sin(np.outer(time, rate) + k * np.pi / 2) for k in range(3)]
    parts = {name: (("time", "dof"), x) for name, x in zip("qva", levels, strict=True)}
    facts = {"robot": robot.source, "robot_name": robot.name}
    motion = xr.Dataset(parts, {"time": time, "dof": list(robot.dof_names)}, facts)
    noise = {"accelerometer_density": 2e-3, "gyroscope_density": 2e-4}
    unit = S.Imu(name="unit", body="unit", rate=500.0, **noise)
    cameras = S.MotionCapture(
        name="cameras", body="markers", rate=500.0, position_std=2e-4, attitude_std=3e-3, delay=5e-3
    )
    log = pt.sense(motion, [unit, cameras]).without_truth()
    untold = replace(cameras, position_std=0.0, attitude_std=0.0)
    log = replace(log, sensors={"unit": unit, "cameras": untold})
    found = pt.sensing.estimate_shifts(log, largest=0.02)
    assert found.seconds["cameras"] == pytest.approx(5e-3, abs=2e-4)
    assert abs(found.seconds["cameras"] - 5e-3) < 4 * found.std["cameras"]
