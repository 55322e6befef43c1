"""AD of the equations against finite differences, also at rest and at zero angles."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.dynamics import equations


@pytest.mark.parametrize("at_rest", [False, True])
def test_derivatives_of_forward_and_inverse(at_rest, rng):
    robot = pt.load_robot("aerobat")
    machine, p = robot.symbolic()
    n = robot.dof
    q, v, a = (ca.SX.sym(name, n) for name in "qva")
    everything = ca.vertcat(q, v, a, p)
    point = np.concatenate(
        [np.zeros(3 * n) if at_rest else rng.normal(size=3 * n), robot.parameters]
    )
    direction = rng.normal(size=point.size)
    direction[3 * n :] *= robot.parameters  # a parameter moves by a share of itself
    for expression in (
        equations.inverse(machine, q, v, a),
        equations.forward(machine, q, v, a * 1e-3),
    ):
        value = ca.Function("f", [everything], [expression])
        slope = ca.Function("s", [everything], [ca.jtimes(expression, everything, direction)])
        exact = np.array(slope(point)).ravel()
        step = 1e-5
        ahead, behind = (np.array(value(point + s * direction)).ravel() for s in (step, -step))
        # central difference: truncation step^2 = 1e-10, rounding 1e-16/1e-5 = 1e-11
        np.testing.assert_allclose(
            (ahead - behind) / (2 * step), exact, atol=1e-7 * np.abs(exact).max()
        )
