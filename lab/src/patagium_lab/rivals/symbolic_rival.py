"""Symbolically derived equations as compiled C, and as the Python that `lambdify` gives.

The compiler gets the same flags as for ours; without `cse` it finds most of the shared
subexpressions by itself, in its own time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from patagium.arrays import Array
from patagium.native.compiler import compiler_command
from patagium.robot.model import Robot
from patagium_lab.rivals.compiled import (
    LONG_FLAGS,
    SHORT_FLAGS,
    Rival,
    compile_rival,
    library_calls,
)
from patagium_lab.rivals.lagrangian import derive_symbolic
from patagium_lab.rivals.symbolic_code import (
    QUANTITIES,
    SymbolicCode,
    c_text,
    stored_code,
    symbolic_code,
)


def symbolic_rival(
    robot: Robot, code: SymbolicCode, shared: bool, quantities: Sequence[str] = QUANTITIES
) -> Rival | str:
    """Compiled D, C v + G and both in one call.

    Args:
        robot: The robot the code is of.
        code: The equations.
        shared: Whether shared subexpressions are kept.
        quantities: Names out of `QUANTITIES`.
    """
    compiler = compiler_command()
    if compiler is None:
        return "no C compiler"
    texts = [c_text(code, robot.dof, quantity, shared) for quantity in quantities]
    text, flags = "\n".join(texts), SHORT_FLAGS if shared else LONG_FLAGS
    name = f"{code.backend} {'with' if shared else 'without'} cse"
    library, seconds = compile_rival(name, {"rival.c": text}, compiler, flags)
    n = robot.dof
    sizes = {"mass_matrix": (n * n,), "bias": (n,), "both": (n * n, n)}
    calls = library_calls(library, {quantity: sizes[quantity] for quantity in quantities})
    derivation = code.derivation_time + (code.sharing_time if shared else 0.0)
    order, extra = np.arange(n), (robot.parameters,)
    return Rival(name, calls, order, extra, flags[0], seconds, derivation, len(text))


def sympy_code(robot: Robot, rederive: bool = False) -> SymbolicCode:
    """Equations by SymPy: the stored ones, or derived again.

    Args:
        robot: An Aerobat.
        rederive: Whether to derive again, which needs SymPy and takes its time.

    Raises:
        ParameterError: If nothing is stored for that robot.
    """
    if rederive:
        return symbolic_code(derive_symbolic(robot, "sympy"), robot)
    return stored_code(robot)


def symengine_code(robot: Robot) -> SymbolicCode | str:
    """Equations by SymEngine, derived now, or why there are none.

    Args:
        robot: The machine.
    """
    try:
        return symbolic_code(derive_symbolic(robot, "symengine"), robot)
    except ImportError:
        return "symengine is not installed"


def lambdified(code: SymbolicCode, quantity: str) -> Callable[[Any, Any, Any], Any]:
    """The Python function `lambdify(..., modules="math", cse=True)` made of a quantity.

    Args:
        code: Equations by SymPy.
        quantity: "mass_matrix" (its lower triangle by rows) or "bias".

    Returns:
        Function of q, v and the robot's parameters, as sequences of numbers.
    """
    namespace: dict[str, Any] = dict(vars(math))
    exec(code.python[quantity], namespace)  # text of this package, written by `store`
    return namespace["_lambdifygenerated"]  # type: ignore[no-any-return]


def lambdified_by_symengine(robot: Robot, quantity: str) -> Callable[[Array], Array]:
    """SymEngine's own `Lambdify(..., cse=True)` of a quantity.

    Args:
        robot: The machine.
        quantity: "mass_matrix" (its lower triangle by rows) or "bias".

    Returns:
        Function of q, v and the robot's parameters in one vector.
    """
    import symengine

    equations = derive_symbolic(robot, "symengine")
    entries = {"mass_matrix": equations.lower_triangle, "bias": equations.bias}[quantity]
    arguments = [symbol for group in equations.arguments for symbol in group]
    return symengine.Lambdify(arguments, entries, cse=True)  # type: ignore[no-any-return]
