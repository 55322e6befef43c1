"""Online tracker of a robot's motion from samples that may come late.

The tracker is the filter of `estimate_motion` that runs with the robot, one filter for all
coordinates that sensors link and one for each encoder with coordinates of its own. A late sample
is inserted at its time, and the later samples are processed again. Samples later than the memory
are counted and left out. A little behind the last sample, a fixed-lag smoother gives the motion
with the samples since. Where innovations stay larger than expected, the driving noise is raised.

References:
    Bierman (1973), Fixed interval smoothing with discrete measurements (Bryson and Frazier's form).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from patagium.arguments import checked
from patagium.arrays import Array, brief, real_array, rising
from patagium.errors import LogError, ParameterError, check_names, positive
from patagium.robot import Robot
from patagium.sensing.motion.estimate_motion import (
    SmoothedMotion,
    groups_of,
    in_coordinates,
    initial_estimate,
)
from patagium.sensing.motion.frame_model import Motion, with_euler_angles
from patagium.sensing.motion.motion_filter import Corrected, MotionEstimate, MotionFilter
from patagium.sensing.motion.sensor_streams import (
    EncoderModel,
    MeasurementModel,
    Observation,
    Stream,
    measurement_models,
)
from patagium.sensing.motion.smoothers import check_order
from patagium.sensing.sensors.sensor import Sensor

LOUD = 3.0
"""Normalized innovation squared of a value above which the driving noise is too small, ..."""
LATELY = 100
"""... in most of so many samples; ..."""
ENLIVENED = 30.0
"""... it is then multiplied by this."""


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
    __repr__ = brief


@dataclass
class Event:
    """Sample, its correction, and span and turn from it to the next sample of a later time."""

    time: float
    observation: Observation
    found: Corrected
    span: float = 0.0
    turned: Array | None = None

    @property
    def after(self) -> MotionEstimate:
        """Estimate after the sample."""
        return self.found.estimate


class MotionTracker:
    """Tracker of coordinates, velocities and accelerations.

    Tracking starts when every encoder and camera has given a sample.

    Args:
        robot: The machine; a quaternion is replaced by roll, pitch and yaw.
        sensors: Encoders, inertial units and cameras by name; other sensors are left out.
        density: Density of the white noise that drives each coordinate, (n,)
            [unit^2/s^(2 order - 1)]; raised where innovations show that it is too small.
        order: Number of levels of each coordinate: 3 for white jerk, 4 for white snap.
        shifts: Shift of late stamps by name of the sensor [s].
        memory: Longest delay of a sample that is still used, and longest lag of `past` [s].
        variances: Variance of the noise of each value by name of the sensor, where a log tells it
            better than the sensor's data, (k,) [square of its unit].

    Raises:
        ParameterError: If an argument is out of its range.
        ShapeError: If `density` is not (n,).
        LogError: If no sensor sees motion, or a coordinate is seen by none.
    """

    @checked
    def __init__(
        self,
        robot: Robot,
        sensors: Mapping[str, Sensor],
        density: ArrayLike,
        *,
        order: int = 4,
        shifts: Mapping[str, float] | None = None,
        memory: float = 0.1,
        variances: Mapping[str, Array] | None = None,
    ) -> None:
        self.robot = with_euler_angles(robot)
        drive = real_array("density", density, (self.robot.dof,))
        if not (np.isfinite(drive).all() and (drive > 0).all()):
            raise ParameterError("density", "positive numbers", drive.tolist())
        check_order(order)
        self.memory = positive("memory", memory)
        models = measurement_models(sensors, self.robot)
        if not models:
            raise LogError("sensors", "encoders, inertial units or cameras", "none")
        for word, given, known in (("shifts", shifts, sensors), ("variances", variances, models)):
            check_names(word, given or {}, known, "those of", near=True)
        for name, values in (variances or {}).items():
            models[name].variances = real_array("variances", values, models[name].variances.shape)
        self.sensors = {name: sensors[name] for name in models}
        self.widths = {name: model.width for name, model in models.items()}
        self.shifts = dict(shifts or {})
        streams = [Stream(name, m, np.zeros(0), np.zeros((0, 0))) for name, m in models.items()]
        self.parts = [
            _Part(self.robot, group, drive[group], order, {one.name: one.model for one in seeing})
            for group, seeing in groups_of(self.robot, streams)
        ]

    def __repr__(self) -> str:
        return f"<MotionTracker of {self.robot.name}: {', '.join(self.sensors)}>"

    @property
    def started(self) -> bool:
        """Whether every encoder and camera has given a sample."""
        return all(part.events for part in self.parts)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time that `past` can tell [s]."""
        begin = max(part.events[0].time for part in self.parts)
        return begin, min(part.events[-1].time for part in self.parts)

    @property
    def late(self) -> int:
        """Number of samples that came later than the memory."""
        return sum(part.late for part in self.parts)

    @property
    def raised(self) -> int:
        """Number of times that the driving noise was raised."""
        return sum(part.raised for part in self.parts)

    @checked
    def push(self, name: str, stamp: float, values: ArrayLike) -> None:
        """Update with one sample.

        Args:
            name: Name of the sensor.
            stamp: Stamp by the sensor's clock [s].
            values: Coordinates [m, rad]; specific force and angular rate, (6,) [m/s^2, rad/s]; or
                position and quaternion w, x, y, z, (7,) [m, -]. NaN where a value is missing.

        Raises:
            ParameterError: If there is no such sensor.
            ShapeError: If the sample has another size.
            FilterDiverged: If the estimate is no longer finite.
        """
        check_names("name", [name], self.sensors)
        row = self.sensors[name].in_range(real_array("values", values, (self.widths[name],)))
        time = stamp - self.shifts.get(name, 0.0)
        for part in self.parts:
            if name in part.models:
                part.push(name, time, row, self.memory)

    @checked
    def now(self, time: float | None = None) -> MotionNow:
        """Motion after all samples so far.

        Args:
            time: Time at or after the last sample [s]; None for that of the last sample.

        Raises:
            LogError: If tracking has not started, or the time is before the last sample or so far
                after it that nothing is known.
        """
        self._require_started()
        latest = max(part.events[-1].time for part in self.parts)
        moment = latest if time is None else time
        if moment < latest:
            raise LogError("time", f"{latest:.6g} s or later", f"{moment:.6g} s")
        n = self.robot.dof
        levels, covariance = np.zeros((1, 3, n)), np.zeros((1, 3 * n, 3 * n))
        attitude = np.eye(3)
        for part in self.parts:
            last = part.events[-1]
            estimate, _ = part.filter.predict(last.after, moment - last.time)
            columns = part.filter.columns
            levels[0][:, columns] = estimate.motion.levels[:3, columns]
            place = (columns + n * np.arange(3)[:, None]).ravel()
            covariance[0][np.ix_(place, place)] = estimate.covariance[: len(place), : len(place)]
            attitude = attitude @ estimate.motion.attitude  # the identity but for one part
        if not np.isfinite(covariance).all():
            raise LogError("time", f"soon after {latest:.6g} s", f"{moment:.6g} s")
        found = SmoothedMotion(levels, Rotation.from_matrix(attitude[None]), covariance)
        levels, covariance = in_coordinates(self.robot, found)
        q, v, a = levels[0]
        return MotionNow(moment, q, v, a, covariance[0])

    def past(self, times: ArrayLike) -> Array:
        """Motion a little ago, given all samples so far: a smoother of fixed lag.

        Args:
            times: Increasing times between the memory's begin and the last sample, (M,) [s].

        Returns:
            q, v and a at each time, (M, 3, n) [m, rad, per s, per s^2].

        Raises:
            LogError: If tracking has not started, or a time is out of the memory.
        """
        self._require_started()
        moments, n = rising(real_array("times", times, ("N",))), self.robot.dof
        if not (len(moments) and np.isfinite(moments[0])):
            raise LogError("times", "one at least", moments.tolist())
        levels = np.zeros((len(moments), 3, n))
        attitude = np.tile(np.eye(3), (len(moments), 1, 1))
        for part in self.parts:
            for k, motion in enumerate(part.past(moments)):
                levels[k][:, part.filter.columns] = motion.levels[:3, part.filter.columns]
                attitude[k] = attitude[k] @ motion.attitude
        nothing = np.zeros((len(moments), 3 * n, 3 * n))
        found = SmoothedMotion(levels, Rotation.from_matrix(attitude), nothing)
        return in_coordinates(self.robot, found)[0]

    def _require_started(self) -> None:
        if not self.started:
            missing = ", ".join(sorted({name for one in self.parts for name in one.missing}))
            raise LogError(f"motion: expected a sample of {missing} first")


