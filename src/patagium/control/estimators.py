"""Estimators of a flight: the true state with noise, or a tracker of sensors with data sheets.

A controller needs the state now: of the tracker that is its filter at the newest sample that has
come, predicted to the present; a smoother would be 20 ms late. Clocks are taken as known, and
so are delays, but a sample comes when its delay is over. Neglected: samples that overtake others
of the same sensor.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import numpy as np
import xarray as xr

from patagium.arguments import check_fields, of_kind
from patagium.arrays import Array, brief
from patagium.control.orbit import Orbit
from patagium.errors import FilterDiverged, ParameterError
from patagium.robot import Robot
from patagium.sensing.motion.motion_tracker import MotionTracker
from patagium.sensing.sensors.imu import Imu
from patagium.sensing.sensors.joints import Encoder
from patagium.sensing.sensors.motion_capture import MotionCapture
from patagium.sensing.sensors.scene import Scene
from patagium.sensing.sensors.sensor import Sensor
from patagium.simulation.simulator import FlightState


@dataclass(frozen=True)
class Truth:
    """True motion of a flight so far, at every time step.

    Attributes:
        robot: The machine that flies.
        time_step: Step [s].
        q: Coordinates, (N, n_q) [m, rad, 1].
        v: Velocities, (N, n) [m/s, rad/s].
        a: Accelerations, (N, n) [m/s^2, rad/s^2].
        along: Function from times, (m,) [s], to rows of q, v and a on the orbit that is followed
            now, (m, n_q + 2 n) [SI], but for where it is.
    """

    robot: Robot
    time_step: float
    q: Array
    v: Array
    a: Array
    along: Callable[[Array], Array]
    __repr__ = brief


@dataclass(frozen=True)
class Estimate:
    """Estimate of the state of a flight.

    Attributes:
        state: Coordinates and velocities, and the time that they are those of.
        acceleration: Accelerations then, (n,) [m/s^2, rad/s^2].
    """

    state: FlightState
    acceleration: Array
    __repr__ = brief


@runtime_checkable
class Estimator(Protocol):
    """Estimator of the state of a flight."""

    def __call__(self, truth: Truth) -> Estimate | None:
        """Estimate by now from what its sensors see of all motion so far, or None."""


@dataclass(frozen=True)
class NoisyState:
    """State as it is, with white noise, late or missing.

    Args:
        std: Standard deviations by name: a coordinate such as `z`, `velocity of z`, or
            `acceleration of z` [SI]; what is not named is exact.
        delay: Time by which every sample is late; it is taken to the present along the orbit that
            is followed, so that its departure from the orbit is as old as the delay [s].
        missing: Share of samples that do not come, below 1.

    Raises:
        ParameterError: If a number is out of its range.
    """

    std: Mapping[str, float] = field(default_factory=dict)
    delay: float = 0.0
    missing: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        for name, value in (*self.std.items(), ("delay", self.delay)):
            if value < 0:
                raise ParameterError(name, "zero or more", value)
        if not 0 <= self.missing < 1:
            raise ParameterError("missing", "at least 0 and below 1", self.missing)

    def estimator(self, orbit: Orbit, duration: float, seed: int) -> Estimator:
        """Estimator of one flight.

        Args:
            orbit: Orbit that it flies along.
            duration: Duration of the flight [s].
            seed: Seed of noise and missing samples.

        Raises:
            ParameterError: If the robot has no such state.
        """
        robot, dofs = orbit.robot, orbit.robot.dof_names
        names = [*robot.coordinate_names]
        names += [f"{rate} of {dof}" for rate in ("velocity", "acceleration") for dof in dofs]
        for name in self.std:
            if name not in names:
                raise ParameterError("std", "states of the robot", name, names)
        stds = np.array([self.std.get(name, 0.0) for name in names])
        rng = np.random.default_rng([seed, 0x5EED])

        def estimate(truth: Truth) -> Estimate | None:
            errors, lost = stds * rng.standard_normal(len(stds)), rng.random() < self.missing
            last = len(truth.q) - 1
            place = last - round(self.delay / truth.time_step)
            if lost or place < 0:
                return None
            moved = np.concatenate([part[place] for part in (truth.q, truth.v, truth.a)]) + errors
            if place < last:
                then, now = truth.along(truth.time_step * np.array([place, last]))
                moved += now - then
            q, v, a = np.split(moved, [truth.q.shape[1], truth.q.shape[1] + len(dofs)])
            return Estimate(FlightState(robot, last * truth.time_step, q, v), a)

        return estimate


@dataclass(frozen=True)
class TrackedState:
    """State as a tracker knows it from encoders, inertial units and cameras.

    The driving noise of the tracker is that of the orbit: the variance of the fourth derivative
    times the beat over 2 pi, of all directions and all joints that of the liveliest one.

    Args:
        sensors: Sensors, each with its own name, rate, noise and delay.

    Raises:
        ParameterError: If one is of another kind, or two have one name.
    """

    sensors: Sequence[Sensor]

    def __post_init__(self) -> None:
        check_fields(self)
        names = [sensor.name for sensor in self.sensors]
        for sensor in self.sensors:
            of_kind("sensors", sensor, Encoder | Imu | MotionCapture)
            if names.count(sensor.name) > 1:
                raise ParameterError("sensors", "a name of its own for each", sensor.name)

    def estimator(self, orbit: Orbit, duration: float, seed: int) -> Estimator:
        """Estimator of one flight, with errors as of `sense`; see `NoisyState.estimator`.

        Raises:
            LogError: If a coordinate is seen by no sensor.
            ParameterError: If an inertial unit saturates on the orbit.
        """
        for unit in (one for one in self.sensors if isinstance(one, Imu)):
            scene = Scene(orbit.flight(beats=1.0))
            free = replace(unit, accelerometer_range=None, gyroscope_range=None)
            shown = free.shown(scene, scene.time, (np.zeros(3),) * 4).true
            for name, of in (("accelerometer", "specific_force"), ("gyroscope", "angular_rate")):
                most, end = float(np.abs(shown[of].values).max()), getattr(unit, f"{name}_range")
                if end is not None and most > end:
                    expected = f"{most:.4g} {shown[of].units} at least, which the orbit asks for"
                    raise ParameterError(f"{unit.name}.{name}_range", expected, end)
        return _Tracking(self.sensors, orbit, duration, seed)


def driving_noise(orbit: Orbit) -> Array:
    """Spectral density of the noise that drives each coordinate, (n,) [unit^2/s^7].

    It is white noise in the fourth derivative (snap), as large as the snap of the orbit.

    Args:
        orbit: The orbit.
    """
    robot, flight = orbit.robot, orbit.flight(beats=1.0)
    jerk = np.gradient(flight["a"].values, orbit.time_step, axis=0)
    snap = np.gradient(jerk, orbit.time_step, axis=0)[2:-2]
    density = np.mean(snap**2, axis=0) * orbit.period / (2 * np.pi)
    base = robot.floating_dofs
    for group in map(list, (base[:3], base[3:6], robot.actuated)):
        if group:
            density[group] = max(density[group].max(), _LEAST)
    return np.asarray(np.maximum(density, _LEAST))


_LEAST = 1.0  # unit^2/s^7, of the driving noise, enough to follow motion of 2 Hz
_MEMORY = 0.05  # s, longest delay of a sample that is still used
_BESIDE = 8  # time steps before a sample through which its truth is interpolated


class _Tracking:
    """Sensors and tracker of one flight; samples are taken as the truth goes on."""

    def __init__(self, sensors: Sequence[Sensor], orbit: Orbit, duration: float, seed: int) -> None:
        self._by_name = {sensor.name: sensor for sensor in sensors}
        self._robot, self._density = orbit.robot, driving_noise(orbit)
        self._samples: dict[str, tuple[Array, tuple[Array, ...]]] = {}
        for name, sensor in self._by_name.items():
            rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
            times = sensor.clock(0.0, duration)[1]
            self._samples[name] = times, sensor.errors(orbit.robot, len(times), rng)
        self._coming: list[tuple[float, float, str, Array]] = []
        self._tracker = self._started()

    def _started(self) -> MotionTracker:
        return MotionTracker(self._robot, self._by_name, self._density, memory=_MEMORY)

    def __call__(self, truth: Truth) -> Estimate | None:
        """Estimate by now, or None where no sample has come since the last one."""
        now = (len(truth.q) - 1) * truth.time_step
        self._look(truth, now)
        self._coming.sort(key=lambda one: one[:3])
        come = [one for one in self._coming if one[0] <= now + 1e-9]
        del self._coming[: len(come)]
        for _, time, name, row in come:
            try:
                self._tracker.push(name, time, row)
            except FilterDiverged:
                self._tracker = self._started()
        if not come or not self._tracker.started:
            return None
        found = self._tracker.now(max(now, self._tracker.span[1]))
        return Estimate(FlightState(self._robot, now, found.q, found.v), found.a)

    def _look(self, truth: Truth, now: float) -> None:
        """Take the samples of the truth since the last look."""
        if len(truth.q) < 4:
            return
        earliest = min([now, *(times[0] for times, _ in self._samples.values() if len(times))])
        begin = max(0, min(int(earliest / truth.time_step), len(truth.q)) - _BESIDE)
        time = truth.time_step * np.arange(begin, len(truth.q))
        series = {k: (("time", f"of_{k}"), getattr(truth, k)[begin:]) for k in ("q", "v", "a")}
        scene = Scene(xr.Dataset(series, {"time": time}), truth.robot)
        for name, (times, errors) in self._samples.items():
            sensor, count = self._by_name[name], np.searchsorted(times, now + 1e-9, side="right")
            if count == 0:
                continue
            own = np.clip(times[:count], time[0], time[-1])
            reading = sensor.shown(scene, own, tuple(part[:count] for part in errors))
            rows = np.hstack([one.values for one in reading.measured.values()])
            for stamp, row in zip(times[:count].tolist(), rows, strict=True):
                self._coming.append((stamp + sensor.delay, stamp, name, row))
            self._samples[name] = times[count:], tuple(part[count:] for part in errors)
