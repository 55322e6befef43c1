"""Measurement models of encoders, inertial units and cameras: residual, Jacobian and noise.

Neglected: the error of an encoder's zero.
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
from patagium.sensing.motion.frame_model import FrameModel, Motion
from patagium.sensing.motion.rotation_vectors import rotation_vector
from patagium.sensing.sensors import Encoder, Imu, MotionCapture, from_quaternion
from patagium.sensing.sensors.joints import joint_names
from patagium.sensing.sensors.sensor import Sensor

Array = NDArray[np.float64]

FLOOR = {"m": 2e-6, "rad": 1e-5, "rad/s": 1e-5, "m/s^2": 1e-4}
"""Smallest standard deviation of a measurement by its unit: a hundredth of data sheet values."""


@dataclass(frozen=True)
class Observation:
    """Sample of a sensor.

    Attributes:
        name: Name of the sensor.
        values: Measured values; NaN where one is missing.
    """

    name: str
    values: Array


class MeasurementModel(Protocol):
    """Model of a sensor for the motion filter.

    Attributes:
        biases: Whether the sensor has biases that the filter estimates.
        bias_walk: Random walk of the biases, (6,) [m/s^2/sqrt(s), rad/s/sqrt(s)].
        bias_std: Initial standard deviation of the biases, (6,) [m/s^2, rad/s].
    """

    biases: bool
    bias_walk: Array
    bias_std: Array

    def rows(self, reading: xr.Dataset) -> Array:
        """Samples of a reading, (N, k), in the unit of the sensor."""
        ...

    def residual(
        self, motion: Motion, observation: Observation, bias: Array | None
    ) -> tuple[Array, Array, Array]:
        """Residual (k,), its Jacobian in the levels (k, m', n), noise variance (k,)."""
        ...


class _NoBias:
    biases = False
    bias_walk: Array = np.zeros(0)
    bias_std: Array = np.zeros(0)


class EncoderModel(_NoBias):
    """Measurement model of an encoder: coordinates.

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

    def residual(
        self, motion: Motion, observation: Observation, bias: Array | None
    ) -> tuple[Array, Array, Array]:
        """Residual, Jacobian and noise variance of a sample; see `MeasurementModel`."""
        seen = np.isfinite(observation.values)
        residual = observation.values - motion.levels[0, self.columns]
        variance = np.full(int(seen.sum()), self.std**2)
        return residual[seen], self._slope[seen], variance


class ImuModel:
    """Measurement model of an inertial unit: specific force and angular rate with biases.

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

    def residual(
        self, motion: Motion, observation: Observation, bias: Array | None
    ) -> tuple[Array, Array, Array]:
        """Residual, Jacobian and noise variance of a sample; see `MeasurementModel`."""
        expected, slope = self.frame.inertial(motion)
        residual = observation.values - expected - (0.0 if bias is None else bias)
        return residual, slope, self.variance


class CaptureModel(_NoBias):
    """Measurement model of motion capture: position and attitude of a frame on a body.

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

    def residual(
        self, motion: Motion, observation: Observation, bias: Array | None
    ) -> tuple[Array, Array, Array]:
        """Residual, Jacobian and noise variance of a sample; see `MeasurementModel`."""
        position, attitude, slope = self.frame.pose(motion)
        shown = from_quaternion(observation.values[3:]).as_matrix()
        turned = rotation_vector(attitude.T @ shown)
        residual = np.concatenate([observation.values[:3] - position, turned])
        return residual, slope[:, None, :], self.variance


def measurement_models(sensors: Mapping[str, Sensor], robot: Robot) -> dict[str, MeasurementModel]:
    """Measurement models of the sensors that see motion, by name.

    Args:
        sensors: Sensors by name; load cells and motor currents are left out.
        robot: The machine.
    """
    found: dict[str, MeasurementModel] = {}
    for name, sensor in sensors.items():
        if isinstance(sensor, Encoder):
            found[name] = EncoderModel(sensor, robot)
        elif isinstance(sensor, Imu):
            found[name] = ImuModel(sensor, robot)
        elif isinstance(sensor, MotionCapture):
            found[name] = CaptureModel(sensor, robot)
    return found


def values_of(reading: xr.Dataset, name: str, size: int) -> Array:
    """Variable of a reading, (N, size), in the unit of the sensor.

    Raises:
        LogError: If the reading has no such variable, or the variable has another shape.
    """
    if name not in reading:
        held = ", ".join(map(str, reading.data_vars))
        raise LogError(f"reading: expected {name} (time, {size}), but it holds {held}")
    values = np.asarray(reading[name].transpose("time", ...).values, float)
    if values.shape[1:] != (size,):
        raise LogError(f"{name}: expected shape (time, {size}), found {values.shape}")
    return values
