"""Energy, momentum, symmetry: what no formulation of the equations may break."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.dynamics import equations

PRESETS = ["aerobat", "aerobat-published", "aerobat-beta", "yeo-wing"]
ROUNDING = 1e-11  # differentiated expressions, some hundred roundings


@pytest.fixture(params=PRESETS)
def robot(request):
    return pt.load_robot(request.param)


def test_mass_matrix_is_symmetric_positive_definite(robot, rng):
    matrices = pt.Dynamics(robot).batch.mass_matrix(rng.normal(size=(200, robot.dof)))
    np.testing.assert_array_equal(matrices, matrices.transpose(0, 2, 1))
    assert float(np.linalg.eigvalsh(matrices).min()) > 0


def test_coriolis_force_only_moves_energy_between_coordinates(robot, rng):
    """Power of C v: v . (C v) = 1/2 v^T dD/dt v, that is, D' - 2 C is skew."""
    q, v = ca.SX.sym("q", robot.dof), ca.SX.sym("v", robot.dof)
    rate = ca.jtimes(equations.kinetic_energy(robot, q, v), q, v)
    power = ca.dot(v, equations.coriolis(robot, q, v))
    both = ca.Function("both", [q, v], [rate, power])
    for _ in range(20):
        left, right = (float(x) for x in both(*rng.normal(size=(2, robot.dof))))
        assert left == pytest.approx(right, rel=ROUNDING)


def test_kinetic_energy_is_the_mass_matrix_form_and_gravity_its_slope(robot, rng):
    dyn = pt.Dynamics(robot)
    q = ca.SX.sym("q", robot.dof)
    slope = ca.Function("s", [q], [ca.gradient(equations.potential_energy(robot, q), q)])
    for _ in range(10):
        x, u = rng.normal(size=(2, robot.dof))
        assert dyn.kinetic_energy(x, u) == pytest.approx(u @ dyn.mass_matrix(x) @ u / 2, rel=1e-12)
        np.testing.assert_allclose(dyn.gravity(x), np.array(slope(x)).ravel(), atol=1e-13)


def test_free_motion_keeps_energy_and_momentum(robot, rng):
    """Rates along the free motion: d(K + U)/dt = 0, dp/dt = m g, dl/dt = r_c x m g."""
    n = robot.dof
    q, v, a = (ca.SX.sym(name, n) for name in "qva")
    energy = equations.kinetic_energy(robot, q, v) + equations.potential_energy(robot, q)
    linear = equations.momentum(robot, q, v)
    angular = equations.angular_momentum(robot, q, v)

    def rate(x):
        return ca.jtimes(x, q, v) + ca.jtimes(x, v, a)

    rates = ca.Function("r", [q, v, a], [rate(energy), rate(linear), rate(angular)])
    dyn = pt.Dynamics(robot)
    weight = np.array([0.0, 0.0, -dyn.mass_matrix(np.zeros(n))[0, 0] * robot.gravity])
    for _ in range(10):
        x, u = rng.normal(size=(2, n))
        acceleration = dyn.forward(x, u, np.zeros(n))
        d_energy, d_linear, d_angular = (np.array(r).ravel() for r in rates(x, u, acceleration))
        scale = max(1.0, float(np.abs(acceleration).max())) * max(1.0, dyn.kinetic_energy(x, u))
        assert abs(float(d_energy[0])) < ROUNDING * scale
        if robot.floating:
            np.testing.assert_allclose(d_linear, weight, atol=ROUNDING * scale)
            moment = np.cross(dyn.center_of_mass(x), weight)
            np.testing.assert_allclose(d_angular, moment, atol=ROUNDING * scale)


@pytest.mark.parametrize("name", ["aerobat", "aerobat-published", "aerobat-beta"])
def test_a_mirrored_state_has_the_mirrored_acceleration(name, rng):
    robot = pt.load_robot(name)
    dyn = pt.Dynamics(robot)
    order, sign = [], np.ones(robot.dof)
    for i, dof in enumerate(robot.dof_names):
        other = dof.replace("left_", "*").replace("right_", "left_").replace("*", "right_")
        order.append(robot.index(other))
        if dof in ("y", "roll", "yaw"):
            sign[i] = -1.0

    def mirror(x):
        return sign * x[order]

    for _ in range(10):
        q, v, f = rng.normal(size=(3, robot.dof))
        straight = dyn.forward(q, v, f)
        mirrored = dyn.forward(mirror(q), mirror(v), mirror(f))
        scale = float(np.abs(straight).max())
        np.testing.assert_allclose(mirror(mirrored), straight, atol=ROUNDING * scale)
