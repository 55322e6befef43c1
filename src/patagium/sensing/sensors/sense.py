"""Log of the sensors of a flight: its measurement and its netCDF file, one group a sensor."""

from __future__ import annotations

import json
import warnings
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from patagium.aerodynamics import Air
from patagium.arguments import checked
from patagium.arrays import Array, brief
from patagium.errors import FlightError, LogError, ParameterError, check_names
from patagium.netcdf_file import loaded_dataset, open_netcdf, write_netcdf
from patagium.reading import json_object, made_again
from patagium.robot import Robot
from patagium.robot.files import robot_attributes
from patagium.sensing.sensors.imu import WEIGHTLESS, Imu
from patagium.sensing.sensors.joints import Encoder, MotorCurrent
from patagium.sensing.sensors.load_cell import LoadCell
from patagium.sensing.sensors.motion_capture import MotionCapture
from patagium.sensing.sensors.scene import Scene
from patagium.sensing.sensors.sensor import HIDDEN, Reading, Sensor, Signal, saturation
from patagium.simulation.flight import air_of, robot_of


@dataclass(frozen=True)
class SensorLog:
    """Log of the sensors on a flight.

    Args:
        readings: Samples of each sensor by name, over `time`, the stamps of its own clock [s].
        sensors: Each sensor by name as a laboratory knows it: delay and clock are zero.
        truth: Signals without errors of each sensor by name, over the same stamps, with
            `true_time`, slow errors, and delay and clock as attributes; empty if unknown.
        robot: The machine.
        mount: Description of its mount.
        air: Air that the robot flew in, without its gusts.

    Raises:
        ParameterError: If a reading has no sensor.
    """

    readings: Mapping[str, xr.Dataset]
    sensors: Mapping[str, Sensor]
    truth: Mapping[str, xr.Dataset]
    robot: Robot
    mount: str
    air: Air = Air()
    __repr__ = brief

    def __post_init__(self) -> None:
        for name in self.readings:
            if name not in self.sensors:
                raise ParameterError("sensors", f"a sensor for the reading {name!r}", "none")

    def __getitem__(self, name: str) -> xr.Dataset:
        """Samples of one sensor.

        Raises:
            ParameterError: If the log has no such sensor.
        """
        if not (isinstance(name, str) and name in self.readings):
            raise ParameterError("sensor", f"one of {', '.join(self.readings)}", name)
        return self.readings[name]

    def __iter__(self) -> Iterator[str]:
        """Names of the sensors."""
        return iter(self.readings)

    def __len__(self) -> int:
        """Number of sensors."""
        return len(self.readings)

    def samples(self) -> list[tuple[str, float, Array]]:
        """Name, stamp [s] and values of samples in order, as `MotionTracker.push` takes them."""
        found = []
        for name, reading in self.readings.items():
            rows = _rows(reading, _OF_MOTION)
            stamps = reading["time"].values.tolist()
            found += [(name, stamp, row) for stamp, row in zip(stamps, rows, strict=False)]
        return sorted(found, key=lambda one: one[1])

    def saturated(self) -> dict[str, str]:
        """Sentence on the saturated samples of each sensor that has some, by its name."""
        found: dict[str, str] = {}
        for name, reading in self.readings.items():
            rows = _rows(reading, (*_OF_MOTION, "current", "wrench"))
            count = int(self.sensors[name].saturated(rows).any(axis=1).sum()) if rows.size else 0
            found |= {name: saturation(name, count, len(rows))} if count else {}
        return found

    def without_truth(self) -> SensorLog:
        """Log without its truth, as a laboratory would have it."""
        return replace(self, truth={})


_MOST = 1e8  # samples of a sensor
_OF_MOTION = ("position", "quaternion", "specific_force", "angular_rate")


def _rows(reading: xr.Dataset, kinds: Sequence[str]) -> Array:
    """Values of each sample of a reading, side by side, (N, k)."""
    parts = [reading[kind].values for kind in kinds if kind in reading]
    return np.hstack(parts) if parts else np.zeros((0, 0))


