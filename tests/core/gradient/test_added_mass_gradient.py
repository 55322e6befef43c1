"""Derivatives of the acceleration with carried air: AD against central differences."""

from __future__ import annotations

import casadi as ca
import numpy as np

import patagium as pt
from patagium.dynamics import equations


def test_acceleration_is_differentiable_in_state_wind_factor_and_robot(rng):
    robot = pt.load_robot("aerobat")
    model = pt.AddedMass(robot)
    symbolic, p = robot.symbolic()
    n = robot.dof
    x = ca.SX.sym("x", 2 * n + 5)
    q, v, wind, c = x[:n], x[n : 2 * n], x[2 * n : 2 * n + 3], x[2 * n + 3 :]
    added = model.inertia(symbolic, wind, c)
    force = model.circulation_force(symbolic, q, v, wind, c)
    a = equations.forward(symbolic, q, v, force, added)
    output = ca.Function("a", [x, p], [a])
    jacobian = ca.Function("j", [x, p], [ca.jacobian(a, ca.vertcat(x, p))])
    parameters = robot.parameters
    state = np.concatenate([0.4 * rng.normal(size=2 * n), [-3.0, 0.2, 0.1, 1.225, 0.85]])

    def at(z):
        return np.array(output(z[: x.numel()], z[x.numel() :])).ravel()

    z = np.concatenate([state, parameters])
    exact = np.array(jacobian(state, parameters))
    for k in range(z.size):
        step = 1e-6 * np.maximum(abs(z[k]), 1e-3)
        shift = step * np.eye(z.size)[k]
        slope = (at(z + shift) - at(z - shift)) / (2 * step)
        scale = max(1.0, np.abs(exact[:, k]).max())
        # rounding of accelerations of order 100 over steps of 1e-6
        np.testing.assert_allclose(exact[:, k], slope, atol=2e-5 * scale, err_msg=str(k))
