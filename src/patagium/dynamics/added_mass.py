"""Inertia of the fluid that moves with each body, as CasADi expressions.

A body that moves through an ideal fluid carries with it the energy 1/2 V^T M V, with V its
twist relative to the fluid and M a constant symmetric matrix in its own axes; Kirchhoff's
equations give the force. A steady wind only moves the observer. Neglected: the rate of a wind
that changes (a gust's push on the apparent mass), the fluid between bodies, vorticity and its wake.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from patagium.dynamics.chain import Turn
from patagium.dynamics.kinematics import Twist, body_poses, body_velocities, in_body_axes
from patagium.robot.model import Robot


@dataclass(frozen=True)
class BodyAddedMass:
    """Added mass of the bodies in a fluid that moves.

    Attributes:
        matrices: For a body's index its apparent inertia about the body's origin, (6, 6)
            symmetric, linear before angular, body axes [kg, kg m, kg m^2].
        wind: Velocity of the fluid far away, world axes, (3, 1), or about each body,
            (3, n_bodies) [m/s].
    """

    matrices: Mapping[int, ca.SX]
    wind: ca.SX

    def winds(self, robot: Robot, q: ca.SX) -> list[ca.SX]:
        """Velocity of the fluid about every body, body axes, (3, 1) each [m/s].

        Args:
            robot: The machine.
            q: Generalized coordinates, (n_q,) [m, rad, 1].
        """
        if self.wind.shape[1] == 1:
            return in_body_axes(robot, q, self.wind)
        poses = body_poses(robot, q)
        return [poses[k].rotation.T @ self.wind[:, k] for k in range(len(robot.bodies))]

    def twists(self, robot: Robot, q: ca.SX, v: ca.SX) -> dict[int, Twist]:
        """Motion of every body that carries fluid relative to the fluid, by its index.

        Args:
            robot: The machine.
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
        """
        twists, winds = body_velocities(robot, q, v), self.winds(robot, q)
        return {k: Twist(twists[k].linear - winds[k], twists[k].angular) for k in self.matrices}


class CompositeAddedMass:
    """Apparent inertia of a composite body about an origin, in blocks.

    With linear velocity v of the origin and angular velocity w: linear momentum
    A v + B w, angular momentum B^T v + C w.

    Args:
        matrix: Added mass, (6, 6), symmetric [kg, kg m, kg m^2].
    """

    def __init__(self, matrix: ca.SX) -> None:
        self.a, self.b, self.c = matrix[:3, :3], matrix[:3, 3:], matrix[3:, 3:]

    def momenta(self, v: ca.SX, w: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Linear and angular momentum, (3, 1) each.

        Args:
            v: Velocity of the origin relative to the fluid, (3, 1) [m/s].
            w: Angular velocity, (3, 1) [rad/s].
        """
        return self.a @ v + self.b @ w, self.b.T @ v + self.c @ w

    def merge(self, other: CompositeAddedMass) -> None:
        """Add what another body carries, about the same origin in the same axes."""
        self.a, self.b, self.c = self.a + other.a, self.b + other.b, self.c + other.c

    def turn(self, turned: Turn) -> None:
        """Turn the blocks to the axes before a turn."""
        self.a = turned.inward_inertia(self.a)
        self.c = turned.inward_inertia(self.c)
        self.b = turned.matrix @ self.b @ turned.matrix.T

    def shift(self, offset: ca.SX) -> None:
        """Shift the origin to a point from which the old origin is at `offset`, (3, 1) [m].

        Args:
            offset: Old origin seen from the new one, (3, 1) [m].
        """
        arm = ca.skew(offset)
        moved = self.b - self.a @ arm
        self.c = self.c + arm @ moved - self.b.T @ arm
        self.b = moved


def kirchhoff_wrench(
    matrix: ca.SX, twist: Twist, acceleration: ca.SX, dw: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Force and moment about the origin that the motion of a body through a fluid takes.

    With p = A v + B w and h = B^T v + C w: dp/dt + w x p and dh/dt + w x h + v x p.

    Args:
        matrix: Added mass, (6, 6) [kg, kg m, kg m^2].
        twist: v and w: motion of the body relative to the fluid.
        acceleration: Of the origin, an observer's, in body axes, (3, 1) [m/s^2].
        dw: Angular acceleration, body axes, (3, 1) [rad/s^2].

    References:
        Lamb (1932), Hydrodynamics, sections 121-124.
    """
    fluid, v, w = CompositeAddedMass(matrix), twist.linear, twist.angular
    p, h = fluid.momenta(v, w)
    dp, dh = fluid.momenta(acceleration - ca.cross(w, v), dw)
    return dp + ca.cross(w, p), dh + ca.cross(w, h) + ca.cross(v, p)


def kirchhoff_wrenches(
    robot: Robot,
    q: ca.SX,
    v: ca.SX,
    accelerations: Mapping[int, tuple[ca.SX, ca.SX]],
    added: BodyAddedMass,
) -> dict[int, tuple[ca.SX, ca.SX]]:
    """Kirchhoff's wrench of every body that carries fluid, about its origin, body axes.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        accelerations: For a body's index the acceleration of its origin and its angular
            acceleration, body axes, (3, 1) each.
        added: Added mass of the bodies.
    """
    return {
        body: kirchhoff_wrench(added.matrices[body], twist, *accelerations[body])
        for body, twist in added.twists(robot, q, v).items()
    }


def fluid_momentum(robot: Robot, q: ca.SX, v: ca.SX, added: BodyAddedMass) -> ca.SX:
    """Linear momentum of the fluid that moves with the bodies, world axes, (3, 1) [kg m/s].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        added: Added mass of the bodies.
    """
    poses, total = body_poses(robot, q), ca.SX.zeros(3, 1)
    for body, _, linear, _ in _momenta(robot, q, v, added):
        total = total + poses[body].rotation @ linear
    return total


def fluid_energy(robot: Robot, q: ca.SX, v: ca.SX, added: BodyAddedMass) -> ca.SX:
    """Kinetic energy of the fluid that moves with the bodies, seen from the ground, scalar [J].

    1/2 sum_b V_b^T M_b V_b + wind . momentum: beside the energy of the undisturbed wind.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        added: Added mass of the bodies.
    """
    winds, energy = added.winds(robot, q), ca.SX(0)
    for body, twist, linear, angular in _momenta(robot, q, v, added):
        energy = energy + ca.dot(winds[body], linear)
        energy = energy + (ca.dot(linear, twist.linear) + ca.dot(angular, twist.angular)) / 2
    return energy


def _momenta(
    robot: Robot, q: ca.SX, v: ca.SX, added: BodyAddedMass
) -> list[tuple[int, Twist, ca.SX, ca.SX]]:
    """Body, its twist relative to the fluid, and its fluid's linear and angular momentum."""
    fluids = {body: CompositeAddedMass(matrix) for body, matrix in added.matrices.items()}
    twists = added.twists(robot, q, v)
    return [(k, one, *fluids[k].momenta(one.linear, one.angular)) for k, one in twists.items()]
