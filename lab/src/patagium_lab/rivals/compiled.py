"""C and C++ of the rivals, compiled into the same cache as ours."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from patagium.native.compiler import STRAIGHT_LINE, build
from patagium_lab.timing import CompiledCall

SHORT_FLAGS = (*STRAIGHT_LINE, "-w")
LONG_FLAGS = ("-O1", *STRAIGHT_LINE[1:], "-w")  # megabytes of text compile for minutes above -O1


@dataclass(frozen=True)
class Rival:
    """Somebody else's equations of the same robot, compiled.

    Attributes:
        name: Name, as it stands in the bench.
        calls: Compiled function for each quantity it offers.
        order: Index in q of each of its coordinates, (n,) [1].
        extra: Arrays after q, v, a or f, the same for all states.
        note: How the rival was made.
        compile_time: Time the compiler took when it was built [s].
        derivation_time: Time to derive and write the code [s]; zero where there is none.
        code_size: Length of the generated code [bytes].
    """

    name: str
    calls: Mapping[str, CompiledCall]
    order: NDArray[np.intp]
    extra: tuple[NDArray[np.float64], ...] = ()
    note: str = ""
    compile_time: float = float("nan")
    derivation_time: float = 0.0
    code_size: int = 0

    @property
    def story(self) -> str:
        """Story of the compiled code, in words."""
        parts = [self.note]
        if self.code_size:
            size, seconds = self.code_size / 1e6, self.derivation_time
            parts.append(f"{size:.2f} MB of C for all it offers, derived in {seconds:.2g} s")
        return "; ".join([*parts, f"compiled in {self.compile_time:.2g} s"])


def compile_rival(
    name: str, sources: Mapping[str, str], compiler: tuple[str, ...], flags: Sequence[str]
) -> tuple[ctypes.CDLL, float]:
    """A compiled library, and the seconds the compiler took to build it.

    Args:
        name: Name of the library, for the progress line.
        sources: File name (`.c`) to text: C, or C++ where the flags say so.
        compiler: The compiler and its arguments.
        flags: Flags of the compiler.

    Raises:
        CompilerError: With the compiler's own words.
    """
    library = build(compiler, sources, flags, name)
    return library.handle, library.facts


def library_calls(
    library: ctypes.CDLL, sizes: Mapping[str, tuple[int, ...]]
) -> dict[str, CompiledCall]:
    """The functions `rival_<quantity>` of a library.

    Args:
        library: The library.
        sizes: Entries of each result, for each quantity.
    """
    calls = {}
    for quantity, entries in sizes.items():
        address = ctypes.cast(getattr(library, f"rival_{quantity}"), ctypes.c_void_p).value
        calls[quantity] = CompiledCall(address or 0, entries, library)
    return calls
