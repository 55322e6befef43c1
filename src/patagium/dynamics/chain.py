"""Every joint as a chain of steps, and how each step turns and shifts.

A floating body is the chain x, y, z, yaw, pitch, roll, or x, y, z and one turn by a
quaternion; a fixed one the empty chain. Joint axes that are not the parent's are one more step
before it, which turns and has no velocity. With that, each recursive algorithm knows only two
kinds of step: one that slides, one that turns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from patagium.robot.model import Axis, Body, Robot

_AXES = _X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_TURNS = ((5, _Z), (4, _Y), (3, _X))


@dataclass(frozen=True)
class Step:
    """One step of a chain.

    Attributes:
        turns: Whether it turns; else it slides.
        axes: The unit axis of each of its velocities, in the axes after the step.
        dofs: Places of the velocities in v: one, or the three of a quaternion.
        coordinates: Places of the coordinates in q: one, or the four of a quaternion.
    """

    turns: bool
    axes: tuple[Axis, ...]
    dofs: tuple[int, ...]
    coordinates: tuple[int, ...]

    def turn(self, q: ca.SX) -> Turn:
        """The rotation that a step which turns makes.

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
        """
        if len(self.coordinates) == 1:
            return AxisTurn(self.axes[0], q[self.coordinates[0]])
        return QuaternionTurn(q[list(self.coordinates)])

    def slide(self, q: ca.SX) -> ca.SX:
        """The displacement of a step which slides, (3, 1) [m].

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
        """
        return vector(self.axes[0]) * q[self.coordinates[0]]

    def along(self, v: ca.SX) -> ca.SX:
        """Velocities, accelerations or forces of the step as one vector, (3, 1).

        Args:
            v: Velocities, accelerations or forces of all degrees of freedom, (n,) [SI].
        """
        if len(self.dofs) == 1:
            return vector(self.axes[0]) * v[self.dofs[0]]
        return v[list(self.dofs)]


def chain_of(robot: Robot, body: Body) -> tuple[Step, ...]:
    """Steps from the parent to the body, in order."""
    if body.floating_dofs is None:
        places = robot.coordinate_indices
        return tuple(
            Step(joint.kind == "revolute", (joint.axis,), (joint.dof,), (places[joint.dof],))
            for joint in body.joints
        )
    dofs, coordinates = body.floating_dofs, robot.floating_coordinates(body)
    slides = [Step(False, (axis,), (dofs[k],), (coordinates[k],)) for k, axis in enumerate(_AXES)]
    if body.by_quaternion:
        return (*slides, Step(True, _AXES, dofs[3:], coordinates[3:]))
    turns = [Step(True, (axis,), (dofs[k],), (coordinates[k],)) for k, axis in _TURNS]
    return (*slides, *turns)


@dataclass(frozen=True)
class _JointAxes(Step):
    """Constant rotation from the parent's axes to those of the joint."""

    matrix: ca.SX

    def turn(self, q: ca.SX) -> Turn:
        return Turn(self.matrix)

    def along(self, v: ca.SX) -> ca.SX:
        return ca.SX.zeros(3, 1)


def steps_to(robot: Robot, body: Body) -> tuple[Step, ...]:
    """Steps from the parent's axes at the body's position to the body, in order."""
    if body.orientation == _AXES:
        return chain_of(robot, body)
    matrix = ca.SX(ca.DM([list(row) for row in body.orientation]))
    return (_JointAxes(True, (), (), (), matrix), *chain_of(robot, body))


def parent_coordinates(robot: Robot) -> tuple[int, ...]:
    """For each entry of v the one before it on the way to the root, -1 at the root, (n,)."""
    parents = [-1] * robot.dof
    last: list[int] = []
    for body in robot.bodies:
        previous = last[body.parent] if body.parent >= 0 else -1
        for dof in (dof for step in chain_of(robot, body) for dof in step.dofs):
            parents[dof] = previous
            previous = dof
        last.append(previous)
    return tuple(parents)


