"""Whether an arm can: singularities, and limits of position, speed, acceleration and torque.

Judged at the knots of a path, in the order of time within each kind of limit. Torques are
those of the arm alone. Neglected: the load on the tool, jerk, power.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from patagium.errors import PathError
from patagium.robot import Robot
from patagium.simulation.arm_kinematics import Array, Tool
from patagium.simulation.gait_models import PrescribedMotion
from patagium.simulation.paths import Path

CLEARANCE = 0.03
"""Least singular value of the Jacobian, lengths in reaches of the arm, that is no singularity."""
CLOSED = 1e-10
"""How far the tool may be from the path [m, rad]."""


def check_branch(arm: Robot, tool: Tool, time: Array, target: PrescribedMotion, q: Array) -> float:
    """Clearance from singularities of a branch that the arm can follow.

    Args:
        arm: The arm.
        tool: Tool that follows the path.
        time: Knots, (K,) [s].
        target: The path there.
        q: Joint positions there, (K, n) [rad, m]; not finite from where there are none.

    Returns:
        Least singular value of the Jacobian, lengths in reaches of the arm.

    Raises:
        PathError: At the first time when it cannot.
    """
    sound = np.isfinite(q).all(axis=1)
    count = len(time) if sound.all() else int(np.argmin(sound))
    _, _, jacobian = tool.pose(q[:count])
    reach = sum(float(np.linalg.norm(np.asarray(b.position, float))) for b in arm.bodies)
    scaled = jacobian / np.array([reach] * 3 + [1.0] * 3)[:, None]
    clearance = np.linalg.svd(scaled, compute_uv=False)[:, -1]
    if clearance.min() < CLEARANCE:
        k = int(np.argmax(clearance < CLEARANCE))
        quantity = "inverse clearance from a singularity"
        raise PathError(time[k], "", quantity, 1 / clearance[k], 1 / CLEARANCE, "")
    if count < len(time):
        raise PathError(time[count], "", "distance of the tool from the path", np.inf, CLOSED, "m")
    part = PrescribedMotion(
        *(k[:count] for k in (target.position, target.velocity, target.acceleration))
    )
    _check_limits(arm, tool, time, tool.follow(q[:count], part))
    return float(clearance.min())


def _check_limits(arm: Robot, tool: Tool, time: Array, motion: PrescribedMotion) -> None:
    none = (np.inf,) * arm.dof
    quantities: list[tuple[str, Array, Sequence[float], tuple[str, str]]] = [
        ("position", motion.position, arm.upper, ("rad", "m")),
        ("position", -motion.position, tuple(-k for k in arm.lower), ("rad", "m")),
        ("speed", np.abs(motion.velocity), arm.speed_limit or none, ("rad/s", "m/s")),
        (
            *("acceleration", np.abs(motion.acceleration)),
            *(arm.acceleration_limit or none, ("rad/s^2", "m/s^2")),
        ),
    ]
    if arm.effort_limit:
        effort = np.abs(tool.torque(motion))
        quantities.append(("torque", effort, arm.effort_limit, ("N m", "N")))
    for number, (name, values, most, units) in enumerate(quantities):
        beyond = values > np.array(most)
        if beyond.any():
            k = int(np.argmax(beyond.any(axis=1)))
            joint = int(np.argmax(beyond[k]))
            sign = -1.0 if number == 1 else 1.0
            unit = units[0] if arm.dof_units[joint] == "rad" else units[1]
            value, limit = sign * values[k, joint], sign * most[joint]
            raise PathError(time[k], arm.dof_names[joint], name, value, limit, unit)


def check_period(arm: Robot, path: Path, q: Array) -> None:
    """A periodic path must bring every joint back: a turn too many cannot go on for ever.

    Args:
        arm: The arm.
        path: Path of the tool.
        q: Joint positions over one period, (K, n) [rad, m].

    Raises:
        PathError: If a joint is elsewhere after a period.
    """
    if not path.period:
        return
    gone = np.abs(q[-1] - q[0])
    joint = int(np.argmax(gone))
    if gone[joint] > 1e-6:
        name, unit = arm.dof_names[joint], arm.dof_units[joint]
        raise PathError(path.period, name, "gain a period", gone[joint], 0.0, unit)
