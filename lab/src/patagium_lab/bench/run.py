"""How fast everything is, beside other programs doing the same on the same robot.

Our compiled equations, air, networks and updates against the energy form, SymPy,
SymEngine, Pinocchio and MuJoCo: one run, random states, medians, one core, like
compiled with like. Neglected: accuracy (the oracles' business), cold caches.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection, Iterator
from typing import Any

from patagium.errors import ParameterError
from patagium.robot import load_robot
from patagium_lab.bench import air as benchmark_air
from patagium_lab.bench import learning
from patagium_lab.bench.dynamics import DynamicsBench
from patagium_lab.bench.result import Progress, Result
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
from patagium_lab.timing import one_core

Group = Callable[[DynamicsBench], Iterator[Result]]
CONDITIONS = "conditions"
"""Group of the lines that say where and when."""


def run_benchmark(
    selection: Collection[str] | None = None, progress: Progress | None = None
) -> list[dict[str, Any]]:
    """Times of ours and of the rivals on the Aerobat.

    The first run compiles the rivals: some three minutes of one core, most of it
    Pinocchio's headers and the published experiment's own C; they are kept.

    Args:
        selection: Some of `GROUPS`; all by default, `QUICK` are those whose rivals
            compile in seconds.
        progress: Told the stage and the part of all done.

    Returns:
        One dictionary a figure: group, name, value, unit, against, ratio, note,
        against_value. A rival that is missing is one line of value None whose note says
        why. The group "conditions" is the machine, its load before and after, and the time
        each group took.

    Raises:
        ParameterError: If a group is unknown.
        PatagiumError: If a rival computes other numbers than we do.
    """
    chosen = list(GROUPS) if selection is None else [g for g in GROUPS if g in selection]
    for name in selection or ():
        if name not in GROUPS:
            raise ParameterError("selection", f"some of {', '.join(GROUPS)}", name)
    rows = [_condition("processors", float(os.cpu_count() or 1), "cores", machine())]
    rows.append(_condition("load average at the start", None, "1", load_average()))
    bench = DynamicsBench(load_robot("aerobat"))
    for number, name in enumerate(chosen):
        if progress is not None:
            progress(name, number / len(chosen))
        started = time.perf_counter()
        rows += [{"group": name, **result.as_dict()} for result in GROUPS[name](bench)]
        rows.append(_condition(f"time taken by {name}", time.perf_counter() - started, "s"))
    rows.append(_condition("load average at the end", None, "1", load_average()))
    if progress is not None:
        progress("done", 1.0)
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


GROUPS: dict[str, Group] = {
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
"""Parts of the bench by name."""

QUICK = tuple(
    g
    for g in GROUPS
    if g not in ("published", "sympy-without-cse", "pinocchio", "strips", "pipeline", "compile")
)
"""Groups whose rivals compile in seconds."""
