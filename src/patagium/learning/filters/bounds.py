"""Bounds of inputs and outputs, ahead of every filter: what a sensor can say.

A value is refused that lies further than 3 widths of its range (10 for an output) outside of that
range. So is an input, no acceleration and no command, that jumps: by more than 15 times its median
step and a quarter of its range, and 2 steps more for each usual time step since it was last taken,
but not after a gap of 20. After a jump an input is taken again within 5 median steps for each of
these time steps, unless all inputs go on smoothly from what was refused. Median steps are those of
a usual time step, and change with it. It is refused for as many
samples as the inputs went on smoothly before it, 20 to 100; then it is believed, and moves of its
size are no jumps any more. The range is that of the values taken so far, at least the network's own
scale of an input and a hundredth of the widest output, both over their scales. A value outside of
it widens it by a quarter at most, and 1e-4 of it is forgotten with each sample. The first 20 values
of a channel that moves are bounded by 1e9 of the network's scale alone.

A sample with an input that is refused is not learned; an output that is refused is missing. A
hundred more refused than taken, none of them further off than 1e4 widths and no two in a row
equal, are what the sensor says by now: the range opens up to them, which is an event.
A coordinate of a robot that stands at a velocity of zero rests, as wings do in a glide. Another
input that moved, and now stands while another moves, for 5 samples more than twice its longest
rest of late, is stuck, for a hundred samples; a rest ends within 3 median steps of where it was.
`kernels/bounds.h` does the same in C on the same arrays, and defines the numbers. Neglected:
values that are wrong within their range.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.arrays import Array, Bools
from patagium.learning.models.memory import measured_inputs
from patagium.learning.models.network import Network, flight_terms
from patagium.native.structs import header_numbers

_C = header_numbers("bounds.h")
_TAIL = 0.01  # share of a log below and above the range that is known beforehand
_LAST, _USUAL, _MISSED = range(3)
_TAKEN, _JUMPED = range(2)
_VALUES = ("low", "high", "before", "step", "odd", "odd_low", "odd_high", "rest", "seen")
_COUNTS = ("taken", "odd_run", "stood")
MEMORY = tuple(f"bound_{name}" for name in (*_VALUES, *_COUNTS, "clock", "track"))
"""Names of the arrays of a memory."""


class Bounds:
    """Memory of the bounds, arrays that the kernels share: inputs first, then outputs.

    Args:
        network: Network that is fed.

    Attributes:
        inputs: Number of inputs that are measured.
        coordinates, dof: Number of q and of v among them, the first; 0 where they are no state.
        smooth: Number of them that do not jump, the first: all but accelerations and commands.
        x: Inputs of a sample where a kernel does not read them itself, (n_x,) [units of x].
        scale: Scale of each channel before it is known, (n,) [units of x and y].
        parts: Memory by name, (n,) each; clock: last stamp [s], usual step [s], samples
            refused since then; track: samples taken smoothly, whether one jumped since then.
    """

    def __init__(self, network: Network) -> None:
        self.inputs, outputs = measured_inputs(network), network.outputs
        accelerations = self.inputs // 3 if flight_terms(network).acceleration else 0
        self.smooth = 0 if getattr(network, "inputs_jump", False) else self.inputs - accelerations
        self.coordinates, self.dof = 0, 0
        robot: Any = getattr(network, "robot", None)
        if robot is not None and self.inputs - accelerations == robot.state_size:
            self.coordinates, self.dof = robot.coordinate_count, robot.dof
        self.x = np.zeros(network.inputs)
        self.scale = np.ones(self.inputs + outputs)
        self.scale[: self.inputs] = getattr(network, "input_scale", 1.0)
        self.scale[self.inputs :] = getattr(network, "output_scale", 1.0)
        self._reach = np.repeat((_C.INPUT_REACH, _C.OUTPUT_REACH), (self.inputs, outputs))
        self.parts: dict[str, NDArray[Any]] = {
            **{name: np.full(len(self.scale), np.nan) for name in _VALUES},
            **{name: np.zeros(len(self.scale), np.int64) for name in _COUNTS},
            "clock": np.array([np.nan, 0.0, 0.0]),
            "track": np.zeros(2),
        }
        self.parts["step"][:] = self.parts["rest"][:] = 0.0

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays in which the bounds are remembered, by the names of `MEMORY`."""
        return {f"bound_{name}": array for name, array in self.parts.items()}

    def expect(self, x: Array, y: Array) -> None:
        """Take the ranges of a log, which may begin at rest; 2 % may lie outside.

        Args:
            x: Inputs, (N, n_x) [units of x].
            y: Measurements, (N, n_y) [unit of y]; NaN where none was made.
        """
        values = np.hstack([x[:, : self.inputs], y])
        values = values[:, heard := np.isfinite(values).any(axis=0)]
        least, most = np.nanquantile(values, [_TAIL, 1.0 - _TAIL], axis=0)
        low, high = self.parts["low"], self.parts["high"]
        low[heard], high[heard] = np.fmin(low[heard], least), np.fmax(high[heard], most)

    def forget_place(self) -> None:
        """Take the next inputs however far they moved."""
        self.parts["before"][:] = np.nan
        self.parts["track"][:] = 0.0

    def bounded(self, x: Array, y: Array, time: float) -> tuple[bool, Array, dict[str, int]]:
        """Whether a sample can be learned; y, NaN where it is refused, (n_y,); events.

        Args:
            x: Input, (n_x,) [units of x].
            y: Measurement, (n_y,) [unit of y].
            time: Of the sample [s]; NaN: unknown.
        """
        low, high, before, step = (self.parts[name] for name in _VALUES[:4])
        n = self.inputs
        taken, stood = self.parts["taken"], self.parts["stood"]
        track = self.parts["track"]
        value = np.concatenate([x[:n], y])
        width = self._width()
        ahead = self._ahead(time)
        with np.errstate(invalid="ignore", over="ignore"):
            beyond = np.maximum(low - value, value - high)
            known = taken >= _C.KNOWN
            room = np.where(known, inf, _C.BOUNDLESS * self.scale)
            outside = known & ~(beyond <= self._reach * width)
            outside |= ~(np.abs(value) <= room)
            moved = np.abs(value - before)
            moved[self.smooth :] = np.nan
            stuck, judged = self._stuck(moved, self._rests(value, moved)), self._compares(ahead)
            jumps = judged & (taken >= _C.MANY) & (moved > self._most(width, ahead)) & ~outside
            along = self._goes_along(value) and judged
            rough = (moved > _C.SMOOTH * step * ahead) | (stood > _C.STANDS)
        odd = outside | jumps | stuck
        wrong = bool((outside | jumps)[:n].any())
        usable = not (odd[:n].any() or along)
        if usable:
            if track[_JUMPED] and not judged:  # it is believed
                step[:] = np.fmax(step, moved / _C.JUMP)
            smooth = not (rough.any() or track[_JUMPED])
            track[:] = smooth * (track[_TAKEN] + 1), 0.0
            self._keep_time(time)
            self._take(value, ~odd, known, width)
        else:
            self.parts["clock"][_MISSED] += 1
            track[_JUMPED] = max(track[_JUMPED], float(jumps.any()))
            odd[n:] = False
        told = np.flatnonzero(odd & ~stuck & np.isfinite(value)).tolist()
        opened = [self._refuse(k, value[k], known[k], width[k]) for k in told]
        events = {
            "out_of_range": len(told) - int(jumps.sum()),
            "jumps": int(jumps.sum()) + (along and not wrong),
            "stuck": int(stuck.sum()),
            "reopened": sum(opened),
        }
        return usable, np.where(odd[n:], np.nan, y), events

    def _compares(self, ahead: float) -> bool:
        """Whether inputs are compared with the last ones taken; not after a gap, nor for ever."""
        missed, smooth = self.parts["clock"][_MISSED], self.parts["track"][_TAKEN]
        patience = max(_C.GAP, min(smooth, _C.ODD_RUN))
        return bool(ahead <= missed + _C.GAP and missed < patience)

    def _most(self, width: Array, ahead: float) -> Array:
        """Largest move of each channel that is no jump, (n,) [units of x and y]."""
        step = self.parts["step"]
        if self.parts["track"][_JUMPED]:
            return np.asarray(_C.SMOOTH * step * ahead)
        most = np.maximum(_C.JUMP_SHARE * width, _C.JUMP * step)
        return np.asarray(most + _C.AHEAD * step * (ahead - 1))

    def _goes_along(self, value: Array) -> bool:
        """Whether inputs go on smoothly from a sample that was refused for a jump."""
        seen, near = self.parts["seen"], _C.SMOOTH * self.parts["step"]
        moved, own = np.abs(value - seen), slice(0, self.smooth)
        seen[: self.inputs] = value[: self.inputs]
        return bool(self.parts["track"][_JUMPED] and (moved[own] <= near[own]).all())

    def _rests(self, value: Array, moved: Array) -> Bools:
        """Inputs of joints at rest, (n,): position and velocity do not change; velocity is zero."""
        found, first = np.zeros(len(value), bool), self.coordinates - self.dof
        q = slice(first, self.coordinates)
        v = slice(self.coordinates, self.coordinates + self.dof)
        found[q] = found[v] = (moved[q] == 0) & (moved[v] == 0) & (value[v] == 0)
        return found

    def _stuck(self, moved: Array, rests: Bools) -> Bools:
        """Inputs that are stuck: constant for longer than at rest, while another input moves."""
        rest, run, taken = (self.parts[n] for n in ("rest", "stood", "taken"))
        ended = (moved > 0) & (moved <= _C.REST_STEPS * self.parts["step"])
        run += (moved == 0) & (moved > 0).any()
        rest[:] = np.where(ended, np.maximum(rest, run), rest) * (1.0 - _C.LEAK)
        run[(moved > 0) | rests] = 0
        over = run - 2.0 * rest - _C.STANDS
        return np.asarray((taken >= _C.MANY) & (over > 0) & (over <= _C.ODD_RUN))

    def _width(self) -> Array:
        n, low, high = self.inputs, self.parts["low"], self.parts["high"]
        width = np.nan_to_num(high - low)
        width[:n] = np.maximum(width[:n], self.scale[:n])
        widest = (width[n:] / self.scale[n:]).max(initial=0.0)
        width[n:] = np.maximum(width[n:], _C.LEAST_SHARE * widest * self.scale[n:])
        return np.asarray(width)

    def _ahead(self, time: float) -> float:
        """Usual steps since the last sample that was taken; infinite where none can be told."""
        last, usual, missed = self.parts["clock"].tolist()
        step = time - last
        if not isfinite(step):
            return float(1.0 + missed)
        return float(max(step / usual, 1.0)) if step > 0 and usual > 0 else inf

    def _keep_time(self, time: float) -> None:
        clock = self.parts["clock"]
        step, usual = time - clock[_LAST], clock[_USUAL]
        if isfinite(step) and step > 0:
            counted = min(step, _C.STEPS * usual)
            clock[_USUAL] = usual + (counted - usual) / _C.STEPS if usual > 0 else step
            self.parts["step"] *= clock[_USUAL] / usual if usual > 0 else 1.0
        clock[_LAST], clock[_MISSED] = time, 0.0

    def _take(self, value: Array, kept: Bools, known: Any, width: Array) -> None:
        """Range and median step from a sample; channels that are not kept stay as they are."""
        low, high, before, step = (self.parts[name] for name in _VALUES[:4])
        taken, run = (self.parts[name] for name in _COUNTS[:2])
        span, most = _C.LEAK * (high - low), np.where(known, _C.GROWTH * width, inf)
        raised = np.where(value > high, np.minimum(value, high + most), high - span)
        lowered = np.where(value < low, np.maximum(value, low - most), low + span)
        first, moved = np.isnan(low), np.abs(value - before)
        np.copyto(high, np.where(first, value, raised), where=kept)
        np.copyto(low, np.where(first, value, lowered), where=kept)
        moving = kept & (moved > 0)
        share = np.maximum(_C.MANY / np.maximum(taken, 1), 1.0)
        rate = np.where(known, _C.SLOW * share, _C.FAST)
        after = step + step * np.where(moved > step, rate, -rate)
        np.copyto(step, np.where(step > 0, after, moved), where=moving)
        np.copyto(before, value, where=kept)
        taken += moving
        run -= kept & (run > 0)

    def _refuse(self, k: int, value: float, known: bool, width: float) -> bool:
        """Whether the range of a channel opens after one more value that was refused."""
        low, high, before, _, odd, least, most, *_ = (self.parts[n] for n in _VALUES)
        run = self.parts["odd_run"]
        if not (known and max(low[k] - value, value - high[k]) <= _C.ODD * width):
            run[k] = 0
        elif value != odd[k]:
            least[k] = min(value, least[k]) if run[k] else value
            most[k] = max(value, most[k]) if run[k] else value
            odd[k], run[k] = value, run[k] + 1
        if run[k] < _C.ODD_RUN:
            return False
        low[k], high[k] = min(low[k], least[k]), max(high[k], most[k])
        before[k], run[k] = value, 0
        return True
