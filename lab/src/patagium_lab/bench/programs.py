"""Times of quadratic programs of predictive control, compared with those of four other solvers.

The same random programs of 20 stages, 12 states and 6 inputs for all, in one run: once from
nothing, once from the solution of a program whose first state was a little different, as a
controller meets them. PIQP and OSQP are called directly by their own Python wheels, HPIPM and
qpOASES through CasADi, which bundles them and copies all matrices at each call; each is prepared
once and given new numbers. Then the programs of a predictive controller on the way from a start to
its orbit, sample after sample, whose matrices come again beat by beat: ours as it flies, rivals
from nothing, their preparation not counted. Neglected: rivals without a wheel; models that are new
at every sample.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter_ns
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from patagium.arrays import Array
from patagium.control.quadratic_program import ProgramStatus, QuadraticProgram, condensed
from patagium_lab.bench.result import Result, compared
from patagium_lab.feedback.plan import AEROBAT, NOISE, ORNITHOPTER, PREDICTIVE, Case
from patagium_lab.feedback.run import controller, design, starts_of, vector

STAGES, STATES, INPUTS = 20, 12, 6
PROGRAMS = 60
NEXT = 0.02
"""Standard deviation by which the next sample's state differs, of states of some units."""
KINDS = {"ranges": (False, False), "ranges, rates, soft limits": (True, True)}
"""Limits of the programs: whether rates of inputs, and whether states."""


def fill(program: QuadraticProgram, seed: int, rates: bool, soft: bool) -> None:
    """Write a random program: a model at the verge of stability, inputs that saturate.

    Args:
        program: Program of the sizes of this module.
        seed: Its number.
        rates: Whether inputs may change by .3 a stage only.
        soft: Whether states are held within 1 by a weight of 100.
    """
    rng = np.random.default_rng(seed)
    model = np.eye(STATES) + 0.2 * rng.normal(size=(STATES, STATES)) / STATES**0.5
    program["A"][...] = model / np.abs(np.linalg.eigvals(model)).max()
    program["B"][...] = 0.3 * rng.normal(size=(STATES, INPUTS))
    program["Q"][...] = np.diag(rng.uniform(0.1, 10.0, STATES))
    program["R"][...] = np.diag(rng.uniform(0.01, 0.1, INPUTS))
    program["start"][...] = 3.0 * rng.normal(size=STATES)
    program["lower"][...], program["upper"][...] = -1.0, 1.0
    change = 0.3 if rates else np.inf
    program["fall"][...], program["rise"][...] = -change, change
    program["least"][...], program["most"][...] = -1.0, 1.0
    program["weight"][...] = 100.0 if soft else 0.0


@dataclass(frozen=True)
class Sparse:
    """A program by matrices: 1/2 z'P z, A z = b, g_low <= G z <= g_high, stage by stage.

    Attributes:
        states: Number of states n_x.
        cost: P.
        equal: A.
        limited: G.
        right: b, whose first entries are the first state.
        low: g_low.
        high: g_high.
    """

    states: int
    cost: Any
    equal: Any
    limited: Any
    right: Array
    low: Array
    high: Array


def sparse(program: QuadraticProgram, rates: bool, soft: bool) -> Sparse:
    """A program with states, inputs and slacks of soft limits as unknowns.

    Args:
        program: The program.
        rates: Whether rates are limited.
        soft: Whether states are.
    """
    stages, states, inputs = program.sizes
    slacks = states if soft else 0
    x, u, s = _pickers(program.sizes, slacks)
    costs = []
    for k in range(stages + 1):
        costs.append(program["Q"][k])
        costs += [program["R"][k]] if k < stages else []
        costs += [np.diag(program["weight"][k])] if soft else []
    equal, limited, low, high = [x(0)], [], [], []
    for k in range(stages):
        equal.append(program["A"][k] @ x(k) + program["B"][k] @ u(k) - x(k + 1))
        limited.append(u(k))
        low.append(program["lower"][k])
        high.append(program["upper"][k])
        if rates:
            before = np.zeros(inputs) if k else program["before"]
            limited.append(u(k) - u(k - 1) if k else u(k))
            low.append(program["fall"][k] + before)
            high.append(program["rise"][k] + before)
        if soft:
            limited.append(x(k + 1) - s(k + 1))
            low.append(program["least"][k])
            high.append(program["most"][k])
    right = np.r_[program["start"], -program["c"].ravel()]
    stacked = [sp.vstack([sp.csc_matrix(one) for one in part]) for part in (equal, limited)]
    return Sparse(
        states=states,
        cost=sp.block_diag(costs, format="csc"),
        equal=stacked[0].tocsc(),
        limited=stacked[1].tocsc(),
        right=right,
        low=np.concatenate(low),
        high=np.concatenate(high),
    )


