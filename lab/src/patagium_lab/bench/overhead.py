"""Overheads of dynamics and of aerodynamics, as in two figures of the paper, like for like.

Dynamics: symbolic against algorithmic differentiation, interpreted and compiled, as published and
as it should be. Aerodynamics: every model of the air, and the networks that learned it. Times are
medians on random states.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from patagium.aerodynamics import Air
from patagium.dynamics import equations
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.learning.models.network import Network
from patagium.native.compiler import STRAIGHT_LINE, compiler_command
from patagium.native.emit import emit
from patagium.robot import load_robot
from patagium.robot.model import Robot
from patagium_lab.bench import air as benchmark_air
from patagium_lab.bench import learning
from patagium_lab.bench.dynamics import DynamicsBench, random_states, walk
from patagium_lab.jobs import Job
from patagium_lab.rivals import energy_rival, symbolic_rival
from patagium_lab.rivals.compiled import Rival, compile_rival, library_calls
from patagium_lab.rivals.python_rivals import interpreted_energy, python_rivals
from patagium_lab.timing import one_core, time_call, time_python

_NAN = float("nan")
CALLS = 40_000
"""Calls of the model of the air in 1 s of flight: Runge-Kutta of four stages at 1e-4 s."""


def dynamics_overhead(robot: Robot, rivals: Sequence[str]) -> list[dict[str, Any]]:
    """Times of D, of C v + G and of both, by formulation and by how it is run.

    Args:
        robot: An Aerobat: symbolic equations are stored for it.
        rivals: Keys of `RIVALS` that are timed compiled.

    Returns:
        Rows with the keys formulation, run ("compiled" or "interpreted"), mass_matrix, bias,
        both [ns] (NaN where a formulation offers none), derivation_time [s], compile_time [s],
        code_size [bytes].
    """
    bench = DynamicsBench(robot)
    rows = [_interpreted(bench, kind) for kind in ("symbolic", "differentiated")]
    made = [RIVALS[name].make(robot) for name in rivals]
    with one_core():
        rows += [_compiled(bench, rival) for rival in made if isinstance(rival, Rival)]
    return rows


def compile_jobs(
    rivals: Sequence[str], models: Sequence[str], networks: Sequence[str]
) -> list[Job]:
    """Jobs that compile into the cache what is timed here.

    Args:
        rivals: Keys of `RIVALS`.
        models: Keys of `bench.air.MODELS`.
        networks: Keys of `WING_NETWORKS`.
    """
    jobs = [Job(compile_ahead, ("rival", name), RIVALS[name].cost) for name in rivals]
    jobs += [Job(compile_ahead, ("air", name), 3.0) for name in models]
    return jobs + [Job(compile_ahead, ("network", name), 5.0) for name in networks]


def compile_ahead(kind: str, name: str) -> None:
    """Compile one function into the cache.

    Args:
        kind: "rival", "air" or "network".
        name: Key of that kind.
    """
    robot = load_robot("aerobat")
    if kind == "rival":
        RIVALS[name].make(robot)
    elif kind == "air":
        benchmark_air.compiled(benchmark_air.MODELS[name](robot, Air()))
    else:
        learning.compiled_network(WING_NETWORKS[name](robot))


def aerodynamics_overhead(models: Sequence[str], networks: Sequence[str]) -> list[dict[str, Any]]:
    """Times of the force of the Aerobat's air by its equations and by networks.

    Args:
        models: Keys of `bench.air.MODELS`.
        networks: Keys of `WING_NETWORKS`.

    Returns:
        Rows with the keys model, kind ("equations" or "learned"), single [ns a state, one
        state a call, compiled, with rates of its own states], batch [ns a state, many
        states in one Python call; NaN if not timed], flight_second (time in one second of
        flight, `CALLS` calls [s]), times_real_time.
    """
    robot = load_robot("aerobat")
    values = {result.name: result.value or _NAN for result in learning.on_one_thread("air")}
    with one_core():
        rows = [
            _cost_row(name, "equations", benchmark_air.model_cost(robot, name)) for name in models
        ]
        states = random_states(robot, 512)
        known = np.hstack([states.q, states.v])
        for name in networks:
            network = WING_NETWORKS[name](robot)
            others = np.random.default_rng(0).normal(size=(512, network.inputs - known.shape[1]))
            value = learning.network_cost(network, np.hstack([known, others]))
            rows.append(_cost_row(f"network {name} ({network.size} weights)", "learned", value))
    rows += [
        _cost_row(name, "learned", value, values[f"{name} batch"])
        for name, value in values.items()
        if name.startswith("network") and not name.endswith(" batch")
    ]
    rows[0]["batch"] = values["aerodynamic_force batch"]
    return rows


def _cost_row(model: str, kind: str, single: float, batch: float = _NAN) -> dict[str, Any]:
    second = CALLS * single * 1e-9
    return {
        "model": model,
        "kind": kind,
        "single": single,
        "batch": batch,
        "flight_second": second,
        "times_real_time": 1.0 / second,
    }


def _interpreted(bench: DynamicsBench, kind: str) -> dict[str, Any]:
    """One state a Python call, nothing compiled."""
    symbolic, times, derivation = kind == "symbolic", {}, 0.0
    for quantity in ("mass_matrix", "bias"):
        started = time.process_time()
        if symbolic:
            function = python_rivals(bench.robot, quantity)["SymPy's lambdify with cse"]
        else:
            function = interpreted_energy(bench.robot, quantity)
            derivation += time.process_time() - started
        rows = list(zip(*bench.states.of(quantity), strict=True))
        times[quantity] = time_python(walk(function, rows))
    if symbolic:
        code = symbolic_rival.sympy_code(bench.robot)
        derivation = code.derivation_time + code.sharing_time
    return {
        "formulation": "SymPy, lambdify with cse" if symbolic else "energy form, CasADi call",
        "run": "interpreted",
        **times,
        "both": sum(times.values()),
        "derivation_time": derivation,
        "compile_time": 0.0,
        "code_size": 0,
    }


def _shared(robot: Robot) -> Rival | str:
    return symbolic_rival.symbolic_rival(robot, symbolic_rival.sympy_code(robot), shared=True)


def _unshared(robot: Robot) -> Rival | str:
    code = symbolic_rival.sympy_code(robot)
    return symbolic_rival.symbolic_rival(robot, code, False, ("mass_matrix", "bias"))


def _recursive(robot: Robot) -> Rival | str:
    """Our own D, C v + G and both, built alone so that their making can be timed."""
    compiler = compiler_command()
    if compiler is None:
        return "no C compiler"
    started = time.process_time()
    machine, p = robot.symbolic()
    q, v = ca.SX.sym("q", robot.dof), ca.SX.sym("v", robot.dof)
    mass_matrix, bias = equations.mass_matrix(machine, q), equations.bias(machine, q, v)
    functions = [
        ca.Function("rival_mass_matrix", [q, p], [mass_matrix], ["q", "parameters"], ["D"]),
        ca.Function("rival_bias", [q, v, p], [bias], ["q", "v", "parameters"], ["h"]),
        ca.Function(
            "rival_both", [q, v, p], [mass_matrix, bias], ["q", "v", "parameters"], ["D", "h"]
        ),
    ]
    sources = {f"{function.name()}.c": "".join(emit(function)) for function in functions}
    derivation = time.process_time() - started
    library, seconds = compile_rival("our D and C v + G", sources, compiler, STRAIGHT_LINE)
    n = robot.dof
    sizes = {"mass_matrix": (n * n,), "bias": (n,), "both": (n * n, n)}
    return Rival(
        "recursive, SX (patagium)",
        library_calls(library, sizes),
        np.arange(n),
        (robot.parameters,),
        compile_time=seconds,
        derivation_time=derivation,
        code_size=sum(map(len, sources.values())),
    )


def _compiled(bench: DynamicsBench, rival: Rival) -> dict[str, Any]:
    times = {}
    for quantity in ("mass_matrix", "bias", "both"):
        call = rival.calls.get(quantity)
        inputs = bench.states.of("bias" if quantity == "both" else quantity)
        times[quantity] = time_call(call, [*inputs, *rival.extra]) if call else _NAN
    return {
        "formulation": rival.name,
        "run": "compiled",
        **times,
        "derivation_time": rival.derivation_time,
        "compile_time": rival.compile_time,
        "code_size": rival.code_size,
    }


class RivalMaker(NamedTuple):
    """A formulation of the dynamics that is timed.

    Attributes:
        make: Gives the compiled functions, or the reason why there are none.
        cost: Expected time of the C compiler the first time [s].
    """

    make: Callable[[Robot], Rival | str]
    cost: float


RIVALS = {
    "shared": RivalMaker(_shared, 11.0),
    "unshared": RivalMaker(_unshared, 36.0),
    "published": RivalMaker(energy_rival.published_rival, 33.0),
    "short": RivalMaker(energy_rival.short_rival, 4.0),
    "recursive": RivalMaker(_recursive, 1.0),
}
"""Formulations of the dynamics, by name."""
USUAL_RIVALS = ("shared", "short", "recursive")
"""Formulations that compile in seconds; the others take half a minute each."""
QUICK_RIVALS = ("shared", "recursive")
"""One of them symbolic and one differentiated."""
WING_NETWORKS: dict[str, Callable[[Robot], Network]] = {
    "attached strips": partial(LinearStripNetwork, attached=True),
}
"""Networks that the bench of updates does not time, by name."""
AIR_MODELS, AIR_NETWORKS = tuple(benchmark_air.MODELS), tuple(WING_NETWORKS)
"""Names of all models of the air and of all networks that are timed."""
