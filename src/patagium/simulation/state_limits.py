"""Limits of the state in a flight, and messages about why a run stopped.

Beyond the limits the equations still give numbers, but not of this machine:
Euler angles are singular at a pitch of 90 degrees, joints have stops that are not
modeled, and air is compressible near the speed of sound.

A damper or spring that answers faster than a step makes Runge-Kutta's numbers grow where
the motion fades. It is distinguished from a motion that does grow by two questions, asked only
when a run has stopped: does the linearized rate, while the run broke, have a mode that grows in the
numbers and not in the equations; and is the same stretch flown past that moment with a
step short enough for it. A step that is chosen is also short enough that weakly damped
oscillations keep their amplitude. Neglected: motions that get faster than at the start.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, log10

import numpy as np
from numpy.typing import NDArray

from patagium.arrays import Array
from patagium.errors import Outcome, ParameterError
from patagium.robot import Robot
from patagium.robot.units import meant, spoken
from patagium.simulation.implicit_steps import rate_jacobian
from patagium.simulation.runge_kutta import Equations, IntegrationResult, integrate

REACH = 200
"""Steps before the break that are analyzed."""

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
        rate: Size of its eigenvalue [1/s].
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
        equations: Equations of the run.
        state_of: State at a sample of a run, (size,).
        samples: Samples of the run.
        rows: Table rows at given times, (N,) [s] to (N, row_size) [SI].
        broken: Steps completed before the one that broke.
        steps: Steps that were to be taken.
        time_step: Step [s].
    """

    def cause(
        samples: dict[str, Array], first: int, last: int, began: float, step: float
    ) -> StepTooLong | None:
        places = np.unique(np.linspace(first, last, SAMPLES).astype(np.int64))
        states = [state_of(samples, k) for k in places]
        slopes = rate_slopes(equations, states, rows, (began + step * places).astype(float))
        return tightest_limit(slopes, time_step)

    first = max(0, broken - REACH)
    found = cause(samples, first, broken, 0.0, time_step)
    if found is None:
        return None
    began, parts = first * time_step, ceil(time_step / found.longest)
    past = min(steps, broken + 1 + (broken - first) // 2)
    count = min((past - first) * parts, BUDGET)
    # flown again, shorter: where the motion itself grows this run breaks too
    step, start = time_step / parts, state_of(samples, first)
    again = integrate(equations, start, rows, count, step, began=began)
    if again.outcome is not Outcome.COMPLETED:
        return None
    # a run about to break is nowhere near its motion: the second one knows better
    return cause(again.samples, 0, count, began, step) or found


STEPS_A_BEAT = 400
"""Steps in a wingbeat where no step is given."""
LONGEST_CHOSEN = 1e-3
"""Longest step where none is given [s]."""
STEPS_A_GUST = 20
"""Steps in a gust that comes and goes where no step is given."""
IMPLICIT_COST = 100
"""Explicit steps that take as long as an implicit one, roughly."""


def chosen_step(
    equations: Equations,
    state: Array,
    rows: Callable[[Array], Array],
    beat: float | None,
    duration: float,
    divided: float,
    implicit: bool,
    gust: float,
) -> float:
    """Step for a flight where none is given [s].

    A 400th of a wingbeat, at which the energy audit of the presets is below 1e-8, a 20th of a gust
    that comes and goes, half the longest step that is stable at the start, or what keeps the
    amplitude of its oscillations, whichever is shortest. Implicit steps need not be so short for
    stability alone.

    Args:
        equations: Equations of the flight.
        state: State at the start, (size,).
        rows: Table rows at given times, (N,) [s] to (N, row_size) [SI].
        beat: Wingbeat [s], or None.
        duration: Duration of the flight [s].
        divided: Time that is a whole number of steps [s].
        implicit: Whether steps are implicit where explicit ones are not stable.
        gust: Duration of the gust, infinite where none comes and goes [s].
    """
    wanted = min(LONGEST_CHOSEN, (beat or np.inf) / STEPS_A_BEAT, gust / STEPS_A_GUST)
    times = np.linspace(0.0, min(beat or duration, duration), SAMPLES)
    slopes = rate_slopes(equations, [state] * SAMPLES, rows, times)
    found = tightest_limit(slopes, 2 * wanted)
    accurate = min([wanted, *map(_accurate_step, slopes)])
    stable = accurate if found is None else 0.5 * found.longest
    if implicit and stable * IMPLICIT_COST < accurate:
        stable = accurate
    return tidy_step(divided, min(accurate, stable))


def _accurate_step(slope: Array) -> float:
    """Longest step that keeps the amplitude of weakly damped oscillations [s].

    In a step h the classic Runge-Kutta method takes the share (w h)^6/144 of the amplitude of an
    oscillation of frequency w. That is at most 5e-6 (w h = .3), or a tenth of what damping takes.
    Modes with a damping ratio above .4 are not counted as oscillations.
    """
    eigenvalues = np.linalg.eigvals(slope).astype(complex)
    rates = np.abs(eigenvalues)
    swings = np.abs(eigenvalues.real) < 0.4 * rates
    damping = np.abs(eigenvalues.real)[swings] / rates[swings]
    steps = np.maximum(0.3, (14.4 * damping) ** 0.2) / rates[swings]
    return float(steps.min(initial=np.inf))


def tidy_step(duration: float, most: float) -> float:
    """Step of one digit (1, 2 or 5) up to a length that divides a duration, or what does [s].

    Args:
        duration: Duration [s].
        most: Longest step [s].
    """
    power = 10.0 ** floor(log10(most))
    step = float(f"{power * max(k for k in (1, 2, 5) if k * power <= most * (1 + 1e-9)):g}")
    steps = duration / step
    return step if abs(steps - round(steps)) < 1e-6 and round(steps) else duration / ceil(steps)


def growth(z: NDArray[np.complex128]) -> Array:
    """Growth in a step of classic Runge-Kutta, |1 + z + z^2/2 + z^3/6 + z^4/24|, as z [-]."""
    return np.abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4))))


