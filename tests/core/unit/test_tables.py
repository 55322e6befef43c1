"""Tables between their knots: lines, rounded corners, weights that are never negative."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics.polars import table_function, table_values
from patagium.native import load_functions

KNOTS = np.array([-1.5, -0.4, -0.1, 0.0, 0.3, 0.35, 1.2])


def looked_up(x: np.ndarray, values: np.ndarray) -> np.ndarray:
    function = table_function(len(KNOTS), values.shape[1])
    return np.array([np.array(function(k, KNOTS, values)).ravel() for k in x])


def test_lines_between_knots_and_constant_beyond() -> None:
    values = KNOTS[:, None] * [2.0, -1.0] + [0.5, 3.0]  # a line needs no rounding but at its ends
    x = np.linspace(-0.9, 0.75, 101)
    assert np.allclose(looked_up(x, values), x[:, None] * [2.0, -1.0] + [0.5, 3.0], atol=1e-14)
    beyond = looked_up(np.array([-9.0, 9.0]), values)
    # the rounded ends lie inside of the last knots' values
    assert np.abs(beyond - values[[0, -1]]).max() < 0.3
    assert np.allclose(beyond[1], looked_up(np.array([7.0]), values)[0], atol=1e-14)


def test_every_value_is_a_mean_with_weights_that_are_never_negative() -> None:
    weights = looked_up(np.linspace(-2.0, 2.0, 4001), np.eye(len(KNOTS)))
    assert weights.min() > -1e-13  # rounding
    assert np.allclose(weights.sum(axis=1), 1.0, atol=1e-14)


def test_three_derivatives_are_continuous() -> None:
    x = ca.SX.sym("x")
    values = ca.DM(np.sin(3 * KNOTS))
    value = table_values(x, ca.SX(ca.DM(KNOTS)), ca.SX(values))
    seams = [0.1, 0.15, 0.05, -0.05, 0.325]  # half way between knots, and where rounding ends
    for _ in range(4):
        evaluate = ca.Function("f", [x], [value])
        largest = max(abs(float(evaluate(k))) for k in np.linspace(-1.4, 1.1, 500))
        for seam in seams:
            left, right = float(evaluate(seam - 1e-10)), float(evaluate(seam + 1e-10))
            assert left == pytest.approx(right, abs=1e-6 * (1 + largest))
        value = ca.jacobian(value, x)


def test_the_kernel_is_the_symbolic_function(rng: np.random.Generator) -> None:
    function = table_function(len(KNOTS), 3)
    inputs = [ca.SX.sym(n, *function.size_in(k)) for k, n in enumerate(function.name_in())]
    outer = ca.Function("outer", inputs, [function(*inputs)], function.name_in(), ["at_x"])
    compiled = load_functions("test table", lambda: [outer], label="table")["outer"]
    values = rng.normal(size=(len(KNOTS), 3))
    x = np.concatenate([rng.uniform(-2, 2, 200), KNOTS, [-np.inf, np.inf]])
    many = compiled.batch(x[:-2], KNOTS, values)
    for k, value in enumerate(x[:-2]):
        expected = np.array(function(value, KNOTS, values)).ravel()
        assert np.allclose(compiled(value, KNOTS, values), expected, rtol=0, atol=1e-13)
        assert np.allclose(many[k], expected, rtol=0, atol=1e-13)
    assert np.isnan(compiled(np.nan, KNOTS, values)).all()


def test_the_kernel_of_the_derivative_is_the_symbolic_one(rng: np.random.Generator) -> None:
    function = table_function(len(KNOTS), 2)
    inputs = [ca.SX.sym(n, *function.size_in(k)) for k, n in enumerate(function.name_in())]
    along = [ca.SX.sym(f"d{n}", *function.size_in(k)) for k, n in enumerate(function.name_in())]
    whole, way = (ca.vertcat(*map(ca.vec, parts)) for parts in (inputs, along))
    slope = ca.jtimes(function(*inputs), whole, way)
    outer = ca.Function("outer", [*inputs, *along], [ca.densify(slope)])
    compiled = load_functions("test slope of a table", lambda: [outer], label="table")["outer"]
    values, dvalues = rng.normal(size=(2, len(KNOTS), 2))
    given = [KNOTS, values], [rng.normal(size=len(KNOTS)), dvalues]
    x, dx = np.concatenate([rng.uniform(-2, 2, 200), KNOTS]), rng.normal(size=200 + len(KNOTS))
    many = compiled.batch(x, *given[0], dx, *given[1])
    for k, (value, change) in enumerate(zip(x, dx, strict=True)):
        arguments = (value, *given[0], change, *given[1])
        expected = np.array(outer(*arguments)).ravel()
        assert np.allclose(compiled(*arguments), expected, rtol=0, atol=1e-11)  # of slopes of 30
        assert np.allclose(many[k], expected, rtol=0, atol=1e-11)
