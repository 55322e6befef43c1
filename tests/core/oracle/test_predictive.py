"""Predictive control against IPOPT, on a model that is not linear."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy import linalg

from patagium.control.predictive import (
    Intervals,
    RealTimeIteration,
    closed_beat,
    lagged,
    periodic_riccati,
)
from patagium.control.quadratic_program import ProgramStatus
from patagium.errors import ParameterError

N, NX, NU, STEP = 8, 4, 2, 0.15
STATE_COST, INPUT_COST = np.diag([4.0, 2.0, 0.3, 0.2]), np.diag([0.05, 0.08])
START, BEFORE = np.array([1.9, -0.8, 0.4, 0.0]), np.array([0.2, -0.1])
SOFT, MOST = 20.0, 0.6


def pendulums():
    """One Runge-Kutta step of two coupled pendulums with torques, and its derivatives."""
    x, u = ca.SX.sym("x", NX), ca.SX.sym("u", NU)
    angles, rates = x[:2], x[2:]
    pull = ca.vertcat(0.7 * ca.sin(angles[0] - angles[1]), 0.7 * ca.sin(angles[1] - angles[0]))
    rate = ca.Function(
        "rate", [x, u], [ca.vertcat(rates, u * ca.cos(angles / 2) + 2 * ca.sin(angles) - pull)]
    )
    one = rate(x, u)
    two = rate(x + STEP / 2 * one, u)
    three = rate(x + STEP / 2 * two, u)
    four = rate(x + STEP * three, u)
    end = x + STEP / 6 * (one + 2 * two + 2 * three + four)
    return ca.Function("step", [x, u], [end, ca.jacobian(end, x), ca.jacobian(end, u)])


STEP_OF = pendulums()


def predict(first, states, inputs):
    found = [STEP_OF(x, u) for x, u in zip(states, inputs, strict=True)]
    ends, by_state, by_input = (np.array([one[k].full() for one in found]) for k in range(3))
    return Intervals(ends[:, :, 0], by_state, by_input)


def problem():
    iteration = RealTimeIteration(predict, N, STATE_COST, INPUT_COST)
    iteration.state_reference[:, 0] = 0.2
    iteration.input_reference[:, 1] = 0.1
    iteration.final_cost = 3 * STATE_COST
    program = iteration.program
    program["lower"][...], program["upper"][...] = -4.0, 4.0
    program["fall"][...], program["rise"][...] = -2.5, 2.5
    program["least"][:, 2:], program["most"][:, 2:] = -MOST, MOST
    program["weight"][:, 2:] = SOFT
    return iteration


def by_ipopt():
    x, u, over = ca.MX.sym("x", NX, N + 1), ca.MX.sym("u", NU, N), ca.MX.sym("s", 2, N + 1)
    rows, low, high, cost = [x[:, 0] - START], [np.zeros(NX)], [np.zeros(NX)], 0.0
    for k in range(N + 1):
        away = x[:, k] - np.array([0.2, 0.0, 0.0, 0.0])
        cost += ca.bilin(STATE_COST if k < N else 3 * STATE_COST, away) / 2
        cost += SOFT / 2 * ca.sumsqr(over[:, k]) if k else 1e-9 * ca.sumsqr(over[:, k])
        if k:
            rows.append(x[2:, k] - over[:, k])
            low.append(np.full(2, -MOST))
            high.append(np.full(2, MOST))
        if k < N:
            cost += ca.bilin(INPUT_COST, u[:, k] - np.array([0.0, 0.1])) / 2
            rows += [x[:, k + 1] - STEP_OF(x[:, k], u[:, k])[0]]
            rows += [u[:, k], u[:, k] - (u[:, k - 1] if k else BEFORE)]
            low += [np.zeros(NX), np.full(2, -4.0), np.full(2, -2.5)]
            high += [np.zeros(NX), np.full(2, 4.0), np.full(2, 2.5)]
    unknowns = ca.vertcat(ca.vec(x), ca.vec(u), ca.vec(over))
    options = {"print_time": False, "ipopt": {"print_level": 0, "tol": 1e-11, "sb": "yes",
               "bound_relax_factor": 0.0}}  # fmt: skip
    solver = ca.nlpsol("o", "ipopt", {"x": unknowns, "f": cost, "g": ca.vertcat(*rows)}, options)
    found = solver(lbg=np.concatenate(low), ubg=np.concatenate(high))
    return float(found["f"])


def converged(iteration):
    """Iterations at one state until no input changes by more than 1e-9 of its range of 8."""
    for _ in range(50):
        last = iteration.inputs
        assert iteration.iterate(0, START, BEFORE) is ProgramStatus.SOLVED
        if (np.abs(iteration.inputs - last) <= 8e-9).all():
            return iteration
    raise AssertionError("the inputs go on changing")


def test_it_converges_to_the_minimum_that_ipopt_finds():
    iteration = converged(problem())
    assert iteration.cost == pytest.approx(by_ipopt(), rel=1e-6)  # of the issue
    program = iteration.program
    assert (np.abs(iteration.inputs) <= 4 + 1e-7).all()
    turns = np.diff(iteration.inputs, axis=0, prepend=BEFORE[None])
    assert np.isclose(np.abs(turns), 2.5).any()  # a limit bites
    assert (np.abs(iteration.states[1:, 2:]) > MOST).any()  # so does a soft one
    ends = predict(0, iteration.states[:-1], iteration.inputs).ends
    np.testing.assert_allclose(ends, iteration.states[1:], atol=1e-8)  # no gap is left
    assert int(program["status"]) == 0


def test_iterations_in_real_time_bring_it_home():
    """One program a sample, the model as plant: the state goes to its reference within limits."""
    iteration, state, before = problem(), START, BEFORE
    iteration.state_reference[...] = iteration.input_reference[...] = 0.0
    factorizations = []
    for tick in range(60):
        assert iteration.iterate(tick, state, before) is ProgramStatus.SOLVED
        factorizations.append(int(iteration.program["factorizations"]))
        command = iteration.inputs[0]
        assert (np.abs(command) <= 4 + 1e-7).all() and (
            np.abs(command - before) <= 2.5 + 1e-7
        ).all()
        before = command.copy()
        state = STEP_OF(state, command)[0].full()[:, 0]
        iteration.shift()
    assert np.abs(state).max() < 1e-3
    assert np.median(factorizations) == 1  # the shifted solution is the next one's active set


def test_what_is_not_finite_leaves_the_prediction():
    iteration = converged(problem())
    states, inputs = iteration.states.copy(), iteration.inputs.copy()
    assert iteration.iterate(0, START * np.nan, BEFORE) is ProgramStatus.NOT_FINITE
    np.testing.assert_array_equal(iteration.states, states)
    np.testing.assert_array_equal(iteration.inputs, inputs)
    assert iteration.iterate(0, START, BEFORE) is ProgramStatus.SOLVED


def test_lags_in_a_row_are_those_of_a_steered_gait():
    free, forced = (part[0] for part in lagged(30.0, np.array([0.07]), True))
    k, t = 30.0, 0.07
    fading = np.exp(-k * t)
    assert forced[1] == pytest.approx(1 - fading * (1 + k * t + (k * t) ** 2 / 2), rel=1e-9)
    whole = t - 3 / k + fading * (3 / k + 2 * t + k * t**2 / 2)  # its integral
    assert forced[0] == pytest.approx(whole, rel=1e-9)
    np.testing.assert_allclose(free[0], [1, *free[0, 1:]])
    np.testing.assert_allclose(free[1:, 1] + forced[1:], [1, 0, 0], atol=1e-12)


def test_gains_settle_where_a_neutral_cost_grows_and_hold_what_they_can():
    """Gains of what is held are SciPy's, though a neutral state that nothing moves is there too."""
    a, b = np.array([[1.1, 0.2], [0.0, 0.9]]), np.array([[0.0], [1.0]])
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[2, 2] = a, 1.0
    moves = np.vstack([b, [[0.0]]])
    _, gains = periodic_riccati(whole[None], moves[None], np.eye(3), np.eye(1))
    cost = linalg.solve_discrete_are(a, b, np.eye(2), np.eye(1))
    expected = np.linalg.solve(np.eye(1) + b.T @ cost @ b, b.T @ cost @ a)
    np.testing.assert_allclose(gains[0], np.c_[expected, [0.0]], atol=1e-8)


