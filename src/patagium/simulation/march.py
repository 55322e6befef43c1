"""Fourth-order Runge-Kutta at a fixed step, compiled, in chunks.

The march knows no physics: it calls the rate of a flat state, row by row of a
table of what is prescribed, and the record of every sample. Chunks bound the
memory of the table and give Ctrl-C and progress a chance. Without a compiler the
same loop runs in Python. Neglected: step-size control, events.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from patagium.errors import Outcome
from patagium.native import NativeFunction, load_kernel

Array: TypeAlias = NDArray[np.float64]
Progress: TypeAlias = Callable[[int, int], None]

CHUNK = 1000
"""Steps between looks at the keyboard."""


@dataclass(frozen=True)
class Equations:
    """What the march integrates; all functions of (state, row, robot and aero parameters).

    Attributes:
        rate: Rate of the state.
        record: Everything worth keeping of a sample.
        prepare: State where a step begins, from the state where the last one ended;
            None to leave it.
        recorded: Names of what `record` gives, in order.
        robot_parameters: The robot's, (n_p,).
        aero_parameters: The aerodynamic model's, (n_c,).
        lower: Where each entry of the state must stay above, (size,).
        upper: Where each entry of the state must stay below, (size,).
    """

    rate: NativeFunction
    record: NativeFunction
    prepare: NativeFunction | None
    recorded: tuple[str, ...]
    robot_parameters: Array
    aero_parameters: Array
    lower: Array
    upper: Array


@dataclass(frozen=True)
class Run:
    """A march that ended, well or not.

    Attributes:
        samples: Name to values at all samples up to the end, (N + 1, ...).
        steps: Steps completed, N.
        outcome: How it ended.
        state: The state at the end; on a bad outcome the one that broke, (size,).
        which: Index in the state of what broke, or -1.
    """

    samples: dict[str, Array]
    steps: int
    outcome: Outcome
    state: Array
    which: int


class March:
    """An integration that goes on as far as it is asked to.

    Args:
        equations: What to integrate.
        state: Initial state, (size,).
        rows: Table rows at given times, (N,) to (N, row_size).
        steps: Steps to take at most.
        time_step: Step [s].
    """

    def __init__(
        self,
        equations: Equations,
        state: Array,
        rows: Callable[[Array], Array],
        steps: int,
        time_step: float,
    ) -> None:
        self._equations, self._rows, self._time_step = equations, rows, time_step
        self._state = np.array(state, float)
        self._samples = _room(equations, steps)
        self._advance = _compiled(equations) or _in_python(equations)
        self._outcome, self._which = Outcome.COMPLETED, -1
        self.steps, self.done = steps, 0
        self._recorded = False

    @property
    def outcome(self) -> Outcome:
        """COMPLETED while all is well."""
        return self._outcome

    @property
    def run(self) -> Run:
        """What was integrated so far."""
        if not self._recorded:
            self._chunk(0)
        kept = {name: values[: self.done + 1] for name, values in self._samples.items()}
        return Run(kept, self.done, self._outcome, self._state, self._which)

    def advance(self, steps: int, progress: Progress | None = None) -> Outcome:
        """Integrate further, or up to the first state that is not sound; not beyond one.

        Args:
            steps: Steps to take, fewer where fewer are left.
            progress: Told the steps done and to do, after every chunk.

        Returns:
            COMPLETED while all is well.
        """
        last = min(self.steps, self.done + steps)
        while self._outcome is Outcome.COMPLETED and self.done < last:
            self._chunk(min(CHUNK, last - self.done))
            if progress is not None:
                progress(self.done, self.steps)
        return self._outcome

    def _chunk(self, count: int) -> None:
        times = times_of(2 * self.done, 2 * count + 1, 0.5 * self._time_step)
        table = np.ascontiguousarray(self._rows(times))
        states = np.empty((count + 1, self._state.size))
        with np.errstate(all="ignore"):  # a state that breaks is an outcome, not a warning
            self._outcome, taken, self._which = self._advance(
                count, self._time_step, self._state, table, states
            )
        rows = table[: 2 * taken + 1 : 2]
        _record(self._equations, states[: taken + 1], rows, self._samples, self.done)
        self.done += taken
        self._recorded = True


def march(
    equations: Equations,
    state: Array,
    rows: Callable[[Array], Array],
    steps: int,
    time_step: float,
    progress: Progress | None = None,
) -> Run:
    """Integrate a number of steps, or up to the first state that is not sound.

    Args:
        equations: What to integrate.
        state: Initial state, (size,).
        rows: Table rows at given times, (N,) to (N, row_size).
        steps: Steps to take.
        time_step: Step [s].
        progress: Told the steps done and to do, after every chunk.
    """
    marching = March(equations, state, rows, steps, time_step)
    marching.advance(steps, progress)
    return marching.run


def times_of(first: int, count: int, time_step: float) -> Array:
    """Times of samples, each its number times the step: the same in chunks of any size."""
    times: Array = np.arange(first, first + count, dtype=np.float64) * np.float64(time_step)
    return times


Advance: TypeAlias = Callable[[int, float, Array, Array, Array], tuple[Outcome, int, int]]


def _room(equations: Equations, steps: int) -> dict[str, Array]:
    shapes = equations.record.size_out
    return {
        name: np.empty((steps + 1, rows) if columns == 1 else (steps + 1, columns, rows))
        for name, (rows, columns) in zip(equations.recorded, shapes, strict=True)
    }


def _record(
    equations: Equations, states: Array, rows: Array, samples: dict[str, Array], start: int
) -> None:
    constants = equations.robot_parameters, equations.aero_parameters
    results = equations.record.batch(states, rows, *constants)
    for (name, result), (_, columns) in zip(
        zip(equations.recorded, results, strict=True), equations.record.size_out, strict=True
    ):
        place = samples[name][start : start + len(states)]
        place[...] = (result if columns == 1 else result.transpose(0, 2, 1)).reshape(place.shape)


def _compiled(equations: Equations) -> Advance | None:
    """The loop in C, or None without a compiler."""
    library = load_kernel("march")
    if library is None or equations.rate.address is None:
        return None
    prepare = equations.prepare.address if equations.prepare is not None else None
    size = equations.lower.size
    work, done, which = np.empty(5 * size), ctypes.c_long(), ctypes.c_long()

    def advance(
        count: int, time_step: float, state: Array, table: Array, states: Array
    ) -> tuple[Outcome, int, int]:
        code = library.march(
            ctypes.c_void_p(prepare),
            ctypes.c_void_p(equations.rate.address),
            ctypes.c_long(count),
            ctypes.c_double(time_step),
            ctypes.c_long(size),
            _pointer(state),
            _pointer(equations.lower),
            _pointer(equations.upper),
            ctypes.c_long(table.shape[1]),
            _pointer(table),
            _pointer(equations.robot_parameters),
            _pointer(equations.aero_parameters),
            _pointer(states),
            _pointer(work),
            ctypes.byref(done),
            ctypes.byref(which),
        )
        return Outcome(code), done.value, which.value

    return advance


def _pointer(array: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _in_python(equations: Equations) -> Advance:
    """The loop of `kernels/march.c` in Python, statement by statement."""
    constants = equations.robot_parameters, equations.aero_parameters

    def advance(
        count: int, time_step: float, state: Array, table: Array, states: Array
    ) -> tuple[Outcome, int, int]:
        for step in range(count + 1):
            if equations.prepare is not None:
                state[:] = equations.prepare(state, table[2 * step], *constants)
            states[step] = state
            if step == count:
                break
            first, middle, last = table[2 * step : 2 * step + 3]
            k1 = equations.rate(state, first, *constants)
            k2 = equations.rate(state + 0.5 * time_step * k1, middle, *constants)
            k3 = equations.rate(state + 0.5 * time_step * k2, middle, *constants)
            k4 = equations.rate(state + time_step * k3, last, *constants)
            state += time_step / 6.0 * ((k1 + k4) + 2.0 * (k2 + k3))
            outcome, which = _judged(equations, state)
            if outcome is not Outcome.COMPLETED:
                return outcome, step, which
        return Outcome.COMPLETED, count, -1

    return advance


def _judged(equations: Equations, state: Array) -> tuple[Outcome, int]:
    broken = ~np.isfinite(state)
    if broken.any():
        return Outcome.NOT_FINITE, int(np.argmax(broken))
    beyond = (state < equations.lower) | (state > equations.upper)
    if beyond.any():
        return Outcome.LIMIT_REACHED, int(np.argmax(beyond))
    return Outcome.COMPLETED, -1
