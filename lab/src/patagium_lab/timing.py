"""Times of calls: compiled functions are timed in C, Python calls in Python.

States are random, caches are warm, times are medians over rounds of about half a millisecond, on
one core where the system lets a process choose. Neglected: cold caches.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from patagium.arrays import Array
from patagium.native import NativeFunction, load_kernel
from patagium_lab.kernels import KERNELS


@dataclass(frozen=True)
class CompiledCall:
    """A compiled function `void f(const double *const *, double *const *)`.

    Attributes:
        address: Address of the function.
        sizes_out: Number of entries of each result.
        keep: Object that must stay alive for the address to be valid.
    """

    address: int
    sizes_out: tuple[int, ...]
    keep: object = None

    def evaluate(self, inputs: Sequence[Array]) -> list[Array]:
        """Results for one state.

        Args:
            inputs: One vector an argument.
        """
        arguments = [np.ascontiguousarray(x, float) for x in inputs]
        results = [np.zeros(size) for size in self.sizes_out]
        function = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(self.address)
        function(_pointers(arguments), _pointers(results))
        return results


def compiled_call(function: NativeFunction) -> CompiledCall | None:
    """Compiled code of a native function; None without a compiler."""
    if function.address is None:
        return None
    sizes = tuple(rows * columns for rows, columns in function.size_out)
    return CompiledCall(function.address, sizes, function)


def time_call(call: CompiledCall, inputs: Sequence[Array], budget: float = 0.03) -> float:
    """Median time of one call [ns].

    Args:
        call: The function.
        inputs: One array an argument: (N, k) a state each, or (k,) for all [SI].
        budget: Time to spend [s].

    Raises:
        RuntimeError: Without a compiler.
    """
    arrays = [np.ascontiguousarray(x, float) for x in inputs]
    states = max(len(x) for x in arrays if x.ndim == 2)
    sizes = (ctypes.c_int64 * len(arrays))(*(x.shape[1] if x.ndim == 2 else 0 for x in arrays))
    results = [np.zeros(size) for size in call.sizes_out]
    spread = (ctypes.c_double * 3)()
    _kernel().time_calls(
        ctypes.c_void_p(call.address),
        len(arrays),
        sizes,
        _pointers(arrays),
        ctypes.c_int64(states),
        _pointers(results),
        ctypes.c_double(1e9 * budget),
        spread,
    )
    return float(spread[1])


def time_batch(function: Callable[[], object], states: int, budget: float = 0.1) -> float:
    """Median time a state of a Python call that takes many states at once [ns].

    Args:
        function: The call.
        states: Number of states of one call.
        budget: Time to spend [s].
    """
    return time_python(function, budget) / states


def time_python(function: Callable[[], object], budget: float = 0.1) -> float:
    """Median time of one Python call [ns].

    Args:
        function: The call; to walk through states, let it draw the next one itself.
        budget: Time to spend [s].
    """
    function()
    rounds: list[int] = []
    stop = time.perf_counter() + budget
    while len(rounds) < 5 or time.perf_counter() < stop:
        started = time.perf_counter_ns()
        function()
        rounds.append(time.perf_counter_ns() - started)
    return float(np.median(rounds))


@contextlib.contextmanager
def one_core() -> Iterator[int | None]:
    """Keep the process on one core and give its number, or None where the system cannot."""
    if not hasattr(os, "sched_setaffinity"):
        yield None
        return
    allowed = os.sched_getaffinity(0)
    core = max(allowed)
    os.sched_setaffinity(0, {core})
    try:
        yield core
    finally:
        os.sched_setaffinity(0, allowed)


def _kernel() -> ctypes.CDLL:
    kernel = load_kernel("timing", folder=KERNELS)
    if kernel is None:
        raise RuntimeError("timing compiled functions needs a C compiler")
    return kernel


def _pointers(arrays: Sequence[Array]) -> ctypes.Array[ctypes.c_void_p]:
    return (ctypes.c_void_p * max(len(arrays), 1))(*(x.ctypes.data for x in arrays))
