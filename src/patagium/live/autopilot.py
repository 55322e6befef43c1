"""Autopilot: estimate, learning and feedback of a flying robot in one compiled call a tick.

The motion tracker, the pipeline of a learner and a linear regulator go on in C from where they
stand, with their numbers in Python but for rounding. Neglected: differences of sensors' clocks.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.arguments import checked
from patagium.arrays import Array, Bools, real_array
from patagium.control.lqr import LinearRegulator
from patagium.errors import CompilerError, LogError, ParameterError, check_names
from patagium.live.pipeline import Pipeline, Records, over_rows
from patagium.native import load_kernel
from patagium.native.structs import AUTOPILOT, MOTION_TRACK, REGULATOR
from patagium.sensing.motion.frame_model import euler_function, floating_base
from patagium.sensing.motion.motion_filter import CompiledFilter
from patagium.sensing.motion.motion_tracker import ENLIVENED, LATELY, LOUD, Event, MotionTracker
from patagium.simulation.steered_gait import Responses, SteeredGait


@dataclass(frozen=True)
class Ticks:
    """Motion, learning and commands of an autopilot at some ticks.

    Attributes:
        rows: Numbers of each tick, (N, 3 n + m + n_u + 2), as the properties read them.
        sizes: n, numbers of the learner's record, and n_u.
    """

    rows: Array
    sizes: tuple[int, int, int]

    @property
    def motion(self) -> Array:
        """Coordinates, velocities and accelerations, (N, 3, n) [m, rad, per s, per s^2]."""
        n = self.sizes[0]
        return self.rows[:, : 3 * n].reshape(-1, 3, n)

    @property
    def learned(self) -> Records:
        """Records of the learner, of the ticks at which it was given a sample."""
        n, count, _ = self.sizes
        rows = self.rows[:, 3 * n : 3 * n + count]
        return Records(rows[~np.isnan(rows[:, -3:-2]).any(axis=1)])

    @property
    def commands(self) -> Array:
        """Commands in force after each tick, (N, n_u), as `SteeredGait` takes them."""
        return self.rows[:, -2 - self.sizes[2] : -2]

    @property
    def commanded(self) -> Bools:
        """Ticks at which commands were given, (N,)."""
        return np.asarray(self.rows[:, -2] == 1.0)

    @property
    def duration(self) -> Array:
        """Wall-clock time of each tick, (N,) [s]."""
        return self.rows[:, -1] * 1e-9


class Autopilot:
    """Tracker, learner and regulator as one compiled call.

    Args:
        tracker: Tracker that has started; it is copied where it stands.
        regulator: Regulator, and the gait that it steers; it is copied where it stands too.
        pipeline: Pipeline of a learner, which is changed; None where nothing is learned.
        every: Ticks from one sample that is learned to the next.

    Raises:
        LogError: If the tracker has not started.
        ParameterError: If the parts are not those of one robot with Euler angles, the tracker
            shifts clocks, or no learner is compiled.
        CompilerError: If there is no compiler: the parts do the same in Python.

    Attributes:
        places: Columns of the stamp and the values of each sensor in a row, and of `forces`.
    """

    @checked
    def __init__(
        self,
        tracker: MotionTracker,
        regulator: LinearRegulator,
        pipeline: Pipeline | None = None,
        *,
        every: int = 1,
    ) -> None:
        kernel, chain = load_kernel("autopilot"), None if pipeline is None else pipeline.chain
        if kernel is None:
            expected = "a C compiler (or use tracker, pipeline and regulator by themselves)"
            raise CompilerError(f"autopilot: expected {expected}, found none")
        _check(tracker, regulator, pipeline, every)
        self._kept: list[Any] = [pipeline]
        self._name = tracker.robot.name
        self._chain, n, commands = chain, tracker.robot.dof, len(regulator.model.commands)
        outputs = forces = 0
        if pipeline is not None:
            outputs = 3 * pipeline.learner.network.outputs + 4
            forces = len(pipeline.columns) - 1 - 3 * n
        self.sizes = n, outputs, commands
        own = [copy(part.filter).compiled for part in tracker.parts]
        filters = [one for one in own if one is not None]
        widths = [1 + width for width in tracker.widths.values()]
        ends = np.cumsum([1, *widths, forces]).tolist()
        named = zip((*tracker.widths, "forces"), pairwise(ends), strict=True)
        self.places = {name: slice(*place) for name, place in named}
        self._row, self._limits = np.full((2, ends[-1]), np.nan)
        for name, sensor in tracker.sensors.items():
            self._limits[self.places[name]][1:] = sensor.saturates
        self._tracks = (MOTION_TRACK.type * len(filters))()
        room = int(tracker.memory * sum(one.rate for one in tracker.sensors.values())) + 16
        for track, part, one in zip(self._tracks, tracker.parts, filters, strict=True):
            self._place(track, part.events, one, room)
            numbers = [one.numbers.get(name, -1) for name in tracker.sensors]
            track.numbers, track.memory = self._address(numbers, np.int32), tracker.memory
            track.loud, track.seen = part.loud, part.seen
        base, self._regulator = floating_base(tracker.robot), self._of(regulator)
        euler = euler_function()
        self._kept.append(euler)
        self._struct = AUTOPILOT.type(
            sensors=len(widths),
            tracks=len(filters),
            dof=n,
            columns=ends[-1],
            record=3 * n + outputs + commands + 2,
            learned=outputs,
            forces=forces,
            every=every,
            time=max(part.events[-1].time for part in tracker.parts),
            memory=tracker.memory,
            widths=self._address(widths, np.int32),
            track=ctypes.addressof(self._tracks),
            turn=None if base is None else self._address(base.turn, np.int32),
            euler=euler.address,
            packet=self._address(np.zeros(1 + 3 * n + forces)),
            regulator=ctypes.addressof(self._regulator),
        )
        if chain is not None:
            self._struct.run, self._struct.pipeline = chain.native
        self._run = over_rows(kernel.autopilot_run, self._struct)

    def __reduce__(self) -> Any:  # of copies too
        raise ParameterError("copy", "another Autopilot(tracker, regulator)", self)

    def __repr__(self) -> str:
        return f"<Autopilot of {self._name}: {', '.join(self.places)}>"

    def _address(self, values: ArrayLike, kind: type = float) -> int:
        """Address of an array that lives as long as this."""
        array: NDArray[Any] = np.array(values, kind, order="C")
        self._kept.append(array)
        return int(array.ctypes.data)

    def _place(self, track: Any, events: list[Event], native: CompiledFilter, room: int) -> None:
        """Fill the memory of a part of the tracker with its samples of late."""
        self._kept.append(native)
        room += len(events)
        width = max(sensor.width for sensor in native.sensors)
        time, numbers, values = np.zeros(room), np.zeros(room), np.zeros((room, width))
        estimates = np.zeros((room, native.row_size))
        for k, event in enumerate(events):
            seen, estimates[k], time[k] = event.observation, event.after.row, event.time
            numbers[k], values[k, : len(seen.values)] = native.numbers[seen.name], seen.values
        track.filter, track.count = ctypes.addressof(native.struct), len(events)
        track.capacity, track.size, track.width = room, native.row_size, width
        track.time, track.sensor = self._address(time), self._address(numbers, np.int32)
        track.values = self._address(values)
        track.estimates, track.scratch = self._address(estimates), self._address(estimates[0])
        track.found = native.found.ctypes.data
        track.too_loud, track.lately, track.enlivened = LOUD, LATELY, ENLIVENED

    def _of(self, regulator: LinearRegulator) -> Any:
        """Structure of a regulator, and of the gait that it steers."""
        model, names = regulator.model, regulator.model.robot.dof_names
        course, last = model.course, model.number(max(regulator.called, -model.period))
        gait, count = model.steered, len(model.commands)
        moving = [name.removeprefix("velocity of ") for name in model.names]
        sources = [
            names.index(name) + len(names) * (name != whole) if name in names else -1
            for name, whole in zip(moving, model.names, strict=True)
        ]
        moves = np.zeros((count, len(gait.neutral)))
        for row, name in zip(moves, model.commands, strict=True):
            row[gait.places(name)] = 1.0
        pieces = _pieces(gait)
        arrays: dict[str, ArrayLike] = {
            "along": course.states, "ahead": course.ahead, "travel": course.travel,
            "origin": course.origin,
            "moves": moves, "neutral": model.neutral, "low": regulator.low,
            "high": regulator.high, "fastest": regulator.fastest, "gains": regulator.gains,
            "scale": [gait.scale(name) for name in model.commands], "before": regulator.before,
            "sharpness": gait.sharpness, "range": gait.range, "rates": gait.rates,
            "largest": gait.largest_amplitudes, "room": gait.room, "reach": gait.reach,
            "target": gait.target,
            "pieces": np.pad(pieces, ((0, len(gait.neutral) + 3 - len(pieces)), (0, 0))),
        }  # fmt: skip
        places: dict[str, ArrayLike] = {
            "pairs": course.pairs, "places": model.kept, "sources": sources,
            "answers": model.places, "chains": model.chains,
        }  # fmt: skip
        return REGULATOR.type(
            parts=model.parts,
            states=len(model.names),
            kept=len(model.kept),
            lags=sum(model.chains),
            commands=count,
            responses=len(gait.neutral),
            joints=len(gait.joints),
            period=model.period,
            next=max(0.0, model.time(last + 1)),
            turn=course.turn,
            heading=course.heading,
            lead=course.lead,
            center_x=course.center.real,
            center_y=course.center.imag,
            vectors=len(course.pairs),
            z=course.places[2],
            yaw=-1 if course.yaw is None else course.yaw,
            count=len(pieces),
            **{name: self._address(values) for name, values in arrays.items()},
            **{name: self._address(values, np.int32) for name, values in places.items()},
        )

    @property
    def counts(self) -> dict[str, int]:
        """Samples and ticks that were `late`, samples `refused`, times that noise was `raised`.

        `held` are the times that commands were, where the motion was no number or the time of a
        tick lay further ahead than the tracker's memory.
        """
        names = ("late", "refused", "raised")
        found = {name: sum(getattr(one, name) for one in self._tracks) for name in names}
        found["late"] += self._struct.late
        return found | {"held": self._regulator.held + self._struct.held}

    @checked
    def step(
        self, time: float, samples: Mapping[str, ArrayLike], forces: ArrayLike | None = None
    ) -> Ticks:
        """One tick.

        Args:
            time: Now, not before the last stamp, since the beginning of the orbit [s]. One that
                falls, or is further ahead of the last tick than the tracker's memory, holds the
                last commands and is counted, until ten that rise are far ahead: the estimate then
                goes on as if its last tick were a memory ago. One of 1e15 intervals is held always.
            samples: Stamp and values of each sensor that has one, as `MotionTracker.push` takes
                them, by its name [s, SI].
            forces: Forces u1 and those carried of the learner's packet, (k n,) [N, N m].

        Raises:
            ParameterError: If there is no such sensor.
            ShapeError: If a sample has another size.
        """
        row = self._row
        row[0], row[1:] = time, np.nan
        given = dict(samples) if forces is None else {**samples, "forces": forces}
        for name, values in given.items():
            check_names("samples", [name], self.places, "those of")
            place = self.places[name]
            row[place] = real_array(name, values, row[place].shape)
        return self.run(row[None])

    def run(self, rows: ArrayLike) -> Ticks:
        """Ticks one after the other.

        Args:
            rows: Time [s], then what `places` says, (N, columns) [s, SI]; without a sample nan.

        Raises:
            ShapeError: If the rows have another size.
        """
        given = real_array("rows", rows, ("N", len(self._row)))
        given = np.where(np.abs(given) >= self._limits, np.nan, given)
        records = np.empty((len(given), self._struct.record))
        done = partial(self._run, given, records)
        if self._chain is None:
            done(0)
        else:
            n, outputs, _ = self.sizes
            self._chain.account_for(done, records[:, 3 * n : 3 * n + outputs])
        return Ticks(records, self.sizes)


def _pieces(gait: SteeredGait) -> Array:
    """Last command as the kernel has it: a row for its beginning and for the end of each ramp."""
    last, rows = gait.answers[-1], []
    for end in np.unique([0.0, *last.lasting]):
        since, slope = np.array([end]), np.where(last.lasting > end, last.ramp.slope, 0.0)
        aim = gait.target - slope * (last.lasting - end)
        goes = Responses.from_state(np.concatenate(last.at(since)), aim, slope, gait.sharpness)
        begin = [last.time + end], last.own(since)
        rows.append(np.concatenate([*begin, goes.target, goes.slope, *goes.c]))
    return np.array(rows)


def _check(
    tracker: MotionTracker, regulator: LinearRegulator, pipeline: Pipeline | None, every: int
) -> None:
    """Refuse parts that do not go together."""
    if not tracker.started:
        raise LogError("tracker", "samples pushed to it until it starts", "too few")
    if every < 1:
        raise ParameterError("every", "a number of ticks, 1 or more", every)
    robots = [one.robot for one in (tracker, regulator.model, pipeline) if one is not None]
    for robot in robots:
        if robot.coordinate_names != tracker.robot.dof_names:
            found = ", ".join(one.name for one in robots)
            raise ParameterError("robot", "the same robot in all parts, with Euler angles", found)
    model = regulator.model
    if model.pace != 1 or abs(model.time(0)) > 1e-6 * model.period:
        expected = "a regulator at the frequency of the gait itself"
        raise ParameterError("regulator", expected, regulator)
    if pipeline is not None and pipeline.chain is None:
        raise ParameterError("pipeline", "a compiled pipeline", "one in Python")
    if any(tracker.shifts.values()):
        raise ParameterError("tracker", "a tracker without clock shifts", tracker.shifts)
