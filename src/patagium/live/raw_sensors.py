"""Packets from the raw samples of a robot's sensors: encoders, inertial units, cameras, motors.

A raw row is a stamp and the values of all sensors, NaN where one has no sample at that stamp. The
first second of rows tells clocks, noise and how lively the motion is, as `patagium motion` finds
them from a log. From then on the motion tracker takes each sample, and gives q, v and a a little
behind it; motor currents give u1. The clock of one sensor that is set is found anew from the next
second. Neglected: load cells, drift of clocks after that second, and jumps that `_PATIENCE` hides.
"""

from __future__ import annotations

import json
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import NamedTuple

import numpy as np
import xarray as xr

from patagium.arrays import Array
from patagium.errors import FilterDiverged, LogError, ParameterError
from patagium.reading import json_object, made_again
from patagium.robot import Robot
from patagium.sensing.force.air_force import packet_columns, packet_parts
from patagium.sensing.logs.importing.consistency import sensor_findings
from patagium.sensing.motion.clock_shifts import found_shifts
from patagium.sensing.motion.estimate_motion import fit_motion
from patagium.sensing.motion.frame_model import floating_base
from patagium.sensing.motion.motion_tracker import MotionTracker
from patagium.sensing.motion.sensor_streams import EncoderModel, Stream, common_times, streams_of
from patagium.sensing.sensors import Encoder, Imu, MotionCapture, MotorCurrent, Sensor, SensorLog
from patagium.sensing.sensors.joints import joint_names
from patagium.sensing.sensors.sense import sensor_from
from patagium.sensing.sensors.sensor import saturation
from patagium.simulation.flight import AXES

LAG = 0.02
"""Time that the motion is behind the last samples, which the tracker smooths over [s]."""
_SETTLING = 1.0
"""Span of the samples that tell clocks and noise [s]."""
_PATIENCE = 0.05
"""Longest time that samples of one sensor wait for those of another [s]."""
_MEMORY = 0.2
"""Memory of the tracker [s]."""
_GAP = 10.0
"""Longest gap between samples of a motor current that is bridged [samples]."""
_QUIET = 1e-3
"""Least driving noise of a joint, relative to that of the liveliest one."""
_LEAST = 1.0
"""Least driving noise, which follows motion of 2 Hz [unit^2/s^7]."""
_RESTARTED = 10
"""Samples in a row out of their time, each later than the last, that tell a new clock."""
_SAMPLES = 3.0
"""Fewest steps of a sensor that its clock jumps ahead by, if it does."""
_SILENCE = 1.0
"""Time of raw rows without a packet after which nothing is said to be learned [s]."""
_FARTHEST, _QUICKEST, _SPUN = 1e4, 340.0, 1e5
"""Size of a coordinate [m], its rate [m/s] and turning [rad/s] beyond which a track is lost."""
_FEWEST, _ALIKE = 50, 0.6
"""Fewest steps for speeds of packets, and correlation from which they are the same motion."""


def channels(robot: Robot, sensor: Sensor) -> dict[str, tuple[str, ...]]:
    """Components of each variable of a sensor's reading, by its name.

    Args:
        robot: The machine.
        sensor: An encoder, inertial unit, camera or motor current; others have none.
    """
    if isinstance(sensor, Encoder | MotorCurrent):
        name = "position" if isinstance(sensor, Encoder) else "current"
        return {name: joint_names(sensor.joints, robot)}
    if isinstance(sensor, Imu):
        return {"specific_force": AXES, "angular_rate": AXES}
    if isinstance(sensor, MotionCapture):
        return {"position": AXES, "quaternion": ("w", *AXES)}
    return {}


def sensor_rows(log: SensorLog) -> Array:
    """Raw rows of a recorded log, (N, columns), one for each stamp."""
    readings = log.readings.values()
    times = np.unique(np.concatenate([one["time"].values for one in readings]))
    blocks = [times[:, None]]
    for label, reading in log.readings.items():
        place = np.searchsorted(times, reading["time"].values)
        for name in channels(log.robot, log.sensors[label]):
            values = reading[name].values
            block = np.full((len(times), values.shape[1]), np.nan)
            block[place] = values
            blocks.append(block)
    return np.hstack(blocks)


