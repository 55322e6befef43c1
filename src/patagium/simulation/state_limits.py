"""Limits of the state in a flight, and messages about a violation.

Beyond these bounds the equations still give numbers, but not of this machine:
Euler angles are singular at a pitch of 90 degrees, joints have stops that are not
modeled, and air is compressible near the speed of sound.
"""

from __future__ import annotations

import numpy as np

from patagium.errors import Outcome, ParameterError
from patagium.robot import Robot
from patagium.simulation.runge_kutta import Array, Equations, IntegrationResult
from patagium.simulation.stiffness import StepTooLong

SPEED_LIMIT = 340.0
"""Speed beyond which a run is stopped: sound [m/s]."""

RATE_LIMIT = 1e5
"""Angular rate beyond which a run is stopped [rad/s]."""

SINGULARITY_REMEDY = (
    "Euler angles are singular at a pitch of 90 degrees; a quaternion is not: "
    'robot.with_attitude("quaternion"), --attitude quaternion of patagium simulate, or '
    "attitude: quaternion in the robot file where the body floats"
)
"""What to do about a pitch near 90 degrees."""

PITCH_MARGIN = 0.02
"""How near to the singularity of Euler angles a run is stopped [rad]."""


def limits(
    machine: Robot, coordinates: tuple[int, ...], passive: tuple[int, ...], state: Array
) -> tuple[Array, Array]:
    """Limits of a state [q passive, v passive, ...].

    Args:
        machine: The machine.
        coordinates: Places in q of what is integrated.
        passive: Places in v of what is integrated.
        state: Where it starts, (size,); pitch keeps to the branch it starts on.

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
        upright = np.pi * np.round(state[k] / np.pi)
        lower[k] = max(lower[k], upright - np.pi / 2 + PITCH_MARGIN)
        upper[k] = min(upper[k], upright + np.pi / 2 - PITCH_MARGIN)
    for k, dof in enumerate(passive, start=len(coordinates)):
        upper[k] = SPEED_LIMIT if machine.dof_units[dof] == "m" else RATE_LIMIT
        lower[k] = -upper[k]
    return lower, upper


def singular_places(machine: Robot, coordinates: tuple[int, ...]) -> tuple[int, ...]:
    """Places in the state of the pitch angles that are integrated.

    Args:
        machine: The machine.
        coordinates: Places in q of what is integrated.
    """
    floating = [body for body in machine.bodies if body.floating_dofs is not None]
    angled = [machine.floating_coordinates(body) for body in floating if not body.by_quaternion]
    pitches = {places[4] for places in angled}
    return tuple(k for k, place in enumerate(coordinates) if place in pitches)


def check_start(
    equations: Equations, names: tuple[str, ...], state: Array, singular: tuple[int, ...] = ()
) -> None:
    """Refuse an initial state outside of where it must stay.

    Args:
        equations: Equations to integrate, with their limits.
        names: Of the entries of the state.
        state: Where it starts, (size,).
        singular: Places in it of pitch angles.

    Raises:
        ParameterError: If an entry is beyond its limits.
    """
    for k, name in enumerate(names):
        low, high = equations.lower[k], equations.upper[k]
        if not low <= state[k] <= high:
            hint = f" ({SINGULARITY_REMEDY})" if k in singular else ""
            raise ParameterError(name, f"a start from {low:.4g} to {high:.4g}{hint}", state[k])


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
        names: Of the entries of the state.
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
    if run.outcome is Outcome.NOT_FINITE:
        others = int((~np.isfinite(run.state)).sum()) - 1
        reason = f"{names[run.which]} became {value}" + (f", and {others} others" if others else "")
    else:
        low, high = equations.lower[run.which], equations.upper[run.which]
        reason = f"{names[run.which]} reached {value:.4g}, outside of {low:.4g} to {high:.4g}"
        remedy = SINGULARITY_REMEDY if run.which in singular else remedy
    if cause is not None:
        remedy = (
            f"the time step is too long for {names[cause.which]}, which answers at "
            f"{cause.rate:.4g} 1/s: {Outcome.STEP_TOO_LONG.remedy} to {cause.longest:.2g} s or less"
        )
    return f"{when}: {reason}; {remedy}"