def _pickers(sizes: tuple[int, int, int], slacks: int) -> list[Callable[[int], Any]]:
    """Functions from a stage to the rows that pick its states, inputs and slacks."""
    stages, states, inputs = sizes
    width = states + inputs + slacks
    whole = sp.identity(stages * width + states + slacks, format="csr")

    def rows(offset: int, count: int, k: int) -> Any:
        first = k * width + (offset if k < stages else min(offset, states))
        return whole[first : first + count]

    return [
        partial(rows, 0, states),
        partial(rows, states, inputs),
        partial(rows, states + inputs, slacks),
    ]


INFINITE = 1e4
"""Bound of what has none for HPIPM, beyond all states met; 1e8 keeps it from converging."""
Solver = Callable[[Array], float]
"""Function from the first state to the cost; begins where it ended, if it can."""


def _piqp(form: Sparse) -> Solver:
    piqp = importlib.import_module("piqp")
    solver = piqp.SparseSolver()
    solver.settings.kkt_solver = piqp.KKTSolver.sparse_multistage
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-8
    none = np.zeros(form.cost.shape[0])
    solver.setup(
        form.cost, none, form.equal, form.right, form.limited, form.low, form.high, None, None
    )
    right = form.right.copy()

    def solve(start: Array) -> float:
        right[: form.states] = start
        solver.update(b=right)
        if solver.solve() != piqp.PIQP_SOLVED:
            return np.nan
        return float(solver.result.info.primal_obj)

    return solve


def _osqp(form: Sparse) -> Solver:
    osqp = importlib.import_module("osqp")
    solver = osqp.OSQP()
    low, high = np.r_[form.right, form.low], np.r_[form.right, form.high]
    solver.setup(
        sp.triu(form.cost, format="csc"), np.zeros(form.cost.shape[0]),
        sp.vstack([form.equal, form.limited], format="csc"), low, high,
        eps_abs=1e-6, eps_rel=1e-6, max_iter=20_000, verbose=False,
    )  # fmt: skip

    def solve(start: Array) -> float:
        low[: form.states] = high[: form.states] = start
        solver.update(l=low, u=high)
        found = solver.solve(raise_error=False)
        return float(found.info.obj_val) if found.info.status == "solved" else np.nan

    return solve


def _qpoases(program: QuadraticProgram, rates: bool, soft: bool) -> Solver:
    """Active set solver of the program in the inputs alone, its states eliminated."""
    if soft:
        raise NotImplementedError("soft limits")
    hessian, _, _, _ = condensed(program)
    stages, _, inputs = program.sizes
    count = len(hessian) if rates else 0
    changes = ca.DM(np.eye(count, len(hessian)) - np.eye(count, len(hessian), -inputs))
    shapes = {"h": ca.DM(hessian).sparsity(), "a": changes.sparsity()}
    options = {"printLevel": "none", "error_on_fail": False}
    solver = ca.conic("rival", "qpoases", shapes, options)
    given = {"h": ca.DM(hessian), "a": changes}
    given |= {"lbx": program["lower"].ravel(), "ubx": program["upper"].ravel()}
    if rates:
        before = np.zeros((stages, inputs))
        before[0] = program["before"]
        given["lba"] = (program["fall"] + before).ravel()
        given["uba"] = (program["rise"] + before).ravel()
    weights = sp.block_diag(list(program["Q"]), format="csr")
    last: dict[str, Any] = {}

    def solve(start: Array) -> float:
        program["start"][...] = start
        _, gradient, _, offsets = condensed(program)
        found = solver(g=gradient, **given, **last)
        last.update(x0=found["x"], lam_x0=found["lam_x"], lam_a0=found["lam_a"])
        if not solver.stats()["success"]:
            return np.nan
        return float(found["cost"]) + float(offsets @ (weights @ offsets)) / 2

    return solve