def sensors_text(log: SensorLog) -> str:
    """Description of the sensors that a sender of raw rows begins with, as JSON."""
    described = {name: log.sensors[name].describe() for name in log.readings}
    return json.dumps({"sensors": described, "mount": log.mount})


def beyond_limits(robot: Robot, q: Array) -> list[str]:
    """Sentence on the first joint of q, (N, n) [m, rad], far outside its limits; or none."""
    low, high = np.array(robot.lower), np.array(robot.upper)
    room = high - low
    far = np.where((q < low - room) | (q > high + room), np.abs(q), 0.0).max(axis=0, initial=0.0)
    for k in np.flatnonzero(far)[:1]:
        unit, other = (" rad", "degrees") if robot.dof_units[k] == "rad" else (" m", "mm")
        limits = f"its limits are {low[k]:.4g} and {high[k]:.4g}{unit}: is it in {other}?"
        return [f"q.{robot.dof_names[k]} reaches {far[k]:.4g}{unit}, {limits}"]
    return []


@np.errstate(all="ignore")
def packet_doubts(robot: Robot, packets: Array) -> list[str]:
    """Sentence on a joint beyond its limits or not as fast as v and time say, or on a; or none."""
    q, v, a, *_ = packet_parts(packets, robot)
    q, steps = q[:, list(robot.coordinate_indices)], np.diff(packets[:, 0])
    found = beyond_limits(robot, q)
    if len(steps) < _FEWEST:
        return found
    for k in robot.actuated:
        moved, told = np.diff(q[:, k]), steps * (v[1:, k] + v[:-1, k]) / 2
        alike, times = np.corrcoef(moved, told)[0, 1], np.std(told) / np.std(moved)
        if alike > _ALIKE and not 0.2 < times < 5:
            found.append(f"v.{robot.dof_names[k]} is {times:.3g} times as fast as q: is time in s?")
    if v.any() > a.any():
        found.append("a is zero in all packets, though v is not")
    return found[:1]


class _Run(NamedTuple):
    """Stamps in a row that do not fit the clock of a sensor, each later than the last [s].

    The newest time of the other sensors is that when the run began.
    """

    first: float
    last: float
    length: int
    others: float