def longest_stable_step(eigenvalues: NDArray[np.complex128], time_step: float) -> float:
    """Longest step, up to the given one, at which no mode grows that should not [s].

    Args:
        eigenvalues: Eigenvalues of the derivative of the rate, (N,) [1/s].
        time_step: Longest of interest [s].
    """
    trials = time_step * np.geomspace(1e-9, 1.0, 9000)  # half a percent apart
    z = np.outer(trials, eigenvalues)
    honest = np.exp(np.clip(z.real, 0.0, 700.0))
    with np.errstate(all="ignore"):  # growth beyond all numbers is growth
        stable = (growth(z) <= (1 + _GROWTH) * honest).all(axis=1)
    last = len(trials) if stable.all() else int(np.argmin(stable))
    return float(trials[max(last - 1, 0)])


def rate_slopes(
    equations: Equations,
    states: Sequence[Array],
    rows: Callable[[Array], Array],
    times: Array,
) -> list[Array]:
    """Derivatives of the rate by the state where they are finite, (size, size) each [1/s].

    Args:
        equations: Equations to integrate.
        states: States at some times, (size,) each [SI].
        rows: Table rows at given times, (N,) [s] to (N, row_size) [SI].
        times: Times of the states, (N,) [s].
    """
    table, field = rows(times), equations.field
    if field is not None:
        flown = np.array(states)
        pieces = field.gust_pieces(flown, table, times[0], times[-1])
        table = field.with_gust(flown, table, times, pieces)
    slopes = [
        rate_jacobian(equations.rate, state, row, *equations.constants)
        for state, row in zip(states, table, strict=True)
    ]
    return [slope for slope in slopes if np.isfinite(slope).all()]


def tightest_limit(slopes: Sequence[Array], time_step: float) -> StepTooLong | None:
    """Tightest limit of stability on an explicit step, or None where it is within all.

    Args:
        slopes: Derivatives of the rate by the state, (size, size) each [1/s].
        time_step: Step [s].
    """
    found: StepTooLong | None = None
    for slope in slopes:
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


SPEED_LIMIT = 340.0
"""Speed beyond which a run is stopped: sound [m/s]."""

RATE_LIMIT = 1e5
"""Angular rate beyond which a run is stopped [rad/s]."""

SINGULARITY_REMEDY = (
    "Euler angles are singular at a pitch of 90 degrees; a quaternion is not: "
    'robot.with_attitude("quaternion"), --attitude quaternion of patagium simulate, or '
    "attitude: quaternion in the robot file where the body floats"
)
"""Remedy for a pitch near 90 degrees."""