def _hpipm(program: QuadraticProgram, rates: bool, soft: bool) -> Solver:
    """Solver that keeps the stages of the program; its first state, which is given, is eliminated.

    Where rates are limited, the inputs of the stage before are further states; slack variables of
    soft limits are further inputs.
    """
    stages, states, inputs = program.sizes
    former, slacks = inputs * rates, states * soft
    width, rest = states + former, inputs + slacks
    ways = np.zeros((stages, width + former + slacks, width + rest))
    moved, kept, limited = slice(0, states), slice(states, width), slice(width, width + former)
    given = slice(width, width + inputs)
    ways[:, moved, moved], ways[:, moved, given] = program["A"], program["B"]
    ways[:, kept, given] = ways[:, limited, given] = np.eye(former, inputs)
    ways[:, limited, kept] = -np.eye(former)
    ways[:, width + former :] = ways[:, :slacks]
    ways[:, width + former :, width + inputs :] = -np.eye(slacks)
    whole = sp.block_diag(list(ways), format="lil")
    for k in range(1, stages):
        here, before = k * (width + rest), (k - 1) * len(ways[0])
        whole[before : before + width, here : here + width] = -np.eye(width)
    end = sp.lil_matrix((whole.shape[0], width))
    end[-len(ways[0]) : width - len(ways[0]) or None] = -np.eye(width)
    matrix = sp.hstack([whole, end], format="csc")
    first, others = matrix[:, :width].toarray(), ca.DM(matrix[:, width:])
    free, none = np.full((stages, width), np.inf), np.zeros((stages, former))
    plain = np.full((stages, slacks), np.inf)
    change, still = program["c"], np.hstack([-program["c"], none])
    low = np.hstack(
        [still, program["fall"][:, :former], (program["least"][1:] - change)[:, :slacks]]
    )
    high = np.hstack(
        [still, program["rise"][:, :former], (program["most"][1:] - change)[:, :slacks]]
    )
    costs = [np.zeros((0, 0))]
    for k in range(stages):
        costs += [program["R"][k], np.diag(program["weight"][k + 1][:slacks])]
        costs += [program["Q"][k + 1], np.zeros((former, former))]
    numbers = {
        "h": ca.DM(sp.block_diag(costs, format="csc")), "a": others,
        "lbx": np.hstack([program["lower"], -plain, -free]).ravel(),
        "ubx": np.hstack([program["upper"], plain, free]).ravel(),
    }  # fmt: skip
    shapes = {name: numbers[name].sparsity() for name in "ha"}
    options = {
        "N": stages, "nx": [0] + [width] * stages, "nu": [rest] * stages + [0],
        "ng": [former + slacks] * stages + [0], "error_on_fail": False, "inf": INFINITE,
        "hpipm": {"iter_max": 100} | {f"res_{kind}_max": 1e-8 for kind in "gbdm"},
    }  # fmt: skip
    solver = ca.conic("rival", "hpipm", shapes, options)

    def solve(start: Array) -> float:
        known = first @ np.r_[start, program["before"][:former]]
        found = solver(lba=low.ravel() - known, uba=high.ravel() - known, **numbers)
        if not solver.stats()["success"]:
            return np.nan
        return float(found["cost"] + start @ program["Q"][0] @ start / 2)

    return solve


def _by_matrices(prepare: Callable[[Sparse], Solver]) -> Preparation:
    return lambda program, rates, soft: prepare(sparse(program, rates, soft))


Preparation = Callable[[QuadraticProgram, bool, bool], Solver]
"""Function that prepares a solver for a program, whose rates or states are limited or not."""
RIVALS: dict[str, Preparation] = {
    "PIQP (multistage)": _by_matrices(_piqp),
    "OSQP (1e-6)": _by_matrices(_osqp),
    "HPIPM through CasADi": _hpipm,
    "qpOASES through CasADi": _qpoases,
}
"""Solvers to compare with; qpOASES gets the program in the inputs alone, without soft limits."""


def program_results() -> Iterator[Result]:
    """Times of our programs, from nothing and as the next sample, compared with each rival's.

    Yields:
        Medians [ns]; the note holds both 99th percentiles and how far costs differ.
    """
    for kind, (rates, soft) in KINDS.items():
        rivals = {name: one for name, one in RIVALS.items() if not (soft and one is _qpoases)}
        ours, times = _Times(), {name: _Times() for name in rivals}
        worst: dict[str, float] = {}
        reasons: dict[str, str] = {}
        for seed in range(PROGRAMS):
            program = QuadraticProgram(STAGES, STATES, INPUTS)
            fill(program, seed, rates, soft)
            first = program["start"].copy()
            later = first + NEXT * np.random.default_rng(seed).normal(size=STATES)
            costs = ours.take(partial(_own, program), (first, later))
            for name, prepare in rivals.items():
                program["start"][...] = first
                try:
                    solver = prepare(program, rates, soft)
                except ImportError as error:
                    reasons[name] = str(error)
                    continue
                found = times[name].take(solver, (first, later))
                gap = np.abs(np.subtract(found, costs)) / np.abs(costs)
                worst[name] = max(worst.get(name, 0.0), *np.nan_to_num(gap, nan=np.inf))
        for name, found_times in times.items():
            yield from _rows(kind, ours, found_times, name, worst.get(name), reasons.get(name))


@dataclass
class _Times:
    """Times of a solver [ns], from nothing and as the next sample."""

    nothing: list[int] = field(default_factory=list)
    following: list[int] = field(default_factory=list)

    def take(self, solve: Solver, starts: tuple[Array, Array]) -> list[float]:
        """Costs from two first states, one after the other."""
        costs = []
        for times, start in zip((self.nothing, self.following), starts, strict=True):
            began = perf_counter_ns()
            costs.append(solve(start))
            times.append(perf_counter_ns() - began)
        return costs


