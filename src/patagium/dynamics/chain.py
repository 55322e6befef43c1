"""Every joint as a chain of one-coordinate steps, and how each step turns and shifts.

A floating body is the chain x, y, z, yaw, pitch, roll; a fixed one the empty
chain. With that, each recursive algorithm knows only two kinds of step.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from patagium.robot.model import Axis, Body, Joint, Robot

_FLOATING: tuple[tuple[str, int, Axis], ...] = (
    ("prismatic", 0, (1.0, 0.0, 0.0)),
    ("prismatic", 1, (0.0, 1.0, 0.0)),
    ("prismatic", 2, (0.0, 0.0, 1.0)),
    ("revolute", 5, (0.0, 0.0, 1.0)),
    ("revolute", 4, (0.0, 1.0, 0.0)),
    ("revolute", 3, (1.0, 0.0, 0.0)),
)


def joint_chain(body: Body) -> tuple[Joint, ...]:
    """Steps from the parent to the body, in order; six for a floating body."""
    if body.floating_dofs is None:
        return body.joints
    return tuple(
        Joint(f"{body.name}.{k}", kind, axis, body.floating_dofs[k])  # type: ignore[arg-type]
        for kind, k, axis in _FLOATING
    )


def parent_coordinates(robot: Robot) -> tuple[int, ...]:
    """For each coordinate the coordinate before it on the way to the root, -1 at the root, (n,)."""
    parents = [-1] * robot.dof
    last: list[int] = []
    for body in robot.bodies:
        previous = last[body.parent] if body.parent >= 0 else -1
        for joint in joint_chain(body):
            parents[joint.dof] = previous
            previous = joint.dof
        last.append(previous)
    return tuple(parents)


def vector(values: Any) -> ca.SX:
    """Three numbers or symbols as a column, (3, 1)."""
    return ca.vertcat(*[ca.SX(value) for value in values])


def cross(a: ca.SX, b: ca.SX) -> ca.SX:
    """Cross product a x b, (3, 1)."""
    return ca.vertcat(
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    )


class Turn:
    """A rotation about a fixed axis: R maps the turned axes' components to the axes before.

    For a coordinate axis a vector costs four products and an inertia nine;
    for any other axis the full matrix is applied.

    Args:
        axis: Unit axis, (3,).
        angle: Angle, scalar [rad].
    """

    def __init__(self, axis: Axis, angle: ca.SX) -> None:
        sine, cosine = ca.sin(angle), ca.cos(angle)
        self.cyclic: tuple[int, int, int] | None = None
        for k in range(3):
            if abs(axis[k]) == 1.0:
                self.cyclic = (k, (k + 1) % 3, (k + 2) % 3)
                sine = sine * axis[k]
        self.sine, self.cosine = sine, cosine
        self.matrix = rotation(axis, angle)

    def outward(self, w: ca.SX) -> ca.SX:
        """R^T w: components before the turn to components after it, (3, 1)."""
        return self.matrix.T @ w

    def inward(self, w: ca.SX) -> ca.SX:
        """R w: components after the turn to components before it, (3, 1)."""
        return self.matrix @ w

    def inward_inertia(self, inertia: ca.SX) -> ca.SX:
        """R I R^T of a symmetric matrix, (3, 3)."""
        if self.cyclic is None:
            turned = self.matrix @ inertia @ self.matrix.T
            return symmetric(turned)
        k, i, j = self.cyclic
        s, c = self.sine, self.cosine
        # planar rotation of the (i, j) block by one shared factor u
        u = s * (inertia[i, i] - inertia[j, j]) + 2 * (c * inertia[i, j])
        moved = s * u
        out = ca.SX(3, 3)
        out[k, k] = inertia[k, k]
        out[i, i] = inertia[i, i] - moved
        out[j, j] = inertia[j, j] + moved
        out[i, j] = out[j, i] = c * u - inertia[i, j]
        out[i, k] = out[k, i] = c * inertia[i, k] - s * inertia[j, k]
        out[j, k] = out[k, j] = s * inertia[i, k] + c * inertia[j, k]
        return out


def rotation(axis: Axis, angle: ca.SX) -> ca.SX:
    """Rodrigues' rotation about a unit axis, (3, 3)."""
    s, c = ca.sin(angle), ca.cos(angle)
    x, y, z = axis

    def diagonal(a: float) -> ca.SX:
        return a * a + c * (1.0 - a * a)

    return ca.vertcat(
        ca.horzcat(diagonal(x), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s),
        ca.horzcat(x * y * (1 - c) + z * s, diagonal(y), y * z * (1 - c) - x * s),
        ca.horzcat(x * z * (1 - c) - y * s, y * z * (1 - c) + x * s, diagonal(z)),
    )


def symmetric(matrix: ca.SX) -> ca.SX:
    """The matrix whose lower triangle repeats the upper one, (3, 3)."""
    out = ca.SX(matrix)
    for i in range(3):
        for j in range(i):
            out[i, j] = matrix[j, i]
    return out


def orientation_matrix(body: Body) -> ca.SX:
    """Constant rotation of the joint axes to the parent's, (3, 3)."""
    return ca.SX(ca.DM([list(row) for row in body.orientation]))


def is_identity(body: Body) -> bool:
    """Whether the joint axes are the parent's at zero coordinates."""
    return body.orientation == ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
