"""Where a run may go, and what is said when it goes elsewhere.

Beyond these bounds the equations still give numbers, but not of this machine:
Euler angles are singular at a pitch of 90 degrees, joints have stops that are not
modeled, and air is compressible near the speed of sound.
"""

from __future__ import annotations

import numpy as np

from patagium.errors import Outcome, ParameterError
from patagium.robot import Robot
from patagium.simulation.march import Array, Equations, Run

SPEED_LIMIT = 340.0
"""Speed beyond which a run is stopped: sound [m/s]."""

RATE_LIMIT = 1e5
"""Angular rate beyond which a run is stopped [rad/s]."""

PITCH_MARGIN = 0.02
"""How near to the singularity of Euler angles a run is stopped [rad]."""


def limits(
    machine: Robot, passive: tuple[int, ...], size: int, state: Array
) -> tuple[Array, Array]:
    """Where a state [q passive, v passive, ...] must stay.

    Args:
        machine: The machine.
        passive: Its coordinates that are integrated.
        size: Length of the state.
        state: Where it starts; pitch keeps to the branch it starts on.

    Returns:
        Lower and upper bounds, (size,) each.
    """
    n_u = len(passive)
    upper = np.full(size, np.inf)
    lower = -upper
    lower[:n_u] = [machine.lower[i] for i in passive]
    upper[:n_u] = [machine.upper[i] for i in passive]
    pitches = [b.floating_dofs[4] for b in machine.bodies if b.floating_dofs is not None]
    for k, i in enumerate(passive):
        if i in pitches:
            upright = np.pi * np.round(state[k] / np.pi)
            lower[k] = max(lower[k], upright - np.pi / 2 + PITCH_MARGIN)
            upper[k] = min(upper[k], upright + np.pi / 2 - PITCH_MARGIN)
        bound = SPEED_LIMIT if machine.dof_units[i] == "m" else RATE_LIMIT
        lower[n_u + k], upper[n_u + k] = -bound, bound
    return lower, upper


def check_start(equations: Equations, names: tuple[str, ...], state: Array) -> None:
    """Refuse an initial state outside of where it must stay.

    Raises:
        ParameterError: If an entry is beyond its limits.
    """
    for k, name in enumerate(names):
        low, high = equations.lower[k], equations.upper[k]
        if not low <= state[k] <= high:
            raise ParameterError(name, f"a start from {low:.4g} to {high:.4g}", state[k])


def message_of(
    run: Run, names: tuple[str, ...], equations: Equations, steps: int, time_step: float
) -> str:
    """How a run ended, in words: when, which quantity, what to do."""
    if run.outcome is Outcome.COMPLETED:
        return f"completed {steps} steps of {time_step:g} s"
    when = f"stopped at t = {run.steps * time_step:.6g} s, step {run.steps + 1} of {steps}"
    value = run.state[run.which]
    if run.outcome is Outcome.NOT_FINITE:
        others = int((~np.isfinite(run.state)).sum()) - 1
        reason = f"{names[run.which]} became {value}" + (f", and {others} others" if others else "")
    else:
        low, high = equations.lower[run.which], equations.upper[run.which]
        reason = f"{names[run.which]} reached {value:.4g}, outside of {low:.4g} to {high:.4g}"
    return f"{when}: {reason}; {run.outcome.remedy}"
