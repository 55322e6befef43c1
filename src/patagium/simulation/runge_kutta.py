"""Fourth-order Runge-Kutta at a fixed step, compiled, in chunks; implicit where asked for.

The march knows no physics: it calls the rate of a flat state, row by row of a
table of what is prescribed, and the record of every sample. A row may end with
what a gust that travels is where the state is, looked up between the two. Chunks
bound the memory of the table and give Ctrl-C and progress a chance. Without a
compiler the same loop runs in Python. Neglected: step-size control, events.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from patagium.aerodynamics.gusts import GUST_COMPONENTS, CubicPieces, gusts_at_strips
from patagium.arguments import Progress
from patagium.arrays import Array, classic_step
from patagium.errors import Interrupted, Outcome
from patagium.native import NativeFunction, load_kernel
from patagium.native.function import as_c
from patagium.scratch import release, room_for
from patagium.simulation.implicit_steps import LobattoStep, Rate


@dataclass(frozen=True)
class GustField:
    """Traveling gust and the delays with which strips meet the gust.

    Attributes:
        meet: Delays of the strips, (4, n) [s, -], of (state, row, robot and aero parameters).
        constants: Robot and aero parameters.
        pieces: The gust from one time to another.
        drift: Fastest motion of a part of the robot over the speed of the gust [1].
    """

    meet: NativeFunction
    constants: tuple[Array, Array]
    pieces: Callable[[float, float], CubicPieces]
    drift: float

    @property
    def strips(self) -> int:
        """Number of strips."""
        return self.meet.size_out[0][1]

    def gust_pieces(self, states: Array, rows: Array, first: float, last: float) -> CubicPieces:
        """All of the gust that can be met in a stretch of time.

        Args:
            states: States at its beginning, or at all times of it, (N, size) [SI].
            rows: Prescribed rows then, (N, row_size) [SI].
            first: First time [s].
            last: Last time [s].
        """
        delays = self._delays(states, rows)
        reach = np.abs(delays[:, :, 1]).max() + self.drift * (last - first)
        earliest, latest = delays[:, :, 0].min(), delays[:, :, 0].max()
        return self.pieces(float(first - latest - reach), float(last - earliest + reach))

    def with_gust(self, states: Array, rows: Array, times: Array, pieces: CubicPieces) -> Array:
        """Rows with what strips meet, (N, row_size + 9 n).

        Args:
            states: States, (N, size) [SI].
            rows: Prescribed rows, (N, row_size) [SI].
            times: (N,) [s].
            pieces: All of the gust that is met.
        """
        return np.column_stack([rows, _met(pieces, times, self._delays(states, rows))])

    def without_gust(self, rows: Array) -> Array:
        """Rows of full length, with nothing met, (N, row_size + 9 n)."""
        return np.column_stack([rows, np.zeros((len(rows), GUST_COMPONENTS * self.strips))])

    def _delays(self, states: Array, rows: Array) -> Array:
        """Delays of the gust at mid-chord and leading edge, and their rates, (N, n, 4) [s, 1]."""
        pairs = zip(states, self.without_gust(rows), strict=True)
        found = [np.reshape(self.meet(*pair, *self.constants), (4, -1)).T for pair in pairs]
        return np.ascontiguousarray(found)


def _met(pieces: CubicPieces, times: Array, delays: Array) -> Array:
    """Gust at the strips, strip after strip, (N, 9 n), from delays (N, n, 4)."""
    library, (count, strips, _) = load_kernel("march"), delays.shape
    if library is None:
        met = gusts_at_strips(pieces, times, delays.swapaxes(1, 2))
        return met.swapaxes(1, 2).reshape(count, -1)
    found = np.empty((count, GUST_COMPONENTS * strips))
    cubics, at = np.ascontiguousarray(pieces.coefficients), np.ascontiguousarray(times)
    decay, sizes = ctypes.c_double(pieces.decay_rate), (count, len(pieces.knots))
    library.met_by_strips(*as_c(*sizes, pieces.knots, cubics, decay, at, strips, delays, found))
    return found


CHUNK = 1000
"""Steps between two calls of the progress function."""


@dataclass(frozen=True)
class Equations:
    """Equations to be integrated; all functions of (state, row, robot and aero parameters).

    Attributes:
        rate: Rate of the state.
        record: Everything worth keeping of a sample.
        prepare: State where a step begins, from the state where the last one ended;
            None to leave it.
        recorded: Names of what `record` gives, in order.
        constants: Parameters of the robot, (n_p,), and of its air, (n_c,) [SI], which all functions
            take after state and row.
        lower: Lower limit of each entry of the state, (size,).
        upper: Upper limit of each entry of the state, (size,).
        field: Gust that rows end with, or None.
    """

    rate: NativeFunction
    record: NativeFunction
    prepare: NativeFunction | None
    recorded: tuple[str, ...]
    constants: tuple[Array, Array]
    lower: Array
    upper: Array
    field: GustField | None = None


@dataclass(frozen=True)
class IntegrationResult:
    """A march that ended, well or not.

    Attributes:
        samples: Name to values at all samples up to the end, (N + 1, ...).
        steps: Steps completed, N.
        outcome: Outcome of the run.
        state: The state at the end; on a bad outcome the one that broke, (size,).
        which: Index in the state of what broke, or -1.
        implicit: Whether its steps were implicit.
    """

    samples: dict[str, Array]
    steps: int
    outcome: Outcome
    state: Array
    which: int
    implicit: bool = False


class Integration:
    """Integration that goes on in pieces of any length.

    Args:
        equations: Equations to integrate.
        state: Initial state, (size,).
        rows: Table rows at given times, (N,) [s] to (N, row_size) [SI].
        steps: Steps to take at most.
        time_step: Step [s].
        began: Time of the initial state [s].
        implicit: Whether steps are implicit (`LobattoStep`).

    Attributes:
        outcome: COMPLETED while all is well.
        state: State now, (size,) [SI].
    """

    def __init__(
        self,
        equations: Equations,
        state: Array,
        rows: Callable[[Array], Array],
        steps: int,
        time_step: float,
        began: float = 0.0,
        implicit: bool = False,
    ) -> None:
        self._rows, self._time_step, self._began = rows, time_step, began
        self.change(equations, implicit)
        self.state = np.array(state, float)
        kept = zip(equations.recorded, equations.record.size_out, strict=True)
        self._samples = room_for(
            {k: (steps + 1, n) if m == 1 else (steps + 1, m, n) for k, (n, m) in kept}
        )
        self.outcome, self._which = Outcome.COMPLETED, -1
        self.steps, self.done = steps, 0

    def __getstate__(self) -> dict[str, Any]:
        """State without the compiled equations, which `change` gives it again."""
        compiled = "_equations", "_advance"
        return {name: value for name, value in vars(self).items() if name not in compiled}

    def change(self, equations: Equations, implicit: bool) -> None:
        """Go on with other equations of the same state, from the state as it is.

        Args:
            equations: Equations from now on; they record what the former recorded.
            implicit: Whether steps are implicit from now on.
        """
        self._equations, self._implicit, self._recorded = equations, implicit, False
        given = equations, self._time_step
        if implicit:
            self._advance = _in_python(*given, LobattoStep())
        else:
            self._advance = _compiled(*given) or _in_python(*given, classic_step)

    @property
    def run(self) -> IntegrationResult:
        """Result of the integration so far."""
        if not self._recorded:
            self._chunk(0)
        kept = {name: values[: self.done + 1] for name, values in self._samples.items()}
        ended = self.outcome, self.state, self._which, self._implicit
        return IntegrationResult(kept, self.done, *ended)

    def advance(self, steps: int, progress: Progress | None = None) -> Outcome:
        """Integrate further, or up to the first state that is not sound; not beyond one.

        Args:
            steps: Steps to take, fewer where fewer are left.
            progress: Function that takes the steps done and to do, called after every chunk;
                where it raises `Interrupted`, the integration ends there.

        Returns:
            COMPLETED while all is well.
        """
        last = min(self.steps, self.done + steps)
        try:
            while self.outcome is Outcome.COMPLETED and self.done < last:
                self._chunk(min(CHUNK, last - self.done))
                if progress is not None:
                    progress(self.done, self.steps)
        except Interrupted:
            if self.outcome is Outcome.COMPLETED and self.done < self.steps:
                self.outcome = Outcome.INTERRUPTED
        return self.outcome

    def _chunk(self, count: int) -> None:
        half = 0.5 * self._time_step
        times = self._began + times_of(2 * self.done, 2 * count + 1, half)
        table = np.ascontiguousarray(self._rows(times))
        states = np.empty((count + 1, self.state.size))
        field, pieces = self._equations.field, None
        if field is not None:
            pieces = field.gust_pieces(self.state[None], table[:1], times[0], times[-1])
        with np.errstate(all="ignore"):  # a state that breaks is an outcome, not a warning
            ended = self._advance(times, table, pieces, self.state, states)
        self.outcome, taken, self._which = ended
        flown, states = slice(0, 2 * taken + 1, 2), states[: taken + 1]
        rows = table[flown]
        if field is not None and pieces is not None:
            rows = field.with_gust(states, rows, times[flown], pieces)
        record = self._equations.record
        results = record.batch(states, rows, *self._equations.constants)
        for samples, result, (_, columns) in zip(
            self._samples.values(), results, record.size_out, strict=True
        ):
            place = samples[self.done : self.done + len(states)]
            shown = result if columns == 1 else result.transpose(0, 2, 1)
            place[...] = shown.reshape(place.shape)
            release(place)
        self.done += taken
        self._recorded = True


def integrate(
    equations: Equations,
    state: Array,
    rows: Callable[[Array], Array],
    steps: int,
    time_step: float,
    progress: Progress | None = None,
    began: float = 0.0,
) -> IntegrationResult:
    """Integrate a number of steps, or up to the first state that is not sound.

    Args:
        equations: Equations to integrate.
        state: Initial state, (size,).
        rows: Table rows at given times, (N,) [s] to (N, row_size) [SI].
        steps: Steps to take.
        time_step: Step [s].
        progress: Function that takes the steps done and to do, called after every chunk.
        began: Time of the initial state [s].
    """
    marching = Integration(equations, state, rows, steps, time_step, began)
    marching.advance(steps, progress)
    return marching.run


def times_of(first: int, count: int, time_step: float) -> Array:
    """Times of samples, each its number times the step: the same in chunks of any size."""
    times: Array = np.arange(first, first + count, dtype=np.float64) * np.float64(time_step)
    return times


Advance: TypeAlias = Callable[
    [Array, Array, CubicPieces | None, Array, Array], tuple[Outcome, int, int]
]
"""Loop over N steps, of times [s] and rows every half step, (2 N + 1, ...), the gust that can be
met, the state, and room for states, (N + 1, size); gives outcome, steps taken and what broke."""


def _compiled(equations: Equations, time_step: float) -> Advance | None:
    """The loop in C, or None without a compiler."""
    library = load_kernel("march")
    if library is None or equations.rate.address is None:
        return None
    field = equations.field
    called = equations.prepare, equations.rate, None if field is None else field.meet
    prepare, rate, meet = (ctypes.c_void_p(one.address if one else None) for one in called)
    strips = 0 if field is None else field.strips
    limits, size = (equations.lower, equations.upper), equations.lower.size
    work, done, which = np.empty(5 * size), ctypes.c_long(), ctypes.c_long()
    step = ctypes.c_double(time_step)

    def advance(
        times: Array, table: Array, pieces: CubicPieces | None, state: Array, states: Array
    ) -> tuple[Outcome, int, int]:
        """Outcome of the loop in C, number of steps done, and place in the state that broke."""
        row_size = table.shape[1]
        knots, cubics, decay = np.empty(0), np.empty(0), 0.0
        if pieces is not None:
            knots, decay = pieces.knots, pieces.decay_rate
            cubics = np.ascontiguousarray(pieces.coefficients)
        room = np.empty(row_size + (GUST_COMPONENTS + 4) * strips)
        code = library.march(
            *as_c(prepare, rate, len(states) - 1, step, size, state, *limits, row_size, table),
            *as_c(*equations.constants, states, work, ctypes.byref(done), ctypes.byref(which)),
            *as_c(meet, strips, len(knots), knots, cubics, ctypes.c_double(decay), times, room),
        )
        return Outcome(code), done.value, which.value

    return advance


def _in_python(
    equations: Equations,
    time_step: float,
    one_step: Callable[[Rate, Array, int, float], Array],
) -> Advance:
    """The loop of `kernels/march.c` in Python, statement by statement."""
    constants, field = equations.constants, equations.field

    def advance(
        times: Array, table: Array, pieces: CubicPieces | None, state: Array, states: Array
    ) -> tuple[Outcome, int, int]:
        count = len(states) - 1

        def rate(reached: Array, place: int) -> Array:
            at = slice(place, place + 1)
            row = table[place]
            if field is not None and pieces is not None:
                row = field.with_gust(reached[None], table[at], times[at], pieces)[0]
            return np.asarray(equations.rate(reached, row, *constants))

        for step in range(count + 1):
            if equations.prepare is not None:
                row = table[2 * step]
                row = row if field is None else field.without_gust(row[None])[0]
                state[:] = equations.prepare(state, row, *constants)
            states[step] = state
            if step == count:
                break
            state[:] = one_step(rate, state, 2 * step, time_step)
            beyond = (state < equations.lower) | (state > equations.upper)
            broken = {Outcome.NOT_FINITE: ~np.isfinite(state), Outcome.LIMIT_REACHED: beyond}
            for outcome, places in broken.items():
                if places.any():
                    return outcome, step, int(np.argmax(places))
        return Outcome.COMPLETED, count, -1

    return advance
