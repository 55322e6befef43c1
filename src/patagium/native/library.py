"""A set of symbolic functions as one compiled library, built once per key.

On a second call with the same key no expression is built at all: shapes and
names come from the cache, the code from the library.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import json
import os
from collections.abc import Callable, Collection, Sequence
from dataclasses import astuple
from functools import partial
from pathlib import Path

import casadi as ca

from patagium.native.compiler import (
    STRAIGHT_LINE,
    build,
    build_lock,
    cache_folder,
    compiler_accepts,
    compiler_path,
    machine_identity,
    short_hash,
)
from patagium.native.emit import emit, emit_batch
from patagium.native.function import Compiled, NativeFunction, Signature

LONG = 200_000
"""Length of a text from which on it is spared what gains nothing and takes long [B]."""
SPARED = ("-fno-tree-pre", "-fno-code-hoisting", "-fira-region=one")
"""Partial redundancies, and code to be hoisted out of branches: there are none in straight lines,
and GCC's search for either takes a time that grows with the square of the text (one pass does
both: it takes both flags to be rid of it). Registers are handed out for the text as a whole."""
_SOURCES = (
    *("native", "robot", "dynamics", "aerodynamics"),
    *("simulation", "sensing", "learning", "live"),
)


def load_functions(
    key: str,
    build_functions: Callable[[], Sequence[ca.Function]],
    *,
    label: str,
    many_only: Collection[str] = (),
) -> dict[str, NativeFunction]:
    """Functions by name, compiled where there is a compiler.

    Args:
        key: Everything the functions depend on beside patagium's own source,
            such as the text of the robot file.
        build_functions: Makes the SX functions; called on a cache miss, and when
            somebody asks for the expression behind a compiled function.
        label: What is being compiled, for the progress line.
        many_only: Functions that are called with many states: their code for many is
            compiled at once beside the others, and that for one state not at all (such a
            call runs on the virtual machine).

    Returns:
        Name of each function to the function to call with arrays.

    Raises:
        CompilerError: If the compiler refuses the generated text.
    """
    expressions = functools.cache(lambda: {made.name(): made for made in build_functions()})
    expression = partial(_expression, expressions)
    path = compiler_path()
    if path is None:
        return {
            name: NativeFunction(_signature(f), partial(expression, name), None)
            for name, f in expressions().items()
        }

    def batch_library(name: str) -> ctypes.CDLL:
        unit = f"{name}_batch.c"
        folder = _folder(
            path,
            f"{key} batch {name}",
            lambda: {unit: emit_batch(expressions()[name])},
            f"{label}: {name} of many states",
        )
        return ctypes.CDLL(str(folder / "library.so"))

    many = " ".join(["many only", *sorted(many_only)]) if many_only else ""
    folder = _folder(path, key + many, lambda: _texts(expressions(), many_only), label)
    library = ctypes.CDLL(str(folder / "library.so"))
    functions = {}
    for entry in json.loads((folder / "signatures.json").read_text()):
        signature = Signature.from_list(entry)
        name = signature.name
        compiled = Compiled(None, lambda: library)
        if name not in many_only:
            compiled = Compiled(getattr(library, name), partial(batch_library, name))
        functions[name] = NativeFunction(signature, partial(expression, name), compiled)
    return functions


def _folder(path: str, key: str, texts: Callable[[], dict[str, str]], label: str) -> Path:
    """Folder of the cache with the library of a key; its texts are made only when missing."""
    name = short_hash(key, source_digest(), machine_identity(path))
    folder = _cached_folder(name)
    if folder is None:
        with build_lock(name):
            folder = _cached_folder(name) or _built_folder(path, name, texts, label)
    return folder


def _cached_folder(name: str) -> Path | None:
    """Folder of the cache that an index names; None where there is none."""
    index = cache_folder() / f"index-{name}"
    folder = cache_folder() / index.read_text() if index.exists() else None
    return folder if folder is not None and (folder / "library.so").exists() else None


def _built_folder(path: str, name: str, texts: Callable[[], dict[str, str]], label: str) -> Path:
    """Folder of the cache with a library that is compiled now and named by an index."""
    units = texts()
    long = max(map(len, units.values())) > LONG
    spared = [flag for flag in SPARED if long and compiler_accepts(path, flag)]
    folder = build(path, units, (*STRAIGHT_LINE, *spared), label)
    scratch = cache_folder() / f"index-{name}.{os.getpid()}"
    scratch.write_text(folder.name)
    scratch.replace(cache_folder() / f"index-{name}")
    return folder


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
    return Signature(
        function.name(),
        tuple(function.name_in()),
        tuple(tuple(function.size_in(k)) for k in range(function.n_in())),
        tuple(function.name_out()),
        tuple(tuple(function.size_out(k)) for k in range(function.n_out())),
    )


def _expression(functions: Callable[[], dict[str, ca.Function]], name: str) -> ca.Function:
    return functions()[name]


def _texts(functions: dict[str, ca.Function], many_only: Collection[str]) -> dict[str, str]:
    """C text of each function, and their signatures, by the name of the file."""
    signatures = [astuple(_signature(function)) for function in functions.values()]
    units = {
        f"{name}_batch.c" if name in many_only else f"{name}.c": (
            emit_batch(function) if name in many_only else emit(function)
        )
        for name, function in functions.items()
    }
    return units | {"signatures.json": json.dumps(signatures)}
