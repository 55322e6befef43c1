"""The quadratic program of predictive control against CasADi's solvers and its own dense form."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from patagium.control import quadratic_program
from patagium.control.quadratic_program import ProgramStatus, QuadraticProgram
from patagium.errors import PatagiumError
from patagium.native import compiler_name

N, NX, NU = 8, 4, 2


def filled(seed, *, rates=True, soft=True, start=2.0):
    """A program whose limits bite, with all its terms."""
    rng, program = np.random.default_rng(seed), QuadraticProgram(N, NX, NU)
    for name, size in {"A": 0.3, "B": 0.5, "c": 0.1, "q": 0.3, "r": 0.1, "S": 0.02}.items():
        program[name][...] = size * rng.normal(size=program[name].shape)
    program["A"][...] += np.eye(NX)
    root = rng.normal(size=(N + 1, NX, NX))
    program["Q"][...] = root @ root.transpose(0, 2, 1) / NX + 0.1 * np.eye(NX)
    root = 0.3 * rng.normal(size=(N, NU, NU))
    program["R"][...] = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(NU)
    program["start"][...] = start * rng.normal(size=NX)
    program["lower"][...], program["upper"][...] = -0.8, 0.6
    program["before"][...] = [0.3, -0.2]
    if rates:
        program["fall"][...], program["rise"][...] = -0.3, 0.25
    if soft:
        program["least"][...], program["most"][:, ::2], program["weight"][...] = -1.0, 0.8, 30.0
    return program


def by_casadi(program):
    """Cost and inputs of the same program, states and slacks as unknowns, by an active set."""
    x, u = ca.MX.sym("x", NX, N + 1), ca.MX.sym("u", NU, N)
    over, rows, low, high, cost = ca.MX.sym("s", NX, N + 1), [], [], [], 0

    def limit(row, least, most):
        rows.append(row)
        low.append(least)
        high.append(most)

    limit(x[:, 0], program["start"], program["start"])
    for k in range(N + 1):
        cost += 0.5 * ca.bilin(program["Q"][k], x[:, k]) + ca.dot(program["q"][k], x[:, k])
        cost += 0.5 * ca.dot(program["weight"][k] * over[:, k], over[:, k])
        bounds = (program["least"][k], program["most"][k]) if k else (-np.inf, np.inf)
        limit(x[:, k] - over[:, k], *(np.broadcast_to(one, NX) for one in bounds))
        cost += 1e-9 * ca.sumsqr(over[:, k])
        if k < N:
            cost += 0.5 * ca.bilin(program["R"][k], u[:, k]) + ca.dot(program["r"][k], u[:, k])
            cost += ca.dot(u[:, k], ca.mtimes(program["S"][k], x[:, k]))
            moved = ca.mtimes(program["A"][k], x[:, k]) + ca.mtimes(program["B"][k], u[:, k])
            limit(x[:, k + 1] - moved, program["c"][k], program["c"][k])
            limit(u[:, k], program["lower"][k], program["upper"][k])
            before = u[:, k - 1] if k else program["before"]
            limit(u[:, k] - before, program["fall"][k], program["rise"][k])
    unknowns = ca.vertcat(ca.vec(x), ca.vec(u), ca.vec(over))
    qp = {"x": unknowns, "f": cost, "g": ca.vertcat(*rows)}
    found = ca.qpsol("qp", "qpoases", qp, {"printLevel": "none"})(
        lbg=np.concatenate(low), ubg=np.concatenate(high)
    )
    inputs = found["x"].full().ravel()[NX * (N + 1) :][: NU * N].reshape(N, NU)
    return float(found["f"]), inputs


@pytest.mark.parametrize("kernel", [True, False])
@pytest.mark.parametrize(
    ("rates", "soft"), [(False, False), (True, False), (False, True), (True, True)]
)
def test_it_finds_the_minimum_of_an_independent_solver(rates, soft, kernel, monkeypatch):
    if not kernel:
        monkeypatch.setattr(quadratic_program, "load_kernel", lambda *_: None)
    bites = 0
    for seed in range(6):
        program = filled(seed, rates=rates, soft=soft)
        assert program.solve() is ProgramStatus.SOLVED
        cost, inputs = by_casadi(program)
        # tolerance: 1e-9 of a width in the limits, and the oracle's own 1e-8
        np.testing.assert_allclose(program["u"], inputs, atol=1e-6)
        assert float(program["cost"]) == pytest.approx(cost, rel=1e-7, abs=1e-7)
        turns = np.diff(program["u"], axis=0, prepend=program["before"][None])
        assert (program["u"] <= 0.6 + 1e-8).all() and (program["u"] >= -0.8 - 1e-8).all()
        assert not rates or (turns.max() <= 0.25 + 1e-8 and turns.min() >= -0.3 - 1e-8)
        bites += np.isclose(program["u"], 0.6, atol=1e-7).any() or np.isclose(turns, 0.25).any()
    assert bites >= 3


@pytest.mark.parametrize("rates", [True, False])
def test_a_kept_inverse_gives_the_same(rates):
    """Sample after sample, from a warm start, with limits that come and go."""
    if compiler_name() is None:
        pytest.skip("the dense form keeps nothing")
    bites = set()
    for seed in range(12):
        rng, kept = np.random.default_rng(seed), filled(seed, rates=rates, soft=False)
        inverse = kept.inverse()
        for size in (2.0, 0.01, 0.5, 4.0, 0.0, 1e-7):
            kept["start"][...] += size * rng.normal(size=NX)
            kept["c"][...] = 0.1 * rng.normal(size=kept["c"].shape)
            other = filled(seed, rates=rates, soft=False)
            other["start"][...], other["c"][...] = kept["start"], kept["c"]
            assert kept.solve(inverse) is ProgramStatus.SOLVED is other.solve()
            assert int(kept["sweeps"]) == 0  # no recursion
            # tolerance: 1e-9 of a width in the limits of both
            np.testing.assert_allclose(kept["u"], other["u"], atol=1e-7)
            np.testing.assert_allclose(kept["x"], other["x"], atol=1e-6)
            assert float(kept["cost"]) == pytest.approx(float(other["cost"]), rel=1e-8)
            bites.add(int((np.abs(kept["range_force"]) > 0).sum()))
    assert len(bites) > 5


def test_an_inverse_of_other_matrices_is_found_out():
    if compiler_name() is None:
        pytest.skip("the dense form keeps nothing")
    wrong = filled(2, soft=False).inverse()
    for inverse in (wrong, np.full_like(wrong, np.nan), -wrong, 0 * wrong):
        program, other = filled(3, soft=False), filled(3, soft=False)
        assert program.solve(inverse) is ProgramStatus.SOLVED is other.solve()
        np.testing.assert_allclose(program["u"], other["u"], atol=1e-8)
        assert int(program["sweeps"]) > 0
    for inverse in (wrong[1:, 1:], wrong[0], wrong.astype(str), "wrong"):
        with pytest.raises(PatagiumError, match="inverse"):
            filled(3, soft=False).solve(inverse)
    program = filled(2, soft=False)
    assert program.solve(np.asfortranarray(np.tile(wrong, (1, 2)))[:, :16]) is ProgramStatus.SOLVED
    assert int(program["sweeps"]) == 0
    soft = filled(3)  # soft limits of states are the recursion's
    assert soft.solve(soft.inverse()) is ProgramStatus.SOLVED
    plain = filled(3)
    plain.solve()
    np.testing.assert_allclose(soft["u"], plain["u"], atol=1e-12)


def test_limits_that_depend_on_each_other_are_met_with_an_inverse():
    """Fixed inputs, ranges and rates that meet, both active at once, horizon after horizon."""
    if compiler_name() is None:
        pytest.skip("the dense form keeps nothing")
    fixed = filled(5, soft=False)
    fixed["lower"][:, 0] = fixed["upper"][:, 0] = 0.3
    fixed["fall"][:, 1] = fixed["rise"][:, 1] = 0.0
    assert fixed.solve(fixed.inverse()) is ProgramStatus.SOLVED
    np.testing.assert_allclose(fixed["u"], np.tile([0.3, -0.2], (N, 1)), atol=1e-7)
    ramp = filled(6, soft=False)
    ramp["r"][...] = -50.0  # up at the rate until the range ends
    ramp["before"][...] = 0.6 - 3 * 0.25
    inverse = ramp.inverse()
    for _ in range(4):
        other = filled(6, soft=False)
        other["r"][...], other["before"][...] = -50.0, ramp["before"]
        assert ramp.solve(inverse) is ProgramStatus.SOLVED is other.solve()
        np.testing.assert_allclose(ramp["u"], other["u"], atol=1e-7)
        ramp["before"][...] = ramp["u"][0]
        for name in ("u", "x", "range_force", "change_force"):
            ramp[name][:-1] = ramp[name][1:]


def test_a_warm_start_takes_few_factorizations_and_gives_the_same():
    if compiler_name() is None:
        pytest.skip("the dense form has no warm start")
    program = filled(3)
    program.solve()
    cold = int(program["factorizations"])
    again = program["u"].copy()
    program.solve()
    assert int(program["factorizations"]) == 1 < cold
    np.testing.assert_allclose(program["u"], again, atol=1e-8)
    program["start"][...] += 0.002
    program.solve()
    warm, few = program["u"].copy(), int(program["factorizations"])
    anew = filled(3)
    anew["start"][...] = program["start"]
    anew.solve()
    np.testing.assert_allclose(warm, anew["u"], atol=1e-8)
    assert few < int(anew["factorizations"])
    program["u"][...] = 50.0  # a warm start far outside
    assert program.solve() is ProgramStatus.SOLVED
    np.testing.assert_allclose(warm, program["u"], atol=1e-7)


@pytest.mark.parametrize("kernel", [True, False])
def test_degenerate_limits_are_met(kernel, monkeypatch):
    if not kernel:
        monkeypatch.setattr(quadratic_program, "load_kernel", lambda *_: None)
    free = filled(5, rates=False, soft=False)
    free["lower"][...], free["upper"][...] = -np.inf, np.inf
    assert free.solve() is ProgramStatus.SOLVED
    weakly = filled(5, rates=False, soft=False)  # a limit exactly at the minimum without it
    weakly["lower"][...], weakly["upper"][...] = free["u"], np.inf
    assert weakly.solve() is ProgramStatus.SOLVED
    np.testing.assert_allclose(weakly["u"], free["u"], atol=1e-5)
    fixed = filled(5, soft=False)
    fixed["lower"][:, 0] = fixed["upper"][:, 0] = 0.3  # an input that may not move
    fixed["fall"][:, 1] = fixed["rise"][:, 1] = 0.0
    assert fixed.solve() is ProgramStatus.SOLVED
    np.testing.assert_allclose(fixed["u"], np.tile([0.3, -0.2], (N, 1)), atol=1e-7)


@pytest.mark.parametrize("kernel", [True, False])
def test_what_cannot_be_solved_is_said(kernel, monkeypatch):
    if not kernel:
        monkeypatch.setattr(quadratic_program, "load_kernel", lambda *_: None)
    names = ("A", "B", "c", "Q", "R", "S", "q", "r", "lower", "rise", "most", "start", "before")
    for name in (*names, "weight"):
        program = filled(1)
        program[name].reshape(-1)[-1] = np.nan
        assert program.solve() is not ProgramStatus.SOLVED, name
        assert int(program["status"]) == program.solve() != 0
    for name in ("weight", "start", "before"):
        program = filled(1)
        program[name].reshape(-1)[-1] = np.inf
        assert program.solve() is ProgramStatus.NOT_FINITE, name
    far = filled(1)
    far["before"][...] = 4.0  # out of its range by more than its rate
    assert far.solve() is ProgramStatus.INFEASIBLE
    crossed = filled(1)
    crossed["lower"][3, 1] = 0.7
    assert crossed.solve() is ProgramStatus.INFEASIBLE
    hollow = filled(1)
    hollow["R"][...] -= 40 * np.eye(NU)
    assert hollow.solve() is ProgramStatus.NOT_CONVEX
    again = filled(1)
    assert again.solve() is ProgramStatus.SOLVED
    again["start"][0] = np.nan
    assert again.solve() is ProgramStatus.NOT_FINITE
    again["start"][0] = 0.1
    assert again.solve() is ProgramStatus.SOLVED


@pytest.mark.parametrize("name", ["velocity", 3, None, ["x"]])
def test_an_array_that_it_has_not_is_refused(name):
    with pytest.raises(PatagiumError, match="name: expected one of A, B, c"):
        filled(1)[name]


def test_unstable_models_and_long_horizons_are_solved():
    """No factor grows from stage to stage: costs agree with the dense form."""
    solved = 0
    for seed in range(5):
        program = filled(seed, start=4.0)
        program["A"][...] = program["A"][0] / np.abs(np.linalg.eigvals(program["A"][0])).max() * 1.3
        assert program.solve() is ProgramStatus.SOLVED
        cost = float(program["cost"])
        solved += quadratic_program._solve_dense(program) is ProgramStatus.SOLVED
        assert cost == pytest.approx(float(program["cost"]), rel=1e-7)
    assert solved == 5