def _own(program: QuadraticProgram, start: Array) -> float:
    program["start"][...] = start
    solved = program.solve() is ProgramStatus.SOLVED
    return float(program["cost"]) if solved else float("nan")


def _rows(
    kind: str, ours: _Times, found: _Times, name: str, worst: float | None, reason: str | None
) -> Iterator[Result]:
    ways = {
        "from nothing": (ours.nothing, found.nothing),
        "next sample": (ours.following, found.following),
    }
    for way, pair in ways.items():
        title = f"quadratic program, {kind}, {way}"
        if reason is not None:
            yield Result(f"{title}: {name} left out", None, "ns", note=reason)
            continue
        own, other = (float(np.median(times)) for times in pair)
        slow = [float(np.percentile(times, 99)) / 1e3 for times in pair]
        note = (
            f"20 stages, 12 states, 6 inputs; 99 % within {slow[0]:.0f} us and {slow[1]:.0f} us; "
            f"costs differ by {worst:.0e} at most"
        )
        yield compared(title, own, "ns", name, other, note)


SAMPLES, BESIDE = 400, 8
"""Samples of each controller, and those of which one is given to the rivals."""
PUSHED = 0.5
"""Size of the start, over that of the largest ones of the region of attraction."""


def controller_results() -> Iterator[Result]:
    """Times of the programs that a predictive controller solves on its way to its orbit.

    Yields:
        Medians [ns]; the note holds both 99th percentiles and how far costs differ.
    """
    for case in (AEROBAT, ORNITHOPTER):
        one = controller(case, PREDICTIVE)
        program = one.iteration.program  # type: ignore[attr-defined]
        times: list[int] = []
        solve, rng = program.solve, np.random.default_rng(0)

        def timed(inverse: Array | None = None, solve=solve, times=times) -> ProgramStatus:  # type: ignore[no-untyped-def]
            began = perf_counter_ns()
            status: ProgramStatus = solve(inverse)
            times.append(perf_counter_ns() - began)
            return status

        model = one.model
        std = np.r_[vector(design(case), NOISE, 0.0)[model.kept], np.zeros(sum(model.chains))]
        begin = model.course.states[0]
        state, command = np.zeros(model.size), np.zeros(len(model.commands))
        sizes, starts = starts_of(case, 0, 1)
        state[: len(model.kept)] = PUSHED / sizes[0] * (starts[0] - begin)[model.kept]
        others: dict[str, list[int]] = {name: [] for name in RIVALS}
        gaps: dict[str, list[float]] = {name: [] for name in RIVALS}
        for k in range(model.parts):  # what comes again is made beforehand
            one.answer(k, 0 * state, command)
        program.solve = timed
        for k in range(SAMPLES):
            measured = state + std * rng.standard_normal(model.size)
            answer = one.answer(model.parts + k, measured, command)
            command = command if answer is None else answer
            for name, prepare in RIVALS.items() if k % BESIDE == 0 else ():
                try:
                    rival = prepare(program, True, False)
                except ImportError:
                    continue
                began = perf_counter_ns()
                cost = rival(measured)
                others[name].append(perf_counter_ns() - began)
                gaps[name].append(abs(cost / float(program["cost"]) - 1))
            part = (model.parts + k) % model.parts
            state = model.by_state[part] @ state + model.by_input[part] @ command
        program.solve = solve
        yield from _flown(case, times, others, gaps, program.sizes)


def _flown(
    case: Case,
    times: list[int],
    others: dict[str, list[int]],
    gaps: dict[str, list[float]],
    sizes: tuple[int, int, int],
) -> Iterator[Result]:
    title = f"predictive controller, {case.robot}, next sample"
    own, slow = float(np.median(times)), float(np.percentile(times, 99)) / 1e3
    for name, found in others.items():
        if not found:
            yield Result(f"{title}: {name} left out", None, "ns", note="it is not installed")
            continue
        unsolved = int(np.isnan(gaps[name]).sum())
        note = (
            "{} stages, {} states, {} inputs, ranges and rates; ".format(*sizes)
            + (f"{unsolved} of {len(found)} not solved by the rival; " if unsolved else "")
            + f"99 % of {len(times)} within {slow:.0f} us; rival from nothing, "
            f"99 % within {np.percentile(found, 99) / 1e3:.0f} us; "
            f"costs differ by {np.nanmax([0.0, *gaps[name]]):.0e} at most"
        )
        yield compared(title, own, "ns", name, float(np.median(found)), note)
