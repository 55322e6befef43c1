"""Memory of strips in a network: lags, how they depend on weights, and how they follow samples.

A block of samples goes through one call of C where there is a compiler, else step by step.
Neglected: flow between samples other than straight.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.learning.models.hidden_equations import Remembered
from patagium.learning.models.live_memory import LiveMemory
from patagium.native import NativeFunction, load_kernel

Array = NDArray[np.float64]


class CompiledLags(NamedTuple):
    """Compiled functions of a network's lags, and their numbers.

    Attributes:
        encode: Address of the function of (measured, z, coded, constants).
        slopes: Address of that of many (dz, dcoded), and [measured, z, coded, outputs, constants].
        states: Length of z.
        remembered: Weights that z depends on, the first.
        prior: Coded numbers are prior + reach W, (n_o,).
        reach: (n_o,).
        constants: Of both functions.
    """

    encode: int
    slopes: int
    states: int
    remembered: int
    prior: Array
    reach: Array
    constants: Array


class Recollection(ctypes.Structure):
    """`recollection` of the kernel, field by field."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in ("measured", "states", "remembered", "strips")),
        *((name, ctypes.c_void_p) for name in ("begin", "step", "coded", "constants", "reach")),
        *((name, ctypes.c_void_p) for name in ("weights", "carried")),
    ]


class LagMemory:
    """What is recalled behind [q, v]: [z, vec S, W_m].

    Args:
        functions: Of `hidden_functions`.
        prior: Coded numbers are prior + reach W, (n_o,).
        reach: (n_o,).
        constants: Of the functions.
        sizes: Of [q, v], of z, of W_m; strips.
    """

    def __init__(
        self,
        functions: Mapping[str, NativeFunction],
        prior: Array,
        reach: Array,
        constants: Array,
        sizes: tuple[int, int, int, int],
    ) -> None:
        self._functions, self._prior, self._constants = functions, prior, constants
        self._all_reach, self._sizes = reach, sizes
        _, self._states, self._count, _ = sizes
        self._reach = np.ascontiguousarray(reach[: self._count])
        n_z, n_m, strips = sizes[1:]
        self._shapes = ((n_z,), (n_z, n_m), (strips,), (strips, n_m), (strips,))
        self._cuts = np.cumsum([math.prod(shape) for shape in self._shapes]).tolist()
        self._kernel = load_kernel("recall")
        begin, step = functions["begin"].address, functions["step"].address
        self._calls = None if self._kernel is None or begin is None else (*sizes, begin, step)

    @property
    def size(self) -> int:
        """Length of [z, vec S, W_m]."""
        return self._states * (1 + self._count) + self._count

    def compiled(self) -> CompiledLags | None:
        """What a compiled filter calls to see a sample at weights; None without a compiler."""
        encode, slopes = (self._functions[name] for name in ("encode", "slopes"))
        several = slopes.batch_address
        if encode.address is None or several is None:
            return None
        numbers = self._prior, self._all_reach, self._constants
        return CompiledLags(encode.address, several, self._states, self._count, *numbers)

    def recall(
        self, own: Array, time: Array, x: Array, carried: Remembered | None, gaps: ArrayLike
    ) -> tuple[Array, Remembered | None]:
        """[z, vec S, W_m] at each sample of a block, (N, size), and what the next goes on from.

        Args:
            own: Weights of the numbers of the air, (n_o,).
            time: Increasing, (N,) [s].
            x: [q, v], (N, n_q + n).
            carried: At the sample before.
            gaps: First sample after each gap.
        """
        anew, before = np.zeros(len(x), np.int8), -np.inf if carried is None else carried.time
        anew[np.asarray(gaps, int)] = 1
        if len(x) and carried is None:
            anew[0] = 1
        steps = np.diff(time, prepend=before)
        coded = self._prior + self._all_reach * own
        if self._kernel is None or self._calls is None or not len(x):
            return self._in_python(coded, own[: self._count], time, x, carried, (anew, steps))
        flat, rows = np.empty(2 * self._cuts[-1]), np.empty((len(x), self.size))
        if carried is not None:
            self.flatten(carried, flat)
        weights, states = own[: self._count].copy(), np.ascontiguousarray(x)
        read = coded, self._constants, self._reach, weights, flat
        struct = Recollection(*self._calls, *(array.ctypes.data for array in read))
        blocks = (ctypes.c_void_p(array.ctypes.data) for array in (states, anew, steps, rows))
        self._kernel.recall_block(ctypes.byref(struct), ctypes.c_int64(len(x)), *blocks)
        return rows, self.parted(flat, float(time[-1]), weights)

    def parted(self, flat: Array, time: float, weights: Array) -> Remembered:
        """What is carried, from its numbers one behind the other.

        Args:
            flat: As many numbers or more.
            time: Of the sample [s].
            weights: W_m, (n_m,).
        """
        parts = np.split(flat[: self._cuts[-1]], self._cuts[:-1])
        each = zip(parts, self._shapes, strict=True)
        return Remembered._make(
            [time, *(part.reshape(shape, order="F") for part, shape in each), weights]
        )

    def flatten(self, carried: Remembered, flat: Array) -> None:
        """The inverse: numbers of what is carried, slopes column by column, into `flat`.

        Args:
            carried: What is carried.
            flat: As many numbers or more.
        """
        parts = [part.ravel(order="F") for part in carried[1:-1]]
        np.concatenate(parts, out=flat[: self._cuts[-1]])

    def live(self, x: Array, mean: Array) -> LiveLags | None:
        """Memory of samples that come one by one, beside a filter; None without a compiler.

        Args:
            x: Input that the filter reads, (n_x,).
            mean: W of the filter, (n,).
        """
        if self._kernel is None or self._calls is None:
            return None
        arrays = {
            "coded": np.zeros_like(self._prior),
            "constants": self._constants,
            "reach": self._reach,
            "weights": np.zeros(self._count),
            "carried": np.zeros(2 * self._cuts[-1]),
        }
        lags = Recollection(*self._calls, *(array.ctypes.data for array in arrays.values()))
        return LiveLags(self, lags, arrays, (self._prior, self._all_reach, mean, x), self._kernel)

    def _in_python(
        self,
        coded: Array,
        own: Array,
        time: Array,
        x: Array,
        carried: Remembered | None,
        when: tuple[NDArray[np.int8], Array],
    ) -> tuple[Array, Remembered | None]:
        rows, known = np.empty((len(x), self.size)), (coded, self._constants)
        each = zip(time.tolist(), x, *when, strict=True)
        for k, (stamp, sample, anew, length) in enumerate(each):
            if carried is None or anew:
                found = self._functions["begin"](sample, *known)
            else:
                found = self._functions["step"](sample, *known, length, *carried[1:-1])
            carried = Remembered._make([stamp, *found, own])
            rows[k] = np.concatenate([carried.state, (carried.slopes * self._reach).ravel(), own])
        return rows, carried


