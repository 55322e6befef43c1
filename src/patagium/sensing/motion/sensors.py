"""What each kind of sensor says of a motion: its residual, its slope, its noise.

Neglected: errors of an encoder's zero, of a load cell's or amplifier's scale; they are no part of
the motion's noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.errors import LogError
from patagium.robot import Robot
from patagium.sensing.motion.attitude import vector_of
from patagium.sensing.motion.model import FrameModel, Motion
from patagium.sensing.sensors import Encoder, Imu, MotionCapture, from_quaternion
from patagium.sensing.sensors.joints import joint_names
from patagium.sensing.sensors.sensor import Sensor

Array = NDArray[np.float64]

FLOOR = {"m": 2e-6, "rad": 1e-5, "rad/s": 1e-5, "m/s^2": 1e-4}
"""Deviation below which no measurement is believed: a hundredth of what data sheets have."""


@dataclass(frozen=True)
class Observation:
    """One sample of a sensor.

    Attributes:
        name: Of the sensor.
        values: What it showed; NaN where it did not.
    """

    name: str
    values: Array


class Channel(Protocol):
    """A sensor as the filter of motion sees it."""

    biases: bool
    bias_walk: Array
    bias_std: Array

    def rows(self, reading: xr.Dataset) -> Array:
        """Samples of a reading, (N, k)."""
        ...

    def compare(
        self, motion: Motion, observation: Observation, bias: Array | None
    ) -> tuple[Array, Array, Array]:
        """Residual (k,), its slope with respect to levels (k, m', n), variance of noise (k,)."""
        ...


class _NoBias:
    biases = False
    bias_walk: Array = np.zeros(0)
    bias_std: Array = np.zeros(0)


class EncoderChannel(_NoBias):
    """Coordinates as they are.

    Args:
        sensor: The encoder.
        robot: The machine.
    """

    def __init__(self, sensor: Encoder, robot: Robot) -> None:
        self.columns = [robot.index(name) for name in joint_names(sensor.joints, robot)]
        self.std = max(sensor.sample_std, FLOOR["rad"])
        self._slope = np.zeros((len(self.columns), 1, robot.dof))
        self._slope[np.arange(len(self.columns)), 0, self.columns] = 1.0

    def rows(self, reading: xr.Dataset) -> Array:
        """Coordinates, (N, k) [m, rad]."""
        return values_of(reading, "position", len(self.columns))

    def compare(
        self, motion: Motion, observation: Observation, bias: Array | None
    ) -> tuple[Array, Array, Array]:
        """Residual, slope and variance of what was shown."""
        seen = np.isfinite(observation.values)
        residual = observation.values - motion.levels[0, self.columns]
        variance = np.full(int(seen.sum()), self.std**2)
        return residual[seen], self._slope[seen], variance


class ImuChannel:
    """Specific force and angular rate, with biases that walk.

    Args:
        sensor: The unit.
        robot: The machine.
    """

    biases = True

    def __init__(self, sensor: Imu, robot: Robot) -> None:
        self.frame = FrameModel(robot, sensor.body, sensor.position, sensor.orientation)
        forces = np.maximum(
            np.hypot(sensor.accelerometer_std, sensor.accelerometer_step / np.sqrt(12)),
            FLOOR["m/s^2"],
        )
        rates = np.maximum(
            np.hypot(sensor.gyroscope_std, sensor.gyroscope_step / np.sqrt(12)),
            FLOOR["rad/s"],
        )
        self.variance = np.concatenate([forces, rates]) ** 2
        floors = np.repeat([FLOOR["m/s^2"], FLOOR["rad/s"]], 3)
        self.bias_std: Array = np.maximum(
            np.repeat([sensor.accelerometer_bias, sensor.gyroscope_bias], 3), floors
        )
        self.bias_walk: Array = np.repeat([sensor.accelerometer_walk, sensor.gyroscope_walk], 3)

    def rows(self, reading: xr.Dataset) -> Array:
        """Specific force and angular rate, (N, 6) [m/s^2, rad/s]."""
        parts = ("specific_force", "angular_rate")
        return np.hstack([values_of(reading, name, 3) for name in parts])

    def compare(
        self, motion: Motion, observation: Observation, bias: Array | None
    ) -> tuple[Array, Array, Array]:
        """Residual, slope and variance of what was shown."""
        expected, slope = self.frame.inertial(motion)
        residual = observation.values - expected - (0.0 if bias is None else bias)
        return residual, slope, self.variance


class CaptureChannel(_NoBias):
    """Position and attitude of a frame on a body.

    Args:
        sensor: The cameras.
        robot: The machine.
    """

    def __init__(self, sensor: MotionCapture, robot: Robot) -> None:
        self.frame = FrameModel(robot, sensor.body, sensor.position, sensor.orientation)
        place = np.maximum(sensor.position_std, FLOOR["m"])
        turn = np.maximum(sensor.attitude_std, FLOOR["rad"])
        self.variance = np.concatenate([place, turn]) ** 2

    def rows(self, reading: xr.Dataset) -> Array:
        """Position and quaternion, (N, 7) [m, 1]."""
        return np.hstack([values_of(reading, "position", 3), values_of(reading, "quaternion", 4)])

    def compare(
        self, motion: Motion, observation: Observation, bias: Array | None
    ) -> tuple[Array, Array, Array]:
        """Residual, slope and variance of what was shown."""
        position, attitude, slope = self.frame.pose(motion)
        shown = from_quaternion(observation.values[3:]).as_matrix()
        turned = vector_of(attitude.T @ shown)
        residual = np.concatenate([observation.values[:3] - position, turned])
        return residual, slope[:, None, :], self.variance


def channels_of(sensors: Mapping[str, Sensor], robot: Robot) -> dict[str, Channel]:
    """The sensors that say something of motion, as the filter sees them.

    Args:
        sensors: By name.
        robot: The machine.
    """
    found: dict[str, Channel] = {}
    for name, sensor in sensors.items():
        if isinstance(sensor, Encoder):
            found[name] = EncoderChannel(sensor, robot)
        elif isinstance(sensor, Imu):
            found[name] = ImuChannel(sensor, robot)
        elif isinstance(sensor, MotionCapture):
            found[name] = CaptureChannel(sensor, robot)
    return found


def values_of(reading: xr.Dataset, name: str, size: int) -> Array:
    """A variable of a reading, (N, size).

    Raises:
        LogError: If it has none of that name, or it has another shape.
    """
    if name not in reading:
        held = ", ".join(map(str, reading.data_vars))
        raise LogError(f"reading: expected {name} (time, {size}), but it holds {held}")
    values = np.asarray(reading[name].transpose("time", ...).values, float)
    if values.shape[1:] != (size,):
        raise LogError(f"{name}: expected shape (time, {size}), found {values.shape}")
    return values
