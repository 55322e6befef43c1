"""Poses of all bodies at many states at once, compiled."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.dynamics.kinematics import body_poses
from patagium.errors import ShapeError
from patagium.native import load_functions
from patagium.robot.model import Robot

Array = NDArray[np.float64]


def poses_at(robot: Robot, q: ArrayLike) -> tuple[Array, Array]:
    """Origin and axes of every body in the world, at many states.

    A point r fixed to body b is at p_b + R_b r.

    Args:
        robot: The machine.
        q: Generalized coordinates, (N, n_q) [m, rad, 1].

    Returns:
        p, (N, n_bodies, 3) [m], and R, body axes to world axes, (N, n_bodies, 3, 3).

    Raises:
        ShapeError: If `q` is not (N, n_q).
    """
    return Poses(robot)(q)


class Poses:
    """Compiled poses of one robot, for repeated calls.

    Args:
        robot: The machine.
    """

    def __init__(self, robot: Robot) -> None:
        key, label = f"{robot.structure} poses", f"poses of {robot.name}"
        self._function = load_functions(key, lambda: [_poses(robot)], label=label)["poses"]
        self._bodies, self._coordinates = len(robot.bodies), robot.coordinate_count
        self._parameters = robot.parameters

    def __call__(self, q: ArrayLike) -> tuple[Array, Array]:
        """Origins (N, n_bodies, 3) [m] and axes (N, n_bodies, 3, 3) of all bodies in the world.

        Args:
            q: Generalized coordinates, (N, n_q) [m, rad, 1].

        Raises:
            ShapeError: If `q` is not (N, n_q).
        """
        states = np.asarray(q, float)
        if states.ndim != 2 or states.shape[1] != self._coordinates or not len(states):
            raise ShapeError("q", ("N", self._coordinates), states.shape)
        position, rotation = self._function.batch(states, self._parameters)
        shape = (len(states), 3, self._bodies)
        columns = rotation.reshape(len(states), 3, self._bodies, 3)
        return position.reshape(shape).transpose(0, 2, 1), columns.transpose(0, 2, 1, 3)


def _poses(robot: Robot) -> ca.Function:
    machine, parameters = robot.symbolic()
    q = ca.SX.sym("q", robot.coordinate_count)
    poses = body_poses(machine, q)
    position = ca.horzcat(*[pose.position for pose in poses])
    rotation = ca.horzcat(*[pose.rotation for pose in poses])
    names_in, names_out = ["q", "parameters"], ["position", "rotation"]
    return ca.Function("poses", [q, parameters], [position, rotation], names_in, names_out)