def test_gains_of_a_slow_mode_are_those_of_the_lifted_equation():
    """A mode of 0.9995 takes some 20,000 beats; two intervals of a beat are SciPy's one."""
    rng = np.random.default_rng(7)
    a = np.array([np.diag([1.0, 0.6, 0.5]) + 0.01 * rng.normal(size=(3, 3)) for _ in range(2)])
    a[:, 0] = np.array([0.99975, 0.0, 0.0])
    b = rng.normal(size=(2, 3, 2))
    b[:, 0] *= 1e-5
    state, inputs = np.diag([1.0, 2.0, 3.0]), np.diag([0.5, 1.0])
    costs, gains = periodic_riccati(a, b, state, inputs)
    both, moves = a[1] @ a[0], np.hstack([a[1] @ b[0], b[1]])
    first = np.hstack([b[0], np.zeros((3, 2))])
    cost = linalg.solve_discrete_are(
        both, moves, state + a[0].T @ state @ a[0],
        linalg.block_diag(inputs, inputs) + first.T @ state @ first, s=a[0].T @ state @ first,
    )  # fmt: skip
    np.testing.assert_allclose(costs[0], cost, rtol=1e-7, atol=1e-7)
    slow = np.abs(np.linalg.eigvals(closed_beat(a, b, gains))).max()
    assert 0.999 < slow < 1.0


def test_a_mode_that_only_rounding_moves_is_refused():
    a, b = np.diag([1.05, 0.5]), np.array([[1e-14], [1.0]])
    with pytest.raises(ParameterError, match="multiplier of 1.05 remains"):
        periodic_riccati(a[None], b[None], np.eye(2), np.eye(1))


def test_a_mode_that_grows_and_that_nothing_moves_is_refused():
    with pytest.raises(ParameterError, match="multiplier of 1.2 remains"):
        periodic_riccati(
            np.diag([1.2, 0.5])[None], np.array([[[0.0], [1.0]]]), np.eye(2), np.eye(1)
        )
