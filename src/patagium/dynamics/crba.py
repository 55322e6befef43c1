"""The mass matrix by the composite-rigid-body algorithm.

Bodies are merged from the tips to the root; the momentum that a unit rate of
each joint gives its composite body is carried on to the root, and its component
along each joint passed is an entry of D.
"""

from __future__ import annotations

import casadi as ca

from patagium.dynamics.added_mass import BodyAddedMass, CompositeAddedMass
from patagium.dynamics.chain import Turn, steps_to, symmetric, vector
from patagium.robot.model import Body, Robot


class _Composite:
    """Mass, first moment and inertia about an origin, and momenta of unit joint rates."""

    def __init__(self) -> None:
        self.mass = ca.SX(0)
        self.first = ca.SX.zeros(3, 1)
        self.inertia = ca.SX.zeros(3, 3)
        self.momenta: list[tuple[int, ca.SX, ca.SX]] = []  # coordinate, linear, angular
        self.fluid = CompositeAddedMass(ca.SX(6, 6))

    def add_body(self, body: Body) -> None:
        center = vector(body.center_of_mass)
        first = center * body.mass
        self.mass = self.mass + body.mass
        self.first = self.first + first
        self.inertia = self.inertia + central_inertia(body) + _shift(first, center)

    def unit_momenta(self, axis: ca.SX, revolute: bool) -> tuple[ca.SX, ca.SX]:
        """Linear and angular momentum at a unit rate about or along an axis, (3, 1) each."""
        if revolute:
            linear, angular = ca.cross(axis, self.first), self.inertia @ axis
        else:
            linear, angular = axis * self.mass, ca.cross(self.first, axis)
        still = ca.SX.zeros(3, 1)
        p, h = self.fluid.momenta(*((still, axis) if revolute else (axis, still)))
        return linear + p, angular + h

    def merge(self, other: _Composite) -> None:
        self.mass = self.mass + other.mass
        self.first = self.first + other.first
        self.inertia = self.inertia + other.inertia
        self.momenta += other.momenta
        self.fluid.merge(other.fluid)

    def turn(self, turned: Turn) -> None:
        self.first = turned.inward(self.first)
        self.inertia = turned.inward_inertia(self.inertia)
        self.momenta = [(k, turned.inward(p), turned.inward(h)) for k, p, h in self.momenta]
        self.fluid.turn(turned)

    def shift(self, offset: ca.SX) -> None:
        """Shift the origin to a point from which the old origin is at `offset`, (3, 1) [m]."""
        twice = self.first + offset * (self.mass / 2)
        self.inertia = self.inertia + _shift(twice, offset) + _shift(offset, twice)
        self.first = self.first + offset * self.mass
        self.momenta = [(k, p, h + ca.cross(offset, p)) for k, p, h in self.momenta]
        self.fluid.shift(offset)


def central_inertia(body: Body) -> ca.SX:
    """Inertia of a body about its centre of mass, body axes, (3, 3) [kg m^2]."""
    xx, yy, zz, xy, xz, yz = body.inertia
    return ca.SX(ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz)))


def mass_matrix(robot: Robot, q: ca.SX, added: BodyAddedMass | None = None) -> ca.SX:
    """Generalized inertia of the robot.

    D(q) = d^2 K / d v^2, the Hessian of the kinetic energy K(q, v) = 1/2 v^T D v.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        added: Added mass of the bodies, sum_b J_b^T M_b J_b; None for a vacuum.

    Returns:
        D, (n, n) [kg, kg m, kg m^2]: symmetric, positive definite; zero between
        coordinates of different branches.

    References:
        Featherstone (2008), Rigid Body Dynamics Algorithms, chapter 6.
    """
    matrix = ca.SX(robot.dof, robot.dof)
    composites = [_Composite() for _ in robot.bodies]
    for index in reversed(range(len(robot.bodies))):
        body, composite = robot.bodies[index], composites[index]
        composite.add_body(body)
        if added is not None and index in added.matrices:
            composite.fluid.merge(CompositeAddedMass(added.matrices[index]))
        for step in reversed(steps_to(robot, body)):
            for unit, dof in zip(step.axes, step.dofs, strict=True):
                axis = vector(unit)
                composite.momenta.append((dof, *composite.unit_momenta(axis, step.turns)))
                for k, p, h in composite.momenta:
                    entry = ca.dot(axis, h if step.turns else p)
                    if not entry.is_zero():
                        matrix[dof, k] = matrix[k, dof] = entry
            if step.turns:
                composite.turn(step.turn(q))
            else:
                composite.shift(step.slide(q))
        if body.parent >= 0:
            composite.shift(vector(body.position))
            composites[body.parent].merge(composite)
    return matrix


def _shift(a: ca.SX, b: ca.SX) -> ca.SX:
    """(a . b) 1 - symmetric part of a b^T, by its upper triangle, (3, 3)."""
    products = a @ b.T
    out = ca.trace(products) * ca.SX.eye(3) - products
    return symmetric(ca.SX(out))
