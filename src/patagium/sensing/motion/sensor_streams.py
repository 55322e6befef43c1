"""Measurement models of sensors, and their samples on one time axis.

A model gives residual, Jacobian and noise of encoders, inertial units and cameras. The
density of the noise that drives each coordinate is the one for which encoders and cameras are most
likely, one coordinate at a time. Neglected: the error of an encoder's zero; drift of clocks within
a log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from patagium.errors import LogError, ParameterError, ShapeError
from patagium.robot import Robot
from patagium.sensing.motion.frame_model import FrameModel, Motion, floating_base, rotation_vector
from patagium.sensing.motion.smoothers import likely_density
from patagium.sensing.sensors import Encoder, Imu, MotionCapture, SensorLog, from_quaternion
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


_MOST_FOR_LIKELIHOOD = 1500


@dataclass(frozen=True)
class Stream:
    """Samples of one sensor on the common time axis.

    Attributes:
        name: Name of the sensor.
        model: Its measurement model.
        time: Times of the samples, (N,) [s].
        rows: Samples, (N, k) [m, rad, m/s^2, rad/s or 1]; NaN where a sample was lost.
    """

    name: str
    model: MeasurementModel
    time: Array
    rows: Array


def streams_of(log: SensorLog, robot: Robot, shifts: Mapping[str, float]) -> list[Stream]:
    """Streams of the sensors of a log that see motion.

    Args:
        log: The log.
        robot: The machine.
        shifts: Shift of late stamps by name of the sensor [s].

    Raises:
        ParameterError: If a shift is that of no sensor of the log.
        LogError: If stamps do not advance, or no sensor sees motion.
    """
    for name in shifts:
        if name not in log.readings:
            raise ParameterError("shifts", f"sensors among {', '.join(log.readings)}", name)
    found = []
    for name, model in measurement_models(log.sensors, robot).items():
        reading = log[name]
        stamps = np.asarray(reading["time"].values, float)
        if not (np.diff(stamps) > 0).all():
            raise LogError(f"{name}: expected stamps that advance")
        found.append(Stream(name, model, stamps - shifts.get(name, 0.0), model.rows(reading)))
    if not found:
        held = ", ".join(log.readings)
        raise LogError(f"log: expected encoders, inertial units or cameras, found {held}")
    return found


def common_times(streams: Sequence[Stream]) -> Array:
    """Times of the fastest sensor within the span of all others, (M,) [s].

    Raises:
        LogError: If the sensors have no time in common.
    """
    begin, end = max(s.time[0] for s in streams), min(s.time[-1] for s in streams)
    fastest = min(streams, key=lambda s: float(np.median(np.diff(s.time))))
    chosen = fastest.time[(fastest.time >= begin - 1e-9) & (fastest.time <= end + 1e-9)]
    if len(chosen) < 2:
        raise LogError(f"log: expected sensors with time in common, found {begin:g} to {end:g} s")
    return np.asarray(chosen)


def first_camera(streams: Sequence[Stream]) -> Stream | None:
    """First stream of motion capture; None without one."""
    cameras = [s for s in streams if isinstance(s.model, CaptureModel)]
    return cameras[0] if cameras else None


def encoded_coordinates(streams: Sequence[Stream]) -> dict[int, tuple[Stream, int]]:
    """Stream and place in it of each coordinate that an encoder sees."""
    return {
        column: (s, k)
        for s in streams
        if isinstance(s.model, EncoderModel)
        for k, column in enumerate(s.model.columns)
    }


def noise_density(
    robot: Robot, streams: Sequence[Stream], given: ArrayLike | None, order: int
) -> Array:
    """Density of the noise that drives each coordinate, (n,) [unit^2/s^(2 order - 1)].

    Args:
        robot: The machine.
        streams: Measurements.
        given: Density of each, (n,) [unit^2/s^(2 order - 1)]; None takes the most likely one.
        order: Number of levels of each coordinate.

    Raises:
        ShapeError: If `given` is not (n,).
        ParameterError: If `given` is not positive.
        LogError: If a coordinate is seen by no encoder and no camera.
    """
    n = robot.dof
    if given is not None:
        drive = np.array(given, float)
        if drive.shape != (n,):
            raise ShapeError("density", (n,), drive.shape)
        if not (np.isfinite(drive).all() and (drive > 0).all()):
            raise ParameterError("density", "positive numbers", drive.tolist())
        return drive
    drive = np.full(n, np.nan)
    seen = encoded_coordinates(streams)
    by_stream: dict[str, list[int]] = {}
    for column, (s, _) in seen.items():
        by_stream.setdefault(s.name, []).append(column)
    for columns in by_stream.values():
        stream = seen[columns[0]][0]
        values = stream.rows[:, [seen[i][1] for i in columns]]
        drive[columns] = _likely(stream, values, _std(stream), order)
    base = floating_base(robot)
    if base is not None:
        drive[[*base.place, *base.turn]] = _density_of_base(streams, order)
    silent = [robot.dof_names[i] for i in np.flatnonzero(np.isnan(drive))]
    if silent:
        raise LogError(
            f"log: expected encoders or cameras that see {', '.join(silent)}, found none "
            "(with inertial units alone give `density`)"
        )
    return drive


def _density_of_base(streams: Sequence[Stream], order: int) -> Array:
    """Density of position and rotation, (6,): the larger of cameras and an inertial unit."""
    camera, found = first_camera(streams), np.full((2, 6), np.nan)
    if camera is None:
        return np.full(6, np.nan)
    place, turn = captured_motion(camera)
    std = np.sqrt(getattr(camera.model, "variance", np.full(6, np.nan)))
    found[0, :3] = _likely(camera, place, std[:3], order)
    found[0, 3:] = _likely(camera, turn, np.full(3, std[3:].mean()), order)
    for s in streams:
        if isinstance(s.model, ImuModel) and s.model.frame.on_base:
            std = np.sqrt(s.model.variance)
            to_body = s.model.frame.mount**2
            attitude = from_quaternion(camera.rows[np.isfinite(camera.rows).all(axis=1), 3:])
            mount = getattr(camera.model, "frame").mount  # noqa: B009
            to_world = np.mean((attitude.as_matrix() @ mount.T) ** 2, axis=0)
            forces = _likely(s, s.rows[:, :3], std[:3], order - 2)
            found[1, :3] = to_world @ to_body @ forces
            found[1, 3:] = to_body @ _likely(s, s.rows[:, 3:], std[3:], order - 1)
    return np.asarray(np.nanmax(found, axis=0))


def _likely(stream: Stream, values: Array, std: ArrayLike, order: int) -> Array:
    kept = slice(0, _MOST_FOR_LIKELIHOOD)
    return likely_density(stream.time[kept], values[kept], std, order=order)


def _std(stream: Stream) -> float:
    return float(getattr(stream.model, "std", np.nan))


def captured_motion(camera: Stream) -> tuple[Array, Array]:
    """Positions [m] and summed small rotations in the frame's axes [rad], (N, 3) each."""
    seen = np.asarray(np.isfinite(camera.rows).all(axis=1))
    turn = np.full((len(camera.rows), 3), np.nan)
    attitude = from_quaternion(camera.rows[seen, 3:])
    small = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
    turn[seen] = np.vstack([np.zeros(3), np.cumsum(small, axis=0)])
    place = np.where(seen[:, None], camera.rows[:, :3], np.nan)
    return place, turn
