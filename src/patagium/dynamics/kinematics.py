"""Kinematics: poses and velocities of all bodies, as CasADi expressions.

Poses in world axes, velocities in body axes, points, Jacobians, and the
transposed Jacobian that maps forces on bodies to generalized ones. dq/dt = N(q) v is
here, for everything that differentiates by q or integrates it.
Observer: the inertial world.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from patagium.dynamics.chain import steps_to, vector
from patagium.robot.model import Robot


@dataclass(frozen=True)
class Pose:
    """Pose of a body.

    Attributes:
        position: Origin in world axes, (3, 1) [m].
        rotation: Body axes to world axes, (3, 3) [-].
    """

    position: ca.SX
    rotation: ca.SX

    def at(self, offset: ca.SX) -> ca.SX:
        """Position of a point of the body at an offset in body axes, world axes, (3, 1) [m]."""
        return self.position + self.rotation @ offset


@dataclass(frozen=True)
class Twist:
    """Velocity and angular velocity of a body, in its own axes.

    Attributes:
        linear: Velocity of the origin, (3, 1) [m/s].
        angular: Angular velocity, (3, 1) [rad/s].
    """

    linear: ca.SX
    angular: ca.SX

    def at(self, offset: ca.SX) -> ca.SX:
        """Velocity of a point of the body at an offset, both in body axes, (3, 1) [m/s]."""
        return self.linear + ca.cross(self.angular, offset)


def coordinate_rates(robot: Robot, q: Any, v: Any) -> Any:
    """Rates of the coordinates, dq/dt = N(q) v, (n_q, 1) [m/s, rad/s, 1/s].

    v itself, but for a quaternion: dq/dt = 1/2 q (0, w), with w in body axes. That keeps the
    length of any quaternion, and turns one of any length alike.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1]; SX or MX, as v.
        v: Generalized velocities, (n,) [m/s, rad/s].
    """
    if robot.coordinate_count == robot.dof:
        return v
    rates: list[Any] = [None] * robot.coordinate_count
    for dof, place in enumerate(robot.coordinate_indices):
        rates[place] = v[dof]
    for body in robot.bodies:
        if not body.by_quaternion or body.floating_dofs is None:
            continue
        places = robot.floating_coordinates(body)[3:]
        w, x, y, z = (q[k] for k in places)
        a, b, c = (v[k] / 2 for k in body.floating_dofs[3:])
        turned = (
            *(-(x * a + y * b + z * c), w * a + y * c - z * b),
            *(w * b + z * a - x * c, w * c + x * b - y * a),
        )
        for place, rate in zip(places, turned, strict=True):
            rates[place] = rate
    return ca.vertcat(*rates)


def body_poses(robot: Robot, q: ca.SX) -> list[Pose]:
    """Origin and axes of every body in the world.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].

    Returns:
        One pose a body; the rotations are proper.
    """
    poses, world = list[Pose](), Pose(ca.SX.zeros(3, 1), ca.SX.eye(3))
    for body in robot.bodies:
        before = poses[body.parent] if body.parent >= 0 else world
        position, rotation = before.at(vector(body.position)), before.rotation
        for step in steps_to(robot, body):
            if step.turns:
                rotation = rotation @ step.turn(q).matrix
            else:
                position = position + rotation @ step.slide(q)
        poses.append(Pose(position, rotation))
    return poses


def body_velocities(robot: Robot, q: ca.SX, v: ca.SX) -> list[Twist]:
    """Velocity of the origin and angular velocity of every body, in body axes.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].

    Returns:
        One twist a body.
    """
    twists, world = list[Twist](), Twist(ca.SX.zeros(3, 1), ca.SX.zeros(3, 1))
    for body in robot.bodies:
        before = twists[body.parent] if body.parent >= 0 else world
        linear, angular = before.at(vector(body.position)), before.angular
        for step in steps_to(robot, body):
            if step.turns:
                turned = step.turn(q)
                linear = turned.outward(linear)
                angular = turned.outward(angular) + step.along(v)
            else:
                linear = linear + ca.cross(angular, step.slide(q)) + step.along(v)
        twists.append(Twist(linear, angular))
    return twists


def in_body_axes(robot: Robot, q: ca.SX, direction: ca.SX) -> list[ca.SX]:
    """A vector of the world in the axes of every body, (3, 1) each.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        direction: The vector in world axes, (3, 1), in any unit of its own.
    """
    turned: list[ca.SX] = []
    for body in robot.bodies:
        local = turned[body.parent] if body.parent >= 0 else direction
        for step in steps_to(robot, body):
            if step.turns:
                local = step.turn(q).outward(local)
        turned.append(local)
    return turned


def point_position(robot: Robot, q: ca.SX, body: int, offset: ca.SX) -> ca.SX:
    """Position of a point fixed to a body, world axes, (3, 1) [m].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        body: Index of the body.
        offset: The point from the body's origin, body axes, (3, 1) [m].
    """
    return body_poses(robot, q)[body].at(offset)


def point_velocity(robot: Robot, q: ca.SX, v: ca.SX, body: int, offset: ca.SX) -> ca.SX:
    """Velocity of a point fixed to a body, world axes, (3, 1) [m/s].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        body: Index of the body.
        offset: The point from the body's origin, body axes, (3, 1) [m].
    """
    twist = body_velocities(robot, q, v)[body]
    return body_poses(robot, q)[body].rotation @ twist.at(offset)


def point_jacobian(robot: Robot, q: ca.SX, body: int, offset: ca.SX) -> ca.SX:
    """Jacobian J of a point: its velocity in world axes is J v, (3, n) [1, m].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        body: Index of the body.
        offset: The point from the body's origin, body axes, (3, 1) [m].
    """
    v = ca.SX.sym("v", robot.dof)
    return ca.jacobian(point_velocity(robot, q, v, body, offset), v)


def add_wrench(
    wrenches: dict[int, tuple[ca.SX, ca.SX]], body: int, force: ca.SX, moment: ca.SX
) -> None:
    """Add a force and a moment about a body's origin, (3, 1) each [N, N m], to those on the body.

    Args:
        wrenches: Force and moment for a body's index, body axes, (3, 1) each [N, N m].
        body: Index of the body.
        force: Further force, body axes, (3, 1) [N].
        moment: Further moment about the body's origin, body axes, (3, 1) [N m].
    """
    total = wrenches.get(body, (ca.SX.zeros(3, 1), ca.SX.zeros(3, 1)))
    wrenches[body] = (total[0] + force, total[1] + moment)


def generalized_force(robot: Robot, q: ca.SX, wrenches: Mapping[int, tuple[ca.SX, ca.SX]]) -> ca.SX:
    """Generalized force of forces and moments on the bodies, (n, 1) [N, N m].

    Q = sum_b J_b^T f_b + Jw_b^T m_b, gathered from the tips to the root.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        wrenches: For a body's index the force (3, 1) [N] and the moment about the
            body's origin (3, 1) [N m], both in body axes.

    References:
        Featherstone (2008), Rigid Body Dynamics Algorithms, section 5.3 (backward pass).
    """
    zero = ca.SX.zeros(3, 1)
    gathered, generalized = dict(wrenches), ca.SX.zeros(robot.dof, 1)
    for index in reversed(range(len(robot.bodies))):
        body = robot.bodies[index]
        force, moment = gathered.get(index, (zero, zero))
        for step in reversed(steps_to(robot, body)):
            for axis, dof in zip(step.axes, step.dofs, strict=True):
                generalized[dof] = ca.dot(vector(axis), moment if step.turns else force)
            if step.turns:
                turned = step.turn(q)
                force = turned.inward(force)
                moment = turned.inward(moment)
            else:
                moment = moment + ca.cross(step.slide(q), force)
        if body.parent >= 0:
            add_wrench(gathered, body.parent, force, moment)
            add_wrench(gathered, body.parent, zero, ca.cross(vector(body.position), force))
    return generalized