class _Part:
    """Filter of coordinates that sensors link, with its samples of late.

    Encoders that see none of them are left out of the models.
    """

    def __init__(
        self,
        robot: Robot,
        group: list[int],
        density: Array,
        order: int,
        models: Mapping[str, MeasurementModel],
    ) -> None:
        self._others = {
            name: [k for k, i in enumerate(m.columns) if i not in group]
            for name, m in models.items()
            if isinstance(m, EncoderModel)
        }
        seeing = (name for name, m in models.items() if len(self._others.get(name, ())) < m.width)
        self.models = {name: models[name] for name in seeing}
        self.filter = MotionFilter(robot, group, density, order, self.models)
        self.events: list[Event] = []
        self.late, self.raised = 0, 0
        self._waiting: dict[str, tuple[float, Array]] = {}
        self.loud = self.seen = 0

    @property
    def missing(self) -> set[str]:
        """Encoders and cameras that have not given a sample."""
        return {name for name, m in self.models.items() if not m.biases} - set(self._waiting)

    def push(self, name: str, time: float, row: Array, memory: float) -> None:
        """Update with one sample, as `MotionTracker.push`."""
        if name in self._others:
            row = row.copy()
            row[self._others[name]] = np.nan
            if not np.isfinite(row).any():
                return
        elif not np.isfinite(row).all():
            return
        if self.events:
            self._place(time, Observation(name, row), memory)
            return
        self._waiting[name] = (time, row)
        if not self.missing:
            self._begin()

    def past(self, times: Array) -> list[Motion]:
        """Motion at increasing times given all samples so far."""
        begin, end = self.events[0].time, self.events[-1].time
        places = [self._after(moment + 1e-9) - 1 for moment in times.tolist()]
        if places[0] < 0 or times[-1] > end + 1e-9:
            expected = f"times from {begin:.6g} to {end:.6g} s"
            raise LogError("times", expected, f"{times[0]:.6g} to {times[-1]:.6g} s")
        wanted, changes = set(places), {}
        adjoint = np.zeros(self.filter.size)
        for k in range(len(self.events) - 1, places[0] - 1, -1):
            event = self.events[k]
            if event.turned is not None:
                adjoint = self.filter.advanced(adjoint, event.span, event.turned, back=True)
            if k in wanted:
                changes[k] = event.after.root @ (event.after.root.T @ adjoint)
            _, innovation, slope, gain = event.found
            adjoint = adjoint + (innovation - adjoint @ gain) @ slope
        found = []
        for moment, k in zip(times.tolist(), places, strict=True):
            motion = self.filter.corrected(self.events[k].after, changes[k]).motion
            span = moment - self.events[k].time
            found.append(self.filter.predicted_motion(motion, span)[0] if span > 1e-9 else motion)
        return found

    def _after(self, time: float) -> int:
        """Place of the first sample after a time."""
        return bisect_right(self.events, time, key=lambda event: event.time)

    def _begin(self) -> None:
        streams = [
            Stream(name, model, np.array([time]), row[None])
            for name, model in self.models.items()
            for time, row in [self._waiting.get(name, (np.inf, np.full(0, np.nan)))]
            if name in self._waiting or model.biases
        ]
        estimate = initial_estimate(self.filter, streams)
        for name, (time, row) in sorted(self._waiting.items(), key=lambda item: item[1][0]):
            if self.events:
                estimate = self._predicted(time)
            self._append(time, Observation(name, row), estimate)

    def _predicted(self, time: float) -> MotionEstimate:
        """Estimate at a time at or after the last sample, before the sample of that time."""
        last = self.events[-1]
        if time <= last.time:
            return last.after
        last.span = time - last.time
        found, last.turned = self.filter.predict(last.after, last.span)
        return found

    def _append(self, time: float, observation: Observation, estimate: MotionEstimate) -> None:
        """Add the sample of a time to the estimate before it."""
        found = self.filter.update(estimate, [observation])
        self.events.append(Event(time, observation, found))
        self.loud += 1 if found.nis > LOUD else -1  # above zero where the median is
        self.seen += 1
        if self.seen == LATELY:
            if self.loud > 0:
                self.filter.enliven(ENLIVENED)
                self.raised += 1
            self.loud = self.seen = 0

    def _place(self, time: float, observation: Observation, memory: float) -> None:
        place = self._after(time)
        if place == 0:
            self.late += 1
            return
        again = [(event.time, event.observation) for event in self.events[place:]]
        del self.events[place:]
        self.events[-1].turned = None
        for moment, seen in [(time, observation), *again]:
            self._append(moment, seen, self._predicted(moment))
        oldest = self.events[-1].time - memory
        while len(self.events) > 1 and self.events[1].time < oldest:
            del self.events[0]
