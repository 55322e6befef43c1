"""A compiled function as a Python callable over NumPy arrays.

One call copies its arguments into fixed buffers, makes one foreign call and
copies the results out: a few microseconds. Hot loops use `address` from C or
`batch`, never a Python call a sample.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, real_array
from patagium.errors import ParameterError, ShapeError
from patagium.native.emit import SHARED_SUFFIX, dense

Shape = tuple[int, int]
_LANES = 8  # of the widest vectors there are; a multiple of all others
_LARGEST_SPARE = 2**24
"""Memory of batches up to this size is used again when nobody looks at it any more [B]."""
_ALIGNMENT = 64
_LONG = 4e-3
"""Time of a batch above which it is worth the start of threads [s]."""


@dataclass(frozen=True)
class Signature:
    """Names and shapes of a function's arguments and results."""

    name: str
    names_in: tuple[str, ...]
    sizes_in: tuple[Shape, ...]
    names_out: tuple[str, ...]
    sizes_out: tuple[Shape, ...]

    @classmethod
    def from_list(cls, entry: list[Any]) -> Signature:
        """Signature of the list of its fields, as JSON has it."""
        name, names_in, sizes_in, names_out, sizes_out = entry
        sizes = [tuple((r, c) for r, c in part) for part in (sizes_in, sizes_out)]
        return cls(name, tuple(names_in), sizes[0], tuple(names_out), sizes[1])


class NativeFunction:
    """A function of arrays, compiled, or on CasADi's virtual machine without a compiler.

    Args:
        signature: Names and shapes.
        expression: Gives the CasADi function behind it.
        library: Gives the library that holds `<name>_batch`, built at the first call; None
            without a compiler.
        function: Machine code `<name>` of one state, callable with pointers to arguments and
            results; None where only that of many is compiled.
    """

    def __init__(
        self,
        signature: Signature,
        expression: Callable[[], ca.Function],
        library: Callable[[], ctypes.CDLL] | None = None,
        function: Any = None,
    ) -> None:
        self.signature, self.name = signature, signature.name
        self.size_in, self.size_out = signature.sizes_in, signature.sizes_out
        self._expression, self._library = expression, library
        self._lock = threading.Lock()
        self._inputs = [_buffer(size) for size in self.size_in]
        self._outputs = [_buffer(size) for size in self.size_out]
        self._shared = [name.endswith(SHARED_SUFFIX) for name in signature.names_in]
        self._spare: dict[int, Array] = {}
        self._run: Callable[[], Any]
        self.address: int | None = None
        if function is not None:
            self.address = ctypes.cast(function, ctypes.c_void_p).value
            arguments, results = _pointers(self._inputs), _pointers(self._outputs)
            self._run = lambda: function(arguments, results)
        elif library is not None:
            self._run = self._start_virtual_machine
        else:
            self._start_virtual_machine(call=False)

    @property
    def batch_address(self) -> int | None:
        """Address of the code for many states, built at the first call; None without a compiler.

        `void f(arg, res, long count, long stride)`: arguments state by state, those the same for
        all once; results entry by entry, rows of `stride` states, a multiple of the lanes.
        """
        return ctypes.cast(self._many, ctypes.c_void_p).value

    @cached_property
    def _many(self) -> Any:
        """The compiled code for many states; None without a compiler."""
        return None if self._library is None else getattr(self._library(), f"{self.name}_batch")

    def _start_virtual_machine(self, call: bool = True) -> None:
        function = dense(self._expression())
        buffer, run = function.buffer()
        for k, array in enumerate(self._inputs):
            buffer.set_arg(k, array.ravel(order="K").data)
        for k, array in enumerate(self._outputs):
            buffer.set_res(k, array.ravel(order="K").data)
        keep = (function, buffer)
        self._run = lambda: run() and keep
        if call:
            self._run()

    @property
    def expression(self) -> ca.Function:
        """The CasADi function behind it, to differentiate or put into a program."""
        return self._expression()

    def __call__(self, *arguments: ArrayLike) -> Any:
        """Results as fresh arrays: (n, 1) as (n,), (1, 1) as float; a tuple when several.

        Raises:
            ShapeError: If an argument has the wrong shape.
            ParameterError: If the number of arguments is wrong.
        """
        self._check_count(arguments)
        with self._lock:
            given = zip(self.signature.names_in, self._inputs, arguments, strict=True)
            for name, buffer, argument in given:
                array = real_array(name, argument)
                if array.shape != buffer.shape and not array.size == buffer.size == 1:
                    many = " (`batch` takes many)" if array.shape[1:] == buffer.shape else ""
                    raise ShapeError(name, f"{buffer.shape}{many}", array.shape)
                buffer[...] = array
            self._run()
            results = [out.copy() if out.ndim else float(out) for out in self._outputs]
        return _lone(results)

    def batch(self, *arguments: ArrayLike) -> Any:
        """Results over a leading axis of N states, as views of one block each.

        Arguments named `...parameters` are the same for all states; any other
        without a leading axis is repeated. What takes long is shared by all cores, or as many
        as OMP_NUM_THREADS says; the numbers are the same.

        Returns:
            (N, ...) arrays; a tuple when several.

        Raises:
            ShapeError: If an argument has the wrong shape, or leading axes differ.
        """
        if self._library is None:
            return self.each(*arguments)
        arrays, count = self._given(arguments)
        padded = _padded(count)
        blocks = []
        for array, buffer, shared in zip(arrays, self._inputs, self._shared, strict=True):
            whole = array if shared else np.broadcast_to(array, (count, *buffer.shape))
            if buffer.ndim == 2:
                whole = np.swapaxes(whole, -1, -2)  # column-major, as the generated code has it
            blocks.append(np.ascontiguousarray(whole))
        results = [
            self._block(position, (columns, rows, padded))
            for position, (rows, columns) in enumerate(self.size_out)
        ]

        lengths = ctypes.c_long(padded)

        def part(begin: int, end: int) -> None:
            pairs = zip(blocks, self._shared, strict=True)
            given = [x if shared else x[begin:] for x, shared in pairs]
            found = _pointers([result[..., begin:] for result in results])
            self._many(_pointers(given), found, ctypes.c_long(end - begin), lengths)

        _side_by_side(part, count)
        shaped = [
            result[:, :, :count].transpose(2, 1, 0).reshape(count, *buffer.shape)
            for result, buffer in zip(results, self._outputs, strict=True)
        ]
        return _lone(shaped)

    def each(self, *arguments: ArrayLike) -> Any:
        """Values as of `batch`, in fresh memory, by the code of one state: nothing is compiled."""
        arrays, count = self._given(arguments)
        results = [np.empty((count, *buffer.shape)) for buffer in self._outputs]
        with self._lock:
            for k in range(count):
                for buffer, array in zip(self._inputs, arrays, strict=True):
                    buffer[...] = array if array.ndim == buffer.ndim else array[k]
                self._run()
                for result, buffer in zip(results, self._outputs, strict=True):
                    result[k] = buffer
        return _lone(results)

    def _given(self, arguments: tuple[ArrayLike, ...]) -> tuple[list[Array], int]:
        """Arguments of many states as arrays, and the number of states."""
        self._check_count(arguments)
        arrays, counts = list[Array](), set[int]()
        given = zip(self.signature.names_in, self._inputs, arguments, self._shared, strict=True)
        for name, buffer, argument, shared in given:
            array = real_array(name, argument)
            if buffer.ndim == 0 and array.shape[-1:] == (1,):
                array = array[..., 0]
            leading = array.ndim - buffer.ndim
            if array.shape[leading:] != buffer.shape or leading not in ((0,) if shared else (0, 1)):
                expected = buffer.shape if shared else ("N", *buffer.shape)
                raise ShapeError(name, expected, array.shape)
            arrays.append(array)
            if leading:
                counts.add(len(array))
        if len(counts) != 1 or 0 in counts:
            raise ShapeError(self.name, "one common leading axis N > 0", sorted(counts))
        return arrays, counts.pop()

    def _block(self, position: int, shape: tuple[int, int, int]) -> Array:
        """Aligned memory: that of an earlier call where nobody holds a view of it any more.

        Fresh memory costs more, in page faults, than the computation that fills it.
        """
        size = shape[0] * shape[1] * shape[2]
        with self._lock:
            owner = self._spare.get(position)
            # references: the dictionary, this name, the argument
            if owner is None or owner.size != size + _LANES or sys.getrefcount(owner) > 3:
                owner = np.empty(size + _LANES)
                if owner.nbytes <= _LARGEST_SPARE:
                    self._spare[position] = owner
            start = -owner.ctypes.data % _ALIGNMENT // owner.itemsize
            return owner[start : start + size].reshape(shape)

    def _check_count(self, arguments: tuple[ArrayLike, ...]) -> None:
        if len(arguments) != len(self._inputs):
            expected = f"{len(self._inputs)} arguments ({', '.join(self.signature.names_in)})"
            raise ParameterError(self.name, expected, len(arguments))


