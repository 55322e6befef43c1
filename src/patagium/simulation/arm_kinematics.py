"""Kinematics of an arm's tool, and the torques of its joints.

The tool is a frame fixed to a body of the arm. Many states at a time, compiled. Neglected:
the load on the tool; elasticity and friction of the joints.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from patagium.dynamics.chain import cross
from patagium.dynamics.equations import damping_force, inverse
from patagium.dynamics.kinematics import body_poses, body_velocities
from patagium.native import load_functions
from patagium.robot import Robot
from patagium.robot.attitude import rotation_from_angles
from patagium.robot.model import Axis
from patagium.simulation.gait_models import PrescribedMotion

Array: TypeAlias = NDArray[np.float64]


class Tool:
    """A frame on an arm as functions of its joints.

    Args:
        arm: The arm.
        at: Name of the body that carries the frame.
        position: Its origin in that body's axes, (3,) [m].
        orientation: Roll, pitch, yaw of its axes in that body's, (3,) [rad].

    Raises:
        ParameterError: If there is no such body.
    """

    def __init__(self, arm: Robot, at: str, position: Axis, orientation: Axis) -> None:
        body = arm.body_index(at)
        placed = np.concatenate([position, rotation_from_angles(orientation).ravel(order="F")])
        self._parameters = np.concatenate([arm.parameters, placed])
        self._functions = load_functions(
            f"tool {arm.structure} {body}",
            lambda: _functions(arm, body),
            label=f"tool of {arm.name}",
            many_only=["pose", "drift", "torque"],
        )

    def pose(self, q: Array) -> tuple[Array, Array, Array]:
        """Position (N, 3) [m], rotation to the world (N, 3, 3) and Jacobian (N, 6, n).

        Args:
            q: Joint positions, (N, n) [rad, m].
        """
        position, turn, jacobian = self._functions["pose"].batch(q, self._parameters)
        return np.array(position), np.array(turn), np.array(jacobian)

    def drift(self, q: Array, v: Array) -> Array:
        """Acceleration of the tool without that of the joints, dJ/dt v, (N, 6).

        Args:
            q: Joint positions, (N, n) [rad, m].
            v: Joint velocities, (N, n) [rad/s, m/s].
        """
        return np.array(self._functions["drift"].batch(q, v, self._parameters))

    def follow(self, q: Array, target: PrescribedMotion) -> PrescribedMotion:
        """Motion of the joints that keeps the tool on a path.

        v = J^-1 twist, a = J^-1 (its rate - dJ/dt v).

        Args:
            q: Joint positions that put it there, (N, n) [rad, m].
            target: The path, x, y, z, roll, pitch, yaw, (N, 6) each [m, rad].
        """
        twist, change = path_twist(target)
        _, _, jacobian = self.pose(q)
        v = solve_each(jacobian, twist)
        return PrescribedMotion(q, v, solve_each(jacobian, change - self.drift(q, v)))

    def torque(self, motion: PrescribedMotion) -> Array:
        """Force or torque of each joint, load left out, (N, n) [N m, N]."""
        moved = motion.position, motion.velocity, motion.acceleration
        return np.array(self._functions["torque"].batch(*moved, self._parameters))


def _functions(arm: Robot, body: int) -> list[ca.Function]:
    machine, own = arm.symbolic()
    placed = ca.SX.sym("placed", 12)
    p, offset, turn = ca.vertcat(own, placed), placed[:3], ca.reshape(placed[3:], 3, 3)
    q, v, a = (ca.SX.sym(name, arm.dof) for name in "qva")
    pose, twist = body_poses(machine, q)[body], body_velocities(machine, q, v)[body]
    place = pose.position + pose.rotation @ offset
    linear = pose.rotation @ (twist.linear + cross(twist.angular, offset))
    moves = ca.vertcat(linear, pose.rotation @ twist.angular)
    outputs = [place, pose.rotation @ turn, ca.jacobian(moves, v)]
    drift = ca.jtimes(moves, q, v)
    torque = inverse(machine, q, v, a) - damping_force(machine, v)
    dense = [ca.densify(k) for k in outputs]
    return [
        ca.Function("pose", [q, p], dense, ["q", "parameters"], ["place", "turn", "jacobian"]),
        ca.Function("drift", [q, v, p], [ca.densify(drift)], ["q", "v", "parameters"], ["drift"]),
        ca.Function("torque", [q, v, a, p], [torque], ["q", "v", "a", "parameters"], ["torque"]),
    ]


def solve_each(matrices: Array, right: Array) -> Array:
    """Solutions of square systems, (N, n), one right-hand side each.

    Args:
        matrices: Matrices, (N, n, n) [SI].
        right: Right-hand sides, (N, n) [SI].
    """
    return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0], np.float64)


def path_twist(motion: PrescribedMotion) -> tuple[Array, Array]:
    """Velocity and acceleration of a path: linear, then angular, world axes, (N, 6) each.

    w = sum_k e_k rate_k over the axes e of roll, pitch and yaw in the world.

    Args:
        motion: Of x, y, z, roll, pitch, yaw, (N, 6) each [m, rad].
    """
    rates, second = motion.velocity[:, 3:], motion.acceleration[:, 3:]
    axes, turned = _euler_axes(motion.position[:, 4:], rates[:, 1:])
    spin = np.einsum("nij,nj->ni", axes, rates)
    spun = np.einsum("nij,nj->ni", axes, second) + np.einsum("nij,nj->ni", turned, rates)
    return (
        np.hstack([motion.velocity[:, :3], spin]),
        np.hstack([motion.acceleration[:, :3], spun]),
    )


def _euler_axes(angles: Array, rates: Array) -> tuple[Array, Array]:
    """Axes of roll, pitch, yaw in the world as columns, and their rates, (N, 3, 3) each."""
    pitch, yaw = angles.T
    pitching, yawing = rates.T
    cp, sp, cy, sy = np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    none = np.zeros_like(pitch)
    roll_axis = [cy * cp, sy * cp, -sp]
    roll_rate = [
        -sy * cp * yawing - cy * sp * pitching,
        cy * cp * yawing - sy * sp * pitching,
        -cp * pitching,
    ]
    pitch_axis, pitch_rate = [-sy, cy, none], [-cy * yawing, -sy * yawing, none]
    axes: Any = [roll_axis, pitch_axis, [none, none, none + 1.0]]
    changes: Any = [roll_rate, pitch_rate, [none, none, none]]
    return np.transpose(np.array(axes), (2, 1, 0)), np.transpose(np.array(changes), (2, 1, 0))


def rotation_vector(matrix: Array) -> Array:
    """Axis times angle of rotations, (N, 3) [rad]; of a half turn one of its two axes.

    Args:
        matrix: Rotations, (N, 3, 3) [-].
    """
    skew = np.stack(
        [
            matrix[:, 2, 1] - matrix[:, 1, 2],
            matrix[:, 0, 2] - matrix[:, 2, 0],
            matrix[:, 1, 0] - matrix[:, 0, 1],
        ],
        axis=1,
    )
    sine = np.linalg.norm(skew, axis=1) / 2
    cosine = (np.trace(matrix, axis1=1, axis2=2) - 1) / 2
    angle = np.arctan2(sine, cosine)
    scale = np.where(sine > 1e-9, angle / np.where(sine > 1e-9, 2 * sine, 1.0), 0.5)
    return np.asarray(skew * scale[:, None])
