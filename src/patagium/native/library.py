"""A set of symbolic functions as one compiled library, built once per key.

On a second call with the same key no expression is built at all: shapes and
names come from the cache, the code from the library.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
from collections.abc import Callable, Collection, Sequence
from dataclasses import astuple
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import casadi as ca

from patagium.native.cache import Library, build_lock, load_library, record_library, short_hash
from patagium.native.compiler import (
    STRAIGHT_LINE,
    build,
    compiler_accepts,
    compiler_command,
    machine_identity,
)
from patagium.native.emit import emit, emit_batch
from patagium.native.function import NativeFunction, Signature

SPARED = (
    *("-fno-tree-pre", "-fno-code-hoisting", "-fno-tree-dse", "-fno-dse", "-fira-region=one"),
    "--param=lra-max-considered-reload-pseudos=100",  # to spill for one register
)
"""What straight code lacks, and GCC seeks in a quarter of its time, of long texts in more."""
BRIEF = "-Og"
"""For long texts that take longer to compile than to run: half of GCC's time."""
_SOURCES = (
    *("native", "robot", "dynamics", "aerodynamics"),
    *("simulation", "sensing", "learning", "live", "control"),
)


Code: TypeAlias = tuple[dict[str, str], list[Any], dict[str, str]]
"""File name to C text, signature of each function, and further flags of some of the files."""


def load_functions(
    key: str,
    build_functions: Callable[[], Sequence[ca.Function]],
    *,
    label: str,
    many_only: Collection[str] = (),
) -> dict[str, NativeFunction]:
    """Functions by name, compiled where there is a compiler.

    Args:
        key: Everything the functions depend on in addition to patagium's own source,
            such as the text of the robot file.
        build_functions: Makes the SX functions; called on a cache miss, and when
            somebody asks for the expression behind a compiled function.
        label: What is being compiled, for the progress line.
        many_only: Functions that are called with many states: their code for many is
            compiled at once beside the others, with less optimization, and that for one
            state not at all (such a call runs on the virtual machine).

    Returns:
        Name of each function to the function to call with arrays.

    Raises:
        CompilerError: If the compiler refuses the generated text.
    """
    expressions = functools.cache(lambda: {made.name(): made for made in build_functions()})

    def expression(name: str) -> ca.Function:
        return expressions()[name]

    compiler = compiler_command()
    if compiler is None:
        return {
            name: NativeFunction(_signature(f), partial(expression, name))
            for name, f in expressions().items()
        }

    def batch_library(name: str) -> ctypes.CDLL:
        return _library(
            compiler,
            f"{key} batch {name}",
            lambda: _code({name: expressions()[name]}, [name]),
            f"{label}: {name} of many states",
        ).handle

    many = " ".join(["many only", *sorted(many_only)]) if many_only else ""
    library = _library(compiler, key + many, lambda: _code(expressions(), many_only, BRIEF), label)
    functions = {}
    for entry in library.facts:
        signature = Signature.from_list(entry)
        name = signature.name
        code: tuple[Any, ...] = (lambda: library.handle,)
        if name not in many_only:
            code = partial(batch_library, name), getattr(library.handle, name)
        functions[name] = NativeFunction(signature, partial(expression, name), *code)
    return functions


def _library(compiler: tuple[str, ...], key: str, code: Callable[[], Code], label: str) -> Library:
    """Library of a key, its facts the signatures; its code is made only where it is not kept."""
    name = short_hash(key, source_digest(), machine_identity(compiler))
    library = load_library(name)
    if library is None:
        with build_lock(name):
            library = load_library(name)
            if library is None:
                units, signatures, flags = code()
                spared = SPARED if compiler_accepts(compiler, SPARED) else ()
                library = build(compiler, units, (*STRAIGHT_LINE, *spared), label, flags)
                record_library(name, library.digest, signatures)
                library = library._replace(facts=signatures)
    return library


def expression_digest(kind: type, build_functions: Callable[[], Sequence[ca.Function]]) -> str:
    """Hash of what a class from outside patagium expresses; empty for patagium's own classes.

    Args:
        kind: The class.
        build_functions: Makes the SX functions that it expresses.
    """
    own = kind.__module__.startswith("patagium.")  # `source_digest` is of these
    return "" if own else " " + short_hash(*(made.serialize() for made in build_functions()))


@functools.cache
def source_digest() -> str:
    """Hash of the modules that make expressions and code."""
    digest = hashlib.sha256(ca.CasadiMeta.version().encode())
    root = Path(__file__).parents[1]
    for layer in _SOURCES:
        for file in sorted((root / layer).rglob("*.[pch]*")):
            if file.suffix in (".py", ".c", ".h"):
                digest.update(file.read_bytes())
    return digest.hexdigest()


def _signature(function: ca.Function) -> Signature:
    given, found = function.name_in(), function.name_out()
    sizes = map(function.size_in, given), map(function.size_out, found)
    return Signature.from_list([function.name(), given, sizes[0], found, sizes[1]])


def _code(
    functions: dict[str, ca.Function], many_only: Collection[str], flag: str | None = None
) -> Code:
    """C files, signatures of the functions, and the compiler's flag of files that may take one."""
    units, flags = dict[str, str](), dict[str, str]()
    for name, function in functions.items():
        many = name in many_only
        stem = f"{name}_batch" if many else name
        texts = emit_batch(function) if many else emit(function)
        own = {f"{stem}{k or ''}.c": text for k, text in enumerate(texts)}
        # files with loops take none: a kernel is called (int[]), or its derivatives are (fwd1_)
        if flag and many and not any("fwd1_" in text for text in own.values()):
            flags |= {k: flag for k in own if "int[]" not in own[k]}
        units |= own
    return units, [astuple(_signature(function)) for function in functions.values()], flags