class _LiveLags(ctypes.Structure):
    """`live_lags` of the kernel, field by field."""

    _fields_ = [
        ("lags", Recollection),
        ("own", ctypes.c_int32),
        *((name, ctypes.c_void_p) for name in ("prior", "reach", "mean", "x", "clock", "counts")),
    ]


class LiveLags:
    """`LiveMemory` of lags as C code has it, between two calls of it.

    Args:
        memory: Whose lags.
        lags: The kernel's memory of a block.
        arrays: That memory's.
        shared: prior and reach of all coded numbers; W and x of the filter.
        kernel: The compiled kernel.
    """

    def __init__(
        self,
        memory: LagMemory,
        lags: Recollection,
        arrays: dict[str, Array],
        shared: tuple[Array, Array, Array, Array],
        kernel: ctypes.CDLL,
    ) -> None:
        self._memory, self._arrays, self._shared = memory, arrays, shared
        self._clock, self._counts = np.zeros(3), np.zeros(2, np.int64)
        addresses = (array.ctypes.data for array in (*shared, self._clock, self._counts))
        self._struct = _LiveLags(lags, len(shared[0]), *addresses)
        names = ("recall_live", "settle_live")
        calls = (ctypes.cast(getattr(kernel, name), ctypes.c_void_p).value for name in names)
        self.native = (*calls, ctypes.addressof(self._struct))

    def load(self, live: LiveMemory) -> None:
        """Take over what is remembered, before a call.

        Args:
            live: The learner's.
        """
        self._clock[:2], self._counts[:] = live.clock, (live.carried is not None, live.resets)
        if live.carried is not None:
            self._memory.flatten(live.carried, self._arrays["carried"])

    def store(self, live: LiveMemory) -> None:
        """Give it back, after a call.

        Args:
            live: The learner's.
        """
        begun, live.resets = self._counts.tolist()
        live.clock = self._clock[:2].copy()
        if begun:
            weights = self._shared[2][: len(self._arrays["weights"])].copy()
            flat = self._arrays["carried"].copy()
            live.carried = self._memory.parted(flat, float(self._clock[0]), weights)