def _lone(results: list[Any]) -> Any:
    """The result where there is one alone, else all."""
    return results[0] if len(results) == 1 else tuple(results)


def _side_by_side(part: Callable[[int, int], None], count: int) -> None:
    """Call for parts of a number of states, on all cores where the first part takes long."""
    begun, first = time.perf_counter(), min(count, 8 * _LANES)
    part(0, first)
    lasts = (time.perf_counter() - begun) * (count / first - 1)
    cores = _cores() if lasts > _LONG else 1
    each = _LANES * -(-(count - first) // (_LANES * cores))
    ends = [*range(first, count, each or 1), count]
    if cores == 1:
        list(map(part, ends, ends[1:]))
        return
    with ThreadPoolExecutor(cores) as pool:  # made anew: no thread outlives a fork
        list(pool.map(part, ends, ends[1:]))


def _cores() -> int:
    """Number of cores, or the first one of a list in OMP_NUM_THREADS ("4,2") where it is set."""
    said = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()
    return max(1, int(said) if said.isdecimal() else os.cpu_count() or 1)


def named_function(
    name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX], **options: Any
) -> ca.Function:
    """CasADi function of symbols and of expressions of them by name."""
    values = [*inputs.values()], [*outputs.values()]
    return ca.Function(name, *values, [*inputs], [*outputs], options)


def _padded(count: int) -> int:
    """Multiple of the lanes, odd in cache lines so that columns do not share cache sets."""
    lines = -(-count // _LANES)
    return _LANES * (lines + 1 - lines % 2 if lines > _LANES else lines)


def _buffer(size: Shape) -> Array:
    rows, columns = size
    if size == (1, 1):
        return np.zeros(())
    return np.zeros(rows) if columns == 1 else np.zeros((rows, columns), order="F")


def _pointers(arrays: list[Array]) -> ctypes.Array[ctypes.c_void_p]:
    return (ctypes.c_void_p * max(len(arrays), 1))(*[array.ctypes.data for array in arrays])


def as_c(*values: Any) -> list[Any]:
    """Arguments in C: arrays by address, integers as ptrdiff_t or long, all else as it is."""
    return [
        ctypes.c_void_p(value.ctypes.data)
        if isinstance(value, np.ndarray)
        else ctypes.c_ssize_t(value)
        if isinstance(value, int)
        else value
        for value in values
    ]
