"""Jacobians by elimination of vertices, against CasADi's and against their own graph."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics import QuasiSteady
from patagium.native.elimination import jacobian
from patagium.native.emit import emit_batch
from patagium.simulation.flight_equations import flight_balance
from patagium.simulation.mounts import mount_of

ROUNDING = 1e-13
"""Relative: products in another order, a few hundred of them."""


def _values(found: ca.SX, symbols: list[ca.SX], rng: np.random.Generator) -> np.ndarray:
    function = ca.Function("values", symbols, [ca.densify(found)])
    return np.array(function(*[rng.uniform(0.1, 0.9, symbol.shape) for symbol in symbols]))


def _everything(x: ca.SX, p: ca.SX) -> ca.SX:
    """Column with each operation that the equations use, a constant and a variable itself."""
    inner = ca.SX.sym("inner", 2)
    each = ca.Function(
        "each_part", [inner], [inner[0] * inner[1], ca.exp(inner[0])], {"never_inline": True}
    )
    product, power = each(x[:2])
    guarded = ca.if_else(x[3] > 0.5, ca.sqrt(x[3]), x[3] ** 2)
    return ca.vertcat(
        product * p[0] + ca.sin(x[2]) / x[1],
        ca.fmax(x[0], x[1]) - ca.fmin(x[2], p[1]) + ca.fabs(x[3]),
        ca.atan2(x[0], x[1]) * ca.tanh(x[2]) + guarded * power,
        ca.log1p(x[3]) + x[3] * x[3] + 2.0 * x[0] - x[0],
        p[0],
        x[2],
    )


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_jacobian(seed: int) -> None:
    x, p = ca.SX.sym("x", 4), ca.SX.sym("p", 2)
    column = _everything(x, p)
    found, expected = jacobian(column, x), ca.jacobian(column, x)
    values = [_values(j, [x, p], np.random.default_rng(seed)) for j in (found, expected)]
    assert np.allclose(*values, rtol=ROUNDING, atol=ROUNDING)
    assert found.shape == (6, 4)
    assert not np.array_equal(values[0][:4], 0 * values[0][:4])


def test_entries_that_are_always_zero_are_absent() -> None:
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p")
    found = jacobian(ca.vertcat(p, x[1], x[0] * p, x[2] - x[2]), x)
    places = zip(found.sparsity().row(), found.sparsity().get_col(), strict=True)
    assert set(places) == {(1, 1), (2, 0)}


@pytest.mark.parametrize("name", ["aerobat", "hawk"])
def test_a_flight_takes_fewer_operations_than_by_casadi(name: str) -> None:
    """Four fifths at most; .59 (hawk) and .74 (aerobat) were counted when it was written."""
    robot = pt.load_robot(name)
    balance = flight_balance(robot, QuasiSteady(robot), mount_of(robot, None), None)
    state, row, *constants = balance.inputs
    variables = ca.vertcat(state, row)

    def statements(found: ca.SX) -> int:
        inputs = [state, row, *constants, balance.free]
        text = emit_batch(ca.Function("slopes", inputs, [ca.vertcat(*found.nonzeros())]))
        return sum(part.count("const lanes t") for part in text)

    own = statements(jacobian(balance.lacking, variables))
    assert own < 0.8 * statements(ca.jacobian(balance.lacking, variables))
