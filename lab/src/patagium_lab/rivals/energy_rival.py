"""The energy form as compiled C, written by CasADi's own generator.

`published`: MX, the full Jacobian of D v, no shared subexpressions, as the published
experiment did it. `short`: SX, directional derivatives, shared subexpressions: the
best of that formulation. The robot's parameters stay inputs, as in ours.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import casadi as ca
import numpy as np

from patagium.native.compiler import compiler_command
from patagium.robot.model import Robot
from patagium_lab.rivals import energy_form as energy
from patagium_lab.rivals.compiled import (
    LONG_FLAGS,
    SHORT_FLAGS,
    Rival,
    compile_rival,
    library_calls,
)
from patagium_lab.rivals.symbols import with_symbols


def published_rival(robot: Robot) -> Rival | str:
    """D and C v + G in one call as the published experiment generated them.

    Args:
        robot: The machine.
    """
    started = time.perf_counter()
    machine, q, v, p = _machine(robot, ca.MX)
    kinetic = energy.energy_kinetic(machine, q, v)
    mass_matrix = ca.jacobian(ca.jacobian(kinetic, v).T, v).T
    slope = ca.jacobian(mass_matrix @ v, q)
    bias = (slope - slope.T / 2) @ v + energy.energy_gravity(machine, q)
    both = ca.Function("both", [q, v, p], [ca.densify(mass_matrix), ca.densify(bias)])
    return _compiled(robot, "energy form, MX as published", [both], LONG_FLAGS, started)


def short_rival(robot: Robot) -> Rival | str:
    """D, C v, G and their sums from SX with shared subexpressions.

    Args:
        robot: The machine.
    """
    started = time.perf_counter()
    machine, q, v, p = _machine(robot, ca.SX)
    mass_matrix = energy.energy_mass_matrix(machine, q)
    coriolis = energy.energy_coriolis(machine, q, v)
    gravity = energy.energy_gravity(machine, q)
    results = {
        "mass_matrix": ([q], [mass_matrix]),
        "coriolis": ([q, v], [coriolis]),
        "gravity": ([q], [gravity]),
        "bias": ([q, v], [coriolis + gravity]),
        "both": ([q, v], [mass_matrix, coriolis + gravity]),
    }
    functions = [
        ca.Function(name, [*inputs, p], outputs, {"cse": True})
        for name, (inputs, outputs) in results.items()
    ]
    return _compiled(robot, "energy form, SX with cse", functions, SHORT_FLAGS, started)


def _machine(robot: Robot, symbol: type) -> tuple[Robot, ca.SX, ca.SX, ca.SX]:
    names = robot.parameter_names
    q, v = symbol.sym("q", robot.dof), symbol.sym("v", robot.dof)  # type: ignore[attr-defined]
    p = symbol.sym("p", len(names))  # type: ignore[attr-defined]
    return with_symbols(robot, dict(zip(names, ca.vertsplit(p), strict=True))), q, v, p


def _compiled(
    robot: Robot, name: str, functions: list[ca.Function], flags: tuple[str, ...], started: float
) -> Rival | str:
    compiler = compiler_command()
    if compiler is None:
        return "no C compiler"
    text = "\n".join([generated_c(functions), *(_wrapper(f) for f in functions)])
    derivation = time.perf_counter() - started
    library, seconds = compile_rival(name, {"rival.c": text}, compiler, flags)
    sizes = {f.name(): tuple(f.numel_out(k) for k in range(f.n_out())) for f in functions}
    return Rival(
        name,
        library_calls(library, sizes),
        np.arange(robot.dof),
        (robot.parameters,),
        flags[0],
        seconds,
        derivation,
        len(text),
    )


def generated_c(functions: list[ca.Function]) -> str:
    """C text of functions by CasADi's own generator.

    Args:
        functions: Any CasADi functions.
    """
    with tempfile.TemporaryDirectory() as folder:
        generator = ca.CodeGenerator("energy.c")
        for function in functions:
            generator.add(function)
        generator.generate(f"{folder}/")
        return Path(folder, "energy.c").read_text()


def _wrapper(function: ca.Function) -> str:
    """The plain interface of our compiled functions around CasADi's."""
    name, inputs, outputs = function.name(), function.n_in(), function.n_out()
    return f"""
void rival_{name}(const double *const *argument, double *const *result)
{{
    static casadi_int iw[{function.sz_iw() + 1}];
    static double w[{function.sz_w() + 1}];
    const double *arg[{function.sz_arg() + 1}];
    double *res[{function.sz_res() + 1}];
    for (int i = 0; i < {inputs}; ++i) arg[i] = argument[i];
    for (int i = 0; i < {outputs}; ++i) res[i] = result[i];
    {name}(arg, res, iw, w, 0);
}}
"""