class MotionPackets:
    """Packets of time, q, v, a and u1, as made from raw rows.

    Args:
        robot: The machine, with Euler angles.
        text: Description of its sensors, as `sensors_text` gives it.

    Attributes:
        text: The description.
        columns: Names of the numbers of a raw row, such as `as5600.position.left_plunge`.
        notes: Findings and chosen settings, in sentences.
        spent: Time that the last packets took each [s].
        counts: Rows with `late` samples (out of their time, and not used), `clock_resets`
            (clocks that were set, which is believed after ten late samples in a row), samples
            with values `out_of_range`, `lost_tracks` (times that the tracker began anew, because
            the motion ran away), and `silences` (times that no packet was made for a second).

    Raises:
        LogError: If the description cannot be read.
        ParameterError: If the robot has no such body or joint, or its attitude is a quaternion.
    """

    spent = _took = 0.0
    _last, _silent = -np.inf, False
    _tracker: MotionTracker | None = None

    def __init__(self, robot: Robot, text: str) -> None:
        if robot.coordinate_count != robot.dof:
            expected = "Euler angles for raw sensors (attitude: euler)"
            raise ParameterError("robot", expected, "a quaternion")
        with made_again("the description of the sensors"):
            described = json_object(text, "sensors")
            self._mount = str(described.get("mount", "free"))
            self._sensors: dict[str, Sensor] = {}
            self._places: dict[str, slice] = {}
            columns = ["time"]
            for label, one in described["sensors"].items():
                self._sensors[label] = sensor_from(json.dumps(one), label)
                begin = len(columns)
                for name, parts in channels(robot, self._sensors[label]).items():
                    columns += [f"{label}.{name}.{part}" for part in parts]
                self._places[label] = slice(begin, len(columns))
        self.columns, self.text = tuple(columns), text
        self._robot = robot
        kinds = Encoder, Imu, MotionCapture
        self._seeing = [n for n, s in self._sensors.items() if isinstance(s, kinds)]
        if not self._seeing:
            raise LogError("sensors", "encoders, inertial units or cameras", "none")
        self._fastest = max(self._seeing, key=lambda name: self._sensors[name].rate)
        said = [f"{n} ({type(s).__name__}, {s.rate:g} Hz)" for n, s in self._sensors.items()]
        self.notes = [f"Raw sensors: {', '.join(said)}"]
        self._waiting: list[tuple[float, str, Array]] = []
        counted = "late", "clock_resets", "out_of_range", "lost_tracks", "silences"
        self.counts = dict.fromkeys(counted, 0)
        self._newest: dict[str, float] = {}
        self._first: dict[str, float] = {}
        self._late: dict[str, _Run] = {}
        self._leads: dict[str, float] = {}
        self._set: dict[str, float] = {}
        self._unheard: Counter[str] = Counter()
        self._samples = {name: np.zeros(2, int) for name in self._sensors}  # bad, and all
        self._told: set[str] = set()
        self._shifts: dict[str, float] = {}
        self._settings: tuple[Array, dict[str, Array]] = np.empty(0), {}
        self._due: list[float] = []
        self._torque = _Torque(robot, self._sensors, self._mount, self._shifts)
        self._made = np.empty((0, len(packet_columns(robot))))
        self._turn = np.zeros(3)
        lengths = np.array(robot.dof_units) == "m"
        most = np.where(lengths, _FARTHEST, np.inf), np.where(lengths, _QUICKEST, _SPUN)
        self._most = np.array([*most, np.full(robot.dof, np.inf)])

    def take(self, rows: Array | None, most: int) -> Array | None:
        """Packets that are ready, (k, 1 + 4 n), at most so many; None where no more will come.

        Args:
            rows: New raw rows, (m, columns) [units of the columns]; None at their end.
            most: Largest number of packets.

        Raises:
            LogError: If the sensors do not tell the motion.
        """
        began = perf_counter()
        for row in (None,) if rows is None else rows:  # one by one: a block may be long
            if row is not None:
                self._sort(row)
            if self._tracker is None and (row is None or self._settled()):
                self._begin()
                began = perf_counter()
        if self._tracker is not None:
            for name, (bad, total) in self._samples.items():
                if bad and name not in self._told:  # once of each sensor
                    self._told.add(name)
                    self.notes.append(saturation(name, bad, total))
            made = self._follow(ended=rows is None)
            self._took += perf_counter() - began
            if made:
                self.spent = self._took / sum(map(len, made))
                self._took = 0.0
            self._keep(made)
        self._tell_silence()
        ready = self._made[:most]
        self._made = self._made[most:]
        return None if rows is None and not len(ready) else ready

    def _keep(self, made: list[Array]) -> None:
        """Keep packets until they are taken."""
        if made:
            self._made = np.concatenate([self._made, *made])
            self._last, self._silent = float(made[-1][-1, 0]), False
            self._unheard.clear()

    def _tell_silence(self) -> None:
        """Say once that samples have come for long of which no packet was made."""
        longest = _SILENCE + (0.0 if self._tracker else 3 * _SETTLING)
        silent = [n for n, k in self._unheard.items() if k > longest * self._sensors[n].rate]
        if silent and not self._silent:
            self._silent = True
            self.counts["silences"] += 1
            self.notes.append(
                f"Warning: no motion was found for {longest:g} s, since t = {self._last:.4g} s, "
                f"and nothing is learned, though samples come of {', '.join(silent)}"
            )

    def _sort(self, row: Array) -> None:
        """Put the values of a row with their sensors; stamps of a sensor must advance."""
        late = False
        for name, place in self._places.items():
            values = row[place]
            if not np.isfinite(values).any():
                continue
            self._unheard[name] += 1
            stamp = self._believed(name, float(row[0]))
            if stamp is None:
                late = True
                continue
            saturated = bool(self._sensors[name].saturated(values).any())
            self.counts["out_of_range"] += saturated
            self._samples[name] += saturated, 1
            if name in self._seeing:
                self._waiting.append((stamp, name, values))
                self._first.setdefault(name, stamp)
            else:
                self._torque.add(name, stamp, values)
        self.counts["late"] += late

    def _believed(self, name: str, stamp: float) -> float | None:
        """Stamp by the sensor's first clock [s]; None where it is out of its time.

        A clock was set where stamps go back, or ahead while those of the others do not.
        """
        stamp -= self._set.get(name, 0.0)
        moments = [self._moment(one, n) for n, one in self._newest.items() if n != name]
        others, moment = max(moments, default=-np.inf), self._moment(stamp, name)
        lead = moment - others if moments else 0.0
        jump, forward = lead - self._leads.get(name, lead), stamp > self._newest.get(name, -np.inf)
        if not forward or jump > max(_PATIENCE, _SAMPLES / self._sensors[name].rate):
            run = self._late.get(name)
            if run is None or stamp <= run.last:
                run = _Run(stamp, stamp, 0, others)
            run = self._late[name] = run._replace(last=stamp, length=run.length + 1)
            alone = others > run.others
            together = self._newest.keys() <= self._late.keys() or stamp - run.first > _PATIENCE
            if not (alone or together) or (run.length < _RESTARTED and (alone or not forward)):
                return None
            if alone and abs(lead) > _PATIENCE:
                self._set_clock(name, jump, others)
                stamp, lead = stamp - jump, lead - jump
            elif not (alone or forward):
                self._restart()
                lead = 0.0
        self._newest[name], self._leads[name] = stamp, lead
        self._late.pop(name, None)
        return stamp

    def _set_clock(self, name: str, by: float, at: float) -> None:
        """Go on after the clock of one sensor was set by a time, at a time of the others [s]."""
        way = "went back" if by < 0 else "jumped ahead"
        words = f"Warning: the clock of {name} {way} by {abs(by):.4g} s at {at:.4g} s"
        self.notes.append(f"{words}: its shift is found anew from the next second")
        self._set[name] = self._set.get(name, 0.0) + by
        self._end_track()
        self._tracker = None

    def _restart(self) -> None:
        """Go on after all clocks were set."""
        self._end_track()
        for held in (self._newest, self._late, self._leads, self._torque):
            held.clear()
        self._tracker = None if self._tracker is None else self._started()

    def _end_track(self) -> None:
        """Make packets of what waits, however rows come in blocks; none follow in its time."""
        self.counts["clock_resets"] += 1
        if self._tracker is not None:
            self._keep(self._follow(ended=True))
        for held in (self._first, self._waiting, self._due):
            held.clear()

    def _settled(self) -> bool:
        """Whether the samples of all sensors span the time to settle, or those of one three."""
        first = self._first
        spans = [self._newest[n] - first[n] if n in first else 0.0 for n in self._seeing]
        return min(spans) >= _SETTLING or max(spans) >= 3 * _SETTLING

    def _begin(self) -> None:
        """Start the tracker with clocks and noise of the first samples, else with those known."""
        try:
            self._fit()
        except (LogError, FilterDiverged) as problem:
            if not self._settings[1]:
                raise
            self.notes.append(f"Clocks and noise are taken as before: {problem}")
        self._tracker = self._started()

    def _fit(self) -> None:
        """Find clocks, noise and driving noise from the first samples."""
        log = self._first_log()
        told, note = found_shifts(log)
        self._shifts |= told
        streams = streams_of(log, self._robot, self._shifts)
        doubts = self._doubts(log, streams)
        self.notes += [f"Warning: {doubt}" for doubt in doubts]
        try:
            times = common_times(streams)
            fitted = fit_motion(self._robot, streams, 4, times)
        except (LogError, FilterDiverged) as problem:
            if not doubts:
                raise
            raise LogError(f"sensors: {'; '.join(doubts)} ({problem})") from problem
        self._settings = self._driven(fitted.density()), fitted.variances()
        self.notes += [note, *fitted.notes]
        self.notes.append(
            f"Noise and driving noise are those of {times[0]:.4g} to {times[-1]:.4g} s; "
            f"the motion is learned {1e3 * LAG:g} ms behind its last sample"
        )
        names = self._robot.dof_names
        silent = [names[i] for i in np.flatnonzero(self._torque.unknown)]
        if silent:
            self.notes.append(
                f"No force is learned of {', '.join(silent)}: nothing measures what drives it"
            )

    def _doubts(self, log: SensorLog, streams: Sequence[Stream]) -> list[str]:
        """Doubts about units and axes of the first samples, those out of range too."""
        shown = [replace(one, rows=one.model.rows(log[one.name])) for one in streams]
        found = [f"{one.where}: {one.text}" for one in sensor_findings(shown)]
        for one in shown:
            if isinstance(one.model, EncoderModel):
                q = np.full((len(one.rows), self._robot.dof), np.nan)
                q[:, one.model.columns] = one.rows
                found += beyond_limits(self._robot, q)
        return found

    def _driven(self, density: Array) -> Array:
        """Density of the driving noise with that of calm coordinates raised, (n,) [unit^2/s^7]."""
        found = np.maximum(density, _LEAST)
        joints = np.ones(len(found), bool)
        base = floating_base(self._robot)
        if base is not None:
            for part in (list(base.place), list(base.turn)):
                found[part] = found[part].max()
                joints[part] = False
        most = found[joints].max(initial=0.0)
        found[joints] = np.maximum(found[joints], _QUIET * most)
        return found

    def _lose_track(self) -> None:
        self.counts["lost_tracks"] += 1
        self._tracker = self._started()

    def _started(self) -> MotionTracker:
        density, variances = self._settings
        sensors = {name: self._sensors[name] for name in variances}
        return MotionTracker(
            self._robot, sensors, density, shifts=self._shifts, memory=_MEMORY, variances=variances
        )

    def _first_log(self) -> SensorLog:
        """Log of the first samples."""
        readings = {}
        for label in self._seeing:
            samples = [(stamp, row) for stamp, name, row in self._waiting if name == label]
            if len(samples) < 2:
                raise LogError(label, "samples in the first second", "none")
            stamps, rows = zip(*samples, strict=True)
            parts = channels(self._robot, self._sensors[label])
            cuts = np.cumsum([len(one) for one in parts.values()])[:-1]
            blocks = np.split(np.array(rows), cuts, axis=1)
            named = zip(parts, blocks, strict=True)
            variables = {name: (("time", f"{name}_part"), block) for name, block in named}
            readings[label] = xr.Dataset(variables, {"time": [*stamps]})
        seeing = {name: self._sensors[name] for name in self._seeing}
        return SensorLog(readings, seeing, {}, self._robot, self._mount)

    def _moment(self, stamp: float, name: str) -> float:
        """Time of a stamp by the clock that all sensors share [s]."""
        return stamp - self._shifts.get(name, 0.0)

    def _follow(self, *, ended: bool) -> list[Array]:
        """Packets from the samples that are due, which the tracker takes in the motion's order."""
        now = [self._moment(self._newest[n], n) for n in self._seeing if n in self._newest]
        until = np.inf if ended else max(min(now), max(now) - _PATIENCE)
        self._waiting.sort(key=lambda one: self._moment(one[0], one[1]))
        made = []
        count = 0
        for stamp, name, values in self._waiting:
            moment = self._moment(stamp, name)
            if moment > until or self._tracker is None:
                break
            count += 1
            try:
                self._tracker.push(name, stamp, values)
            except FilterDiverged:
                self._lose_track()
            if name == self._fastest:
                self._due.append(moment)
                made += self._packets(self._tracker, LAG)
        del self._waiting[:count]
        if ended and self._tracker is not None:
            made += self._packets(self._tracker, 0.0)
        return made

    def _packets(self, tracker: MotionTracker, lag: float) -> list[Array]:
        """Packets at times that are due, a few at once."""
        if not tracker.started:
            return []
        begin, end = tracker.span
        self._due = [moment for moment in self._due if moment >= begin]
        times = np.array([moment for moment in self._due if moment <= end - lag])
        if not len(times) or times[-1] - times[0] < lag / 2:
            return []
        del self._due[: len(times)]
        levels = tracker.past(times)
        if not (np.abs(levels) <= self._most).all():
            self._lose_track()
            return []
        base = floating_base(self._robot)
        if base is not None:  # no jumps of whole turns
            angles = np.vstack([self._turn, levels[:, 0, base.turn]])
            levels[:, 0, base.turn] = np.unwrap(angles, axis=0)[1:]
            self._turn = levels[-1, 0, base.turn]
        motion = levels.reshape(len(times), -1)
        torque = self._torque.at(times)
        return [np.column_stack([times, motion, torque])]


