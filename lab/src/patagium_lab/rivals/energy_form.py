"""Equations of motion by differentiating the energies: the oracle of the recursive ones.

K(q, v) and U(q) are written body by body, then D = d^2 K / d v^2, C v = d(D v)/dt - dK/dq and G =
dU/dq by algorithmic differentiation, with dq/dt = N(q) v: where the velocities are not rates of
coordinates, the equations of Boltzmann and Hamel. Poses are multiplied out from the world here;
only the order of a body's joints and N are shared with the recursive algorithms. Symbols may be
SX (short C) or MX (as the published experiment did it; long C). Slow: about ten times the
arithmetic. Neglected: what `Robot` neglects.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import casadi as ca

from patagium.dynamics.chain import chain_of
from patagium.dynamics.kinematics import coordinate_rates
from patagium.robot.model import Axis, Body, Robot

Symbol: TypeAlias = "ca.SX | ca.MX"


def energy_mass_matrix(robot: Robot, q: Symbol) -> Symbol:
    """Generalized inertia as the Hessian of the kinetic energy.

    D(q) = d^2 K / d v^2.

    Args:
        robot: Machine whose bodies carry the inertia.
        q: Generalized coordinates, (n_q,) [m, rad, 1].

    Returns:
        D, (n, n) [kg, kg m, kg m^2]: symmetric, positive definite.
    """
    v = type(q).sym("v", robot.dof)
    hessian, _ = ca.hessian(energy_kinetic(robot, q, v), v)
    return ca.densify(hessian)


def energy_coriolis(robot: Robot, q: Symbol, v: Symbol) -> Symbol:
    """Coriolis and centrifugal force from the gradients of the kinetic energy.

    C(q, v) v = (dp/dq) N v - N^T dK/dq, with p = D v = dK/dv; on the rates w of a
    quaternion w x p_w besides.

    Args:
        robot: Machine whose bodies carry the inertia.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].

    Returns:
        C v, (n,) [N, N m].

    References:
        Hamel (1904), Die Lagrange-Eulerschen Gleichungen der Mechanik.
    """
    kinetic, rates = energy_kinetic(robot, q, v), coordinate_rates(robot, q, v)
    momentum = ca.gradient(kinetic, v)
    force = ca.jtimes(momentum, q, rates) - _along_velocities(robot, kinetic, q)
    for body in robot.bodies:
        if body.by_quaternion and body.floating_dofs is not None:
            turns = list(body.floating_dofs[3:])
            force[turns] += ca.cross(v[turns], momentum[turns])
    return ca.densify(force)


def energy_gravity(robot: Robot, q: Symbol) -> Symbol:
    """Gravity force as the gradient of the potential energy.

    G(q) = N^T dU/dq.

    Args:
        robot: Machine whose bodies carry the mass.
        q: Generalized coordinates, (n_q,) [m, rad, 1].

    Returns:
        G, (n,) [N, N m].
    """
    return ca.densify(_along_velocities(robot, energy_potential(robot, q), q))


def energy_kinetic(robot: Robot, q: Symbol, v: Symbol) -> Symbol:
    """Kinetic energy, a sum over the bodies.

    K = sum 1/2 m |dc/dt|^2 + 1/2 w^T I w, where c is the centre of mass in world
    axes and w the angular velocity in body axes.

    Args:
        robot: Machine whose bodies carry the inertia.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].

    Returns:
        K, scalar [J].
    """
    kinetic: Any = 0
    for body, center, turned in _walk(robot, q, v):
        velocity = ca.jtimes(center, q, coordinate_rates(robot, q, v))
        kinetic += body.mass * ca.dot(velocity, velocity) / 2
        kinetic += ca.dot(turned, _inertia(body, q) @ turned) / 2
    return kinetic


def energy_potential(robot: Robot, q: Symbol) -> Symbol:
    """Potential energy of gravity, zero at the height of the world origin.

    U = g sum m c_z.

    Args:
        robot: Machine whose bodies carry the mass.
        q: Generalized coordinates, (n_q,) [m, rad, 1].

    Returns:
        U, scalar [J].
    """
    bodies = _walk(robot, q, type(q)(robot.dof, 1))
    return sum((robot.gravity * body.mass * center[2] for body, center, _ in bodies), type(q)(0))


def _along_velocities(robot: Robot, energy: Symbol, q: Symbol) -> Symbol:
    """N(q)^T dE/dq: how an energy changes with what each velocity moves, (n, 1)."""
    slope = ca.gradient(energy, q)
    if robot.coordinate_count == robot.dof:
        return slope
    v = type(q).sym("v", robot.dof)
    return ca.gradient(ca.dot(coordinate_rates(robot, q, v), slope), v)


def _walk(robot: Robot, q: Symbol, v: Symbol) -> Iterator[tuple[Body, Symbol, Symbol]]:
    """Each body, its centre of mass in world axes and its angular velocity in body axes."""
    origin = (ca.DM(3, 1), ca.DM.eye(3), ca.DM(3, 1))
    frames: list[tuple[Any, Any, Any]] = []
    for body in robot.bodies:
        position, rotation, turned = origin if body.parent < 0 else frames[body.parent]
        orientation = ca.sparsify(ca.DM(body.orientation))
        position = position + rotation @ ca.vertcat(*body.position)
        rotation, turned = rotation @ orientation, orientation.T @ turned
        for step in chain_of(robot, body):
            if len(step.dofs) > 1:
                turn = _quaternion_turn(q[list(step.coordinates)])
                rotation = rotation @ turn
                turned = turn.T @ turned + v[list(step.dofs)]
                continue
            axis, coordinate = ca.sparsify(ca.DM(step.axes[0])), q[step.coordinates[0]]
            if not step.turns:
                position = position + rotation @ (axis * coordinate)
                continue
            turn = _turn(step.axes[0], coordinate)
            rotation = rotation @ turn
            turned = turn.T @ turned + axis * v[step.dofs[0]]
        frames.append((position, rotation, turned))
        yield body, position + rotation @ ca.vertcat(*body.center_of_mass), turned


def _turn(axis: Axis, angle: Symbol) -> Symbol:
    """Rotation about a unit axis: a a^T + cos (1 - a a^T) + sin [a]."""
    along = ca.DM(axis) @ ca.DM(axis).T
    across, skew = ca.DM.eye(3) - along, ca.skew(ca.DM(axis))
    along, across, skew = (ca.sparsify(m) for m in (along, across, skew))
    return along + ca.cos(angle) * across + ca.sin(angle) * skew


def _quaternion_turn(quaternion: Symbol) -> Symbol:
    """Rotation by a quaternion (w, u): ((w^2 - u.u) 1 + 2 u u^T + 2 w [u]) / (w^2 + u.u)."""
    w, u = quaternion[0], quaternion[1:]
    square = ca.dot(u, u)
    turn = (w * w - square) * ca.DM.eye(3) + 2 * (u @ u.T) + 2 * w * ca.skew(u)
    return turn / (w * w + square)


def _inertia(body: Body, q: Symbol) -> Symbol:
    """Inertia about the centre of mass in body axes, zero entries left out, (3, 3)."""
    xx, yy, zz, xy, xz, yz = body.inertia
    matrix = type(q)(3, 3)
    entries = {(0, 0): xx, (1, 1): yy, (2, 2): zz, (0, 1): xy, (0, 2): xz, (1, 2): yz}
    for (row, column), value in entries.items():
        if not isinstance(value, (int, float)) or value != 0:
            matrix[row, column] = matrix[column, row] = value
    return matrix
