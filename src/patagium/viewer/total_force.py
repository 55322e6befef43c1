"""The air's force on the whole robot, and its moment about the center of mass.

Of a floating body the generalized force holds both: along x, y, z it is the force F in the
world; on its attitude it is the moment M_o about its origin, seen by the attitude's rates,

    w_body = J(roll, pitch, yaw) rates,   Q = J^T R^T M_o,   or   Q = R^T M_o

where the attitude is a quaternion, since its rates are w_body. About the center of mass c

    M = M_o - (c - o) x F.

Neglected: the angles' singularity; near a pitch of 90 degrees M is the least that fits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from patagium.robot import Robot
from patagium.robot.attitude import body_rates
from patagium.robot.model import Body

Array = NDArray[np.float64]

_SINGULAR = 1e-3  # cosine of a pitch beyond which the angles say nothing of one direction


class TotalForce(NamedTuple):
    """On the robot, world axes.

    Attributes:
        force: F, (N, 3) [N].
        moment: M, (N, 3) [N m]; None where the attitude's part is not known.
    """

    force: Array
    moment: Array | None


def floating_body(robot: Robot) -> tuple[int, Body] | None:
    """The body that floats, and its number; None if none or several do."""
    found = [(k, body) for k, body in enumerate(robot.bodies) if body.floating_dofs is not None]
    return found[0] if len(found) == 1 else None


def total_force(
    robot: Robot,
    names: tuple[str, ...],
    generalized: Array,
    q: Array,
    rotation: Array,
    arm: Array,
) -> TotalForce | None:
    """Force and moment on the robot from generalized forces; None where they do not tell.

    Args:
        robot: The machine.
        names: Coordinates whose force is known, k.
        generalized: That force, (N, k) [N, N m].
        q: Coordinates, (N, n_q) [m, rad, 1].
        rotation: Floating body's axes to world axes, (N, 3, 3) [-].
        arm: Center of mass from the floating body's origin, world axes, (N, 3) [m].
    """
    floating = floating_body(robot)
    if floating is None:
        return None
    _, body = floating
    wanted = [robot.dof_names[k] for k in body.floating_dofs or ()]
    if not set(wanted[:3]) <= set(names):
        return None
    force = generalized[:, [names.index(name) for name in wanted[:3]]]
    if not set(wanted) <= set(names):
        return TotalForce(force, None)
    turning = generalized[:, [names.index(name) for name in wanted[3:]]]
    if not body.by_quaternion:
        angles = q[:, list(robot.floating_coordinates(body))[3:]]
        columns = [body_rates(angles, np.broadcast_to(e, angles.shape)) for e in np.eye(3)]
        # rows e of J^T: what a rate of one angle is in body axes
        turning = (np.linalg.pinv(np.stack(columns, axis=1), rcond=_SINGULAR) @ turning[..., None])[
            ..., 0
        ]
    about_origin = (rotation @ turning[..., None])[..., 0]
    return TotalForce(force, about_origin - np.cross(arm, force))
