"""Online tracker of a robot's motion from samples that may come late.

The tracker is the filter of `estimate_motion` beside a running robot. A late sample is inserted
at its time, and the later samples are processed again. Samples later than the memory are counted
and left out.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from patagium.errors import LogError, ParameterError, ShapeError, positive
from patagium.robot import Robot
from patagium.sensing.motion.estimate_motion import SmoothedMotion, in_coordinates, initial_estimate
from patagium.sensing.motion.frame_model import with_euler_angles
from patagium.sensing.motion.motion_filter import MotionEstimate, MotionFilter
from patagium.sensing.motion.sensor_streams import Observation, Stream, measurement_models
from patagium.sensing.motion.smoothers import MOTION_ORDERS
from patagium.sensing.sensors.sensor import Sensor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MotionNow:
    """Motion at one time.

    Attributes:
        time: Time [s].
        q: Generalized coordinates, (n,) [m, rad].
        v: Generalized velocities, (n,) [m/s, rad/s].
        a: Generalized accelerations, (n,) [m/s^2, rad/s^2].
        covariance: Covariance of [q, v, a], (3 n, 3 n) [products of their units].
    """

    time: float
    q: Array
    v: Array
    a: Array
    covariance: Array


@dataclass(frozen=True)
class _Event:
    time: float
    observation: Observation
    after: MotionEstimate


class MotionTracker:
    """Tracker of coordinates, velocities and accelerations.

    Tracking starts when every encoder and camera has given a sample.

    Args:
        robot: The machine; a quaternion is replaced by roll, pitch and yaw.
        sensors: Encoders, inertial units and cameras by name; other sensors are left out.
        density: Density of the white noise that drives each coordinate, (n,)
            [unit^2/s^(2 order - 1)].
        order: Number of levels of each coordinate: 3 for white jerk, 4 for white snap.
        shifts: Shift of late stamps by name of the sensor [s].
        memory: Longest delay of a sample that is still used [s].

    Raises:
        ParameterError: If an argument is out of its range.
        ShapeError: If `density` is not (n,).
        LogError: If no sensor sees motion.
    """

    def __init__(
        self,
        robot: Robot,
        sensors: Mapping[str, Sensor],
        density: ArrayLike,
        *,
        order: int = 4,
        shifts: Mapping[str, float] | None = None,
        memory: float = 0.1,
    ) -> None:
        robot, drive = with_euler_angles(robot), np.array(density, float)
        if drive.shape != (robot.dof,):
            raise ShapeError("density", (robot.dof,), drive.shape)
        if not (np.isfinite(drive).all() and (drive > 0).all()):
            raise ParameterError("density", "positive numbers", drive.tolist())
        if order not in MOTION_ORDERS:
            raise ParameterError("order", f"one of {MOTION_ORDERS}", order)
        self.memory = positive("memory", memory)
        self._models = measurement_models(sensors, robot)
        if not self._models:
            raise LogError("sensors: expected encoders, inertial units or cameras, found none")
        self._shifts = dict(shifts or {})
        self._filter = MotionFilter(robot, range(robot.dof), drive, order, self._models)
        self._waiting: dict[str, tuple[float, Array]] = {}
        self._needed = {name for name, c in self._models.items() if not c.biases}
        self._events: list[_Event] = []
        self.late = 0

    @property
    def started(self) -> bool:
        """Whether every encoder and camera has given a sample."""
        return bool(self._events)

    def push(self, name: str, stamp: float, values: ArrayLike) -> None:
        """Update with one sample.

        Args:
            name: Name of the sensor.
            stamp: Stamp by the sensor's clock [s].
            values: Coordinates [m, rad]; specific force and angular rate, (6,) [m/s^2, rad/s]; or
                position and quaternion w, x, y, z, (7,) [m, -]. NaN where a value is missing.

        Raises:
            ParameterError: If there is no such sensor.
            FilterDiverged: If the estimate is no longer finite.
        """
        if name not in self._models:
            raise ParameterError("name", f"one of {', '.join(self._models)}", name)
        row, time = np.asarray(values, float), stamp - self._shifts.get(name, 0.0)
        whole = name not in self._needed or len(row) == 7
        if not (np.isfinite(row).all() if whole else np.isfinite(row).any()):
            return
        if not self.started:
            self._waiting[name] = (time, row)
            if self._needed <= set(self._waiting):
                self._begin()
            return
        self._place(time, Observation(name, row))

    def now(self, time: float | None = None) -> MotionNow:
        """Motion after all samples so far.

        Args:
            time: Time at or after the last sample [s]; None for that of the last sample.

        Raises:
            LogError: If tracking has not started, or the time is before the last sample.
        """
        if not self.started:
            missing = ", ".join(sorted(self._needed - set(self._waiting)))
            raise LogError(f"motion: expected a sample of {missing} first")
        last = self._events[-1]
        span = 0.0 if time is None else time - last.time
        if span < 0:
            raise LogError(f"time: expected {last.time:.6g} s or later, found {time:.6g} s")
        estimate = self._filter.predict(last.after, span)
        n = self._filter.robot.dof
        found = SmoothedMotion(
            estimate.motion.levels[None, :3],
            Rotation.from_matrix(estimate.motion.attitude[None]),
            estimate.covariance[None, : 3 * n, : 3 * n],
        )
        levels, covariance = in_coordinates(self._filter.robot, found)
        q, v, a = levels[0]
        return MotionNow(last.time + span, q, v, a, covariance[0])

    def _begin(self) -> None:
        streams = [
            Stream(name, model, np.array([time]), row[None])
            for name, model in self._models.items()
            for time, row in [self._waiting.get(name, (np.inf, np.full(0, np.nan)))]
            if name in self._waiting or model.biases
        ]
        estimate = initial_estimate(self._filter, streams)
        ordered = sorted(self._waiting.items(), key=lambda item: item[1][0])
        first = ordered[0][1][0]
        for name, (time, row) in ordered:
            past = self._events[-1].time if self._events else first
            estimate = self._filter.predict(estimate, time - past)
            observation = Observation(name, row)
            estimate, _ = self._filter.update(estimate, [observation])
            self._events.append(_Event(time, observation, estimate))

    def _place(self, time: float, observation: Observation) -> None:
        place = bisect_right([event.time for event in self._events], time)
        if place == 0:
            self.late += 1
            return
        again = [(time, observation)]
        again += [(event.time, event.observation) for event in self._events[place:]]
        del self._events[place:]
        for moment, seen in again:
            before = self._events[-1]
            estimate = self._filter.predict(before.after, moment - before.time)
            estimate, _ = self._filter.update(estimate, [seen])
            self._events.append(_Event(moment, seen, estimate))
        oldest = self._events[-1].time - self.memory
        while len(self._events) > 1 and self._events[1].time < oldest:
            del self._events[0]
