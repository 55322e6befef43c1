"""Run of the bench of times: our functions beside other programs' on the same robot.

Our compiled equations, air, networks and updates stand against the energy form, SymPy, SymEngine,
Pinocchio and MuJoCo: one run, random states, medians, one core; compiled code is compared with
compiled code. Neglected: cold caches.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import Any

from patagium.robot import Robot, load_robot
from patagium_lab.bench import air as benchmark_air
from patagium_lab.bench import learning, orbits, programs, tick
from patagium_lab.bench.dynamics import DynamicsBench
from patagium_lab.bench.plan import BenchPlan
from patagium_lab.bench.result import Result
from patagium_lab.conditions import load_average, machine
from patagium_lab.rivals import (
    energy_rival,
    mujoco_rival,
    pinocchio_rival,
    symbolic_rival,
)
from patagium_lab.rivals.compiled import Rival
from patagium_lab.rivals.python_rivals import python_rivals
from patagium_lab.rivals.symbolic_code import SymbolicCode
from patagium_lab.study import Stages
from patagium_lab.timing import one_core

Timer = Callable[[DynamicsBench], Iterable[Result]]
CONDITIONS = "conditions"
"""Group of the rows that describe machine and load."""
TIME_TAKEN = "time taken by "
"""Begin of the names of rows that hold the time of a group."""


def run(plan: BenchPlan, stages: Stages) -> list[dict[str, Any]]:
    """Times of our functions and of the rivals' on the Aerobat.

    The first run compiles the rivals: some three minutes of one core, most of it Pinocchio's
    headers and the published experiment's own C; they are kept.

    Args:
        plan: Groups that are timed.
        stages: Receives progress.

    Returns:
        Rows with the keys group, name, value, unit, against, ratio, note, against_value. A
        rival that is missing is one row of value None whose note gives the reason. The group
        "conditions" holds the machine, its load before and after, and the time of each group.

    Raises:
        PatagiumError: If a rival's numbers are not ours.
    """
    rows = [_condition("processors", float(os.cpu_count() or 1), "cores", machine())]
    rows.append(_condition("load average at the start", None, "1", load_average()))
    bench, count = DynamicsBench(load_robot("aerobat")), len(plan.groups)
    for number, name in enumerate(plan.groups):
        with stages.stage(name, number / count, (number + 1) / count):
            rows += [{"group": name, **result.as_dict()} for result in TIMERS[name](bench)]
        rows.append(_condition(f"{TIME_TAKEN}{name}", stages.seconds[name], "s"))
    rows.append(_condition("load average at the end", None, "1", load_average()))
    stages.tell("done", 1.0)
    return rows


def _condition(name: str, value: float | None, unit: str, note: str = "") -> dict[str, Any]:
    return {"group": CONDITIONS, **Result(name, value, unit, note=note).as_dict()}


def _on_one_core(timer: Callable[[DynamicsBench], Iterable[Result]]) -> Timer:
    """Timer that runs on one core."""

    def run_there(bench: DynamicsBench) -> Iterator[Result]:
        with one_core():
            yield from timer(bench)

    return run_there


def _beside(make: Callable[[Robot], Rival | str], batch: bool = False) -> Timer:
    """Timer of our equations beside a rival's, or the reason why the rival is left out."""

    def run_beside(bench: DynamicsBench) -> Iterator[Result]:
        rival = make(bench.robot)
        if isinstance(rival, str):
            yield Result("rival left out", None, "ns", note=rival)
            return
        with one_core():
            yield from bench.against(rival, batch)

    return run_beside


def _symbolic(derive: Callable[[Robot], SymbolicCode | str], shared: bool) -> Timer:
    """Timer of our equations beside code of symbolic algebra."""

    def make(robot: Robot) -> Rival | str:
        code = derive(robot)
        if isinstance(code, str):
            return code
        # both without sharing would compile as long as D and the bias before it
        quantities = ("mass_matrix", "bias", "both") if shared else ("mass_matrix", "bias")
        return symbolic_rival.symbolic_rival(robot, code, shared, quantities)

    return _beside(make)


def _python(bench: DynamicsBench) -> Iterator[Result]:
    for quantity in ("mass_matrix", "bias"):
        rivals = python_rivals(bench.robot, quantity)
        rivals["a plain call of the CasADi function"] = bench.casadi_call(quantity)
        with one_core():
            yield from bench.in_python(quantity, rivals)


TIMERS: dict[str, Timer] = {
    "dynamics": _on_one_core(lambda bench: bench.alone()),
    "batch": _on_one_core(lambda bench: bench.batches()),
    "energy": _beside(energy_rival.short_rival),
    "published": _beside(energy_rival.published_rival),
    "sympy": _symbolic(symbolic_rival.sympy_code, shared=True),
    "sympy-without-cse": _symbolic(symbolic_rival.sympy_code, shared=False),
    "symengine": _symbolic(symbolic_rival.symengine_code, shared=True),
    "pinocchio": _beside(pinocchio_rival.pinocchio_rival, batch=True),
    "mujoco": _beside(mujoco_rival.mujoco_rival),
    "python": _python,
    "aerodynamics": lambda bench: learning.on_one_thread("air"),
    "air-models": _on_one_core(lambda bench: benchmark_air.model_results(bench.robot)),
    "strips": _on_one_core(lambda bench: benchmark_air.strip_results(bench.robot)),
    "update": lambda bench: learning.on_one_thread("update"),
    "pipeline": lambda bench: learning.pipeline_results(),
    "programs": _on_one_core(
        lambda bench: chain(programs.program_results(), programs.controller_results())
    ),
    "tick": _on_one_core(lambda bench: tick.tick_results()),
    "orbits": _on_one_core(lambda bench: orbits.orbit_results()),
    "simulation": _on_one_core(lambda bench: [learning.flight_result(bench.robot)]),
    "compile": lambda bench: learning.compile_results(),
}
"""Function that times each group, by name."""
