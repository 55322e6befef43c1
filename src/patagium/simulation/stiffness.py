"""Whether a run broke because its step was too long, and how long it may be.

A damper or spring that answers faster than a step makes Runge-Kutta's numbers grow where
the motion fades. Told from a motion that does grow by two questions, asked only when a run
has stopped: does the linearized rate, while the run broke, have a mode that grows in the
numbers and not in the equations; and is the same stretch flown past that moment with a
step short enough for it. Neglected: steps that are stable and inaccurate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, log10

import numpy as np
from numpy.typing import NDArray

from patagium.errors import Outcome
from patagium.simulation.runge_kutta import Array, Equations, integrate

REACH = 200
"""Steps before the break that are looked at."""

SAMPLES = 20
"""States among them where the rate is linearized."""

BUDGET = 20_000
"""Short steps that may be spent on flying the stretch again."""

_GROWTH = 1e-3
"""Growth a step, beyond that of the equations, that counts: above what differences leave."""


@dataclass(frozen=True)
class StepTooLong:
    """A step that was too long.

    Attributes:
        longest: Longest stable step, two digits [s].
        which: Index in the state of what answers fastest.
        rate: How fast: size of its eigenvalue [1/s].
    """

    longest: float
    which: int
    rate: float


def diagnose_step(
    equations: Equations,
    state_of: Callable[[dict[str, Array], int], Array],
    samples: dict[str, Array],
    rows: Callable[[Array], Array],
    broken: int,
    steps: int,
    time_step: float,
) -> StepTooLong | None:
    """Cause that made the step too long; None where the motion itself left its bounds.

    Args:
        equations: What was integrated.
        state_of: State at a sample of a run, (size,).
        samples: Those of the run.
        rows: Table rows at given times, (N,) [s] to (N, row_size) [SI].
        broken: Steps completed before the one that broke.
        steps: Steps that were to be taken.
        time_step: Step [s].
    """
    first = max(0, broken - REACH)
    places = _sample_numbers(first, broken)
    states = [state_of(samples, k) for k in places]
    times = np.asarray(time_step * places)
    found = _tightest_limit(equations, states, rows, times, time_step)
    if found is None:
        return None
    began, parts = first * time_step, ceil(time_step / found.longest)
    past = min(steps, broken + 1 + (broken - first) // 2)
    count = min((past - first) * parts, BUDGET)
    # flown again, shorter: where the motion itself grows this run breaks too
    again = integrate(equations, states[0], rows, count, time_step / parts, began=began)
    if again.outcome is not Outcome.COMPLETED:
        return None
    places = _sample_numbers(0, count)
    states = [state_of(again.samples, k) for k in places]
    # a run about to break is nowhere near its motion: the second one knows better
    times = np.asarray(began + time_step / parts * places)
    return _tightest_limit(equations, states, rows, times, time_step) or found


def _sample_numbers(first: int, last: int) -> NDArray[np.int64]:
    """Numbers of some samples from the first to the last, both included."""
    return np.unique(np.linspace(first, last, SAMPLES).astype(np.int64))


def growth(z: NDArray[np.complex128]) -> Array:
    """Growth in a step of classic Runge-Kutta, |1 + z + z^2/2 + z^3/6 + z^4/24|, as z [-].

    Args:
        z: Eigenvalue times step.
    """
    return np.asarray(np.abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))))


def longest_stable_step(eigenvalues: NDArray[np.complex128], time_step: float) -> float:
    """Longest step, up to the given one, at which no mode grows that should not [s].

    Args:
        eigenvalues: Of the rate, (N,) [1/s].
        time_step: Longest of interest [s].
    """
    trials = time_step * np.geomspace(1e-9, 1.0, 9000)  # half a percent apart
    z = np.outer(trials, eigenvalues)
    honest = np.exp(np.clip(z.real, 0.0, 700.0))
    with np.errstate(all="ignore"):  # growth beyond all numbers is growth
        stable = (growth(z) <= (1 + _GROWTH) * honest).all(axis=1)
    last = len(trials) if stable.all() else int(np.argmin(stable))
    return float(trials[max(last - 1, 0)])


def _tightest_limit(
    equations: Equations,
    states: Sequence[Array],
    rows: Callable[[Array], Array],
    times: Array,
    time_step: float,
) -> StepTooLong | None:
    """The tightest limit on the step at some states, or None where it is within all."""
    found: StepTooLong | None = None
    table, field = rows(times), equations.field
    if field is not None:
        flown = np.array(states)
        pieces = field.gust_pieces(flown, table, times[0], times[-1])
        table = field.with_gust(flown, table, times, pieces)
    for state, row in zip(states, table, strict=True):
        slope = _rate_jacobian(equations, state, row)
        if not np.isfinite(slope).all():
            continue
        eigenvalues, modes = np.linalg.eig(slope)
        bound = time_step if found is None else found.longest
        longest = longest_stable_step(eigenvalues.astype(complex), bound)
        if longest < bound:
            limits = [longest_stable_step(np.array([one]), bound) for one in eigenvalues]
            worst = int(np.argmin(limits))
            felt = np.abs(slope).any(axis=0)  # works and impulse ride along, nothing feels them
            which = int(np.argmax(np.abs(modes[:, worst]) * felt))
            found = StepTooLong(longest, which, float(np.abs(eigenvalues[worst])))
    if found is None:
        return None
    digits = 10.0 ** (floor(log10(found.longest)) - 1)
    return replace(found, longest=floor(found.longest / digits) * digits)


def _rate_jacobian(equations: Equations, state: Array, row: Array) -> Array:
    """Derivative of the rate by the state, (size, size) [1/s], by central differences."""
    constants = equations.constants
    columns = []
    with np.errstate(all="ignore"):
        for k, value in enumerate(state):
            step = np.zeros(len(state))
            step[k] = 1e-6 * max(1.0, abs(value))
            ahead, behind = (equations.rate(state + s * step, row, *constants) for s in (1, -1))
            columns.append((np.asarray(ahead) - np.asarray(behind)) / (2 * step[k]))
    return np.stack(columns, axis=1)