@checked
def sense(flight: xr.Dataset, sensors: Sequence[Sensor], *, seed: int = 0) -> SensorLog:
    """Log of sensors on a flight.

    Args:
        flight: Record with q, v, a, and the quantities that the sensors measure.
        sensors: Sensors, each with its own name.
        seed: Seed of all errors; the same seed gives the same log.

    Returns:
        Samples of each sensor by its own clock, with the truth kept apart.

    Raises:
        FlightError: If the flight lacks a quantity, or is too short for a sensor.
        ParameterError: If two sensors have one name, or the robot lacks a body or joint.
    """
    labels = [sensor.name for sensor in sensors]
    for label in labels:
        if labels.count(label) > 1:
            raise ParameterError("sensors", "a name of its own for each", label)
    scene = Scene(flight)
    if not scene.robot.gravity and any(isinstance(sensor, Imu) for sensor in sensors):
        warnings.warn(WEIGHTLESS, stacklevel=3)
    readings, truth = {}, {}
    begin, end = float(scene.time[0]), float(scene.time[-1])
    for sensor in sensors:
        if (count := (end - begin) * sensor.rate) > _MOST:
            found = f"{count:.3g}; is the time of the flight in s?"
            raise FlightError(sensor.name, f"at most {_MOST:.0e} samples", found)
        rng = np.random.default_rng([seed, zlib.crc32(sensor.name.encode())])
        stamps, times = sensor.clock(begin, end)
        if len(times) < 2:
            expected = f"a flight of at least 2 samples at {sensor.rate:g} Hz"
            raise FlightError(sensor.name, expected, f"{len(times)} in {end - begin:g} s")
        reading = sensor.measure(scene, times, rng)
        readings[sensor.name] = _dataset(stamps, reading.measured, reading)
        true = {**reading.true, "true_time": Signal((), "s", times)}
        truth[sensor.name] = _dataset(stamps, true, reading)
        truth[sensor.name].attrs |= {name: getattr(sensor, name) for name in HIDDEN}
    known = {sensor.name: published(sensor) for sensor in sensors}
    air, mount = replace(air_of(flight), gust=None), str(flight.attrs.get("mount", ""))
    return SensorLog(readings, known, truth, robot_of(flight), mount, air)


def published(sensor: Sensor) -> Sensor:
    """Sensor as a laboratory knows it, without its delay and its clock."""
    return replace(sensor, delay=0.0, clock_offset=0.0, clock_drift=0.0)


def _dataset(stamps: Array, signals: Mapping[str, Signal], reading: Reading) -> xr.Dataset:
    variables = {
        name: (("time", *signal.dims), np.ascontiguousarray(signal.values), {"units": signal.units})
        for name, signal in signals.items()
    }
    used = {dim for signal in signals.values() for dim in signal.dims}
    labels = {dim: (dim, list(names)) for dim, names in reading.labels.items() if dim in used}
    return xr.Dataset(variables, coords={"time": ("time", stamps, {"units": "s"}), **labels})


_KINDS: dict[str, type[Sensor]] = {
    kind.__name__: kind for kind in (Imu, Encoder, MotorCurrent, LoadCell, MotionCapture)
}


@checked
def save_sensor_log(log: SensorLog, path: str | Path) -> Path:
    """Write the measurements of a sensor log as netCDF4, whole or not at all.

    Args:
        log: The log; its truth is not written.
        path: The file, replaced if it exists, in a folder that is there.

    Returns:
        Path of the file.

    Raises:
        OutputError: If the file cannot be written.
    """
    origin = {**robot_attributes(log.robot), "mount": log.mount}
    origin["air"] = json.dumps(log.air.describe())
    described = {
        label: reading.assign_attrs(sensor=json.dumps(log.sensors[label].describe()))
        for label, reading in log.readings.items()
    }
    return write_netcdf(path, xr.Dataset(attrs=origin), described)


def is_sensor_log(path: str | Path) -> bool:
    """Whether a file is what `save_sensor_log` wrote.

    Raises:
        LogError: If it is no file, or was damaged since it was written.
    """
    try:
        with open_netcdf(path) as opened:
            return bool(opened.groups)
    except OSError:
        return False


@checked
def load_sensor_log(path: str | Path) -> SensorLog:
    """Sensor log from a file that `save_sensor_log` wrote.

    Args:
        path: The file.

    Returns:
        The log in memory, without any truth.

    Raises:
        LogError: If there is no such file, or the file is no sensor log.
    """
    path = Path(path)
    part = partial(loaded_dataset, path, LogError, "a sensor log")
    whole = part()
    with made_again(f"{path}: the sensor log"):
        with open_netcdf(path) as opened:
            labels = list(opened.groups)
        readings = {label: part(label) for label in labels}
        sensors = {label: sensor_from(readings[label].attrs.pop("sensor")) for label in labels}
        mount, air = whole.attrs.get("mount", ""), air_of(whole)
        return SensorLog(readings, sensors, {}, robot_of(whole), mount, air)


def sensor_from(text: str, name: str = "sensor") -> Sensor:
    """Sensor whose description, as JSON, is `Sensor.describe`; named so in errors.

    Raises:
        ParameterError: If its kind or a key is not known, or a key is missing.
    """
    known = json_object(text, name)
    word = known.pop("kind", None)
    check_names(f"{name}: kind", [word], [*_KINDS], near=True)
    kind = _KINDS[word]
    accepted = [entry.name for entry in fields(kind)]
    check_names(name, known, accepted, f"keys of {word}:", near=True)
    for entry in fields(kind):
        if entry.default is MISSING and entry.name not in known:
            raise ParameterError(name, f"the key {entry.name}", None)
    return kind(**known)