class _Torque:
    """Forces of the joints u1 from the currents of their motors.

    Args:
        robot: The machine.
        sensors: Sensors by name.
        mount: What holds the robot.
        shifts: Shift of late stamps by name of the sensor [s], as known by now.

    Attributes:
        unknown: Whether the force that drives a coordinate is not measured, (n,).
    """

    def __init__(
        self, robot: Robot, sensors: Mapping[str, Sensor], mount: str, shifts: Mapping[str, float]
    ) -> None:
        self._shifts = shifts
        self._motors = {n: s for n, s in sensors.items() if isinstance(s, MotorCurrent)}
        self._columns = {
            name: [robot.index(joint) for joint in joint_names(motor.joints, robot)]
            for name, motor in self._motors.items()
        }
        self._samples: dict[str, deque[tuple[float, Array]]] = {n: deque() for n in self._motors}
        self.unknown = np.zeros(robot.dof, bool)
        self.unknown[list(robot.actuated)] = True
        for columns in self._columns.values():
            self.unknown[columns] = False
        base = floating_base(robot)
        if base is not None and mount not in ("", "free"):
            self.unknown[[*base.place, *base.turn]] = True

    def add(self, name: str, stamp: float, current: Array) -> None:
        """Keep a sample of motor currents, (k,) [A]; those of other sensors are left out."""
        if name in self._motors:
            motor = self._motors[name]
            force = motor.in_range(current) * motor.force_per_current
            self._samples[name].append((stamp, force))

    def clear(self) -> None:
        """Forget all samples."""
        for kept in self._samples.values():
            kept.clear()

    def at(self, times: Array) -> Array:
        """Forces at increasing times, (M, n) [N, N m]; NaN where they are not measured."""
        found = np.zeros((len(times), len(self.unknown)))
        found[:, self.unknown] = np.nan
        for name, motor in self._motors.items():
            kept, longest = self._samples[name], _GAP / motor.rate
            moments = times + self._shifts.get(name, 0.0) + motor.lag
            while len(kept) > 2 and kept[1][0] < moments[0]:
                kept.popleft()
            found[:, self._columns[name]] = np.nan
            if len(kept) < 2:
                continue
            stamps, force = map(np.array, zip(*kept, strict=True))
            after = np.clip(np.searchsorted(stamps, moments), 1, len(stamps) - 1)
            apart = stamps[after] - stamps[after - 1]
            near = np.maximum(apart, moments - stamps[after]) < longest
            for k, column in enumerate(self._columns[name]):
                found[near, column] = np.interp(moments[near], stamps, force[:, k])
        return found