PITCH_MARGIN = 0.02
"""Distance from the singularity of Euler angles at which a run is stopped [rad]."""


def limits(
    machine: Robot, coordinates: tuple[int, ...], passive: tuple[int, ...], state: Array
) -> tuple[Array, Array]:
    """Limits of a state [q passive, v passive, ...].

    Args:
        machine: The machine.
        coordinates: Places in q of what is integrated.
        passive: Places in v of what is integrated.
        state: Initial state, (size,).

    Returns:
        Lower and upper bounds, (size,) each.
    """
    upper = np.full(state.size, np.inf)
    lower = -upper
    dof_of = {place: dof for dof, place in enumerate(machine.coordinate_indices)}
    units = machine.coordinate_units
    for k, place in enumerate(coordinates):
        if units[place] != "1":  # a quaternion goes where it likes
            lower[k], upper[k] = machine.lower[dof_of[place]], machine.upper[dof_of[place]]
    for k in singular_places(machine, coordinates):
        lower[k] = max(lower[k], PITCH_MARGIN - np.pi / 2)
        upper[k] = min(upper[k], np.pi / 2 - PITCH_MARGIN)
    for k, dof in enumerate(passive, start=len(coordinates)):
        upper[k] = SPEED_LIMIT if machine.dof_units[dof] == "m" else RATE_LIMIT
        lower[k] = -upper[k]
    return lower, upper


def singular_places(machine: Robot, coordinates: tuple[int, ...]) -> tuple[int, ...]:
    """Places in the state of the pitch angles that are integrated."""
    floating = machine.floating_bodies.values()
    angled = [machine.floating_coordinates(body) for body in floating if not body.by_quaternion]
    pitches = {places[4] for places in angled}
    return tuple(k for k, place in enumerate(coordinates) if place in pitches)


def check_start(
    equations: Equations, names: tuple[str, ...], state: Array, singular: tuple[int, ...] = ()
) -> None:
    """Refuse an initial state outside of where it must stay.

    Raises:
        ParameterError: If an entry is beyond its limits.
    """
    for k, name in enumerate(names):
        low, high = equations.lower[k], equations.upper[k]
        if not low <= state[k] <= high:
            if k in singular:
                expected = f"a start from {spoken('rad', low, high)} ({SINGULARITY_REMEDY})"
                raise ParameterError(name, expected, spoken("rad", state[k]) + meant(state[k]))
            raise ParameterError(name, f"a start from {low:.4g} to {high:.4g}", state[k])


def outcome_message(
    run: IntegrationResult,
    names: tuple[str, ...],
    equations: Equations,
    steps: int,
    time_step: float,
    singular: tuple[int, ...] = (),
    cause: StepTooLong | None = None,
) -> str:
    """Message about the end of a run: time, quantity and advice.

    Args:
        run: The run.
        names: Names of the entries of the state.
        equations: Equations that were integrated, with their limits.
        steps: Steps that were to be taken.
        time_step: Step [s].
        singular: Places in the state of pitch angles.
        cause: Why the step was too long, if it was.
    """
    if run.outcome is Outcome.COMPLETED:
        return f"completed {steps} steps of {time_step:g} s"
    when = f"stopped at t = {run.steps * time_step:.6g} s, step {run.steps + 1} of {steps}"
    value, remedy = run.state[run.which], run.outcome.remedy
    if run.outcome is Outcome.INTERRUPTED:
        return f"{when}: interrupted; {remedy}"
    if run.outcome is Outcome.NOT_FINITE:
        others = int((~np.isfinite(run.state)).sum()) - 1
        reason = f"{names[run.which]} became {value}" + (f", and {others} others" if others else "")
        if run.implicit and np.isnan(run.state).all():
            reason = "the implicit step did not converge"
    else:
        low, high = equations.lower[run.which], equations.upper[run.which]
        reason = f"{names[run.which]} reached {value:.4g}, outside of {low:.4g} to {high:.4g}"
        remedy = SINGULARITY_REMEDY if run.which in singular else remedy
    if cause is not None:
        remedy = f"{Outcome.STEP_TOO_LONG.remedy} to {cause.longest:.2g} s or less"
        if not run.implicit:
            too_fast = f"{names[cause.which]}, which answers at {cause.rate:.4g} 1/s"
            remedy = f"the time step is too long for {too_fast}: {remedy}"
    return f"{when}: {reason}; {remedy}"
