"""Inverse dynamics by the recursive Newton-Euler algorithm.

Conventional accelerations are carried outwards in body axes, forces inwards.
The velocity of the root never enters (Galilean invariance). A body's inertia
enters through its mass, first moment h = m c and second moment
S = integral r r^T dm about its origin, with which force and moment of the
acceleration field a + W r, W = [dw]x + [w]x^2, are m a + W h and
h x a + integral r x (W r) dm.

Neglected: friction; springs and passive damping are forces of `equations`, not part of this.
"""

from __future__ import annotations

import casadi as ca

from patagium.dynamics.added_mass import BodyAddedMass, kirchhoff_wrenches
from patagium.dynamics.chain import steps_to, vector
from patagium.dynamics.kinematics import add_wrench, generalized_force, in_body_axes
from patagium.robot.model import Body, Robot


def newton_euler(
    robot: Robot,
    q: ca.SX,
    v: ca.SX,
    a: ca.SX,
    gravity: ca.SX,
    added: BodyAddedMass | None = None,
) -> ca.SX:
    """Generalized force of a motion, D a + C v + G.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        a: Generalized accelerations, (n,) [m/s^2, rad/s^2].
        gravity: Acceleration of free fall along -z, scalar [m/s^2].
        added: Added mass of the bodies; None for a vacuum.

    Returns:
        Generalized force, (n, 1) [N, N m]; linear in a.

    References:
        Luh, Walker and Paul (1980); Featherstone (2008), section 5.3.
    """
    states = body_accelerations(robot, q, v, a, gravity)
    wrenches = {
        index: _inertial_wrench(body, _field(w, dw), acceleration)
        for index, (body, (w, dw, acceleration)) in enumerate(
            zip(robot.bodies, states, strict=True)
        )
    }
    if added is not None:
        ground = in_body_axes(robot, q, ca.vertcat(0, 0, gravity))  # its acceleration is no fluid's
        accelerations = {k: (state[2] - ground[k], state[1]) for k, state in enumerate(states)}
        fluid = kirchhoff_wrenches(robot, q, v, accelerations, added)
        for index, wrench in fluid.items():
            add_wrench(wrenches, index, *wrench)
    return generalized_force(robot, q, wrenches)


def kirchhoff_force(robot: Robot, q: ca.SX, v: ca.SX, a: ca.SX, added: BodyAddedMass) -> ca.SX:
    """Generalized force of the fluid that the bodies carry along, (n, 1) [N, N m].

    -(d/dt dT/dv - dT/dq), with T the fluid's kinetic energy: what is missing from the
    force that `newton_euler` asks for in a vacuum.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        a: Generalized accelerations, (n,) [m/s^2, rad/s^2].
        added: Added mass of the bodies.
    """
    states = body_accelerations(robot, q, v, a, ca.SX(0))
    accelerations = {k: (states[k][2], states[k][1]) for k in added.matrices}
    return -generalized_force(robot, q, kirchhoff_wrenches(robot, q, v, accelerations, added))


def body_accelerations(
    robot: Robot, q: ca.SX, v: ca.SX, a: ca.SX, gravity: ca.SX
) -> list[tuple[ca.SX, ca.SX, ca.SX]]:
    """Angular velocity and acceleration of every body, and what an accelerometer feels.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n,) [m, rad].
        v: Generalized velocities, (n,) [m/s, rad/s].
        a: Generalized accelerations, (n,) [m/s^2, rad/s^2].
        gravity: Acceleration of free fall along -z, scalar [m/s^2].

    Returns:
        For each body, in body axes: angular velocity (3, 1) [rad/s], angular acceleration
        (3, 1) [rad/s^2], acceleration of the origin less that of free fall (3, 1) [m/s^2].
    """
    states: list[tuple[ca.SX, ca.SX, ca.SX]] = []
    ground = (ca.SX.zeros(3, 1), ca.SX.zeros(3, 1), ca.vertcat(0, 0, gravity))
    for body in robot.bodies:
        w, dw, acceleration = states[body.parent] if body.parent >= 0 else ground
        acceleration = acceleration + _field(w, dw) @ vector(body.position)
        for step in steps_to(robot, body):
            if step.turns:
                turned = step.turn(q)
                w, dw = turned.outward(w), turned.outward(dw)
                acceleration = turned.outward(acceleration)
                spin = step.along(v)
                dw = dw + step.along(a) + ca.cross(w, spin)
                w = w + spin
            else:
                acceleration = (
                    acceleration
                    + _field(w, dw) @ step.slide(q)
                    + ca.cross(w, step.along(2 * v))
                    + step.along(a)
                )
        states.append((w, dw, acceleration))
    return states


def _field(w: ca.SX, dw: ca.SX) -> ca.SX:
    """Gradient W of the acceleration field of a turning body, (3, 3) [1/s^2]."""
    xy, xz, yz = w[0] * w[1], w[0] * w[2], w[1] * w[2]
    xx, yy, zz = w[0] * w[0], w[1] * w[1], w[2] * w[2]
    return ca.vertcat(
        ca.horzcat(-yy - zz, xy - dw[2], xz + dw[1]),
        ca.horzcat(xy + dw[2], -xx - zz, yz - dw[0]),
        ca.horzcat(xz - dw[1], yz + dw[0], -xx - yy),
    )


def _inertial_wrench(body: Body, field: ca.SX, acceleration: ca.SX) -> tuple[ca.SX, ca.SX]:
    first = vector(body.center_of_mass) * body.mass
    moment = field @ second_moment(body)
    turning = ca.vertcat(
        moment[2, 1] - moment[1, 2], moment[0, 2] - moment[2, 0], moment[1, 0] - moment[0, 1]
    )
    return acceleration * body.mass + field @ first, ca.cross(first, acceleration) + turning


def second_moment(body: Body) -> ca.SX:
    """Second moment of mass about the body's origin, integral r r^T dm, (3, 3) [kg m^2]."""
    xx, yy, zz, xy, xz, yz = body.inertia
    central = ca.vertcat(
        ca.horzcat((yy + zz - xx) / 2, -xy, -xz),
        ca.horzcat(-xy, (xx + zz - yy) / 2, -yz),
        ca.horzcat(-xz, -yz, (xx + yy - zz) / 2),
    )
    center = vector(body.center_of_mass)
    return ca.SX(central) + (center * body.mass) @ center.T
