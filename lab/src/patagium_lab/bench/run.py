"""Run of the bench of times: our functions beside other programs' on the same robot.

Our compiled equations, air, networks and updates stand against the energy form, SymPy, SymEngine,
Pinocchio and MuJoCo: one run, random states, medians, one core; compiled code is compared with
compiled code. Neglected: cold caches.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import Any

from patagium.robot import load_robot
from patagium_lab.bench import air as benchmark_air
from patagium_lab.bench import learning
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

Timer = Callable[[DynamicsBench], Iterator[Result]]
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


def _ours(bench: DynamicsBench) -> Iterator[Result]:
    with one_core():
        yield from bench.alone()


def _batch(bench: DynamicsBench) -> Iterator[Result]:
    with one_core():
        yield from bench.batches()


def _energy(bench: DynamicsBench) -> Iterator[Result]:
    yield from _beside(bench, energy_rival.short_rival(bench.robot))


def _published(bench: DynamicsBench) -> Iterator[Result]:
    yield from _beside(bench, energy_rival.published_rival(bench.robot))


def _sympy(bench: DynamicsBench) -> Iterator[Result]:
    yield from _symbolic(bench, symbolic_rival.sympy_code(bench.robot), shared=True)


def _unshared(bench: DynamicsBench) -> Iterator[Result]:
    yield from _symbolic(bench, symbolic_rival.sympy_code(bench.robot), shared=False)


def _symengine(bench: DynamicsBench) -> Iterator[Result]:
    yield from _symbolic(bench, symbolic_rival.symengine_code(bench.robot), shared=True)


def _symbolic(bench: DynamicsBench, code: SymbolicCode | str, shared: bool) -> Iterator[Result]:
    if isinstance(code, str):
        yield from _beside(bench, code)
        return
    # both without sharing would compile as long as D and the bias before it
    quantities = ("mass_matrix", "bias", "both") if shared else ("mass_matrix", "bias")
    yield from _beside(bench, symbolic_rival.symbolic_rival(bench.robot, code, shared, quantities))


def _pinocchio(bench: DynamicsBench) -> Iterator[Result]:
    yield from _beside(bench, pinocchio_rival.pinocchio_rival(bench.robot), batch=True)


def _mujoco(bench: DynamicsBench) -> Iterator[Result]:
    yield from _beside(bench, mujoco_rival.mujoco_rival(bench.robot))


def _python(bench: DynamicsBench) -> Iterator[Result]:
    for quantity in ("mass_matrix", "bias"):
        rivals = python_rivals(bench.robot, quantity)
        rivals["a plain call of the CasADi function"] = bench.casadi_call(quantity)
        with one_core():
            yield from bench.in_python(quantity, rivals)


def _beside(bench: DynamicsBench, rival: Rival | str, batch: bool = False) -> Iterator[Result]:
    if isinstance(rival, str):
        yield Result("rival left out", None, "ns", note=rival)
        return
    with one_core():
        yield from bench.against(rival, batch)


def _air(bench: DynamicsBench) -> Iterator[Result]:
    yield from learning.on_one_thread("air")


def _models(bench: DynamicsBench) -> Iterator[Result]:
    with one_core():
        yield from benchmark_air.model_results(bench.robot)


def _strips(bench: DynamicsBench) -> Iterator[Result]:
    with one_core():
        yield from benchmark_air.strip_results(bench.robot)


def _update(bench: DynamicsBench) -> Iterator[Result]:
    yield from learning.on_one_thread("update")


def _simulation(bench: DynamicsBench) -> Iterator[Result]:
    with one_core():
        yield learning.flight_result(bench.robot)


def _pipeline(bench: DynamicsBench) -> Iterator[Result]:
    yield from learning.pipeline_results()


def _compile(bench: DynamicsBench) -> Iterator[Result]:
    yield from learning.compile_results()


TIMERS: dict[str, Timer] = {
    "dynamics": _ours,
    "batch": _batch,
    "energy": _energy,
    "published": _published,
    "sympy": _sympy,
    "sympy-without-cse": _unshared,
    "symengine": _symengine,
    "pinocchio": _pinocchio,
    "mujoco": _mujoco,
    "python": _python,
    "aerodynamics": _air,
    "air-models": _models,
    "strips": _strips,
    "update": _update,
    "pipeline": _pipeline,
    "simulation": _simulation,
    "compile": _compile,
}
"""Function that times each group, by name."""