def vector(values: Any) -> ca.SX:
    """Numbers or symbols as a column, three as (3, 1)."""
    return ca.vertcat(*[ca.SX(value) for value in values])


class Turn:
    """A rotation by its matrix R, which maps turned axes' components to the axes before.

    Args:
        matrix: R, (3, 3) [-].
    """

    def __init__(self, matrix: ca.SX) -> None:
        self.matrix = matrix

    def outward(self, w: ca.SX) -> ca.SX:
        """R^T w of a vector, (3, 1) [any unit]: components before the turn to those after it."""
        return self.matrix.T @ w

    def inward(self, w: ca.SX) -> ca.SX:
        """R w of a vector, (3, 1) [any unit]: components after the turn to those before it."""
        return self.matrix @ w

    def inward_inertia(self, inertia: ca.SX) -> ca.SX:
        """R I R^T of a symmetric matrix, (3, 3).

        Args:
            inertia: Symmetric matrix after the turn, (3, 3) [kg m^2].
        """
        return symmetric(self.matrix @ inertia @ self.matrix.T)


class AxisTurn(Turn):
    """Rodrigues' rotation about a fixed axis.

    For a coordinate axis a vector costs four products and an inertia nine;
    for any other axis the full matrix is applied.

    Args:
        axis: Unit axis, (3,) [-].
        angle: Angle, scalar [rad].
    """

    def __init__(self, axis: Axis, angle: ca.SX) -> None:
        s, c = ca.sin(angle), ca.cos(angle)

        def times(factor: float, value: ca.SX) -> ca.SX | float:
            return factor * value if factor else 0.0  # an operation of CasADi takes 30 us

        x, y, z = axis
        xx, yy, zz = (k * k + times(1.0 - k * k, c) for k in axis)
        xy, xz, yz = (times(k, 1 - c) for k in (x * y, x * z, y * z))
        xs, ys, zs = (times(k, s) for k in axis)
        entries = (xx, xy + zs, xz - ys, xy - zs, yy, yz + xs, xz + ys, yz - xs, zz)
        super().__init__(ca.reshape(ca.vertcat(*entries), 3, 3))
        self.cyclic: tuple[int, int, int] | None = None
        self.sine, self.cosine = s, c
        for k in range(3):
            if abs(axis[k]) == 1.0:
                self.cyclic = (k, (k + 1) % 3, (k + 2) % 3)
                self.sine = s * axis[k]

    def inward_inertia(self, inertia: ca.SX) -> ca.SX:
        """R I R^T of a symmetric matrix, (3, 3); see `Turn.inward_inertia`."""
        if self.cyclic is None:
            return super().inward_inertia(inertia)
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


class QuaternionTurn(Turn):
    """A rotation by a quaternion of any length but zero, scalar first.

    R = 1 + 2 (w [u] + [u]^2) / |q|^2, with q = (w, u): a rotation also where an integrator's
    stage has left the unit sphere by a little.

    Args:
        quaternion: qw, qx, qy, qz, (4, 1) [-].
    """

    def __init__(self, quaternion: ca.SX) -> None:
        w, x, y, z = ca.vertsplit(quaternion)
        s = 2 / (w * w + x * x + y * y + z * z)
        sx, sy, sz = s * x, s * y, s * z
        xx, yy, zz = sx * x, sy * y, sz * z
        xy, xz, yz = sx * y, sx * z, sy * z
        wx, wy, wz = sx * w, sy * w, sz * w
        rows = (
            ca.horzcat(1 - (yy + zz), xy - wz, xz + wy),
            ca.horzcat(xy + wz, 1 - (xx + zz), yz - wx),
            ca.horzcat(xz - wy, yz + wx, 1 - (xx + yy)),
        )
        super().__init__(ca.vertcat(*rows))


def symmetric(matrix: ca.SX) -> ca.SX:
    """The matrix, (3, 3) [any unit], whose lower triangle repeats the upper one."""
    return ca.triu2symm(ca.triu(matrix))
