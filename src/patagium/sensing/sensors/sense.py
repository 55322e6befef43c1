"""Simulation of the sensors on a flight: measurements, with the truth kept apart.

Each sensor has its own time base and its own stream of random numbers, drawn from the seed and
its name, so that one more sensor changes nothing for the others. Neglected: the mass of sensors.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from patagium.errors import FlightError, ParameterError
from patagium.robot import Robot
from patagium.sensing.sensors.scene import Scene
from patagium.sensing.sensors.sensor import HIDDEN, Array, Reading, Sensor, Signal
from patagium.simulation.flight import robot_of


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

    Raises:
        ParameterError: If a reading has no sensor.
    """

    readings: Mapping[str, xr.Dataset]
    sensors: Mapping[str, Sensor]
    truth: Mapping[str, xr.Dataset]
    robot: Robot
    mount: str

    def __post_init__(self) -> None:
        for name in self.readings:
            if name not in self.sensors:
                raise ParameterError("sensors", f"a sensor for the reading {name!r}", "none")

    def __getitem__(self, name: str) -> xr.Dataset:
        """Samples of one sensor.

        Raises:
            ParameterError: If the log has no such sensor.
        """
        if name not in self.readings:
            raise ParameterError("sensor", f"one of {', '.join(self.readings)}", name)
        return self.readings[name]

    def without_truth(self) -> SensorLog:
        """Log without its truth, as a laboratory would have it."""
        return replace(self, truth={})


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
    readings, truth = {}, {}
    for sensor in sensors:
        rng = np.random.default_rng([seed, zlib.crc32(sensor.name.encode())])
        stamps, times = sensor.clock(float(scene.time[0]), float(scene.time[-1]))
        if len(times) < 2:
            raise FlightError(
                f"{sensor.name}: expected a flight of at least 2 samples at {sensor.rate:g} Hz, "
                f"found {len(times)} in {scene.time[-1] - scene.time[0]:g} s"
            )
        reading = sensor.measure(scene, times, rng)
        readings[sensor.name] = _dataset(stamps, reading.measured, reading)
        true = {**reading.true, "true_time": Signal((), "s", times)}
        truth[sensor.name] = _dataset(stamps, true, reading)
        truth[sensor.name].attrs |= {name: getattr(sensor, name) for name in HIDDEN}
    known = {sensor.name: published(sensor) for sensor in sensors}
    return SensorLog(readings, known, truth, robot_of(flight), str(flight.attrs.get("mount", "")))


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
