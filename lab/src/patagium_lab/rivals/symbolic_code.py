"""Code of symbolically derived equations: C with and without `cse`, and what `lambdify` writes.

The corrected Aerobat's equations by SymPy are stored, with the time the derivation
took; `derive_symbolic` and `symbolic_code` make them again. The C without shared
subexpressions is made by writing each of them out where it is used.
"""

from __future__ import annotations

import gzip
import importlib
import inspect
import json
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from patagium.errors import ParameterError
from patagium.robot.model import Robot
from patagium_lab.rivals.lagrangian import SymbolicEquations

STORED = Path(__file__).parent / "stored" / "aerobat-sympy.json.gz"
QUANTITIES = ("mass_matrix", "bias", "both")

_SYMBOL = re.compile(r"\bx\d+\b")


@dataclass(frozen=True)
class SymbolicCode:
    """Code for D, C v + G and both of one robot.

    Attributes:
        backend: Computer algebra system and version.
        parameter_names: Names of the parameters p of the robot.
        derivation_time: Processor time of the derivation alone [s].
        sharing_time: Processor time of finding the shared subexpressions, all quantities [s].
        temporaries: For each quantity the shared subexpressions as (name, C text), in order.
        results: For each quantity the C text of each entry: D's lower triangle by rows,
            then C v + G.
        python: For each quantity the source of SymPy's `lambdify` with `cse`, if SymPy made it.
    """

    backend: str
    parameter_names: tuple[str, ...]
    derivation_time: float
    sharing_time: float
    temporaries: Mapping[str, Sequence[tuple[str, str]]]
    results: Mapping[str, Sequence[str]]
    python: Mapping[str, str]


def symbolic_code(equations: SymbolicEquations, robot: Robot) -> SymbolicCode:
    """Code of equations, subexpressions shared by the system's own `cse`.

    Args:
        equations: Derived from the same robot.
        robot: The machine.
    """
    algebra: Any = importlib.import_module(equations.backend)
    started = time.process_time()
    temporaries, results = {}, {}
    for quantity in QUANTITIES:
        entries = [algebra.sympify(entry) for entry in _entries(equations, quantity)]
        shared, reduced = algebra.cse(entries)
        temporaries[quantity] = [(str(name), algebra.ccode(value)) for name, value in shared]
        results[quantity] = [algebra.ccode(algebra.sympify(value)) for value in reduced]
    return SymbolicCode(
        f"{equations.backend} {version(equations.backend)}",
        robot.parameter_names,
        equations.derivation_time,
        time.process_time() - started,
        temporaries,
        results,
        _lambdified(equations) if equations.backend == "sympy" else {},
    )


def _entries(equations: SymbolicEquations, quantity: str) -> list[Any]:
    mass = equations.lower_triangle
    return {"mass_matrix": mass, "bias": equations.bias, "both": mass + equations.bias}[quantity]


def _lambdified(equations: SymbolicEquations) -> dict[str, str]:
    import sympy

    sources = {}
    for quantity in ("mass_matrix", "bias"):
        entries = _entries(equations, quantity)
        function = sympy.lambdify(equations.arguments, entries, modules="math", cse=True)
        sources[quantity] = inspect.getsource(function)
    return sources


def store(code: SymbolicCode, file: Path = STORED) -> None:
    """Writes code to a file, the same bytes for the same code.

    Args:
        code: Code that is written.
        file: File to write.
    """
    text = json.dumps(asdict(code), separators=(",", ":"))
    file.write_bytes(gzip.compress(text.encode(), 9, mtime=0))


def stored_code(robot: Robot) -> SymbolicCode:
    """The stored equations of the Aerobat.

    Args:
        robot: An Aerobat: any parameters, the published bodies and joints.

    Raises:
        ParameterError: If the robot's parameters are not the stored ones.
    """
    fields = json.loads(gzip.decompress(STORED.read_bytes()))
    if tuple(fields["parameter_names"]) != robot.parameter_names:
        raise ParameterError("robot", "the Aerobat the stored equations are of", robot.name)
    return SymbolicCode(**{**fields, "parameter_names": robot.parameter_names})


def c_text(code: SymbolicCode, dof: int, quantity: str, shared: bool = True) -> str:
    """C of one quantity behind the interface of our compiled functions.

    Args:
        code: The equations.
        dof: Number of coordinates n.
        quantity: One of `QUANTITIES`.
        shared: Whether shared subexpressions are kept.
    """
    temporaries, results = code.temporaries[quantity], list(code.results[quantity])
    if not shared:
        temporaries, results = [], _written_out(temporaries, results)
    arguments = {"q": dof, "v": dof, "p": len(code.parameter_names)}
    if quantity == "mass_matrix":
        del arguments["v"]
    used = set(re.findall(r"\b[qvp]\d+\b", " ".join([*results, *(x for _, x in temporaries)])))
    lines = [
        f"const double {name}{i} = argument[{k}][{i}];"
        for k, (name, size) in enumerate(arguments.items())
        for i in range(size)
        if f"{name}{i}" in used
    ]
    lines += [f"const double {name} = {value};" for name, value in temporaries]
    lines += _assignments(results, dof, quantity)
    header = f"void rival_{quantity}(const double *const *argument, double *const *result)"
    return "#include <math.h>\n" + "\n".join([header, "{", *lines, "}\n"])


def _assignments(results: list[str], dof: int, quantity: str) -> list[str]:
    places: list[list[str]] = []
    if quantity != "bias":
        for i in range(dof):
            places += [
                [f"result[0][{i + dof * j}]", f"result[0][{j + dof * i}]"] for j in range(i + 1)
            ]
    if quantity != "mass_matrix":
        places += [[f"result[{int(quantity == 'both')}][{i}]"] for i in range(dof)]
    return [
        f"{' = '.join(dict.fromkeys(place))} = {value};"
        for place, value in zip(places, results, strict=True)
    ]


def _written_out(temporaries: Sequence[tuple[str, str]], results: list[str]) -> list[str]:
    """Results with every shared subexpression replaced by its text."""
    known: dict[str, str] = {}

    def expand(text: str) -> str:
        return _SYMBOL.sub(lambda match: f"({known[match.group()]})", text)

    for name, value in temporaries:
        known[name] = expand(value)
    return [expand(value) for value in results]
