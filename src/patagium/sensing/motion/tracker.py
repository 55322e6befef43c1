"""Motion of a robot by now, from samples as they come in, also those that come late.

The filter of `estimate_motion` as it runs beside a robot: a sample that shows what was before
others already used is put in its place, and what came after it is done again. Neglected: samples
later than the memory; they are counted and left out.
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
from patagium.sensing.motion.chains import MOTION_ORDERS
from patagium.sensing.motion.estimate import in_coordinates
from patagium.sensing.motion.filter import Belief, MotionFilter
from patagium.sensing.motion.model import by_angles
from patagium.sensing.motion.runs import Found, start
from patagium.sensing.motion.sensors import Observation, channels_of
from patagium.sensing.motion.streams import Stream
from patagium.sensing.sensors.sensor import Sensor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MotionNow:
    """Motion at one time.

    Attributes:
        time: [s].
        q: Generalized coordinates, (n,) [m, rad].
        v: Generalized velocities, (n,) [m/s, rad/s].
        a: Generalized accelerations, (n,) [m/s^2, rad/s^2].
        covariance: Of [q, v, a], (3 n, 3 n).
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
    after: Belief


class MotionTracker:
    """Coordinates, velocities and accelerations that follow sensors online.

    It begins when every encoder and camera has shown something.

    Args:
        robot: The machine; roll, pitch and yaw stand for a quaternion of its.
        sensors: Encoders, inertial units and cameras by name; others are left aside.
        density: Of the white noise that drives each coordinate, (n,) [unit^2/s^(2 order - 1)].
        order: Levels of each coordinate: 3 for white jerk, 4 for white snap.
        shifts: What the stamps of a sensor are late, by its name [s].
        memory: How late a sample may come [s].

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
        robot, drive = by_angles(robot), np.array(density, float)
        if drive.shape != (robot.dof,):
            raise ShapeError("density", (robot.dof,), drive.shape)
        if not (np.isfinite(drive).all() and (drive > 0).all()):
            raise ParameterError("density", "positive numbers", drive.tolist())
        if order not in MOTION_ORDERS:
            raise ParameterError("order", f"one of {MOTION_ORDERS}", order)
        self.memory = positive("memory", memory)
        self._channels = channels_of(sensors, robot)
        if not self._channels:
            raise LogError("sensors: expected encoders, inertial units or cameras, found none")
        self._shifts = dict(shifts or {})
        self._filter = MotionFilter(robot, range(robot.dof), drive, order, self._channels)
        self._waiting: dict[str, tuple[float, Array]] = {}
        self._needed = {name for name, c in self._channels.items() if not c.biases}
        self._events: list[_Event] = []
        self.late = 0

    @property
    def started(self) -> bool:
        """Whether every encoder and camera has shown something."""
        return bool(self._events)

    def push(self, name: str, stamp: float, values: ArrayLike) -> None:
        """Take one sample.

        Args:
            name: Of the sensor.
            stamp: By the sensor's clock [s].
            values: What it showed: coordinates; specific force and angular rate, (6,); or
                position and quaternion w, x, y, z, (7,). NaN where something is missing.

        Raises:
            ParameterError: If there is no such sensor.
        """
        if name not in self._channels:
            raise ParameterError("name", f"one of {', '.join(self._channels)}", name)
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
            time: At or after the last sample [s]; None for that of the last sample.

        Raises:
            LogError: If it has not begun, or the time is before the last sample.
        """
        if not self.started:
            missing = ", ".join(sorted(self._needed - set(self._waiting)))
            raise LogError(f"motion: expected a sample of {missing} first")
        last = self._events[-1]
        span = 0.0 if time is None else time - last.time
        if span < 0:
            raise LogError(f"time: expected {last.time:.6g} s or later, found {time:.6g} s")
        belief, _ = self._filter.predict(last.after, span)
        n = self._filter.robot.dof
        found = Found(
            belief.motion.levels[None, :3],
            Rotation.from_matrix(belief.motion.attitude[None]),
            belief.covariance[None, : 3 * n, : 3 * n],
        )
        levels, covariance = in_coordinates(self._filter.robot, found)
        q, v, a = levels[0]
        return MotionNow(last.time + span, q, v, a, covariance[0])

    def _begin(self) -> None:
        streams = [
            Stream(name, channel, np.array([time]), row[None])
            for name, channel in self._channels.items()
            for time, row in [self._waiting.get(name, (np.inf, np.full(0, np.nan)))]
            if name in self._waiting or channel.biases
        ]
        belief = start(self._filter, streams)
        ordered = sorted(self._waiting.items(), key=lambda item: item[1][0])
        first = ordered[0][1][0]
        for name, (time, row) in ordered:
            past = self._events[-1].time if self._events else first
            belief, _ = self._filter.predict(belief, time - past)
            observation = Observation(name, row)
            belief, _ = self._filter.update(belief, [observation])
            self._events.append(_Event(time, observation, belief))

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
            belief, _ = self._filter.predict(before.after, moment - before.time)
            belief, _ = self._filter.update(belief, [seen])
            self._events.append(_Event(moment, seen, belief))
        oldest = self._events[-1].time - self.memory
        while len(self._events) > 1 and self._events[1].time < oldest:
            del self._events[0]
