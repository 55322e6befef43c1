"""Equations of motion of a robot as CasADi expressions.

D(q) a + C(q, v) v + G(q) = u1 + Q, with G the force of gravity and of springs: symbols in,
symbols out, for any robot whose numbers are floats or symbols. `Dynamics` compiles them; an
optimal control problem may use them as they are. Neglected: elasticity of bodies other than
plates (`robot.flexible`), friction, contact.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from patagium.dynamics.added_mass import BodyAddedMass, fluid_energy, fluid_momentum
from patagium.dynamics.chain import parent_coordinates, vector
from patagium.dynamics.crba import central_inertia, mass_matrix
from patagium.dynamics.factorization import solve
from patagium.dynamics.kinematics import body_poses, body_velocities
from patagium.dynamics.rnea import kirchhoff_force, newton_euler
from patagium.robot.model import Robot

__all__ = [
    "BodyAddedMass",
    "angular_momentum",
    "kirchhoff_force",
    "bias",
    "center_of_mass",
    "coriolis",
    "damping_force",
    "fluid_energy",
    "fluid_momentum",
    "forward",
    "forward_prescribed",
    "gravity_force",
    "inverse",
    "kinetic_energy",
    "mass_matrix",
    "momentum",
    "potential_energy",
    "response",
    "spring_force",
]


def inverse(
    robot: Robot, q: ca.SX, v: ca.SX, a: ca.SX, added: BodyAddedMass | None = None
) -> ca.SX:
    """Generalized force of a motion, D a + C v + G, of carried fluid too, (n, 1) [N, N m].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        a: Generalized accelerations, (n,) [m/s^2, rad/s^2].
        added: Added mass of the bodies; None for a vacuum.
    """
    return newton_euler(robot, q, v, a, ca.SX(robot.gravity), added) + spring_force(robot, q)


def spring_force(robot: Robot, q: ca.SX) -> ca.SX:
    """Force that deflects the springs of the joints, (n, 1) [N, N m].

    It is k (q - rest), and c k times the difference of the deflections of two coupled joints.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
    """
    return _coupled(robot, robot.stiffness or (0,) * robot.dof, _deflection(robot, q))


def _coupled(robot: Robot, factors: Sequence[Any], values: ca.SX) -> ca.SX:
    """Factors times values of the joints, with the couplings between them, (n, 1) [N, N m]."""
    factor = vector(factors)
    force = factor * values
    for inner, outer, coupling in robot.couplings:
        between = coupling * factor[outer] * (values[outer] - values[inner])
        force[outer] += between
        force[inner] -= between
    return force


def _deflection(robot: Robot, q: ca.SX) -> ca.SX:
    """Deflection of the springs of the joints, (n, 1) [m, rad]."""
    return q[list(robot.coordinate_indices)] - vector(robot.rest or (0,) * robot.dof)


def bias(robot: Robot, q: ca.SX, v: ca.SX, added: BodyAddedMass | None = None) -> ca.SX:
    """Coriolis, gravity and spring force, C v + G, of carried fluid too, (n, 1) [N, N m].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        added: Added mass of the bodies; None for a vacuum.
    """
    return inverse(robot, q, v, ca.SX.zeros(robot.dof, 1), added)


def coriolis(robot: Robot, q: ca.SX, v: ca.SX) -> ca.SX:
    """Coriolis and centrifugal force, C(q, v) v, (n, 1) [N, N m].

    C v = (d(D v)/dq) v - dK/dq; it does no work in excess of D's change.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
    """
    return newton_euler(robot, q, v, ca.SX.zeros(robot.dof, 1), ca.SX(0))


def gravity_force(robot: Robot, q: ca.SX) -> ca.SX:
    """Force of gravity and of springs, G = dU/dq, (n, 1) [N, N m].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
    """
    return bias(robot, q, ca.SX.zeros(robot.dof, 1))


def forward(
    robot: Robot, q: ca.SX, v: ca.SX, f: ca.SX, added: BodyAddedMass | None = None
) -> ca.SX:
    """Acceleration of the free robot, a = D^-1 (f - C v - G), (n, 1) [m/s^2, rad/s^2].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        f: Every generalized force but inertia and gravity, (n,) [N, N m].
        added: Added mass of the bodies; None for a vacuum.
    """
    matrix = mass_matrix(robot, q, added)
    return solve(matrix, f - bias(robot, q, v, added), parent_coordinates(robot))


def forward_prescribed(
    robot: Robot,
    q: ca.SX,
    v: ca.SX,
    a_prescribed: ca.SX,
    f: ca.SX,
    prescribed: Sequence[int] | None = None,
    added: BodyAddedMass | None = None,
) -> tuple[ca.SX, ca.SX]:
    """Acceleration and constraint force where some coordinates follow a motion exactly.

    With u the free and a the prescribed coordinates: D_uu a_u = f_u - h_u - D_ua a_a,
    and the force that keeps the motion is D_au a_u + D_aa a_a + h_a - f_a, h = C v + G.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        a_prescribed: Accelerations of the prescribed coordinates, (n_a,) [m/s^2, rad/s^2].
        f: Every generalized force but inertia, gravity and the constraint's, (n,) [N, N m].
        prescribed: Indices of the prescribed coordinates; the actuated ones by default.
        added: Added mass of the bodies; None for a vacuum.

    Returns:
        a, (n, 1), and the constraint force, (n, 1), zero in the free coordinates.
    """
    held = list(robot.actuated if prescribed is None else prescribed)
    free = [i for i in range(robot.dof) if i not in held]
    a, force = ca.SX.zeros(robot.dof, 1), ca.SX.zeros(robot.dof, 1)
    a[held] = a_prescribed
    residual = f - inverse(robot, q, v, a, added)
    force[held] = -residual[held, 0]
    if free:
        a[free], matrix = response(robot, q, residual[free], tuple(free), added)
        force[held] = ca.mac(matrix[held, free], a[free], force[held, 0])
    return a, force


def response(
    robot: Robot, q: ca.SX, force: ca.SX, free: tuple[int, ...], added: BodyAddedMass | None
) -> tuple[ca.SX, ca.SX]:
    """Accelerations of free coordinates by forces on them, (m, k), and the mass matrix, (n, n).

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        force: Generalized forces, (m, k) [N, N m].
        free: Coordinates that are free; all others are still.
        added: Added mass of the bodies; None for a vacuum.
    """
    matrix, selected = mass_matrix(robot, q, added), list(free)
    return solve(matrix[selected, selected], force, _parents_among(robot, free)), matrix


def _parents_among(robot: Robot, selected: tuple[int, ...]) -> tuple[int, ...]:
    """Tree of the selected coordinates: each hangs on its nearest selected ancestor."""
    parents = parent_coordinates(robot)
    nearest = []
    for i in selected:
        k = parents[i]
        while k >= 0 and k not in selected:
            k = parents[k]
        nearest.append(selected.index(k) if k >= 0 else -1)
    return tuple(nearest)


def damping_force(robot: Robot, v: ca.SX) -> ca.SX:
    """Force of the passive dampers, -d v, coupled as springs are, (n, 1) [N, N m].

    Args:
        robot: The machine.
        v: Generalized velocities, (n,) [m/s, rad/s].
    """
    return -_coupled(robot, robot.damping, v)


def center_of_mass(robot: Robot, q: ca.SX) -> ca.SX:
    """Center of mass of the robot, world axes, (3, 1) [m].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
    """
    moment = ca.SX.zeros(3, 1)
    for body, pose in zip(robot.bodies, body_poses(robot, q), strict=True):
        moment = moment + body.mass * pose.at(vector(body.center_of_mass))
    return moment / robot.mass


def potential_energy(robot: Robot, q: ca.SX) -> ca.SX:
    """Potential energy of gravity and springs, m g z + 1/2 k (q - rest)^2, scalar [J].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
    """
    springs = ca.dot(spring_force(robot, q), _deflection(robot, q)) / 2
    return robot.mass * robot.gravity * center_of_mass(robot, q)[2] + springs


def kinetic_energy(robot: Robot, q: ca.SX, v: ca.SX) -> ca.SX:
    """Kinetic energy, the sum over bodies of m |v_c|^2 / 2 + w . I w / 2, scalar [J].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
    """
    energy = ca.SX(0)
    for body, twist in zip(robot.bodies, body_velocities(robot, q, v), strict=True):
        velocity = twist.at(vector(body.center_of_mass))
        spin = central_inertia(body) @ twist.angular
        energy = energy + body.mass * ca.dot(velocity, velocity) / 2
        energy = energy + ca.dot(twist.angular, spin) / 2
    return energy


def momentum(robot: Robot, q: ca.SX, v: ca.SX) -> ca.SX:
    """Linear momentum, world axes, (3, 1) [kg m/s].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
    """
    return _momenta(robot, q, v)[0]


def angular_momentum(robot: Robot, q: ca.SX, v: ca.SX) -> ca.SX:
    """Angular momentum about the world's origin, world axes, (3, 1) [kg m^2/s].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
    """
    return _momenta(robot, q, v)[1]


def _momenta(robot: Robot, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX]:
    linear, angular = ca.SX.zeros(3, 1), ca.SX.zeros(3, 1)
    poses, twists = body_poses(robot, q), body_velocities(robot, q, v)
    for body, pose, twist in zip(robot.bodies, poses, twists, strict=True):
        center = vector(body.center_of_mass)
        velocity = pose.rotation @ twist.at(center)
        spin = pose.rotation @ (central_inertia(body) @ twist.angular)
        linear = linear + body.mass * velocity
        arm = pose.at(center)
        angular = angular + spin + ca.cross(arm, body.mass * velocity)
    return linear, angular
