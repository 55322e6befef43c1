"""Every parameter of every sensor moves what it shows, and the errors grow with their scale."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.sensing.sensors.sensor import Sensor

S = pt.sensors
TURNED = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
TALK = tuple(tuple(0.01 * (i != j) for j in range(6)) for i in range(6))
COMMON = {"rate": 400.0, "delay": 3e-3, "clock_offset": 3.1e-3, "clock_drift": 0.01}
CHANGES: dict[type[Sensor], dict[str, Any]] = {
    S.Imu: {
        "body": "body",
        "position": (0.01, 0.0, 0.0),
        "orientation": TURNED,
        "accelerometer_density": 0.1,
        "gyroscope_density": 0.1,
        "accelerometer_bias": 0.1,
        "gyroscope_bias": 0.1,
        "accelerometer_walk": 0.1,
        "gyroscope_walk": 0.1,
        "accelerometer_step": 0.1,
        "gyroscope_step": 0.1,
        "accelerometer_range": 1.0,
        "gyroscope_range": 0.01,
    },
    S.Encoder: {
        "joints": ("right_elbow",),
        "resolution": 0.01,
        "std": 0.01,
        "zero_std": 0.01,
    },
    S.MotorCurrent: {
        "joints": ("right_elbow",),
        "torque_constant": 2e-3,
        "gear_ratio": 20.0,
        "std": 0.01,
        "resolution": 0.01,
        "offset_std": 0.01,
        "torque_constant_std": 0.01,
        "range": 0.01,
        "bandwidth": 20.0,
    },
    S.LoadCell: {
        "wrench": "other_wrench",
        "body": "left_plate",
        "position": (0.1, 0.0, 0.0),
        "orientation": TURNED,
        "force_std": 0.01,
        "moment_std": 0.01,
        "force_bias": 0.01,
        "moment_bias": 0.01,
        "cross_talk": TALK,
        "force_step": 0.01,
        "moment_step": 0.01,
        "force_range": 0.01,
        "moment_range": 1e-4,
        "bandwidth": 20.0,
    },
    S.MotionCapture: {
        "body": "body",
        "position": (0.1, 0.0, 0.0),
        "orientation": TURNED,
        "position_std": 0.01,
        "attitude_std": 0.01,
        "dropout": 0.3,
    },
}
BASES = {
    S.Imu: S.Imu(body="left_plate", rate=500.0),
    S.Encoder: S.Encoder(rate=500.0),
    S.MotorCurrent: S.MotorCurrent(rate=500.0, torque_constant=1e-3, gear_ratio=50.0),
    S.LoadCell: S.LoadCell(rate=500.0),
    S.MotionCapture: S.MotionCapture(body="left_plate", rate=500.0),
}
CASES = [(kind, name) for kind, changes in CHANGES.items() for name in changes | COMMON]


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    robot = pt.load_robot("aerobat")
    aero = pt.QuasiSteady(robot, pt.Air(wind=(-3.0, 0.0, 0.0)))
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5, feather=0.1)
    held = {"duration": 0.1, "time_step": 1e-3, "mount": pt.mounts.fixed()}
    flown = pt.simulate(robot, aero, gait, **held, q=robot.coordinates(x=0.2, yaw=0.4))
    flown["other_wrench"] = 2 * flown["mount_wrench"]
    return flown


def shown(flight: xr.Dataset, sensor: Sensor) -> list[np.ndarray]:
    reading = pt.sense(flight, [sensor])[sensor.name]
    return [reading["time"].values, *(reading[name].values for name in reading)]


def test_the_list_of_parameters_is_complete() -> None:
    for kind, changes in CHANGES.items():
        known = {entry.name for entry in fields(kind)} - {"name", "dropout_length", "at"}
        assert set(changes) | set(COMMON) == known  # both: in the unit tests


@pytest.mark.parametrize(("kind", "name"), CASES, ids=lambda part: getattr(part, "__name__", part))
def test_every_parameter_moves_what_is_shown(
    flight: xr.Dataset, kind: type[Sensor], name: str
) -> None:
    base = BASES[kind]
    value = (CHANGES[kind] | COMMON)[name]
    before, after = shown(flight, base), shown(flight, replace(base, **{name: value}))
    same = [
        a.shape == b.shape and np.array_equal(a, b, equal_nan=True)
        for a, b in zip(before, after, strict=True)
    ]
    assert not all(same)


@pytest.mark.parametrize("kind", [S.Imu, S.Encoder, S.MotorCurrent, S.LoadCell])
def test_errors_grow_with_their_scale(flight: xr.Dataset, kind: type[Sensor]) -> None:
    changes = CHANGES[kind]
    errors = {e.name: changes[e.name] for e in fields(kind) if "noise" in e.metadata}
    errors = {name: value for name, value in errors.items() if value}
    small = {name: 1e-3 * value for name, value in errors.items()}
    sensor = replace(BASES[kind], **small)
    truth = shown(flight, BASES[kind])
    for steps in [name for name in errors if name.endswith(("step", "resolution"))]:
        sensor = replace(sensor, **{steps: 0.0})  # rounding is not proportional to its step
    sizes = [
        np.abs(shown(flight, sensor.scaled(factor))[1] - truth[1]).max() for factor in (0, 1, 4)
    ]
    assert sizes[0] == 0
    assert sizes[2] == pytest.approx(4 * sizes[1], rel=1e-2)  # constants divide by 1 + error


def test_a_sensor_that_is_late_shows_the_past(flight: xr.Dataset) -> None:
    joint = "left_plunge"  # rises at first
    prompt = S.Encoder(joints=(joint,), rate=500.0)
    late = replace(prompt, delay=0.01)
    readings = [pt.sense(flight, [sensor])["encoder"]["position"] for sensor in (prompt, late)]
    at = [reading.sel(time=0.02, method="nearest").item() for reading in readings]
    assert at[1] < at[0]
