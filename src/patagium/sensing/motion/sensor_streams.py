"""Measurement models of sensors, and their samples on one time axis.

A model gives residual, Jacobian and noise of encoders, inertial units and cameras. Neglected: the
error of an encoder's zero; drift of clocks within a log.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from patagium.arrays import Array, Bools, median_step, stored
from patagium.errors import LogError, check_names
from patagium.robot import Robot
from patagium.sensing.motion.frame_model import FrameModel
from patagium.sensing.sensors import Encoder, Imu, MotionCapture, SensorLog, from_quaternion
from patagium.sensing.sensors.joints import joint_names
from patagium.sensing.sensors.sensor import Sensor

FLOOR = {
    "angle": 1e-5,
    "travel": 1e-8,
    "position": 2e-6,
    "attitude": 1e-5,
    "angular rate": 1e-5,
    "specific force": 1e-4,
}
"""Smallest standard deviation by part [its unit]: a hundredth of data sheet values."""


@dataclass(frozen=True)
class Observation:
    """Sample of a sensor.

    Attributes:
        name: Name of the sensor.
        values: Measured values; NaN where one is missing.
    """

    name: str
    values: Array


class MeasurementModel:
    """Model of a sensor for the motion filter.

    Attributes:
        linear: Whether it is linear in the coordinates.
        biases: Whether the sensor has biases that the filter estimates.
        width: Numbers of a sample.
        bias_walk: Random walk of the biases, (6,) [m/s^2/sqrt(s), rad/s/sqrt(s)].
        bias_std: Initial standard deviation of the biases, (6,) [m/s^2, rad/s].
        variances: Variance of the noise of each value, (k,) [square of its unit]; stated, until
            a log tells better.
        parts: Values that are measured alike, one after the other.
        channels: Variables of a reading that make a sample, with the numbers of each.
        frame: Frame of the sensor on its body; encoders have none.
    """

    linear: bool = False
    biases: bool = False
    width: int
    bias_walk: Array = np.zeros(0)
    bias_std: Array = np.zeros(0)
    variances: Array
    parts: tuple[Part, ...]
    channels: tuple[tuple[str, int], ...]
    frame: FrameModel

    def rows(self, reading: xr.Dataset) -> Array:
        """Samples of a reading, (N, k), in the unit of the sensor."""
        return np.hstack([values_of(reading, *one) for one in self.channels])

    def residuals(self, levels: Array, attitude: Rotation, rows: Array) -> tuple[Array, Array]:
        """Residuals of samples (N, k), without biases, and Jacobian (N, k, m', n)."""
        raise NotImplementedError

    def sees(self, robot: Robot) -> set[int]:
        """Coordinates of a robot on which the readings of the sensor depend."""
        rng = np.random.default_rng(0)
        motion = rng.uniform(0.1, 1.0, (1, 3, robot.dof)), Rotation.identity(1)
        _, slope = self.residuals(*motion, np.ones((1, self.width)))
        return set(np.flatnonzero(np.abs(slope).max(axis=(0, 1, 2)) > 0).tolist())


class Part(NamedTuple):
    """Values of a sample that are measured alike.

    Attributes:
        name: Name in findings.
        unit: Unit of the values.
        size: Number of values.
    """

    name: str
    unit: str
    size: int


class EncoderModel(MeasurementModel):
    """Measurement model of an encoder: coordinates.

    Args:
        sensor: The encoder.
        robot: The machine.
    """

    linear = True

    def __init__(self, sensor: Encoder, robot: Robot) -> None:
        self.columns = [robot.index(name) for name in joint_names(sensor.joints, robot)]
        self._turns = [robot.dof_units[i] == "rad" for i in self.columns]
        self.width = len(self.columns)
        self.channels = (("position", self.width),)
        self._slope = np.zeros((len(self.columns), 1, robot.dof))
        self._slope[np.arange(len(self.columns)), 0, self.columns] = 1.0
        kinds = [("angle", "rad") if turns else ("travel", "m") for turns in self._turns]
        self.variances = np.array([max(sensor.sample_std, FLOOR[k]) for k, _ in kinds]) ** 2
        self.parts = tuple(Part(*k, len(list(g))) for k, g in groupby(kinds))

    def rows(self, reading: xr.Dataset) -> Array:
        """Coordinates, (N, k) [m, rad]; angles without whole turns that an encoder jumps by."""
        rows = super().rows(reading)
        for k in np.flatnonzero(self._turns):
            seen = np.isfinite(rows[:, k])
            rows[seen, k] = np.unwrap(np.append(0.0, rows[seen, k]))[1:]
        return rows

    def residuals(self, levels: Array, attitude: Rotation, rows: Array) -> tuple[Array, Array]:
        """Residuals of samples and their Jacobian; see `MeasurementModel`."""
        slope = np.broadcast_to(self._slope, (len(rows), *self._slope.shape))
        return rows - levels[:, 0, self.columns], slope


class ImuModel(MeasurementModel):
    """Measurement model of an inertial unit: specific force and angular rate with biases.

    Args:
        sensor: The unit.
        robot: The machine.
    """

    biases = True
    width = 6
    channels = (("specific_force", 3), ("angular_rate", 3))
    parts = (Part("specific force", "m/s^2", 3), Part("angular rate", "rad/s", 3))

    def __init__(self, sensor: Imu, robot: Robot) -> None:
        self.frame = FrameModel(robot, sensor)
        floors = np.repeat([FLOOR["specific force"], FLOOR["angular rate"]], 3)
        steps = np.repeat([sensor.accelerometer_step, sensor.gyroscope_step], 3)
        noise = np.concatenate([sensor.accelerometer_std, sensor.gyroscope_std])
        self.variances = np.maximum(np.hypot(noise, steps / np.sqrt(12)), floors) ** 2
        biases = np.repeat([sensor.accelerometer_bias, sensor.gyroscope_bias], 3)
        self.bias_std = np.maximum(biases, floors)
        self.bias_walk = np.repeat([sensor.accelerometer_walk, sensor.gyroscope_walk], 3)

    def residuals(self, levels: Array, attitude: Rotation, rows: Array) -> tuple[Array, Array]:
        """Residuals of samples and their Jacobian; see `MeasurementModel`."""
        expected, slope = self.frame.inertials(levels, attitude)
        return rows - expected, slope


class CaptureModel(MeasurementModel):
    """Measurement model of motion capture: position and attitude of a frame on a body.

    Args:
        sensor: The cameras.
        robot: The machine.
    """

    width = 7
    channels = (("position", 3), ("quaternion", 4))
    parts = (Part("position", "m", 3), Part("attitude", "rad", 3))

    def __init__(self, sensor: MotionCapture, robot: Robot) -> None:
        self.frame = FrameModel(robot, sensor)
        place = np.maximum(sensor.position_std, FLOOR["position"])
        turn = np.maximum(sensor.attitude_std, FLOOR["attitude"])
        self.variances = np.concatenate([place, turn]) ** 2

    def residuals(self, levels: Array, attitude: Rotation, rows: Array) -> tuple[Array, Array]:
        """Residuals of samples and their Jacobian; see `MeasurementModel`."""
        position, turned, slope = self.frame.poses(levels, attitude)
        seen = np.isfinite(rows).all(axis=1)
        residual = np.full((len(rows), 6), np.nan)
        residual[seen, :3] = rows[seen, :3] - position[seen]
        residual[seen, 3:] = (turned[seen].inv() * from_quaternion(rows[seen, 3:])).as_rotvec()
        return residual, slope[:, :, None]


def measurement_models(sensors: Mapping[str, Sensor], robot: Robot) -> dict[str, MeasurementModel]:
    """Measurement models of the sensors that see motion, by name.

    Args:
        sensors: Sensors by name; load cells and motor currents are left out.
        robot: The machine.
    """
    return {
        name: model(sensor, robot)
        for name, sensor in sensors.items()
        for kind, model in _MODELS.items()
        if isinstance(sensor, kind)
    }


_MODELS: dict[type[Sensor], Callable[[Any, Robot], MeasurementModel]] = {
    Encoder: EncoderModel,
    Imu: ImuModel,
    MotionCapture: CaptureModel,
}


def values_of(reading: xr.Dataset, name: str, size: int) -> Array:
    """Variable of a reading, (N, size), in the unit of the sensor.

    Raises:
        LogError: If the reading has no such variable, or the variable has another shape.
    """
    if name not in reading:
        held = ", ".join(map(str, reading.data_vars))
        raise LogError(f"reading: expected {name} (time, {size}), but it holds {held}")
    values = stored(reading, name, "time", ...)
    if values.shape[1:] != (size,):
        raise LogError(name, f"shape (time, {size})", values.shape)
    return values


@dataclass(frozen=True)
class Stream:
    """Samples of one sensor on the common time axis.

    Attributes:
        name: Name of the sensor.
        model: Its measurement model.
        time: Times of the samples, (N,) [s].
        rows: Samples, (N, k) [m, rad, m/s^2, rad/s or 1]; NaN where a sample was lost.
        rounding: Standard deviation of rounding of each part in the log that was imported, before
            its samples were interpolated, (parts,) [its unit]; empty where it is not known.
        used: Whether each sample counts, (N,); empty until faults are looked for.
    """

    name: str
    model: MeasurementModel
    time: Array
    rows: Array
    rounding: tuple[float, ...] = ()
    used: Bools = field(default_factory=lambda: np.zeros(0, bool))


def streams_of(log: SensorLog, robot: Robot, shifts: Mapping[str, float]) -> list[Stream]:
    """Streams of the sensors of a log that see motion.

    Args:
        log: The log.
        robot: The machine.
        shifts: Shift of late stamps by name of the sensor [s].

    Raises:
        ParameterError: If a shift is that of no sensor of the log.
        LogError: If stamps do not advance or are not seconds, or no sensor sees motion.
    """
    check_names("shifts", shifts, log.readings, "sensors among")
    found = []
    for name, model in measurement_models(log.sensors, robot).items():
        reading = log[name]
        stamps = stored(reading, "time")
        finite = np.where(np.isfinite(stamps), stamps, -np.inf)
        kept = np.flatnonzero(finite > np.maximum.accumulate(np.r_[-np.inf, finite[:-1]]))
        if len(kept) < max(2, 0.5 * len(stamps)):
            raise LogError(name, "stamps that advance", f"{len(kept)} that do")
        stamps = stamps[kept]
        _check_rate(name, stamps, log.sensors[name].rate)
        rows = log.sensors[name].in_range(model.rows(reading)[kept])
        rounding = tuple(float(one.attrs.get("rounding", 0.0)) for one in reading.values())
        found.append(Stream(name, model, stamps - shifts.get(name, 0.0), rows, rounding))
    if not found:
        held = ", ".join(log.readings) or "none"
        raise LogError("log", "encoders, inertial units or cameras", held)
    return found


def _check_rate(name: str, stamps: Array, rate: float) -> None:
    """Refuse stamps whose steps are far from those of the sensor, as another unit makes them."""
    step = median_step(stamps)
    if 0.1 < step * rate < 10.0:
        return
    units = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
    near = next((word for word, size in units.items() if 0.2 < step * rate / size < 5.0), "")
    hint = f"are the stamps in {near}?" if near else "stamp in seconds, and state the true rate"
    expected = f"expected stamps {1 / rate:g} s apart (the sensor says {rate:g} Hz)"
    raise LogError(f"{name}: {expected}, found {step:g} s: {hint}")


def common_times(streams: Sequence[Stream]) -> Array:
    """Times of the fastest sensor within the span of all others, (M,) [s].

    Raises:
        LogError: If the sensors have no time in common.
    """
    begin = max(s.time[0] for s in streams)
    end = min(s.time[-1] for s in streams)
    fastest = min(streams, key=lambda s: median_step(s.time))
    chosen = fastest.time[(fastest.time >= begin - 1e-9) & (fastest.time <= end + 1e-9)]
    if len(chosen) < 2:
        raise LogError("log", "sensors with time in common", f"{begin:g} to {end:g} s")
    return np.asarray(chosen)


def first_camera(streams: Sequence[Stream]) -> Stream | None:
    """First stream of motion capture; None without one."""
    return next((s for s in streams if isinstance(s.model, CaptureModel)), None)


def encoded_coordinates(streams: Sequence[Stream]) -> dict[int, tuple[Stream, int]]:
    """Stream and place in it of each coordinate that an encoder sees."""
    return {
        column: (s, k)
        for s in streams
        if isinstance(s.model, EncoderModel)
        for k, column in enumerate(s.model.columns)
    }


def captured_motion(rows: Array) -> tuple[Array, Array]:
    """Positions [m] and summed small rotations in the frame's axes [rad], (N, 3) each.

    Args:
        rows: Samples of motion capture, (N, 7) [m, 1].
    """
    seen = np.asarray(np.isfinite(rows).all(axis=1))
    turn = np.full((len(rows), 3), np.nan)
    attitude = from_quaternion(rows[seen, 3:])
    small = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
    turn[seen] = np.vstack([np.zeros(3), np.cumsum(small, axis=0)])
    return np.where(seen[:, None], rows[:, :3], np.nan), turn
