"""Equations of motion by differentiating the energies: the oracle of the recursive ones.

K(q, v) and U(q) are written body by body, then D = d^2 K / d v^2,
C v = (d(D v)/dq) v - dK/dq and G = dU/dq by algorithmic differentiation. Poses are
multiplied out from the world here; only the order of a body's joints is shared with
the recursive algorithms. Symbols may be SX (short C) or MX (as the published experiment did it;
long C). Slow: about ten times the arithmetic. Neglected: what `Robot` neglects.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import casadi as ca

from patagium.dynamics.chain import joint_chain
from patagium.robot.model import Axis, Body, Robot

Symbol: TypeAlias = "ca.SX | ca.MX"


def energy_mass_matrix(robot: Robot, q: Symbol) -> Symbol:
    """Generalized inertia as the Hessian of the kinetic energy.

    D(q) = d^2 K / d v^2.

    Args:
        robot: Machine whose bodies carry the inertia.
        q: Generalized coordinates, (n,) [m, rad].

    Returns:
        D, (n, n) [kg, kg m, kg m^2]: symmetric, positive definite.
    """
    v = type(q).sym("v", robot.dof)
    hessian, _ = ca.hessian(energy_kinetic(robot, q, v), v)
    return ca.densify(hessian)


def energy_coriolis(robot: Robot, q: Symbol, v: Symbol) -> Symbol:
    """Coriolis and centrifugal force from the gradients of the kinetic energy.

    C(q, v) v = (d(D v)/dq) v - dK/dq, with D v = dK/dv.

    Args:
        robot: Machine whose bodies carry the inertia.
        q: Generalized coordinates, (n,) [m, rad].
        v: Generalized velocities, (n,) [m/s, rad/s].

    Returns:
        C v, (n,) [N, N m].
    """
    kinetic = energy_kinetic(robot, q, v)
    momentum = ca.gradient(kinetic, v)
    return ca.densify(ca.jtimes(momentum, q, v) - ca.gradient(kinetic, q))


def energy_gravity(robot: Robot, q: Symbol) -> Symbol:
    """Gravity force as the gradient of the potential energy.

    G(q) = dU/dq.

    Args:
        robot: Machine whose bodies carry the mass.
        q: Generalized coordinates, (n,) [m, rad].

    Returns:
        G, (n,) [N, N m].
    """
    return ca.densify(ca.gradient(energy_potential(robot, q), q))


def energy_kinetic(robot: Robot, q: Symbol, v: Symbol) -> Symbol:
    """Kinetic energy, a sum over the bodies.

    K = sum 1/2 m |dc/dt|^2 + 1/2 w^T I w, where c is the centre of mass in world
    axes and w the angular velocity in body axes.

    Args:
        robot: Machine whose bodies carry the inertia.
        q: Generalized coordinates, (n,) [m, rad].
        v: Generalized velocities, (n,) [m/s, rad/s].

    Returns:
        K, scalar [J].
    """
    kinetic: Any = 0
    for body, center, turned in _walk(robot, q, v):
        velocity = ca.jtimes(center, q, v)
        kinetic += body.mass * ca.dot(velocity, velocity) / 2
        kinetic += ca.dot(turned, _inertia(body, q) @ turned) / 2
    return kinetic


def energy_potential(robot: Robot, q: Symbol) -> Symbol:
    """Potential energy of gravity, zero at the height of the world origin.

    U = g sum m c_z.

    Args:
        robot: Machine whose bodies carry the mass.
        q: Generalized coordinates, (n,) [m, rad].

    Returns:
        U, scalar [J].
    """
    bodies = _walk(robot, q, type(q)(robot.dof, 1))
    return sum((robot.gravity * body.mass * center[2] for body, center, _ in bodies), type(q)(0))


def _walk(robot: Robot, q: Symbol, v: Symbol) -> Iterator[tuple[Body, Symbol, Symbol]]:
    """Each body, its centre of mass in world axes and its angular velocity in body axes."""
    origin = (ca.DM(3, 1), ca.DM.eye(3), ca.DM(3, 1))
    frames: list[tuple[Any, Any, Any]] = []
    for body in robot.bodies:
        position, rotation, turned = origin if body.parent < 0 else frames[body.parent]
        orientation = ca.sparsify(ca.DM(body.orientation))
        position = position + rotation @ ca.vertcat(*body.position)
        rotation, turned = rotation @ orientation, orientation.T @ turned
        for joint in joint_chain(body):
            axis = ca.sparsify(ca.DM(joint.axis))
            if joint.kind == "prismatic":
                position = position + rotation @ (axis * q[joint.dof])
                continue
            turn = _turn(joint.axis, q[joint.dof])
            rotation = rotation @ turn
            turned = turn.T @ turned + axis * v[joint.dof]
        frames.append((position, rotation, turned))
        yield body, position + rotation @ ca.vertcat(*body.center_of_mass), turned


def _turn(axis: Axis, angle: Symbol) -> Symbol:
    """Rotation about a unit axis: a a^T + cos (1 - a a^T) + sin [a]."""
    along = ca.DM(axis) @ ca.DM(axis).T
    across, skew = ca.DM.eye(3) - along, ca.skew(ca.DM(axis))
    along, across, skew = (ca.sparsify(m) for m in (along, across, skew))
    return along + ca.cos(angle) * across + ca.sin(angle) * skew


def _inertia(body: Body, q: Symbol) -> Symbol:
    """Inertia about the centre of mass in body axes, zero entries left out, (3, 3)."""
    xx, yy, zz, xy, xz, yz = body.inertia
    matrix = type(q)(3, 3)
    entries = {(0, 0): xx, (1, 1): yy, (2, 2): zz, (0, 1): xy, (0, 2): xz, (1, 2): yz}
    for (row, column), value in entries.items():
        if not isinstance(value, (int, float)) or value != 0:
            matrix[row, column] = matrix[column, row] = value
    return matrix
