"""The filter of one block a neuron in C: memory of one learner, laid out for `kernels/node.c`.

One foreign call a sample; the arrays live here and are shared by address.
Neglected: two threads on one learner.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.errors import Outcome
from patagium.learning.filters.array import Prediction
from patagium.learning.filters.block import scattered, setting_blocks
from patagium.learning.filters.kernel_memory import (
    ACTIVATION_CODES,
    Compiled,
    aligned,
    compiled_filter,
    install_encoder,
    kernel_function,
    rounded_up,
)
from patagium.learning.filters.kernel_screening import screening_structure
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import with_noise
from patagium.learning.filters.state import RootState, root_state
from patagium.learning.models.perceptron import as_perceptron
from patagium.native import load_kernel

Array = NDArray[np.float64]

_INTEGERS = (
    *("weights", "outputs", "stride", "items", "layers", "activation", "drifts", "drifted"),
)
_NUMBERS = ("spread", "growth", "bend_gain", "centered", "shift_gain", "largest", "nis")
_REALS = (
    *("root", "grown", "drift", "near", "plain", "steps", "slopes", "bends", "gains", "cross"),
    *("outputs_at", "towards", "at_mean"),
)
_DOUBLES = ("directions", "centers", "squares", "small", "wide_small")
_ENCODER = ("encode", "encode_arguments", "encode_results")
_SAMPLE = ("features", "readout", "offset", "measured", "predicted", "innovation", "covariance")
_WIDE = 8


class _Node(ctypes.Structure):
    """`node_filter` of the kernel, field by field."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in _INTEGERS),
        ("widths", ctypes.c_void_p),
        *((name, ctypes.c_double) for name in _NUMBERS),
        *(
            (name, ctypes.c_void_p)
            for name in ("mean", "screen", *_REALS, *_DOUBLES, *_ENCODER, *_SAMPLE)
        ),
    ]


def load_node(dtype: str) -> ctypes.CDLL | None:
    """The kernel for one precision, or None without a compiler."""
    single = dtype == "float32"
    return load_kernel("node", {"REAL": "float" if single else "double", "SINGLE": int(single)})


class NodeFilter:
    """Square-root filter of one block a neuron, compiled; its equations are `BlockFilter`'s.

    With k weights a neuron, an update costs about 2 n k multiplications and additions and the
    memory is n k / 2 numbers where at most one linear layer follows; neurons further from
    the outputs, or evaluated for several items, cost about n n_y (k + 2 n_y). Noise between
    samples adds n k^2 / 3.

    Args:
        setting: What it is made of.
        mean: Weights to start from, (n,).
        roots: The lower triangular square root of each neuron's covariance, (k, k).
        library: The compiled kernel.
    """

    def __init__(
        self,
        setting: FilterNumbers,
        mean: Array,
        roots: Sequence[Array],
        library: ctypes.CDLL,
    ) -> None:
        self.setting = setting
        self._blocks = setting_blocks(setting)
        self._arrays = _allocate(setting, int(library.node_lanes()))
        self.screen = setting.screen()
        self._screening = screening_structure(self.screen)
        self._struct = _structure(setting, self._arrays)
        self._struct.screen = ctypes.addressof(self._screening)
        self._x, self._keep = install_encoder(
            as_perceptron(setting.network), self._struct, self._arrays
        )
        self._address = ctypes.addressof(self._struct)
        self._predict = kernel_function(library, "node_predict")
        self._update = kernel_function(library, "node_update")
        self._unpack = library.node_unpack
        self._unpack.argtypes, self._unpack.restype = [ctypes.c_void_p] * 2, None
        self._features, self._readout = self._arrays["features"], self._arrays["readout"]
        self._measured, self._mean = self._arrays["measured"], self._arrays["mean"]
        self._predicted, self._covariance = self._arrays["predicted"], self._arrays["covariance"]
        self._mean[:] = mean
        self._pack = library.node_pack
        self._pack.argtypes, self._pack.restype = [ctypes.c_void_p] * 2, None
        self._put_roots(roots)

    def __reduce__(self) -> tuple[Any, ...]:
        from patagium.learning.filters.choice import restore_nodes

        return restore_nodes, (self.setting, self.mean, self.roots()), self.screen.arrays

    def __setstate__(self, arrays: dict[str, Array]) -> None:
        self.screen.restore(arrays)

    @property
    def mean(self) -> Array:
        """W, (n,)."""
        return self._mean.copy()

    @property
    def nis(self) -> float:
        """Normalized innovation squared of the last sample learned."""
        return float(self._struct.nis)

    @property
    def compiled(self) -> Compiled | None:
        """The filter as C code meets it; None where Python has to encode the inputs."""
        if self._x is None:
            return None
        calls = self._update, self._predict
        return compiled_filter(calls, self._struct, self._x, self._arrays, self.screen)

    def predict(self, x: Array) -> Prediction:
        """y at x, before it is measured."""
        self._take(x)
        self._predict(self._address)
        return self._prediction()

    def update(self, x: Array, y: Array) -> tuple[Outcome, Prediction]:
        """Learn one sample; whatever is not COMPLETED changed neither mean nor covariance."""
        self._take(x)
        self._measured[:] = y
        outcome = self._update(self._address)
        return Outcome(outcome), self._prediction()

    def roots(self) -> list[Array]:
        """The square root of each neuron's covariance after the last sample, (k, k)."""
        sizes = np.array([len(block) for block in self._blocks])
        flat = np.zeros(int((sizes**2).sum()))
        self._unpack(self._address, flat.ctypes.data)
        ends = np.cumsum(sizes**2)
        return [
            part.reshape(k, k) for part, k in zip(np.split(flat, ends[:-1]), sizes, strict=True)
        ]

    def root(self) -> Array:
        """The same in a matrix of all weights, (n, n)."""
        return scattered(self.roots(), self._blocks)

    def covariance(self) -> Array:
        """P after the last sample, (n, n)."""
        return scattered([root @ root.T for root in self.roots()], self._blocks)

    def variances(self) -> Array:
        """Its diagonal, (n,)."""
        found = np.empty(self.setting.network.size)
        for block, root in zip(self._blocks, self.roots(), strict=True):
            found[block] = np.einsum("ij,ij->i", root, root)
        return found

    def drift(self, growth: float, noise: Array) -> None:
        """P <- growth P + diag(noise), once."""
        roots = self.roots()
        self._put_roots(
            with_noise(np.sqrt(growth) * root, noise[block])
            for root, block in zip(roots, self._blocks, strict=True)
        )

    def _put_roots(self, roots: Iterable[Array]) -> None:
        flat = np.concatenate([np.asarray(root, float).ravel() for root in roots])
        self._struct.largest, self._struct.drifted = 0.0, 0
        self._pack(self._address, flat.ctypes.data)

    def _take(self, x: Array) -> None:
        if self._x is not None:
            self._x[:] = x
            return
        encoding = self.setting.network.encode_one(x)
        self._features[...] = encoding.features
        self._readout[...] = encoding.readout.T

    def _prediction(self) -> Prediction:
        return Prediction(self._predicted.copy(), self._covariance.copy())

    def state(self) -> dict[str, Array]:
        """All that the next samples depend on, as arrays by name."""
        return RootState(self.mean, self.nis, self.roots()).packed(self.setting.dtype)

    def resume(self, state: Mapping[str, Array]) -> None:
        """Go on from a state."""
        found = root_state(state, [len(block) for block in self._blocks])
        self._mean[:], self._struct.nis = found.mean, found.nis
        self._put_roots(found.roots)


def _allocate(setting: FilterNumbers, lanes: int) -> dict[str, Array]:
    """Zeroed arrays of the sizes `node.h` names, on cache lines."""
    network, real = as_perceptron(setting.network), np.dtype(setting.dtype)
    widths, items, outputs = network.perceptron.widths, network.items, network.outputs
    stride = rounded_up(outputs, _WIDE)
    groups = [
        below + 1
        for below, above in pairwise(widths)
        for _ in range(rounded_up(above, lanes) // lanes)
    ]
    rows, most, widest, nodes = sum(groups), max(groups), max(widths), sum(widths[1:])
    entries = sum(_entries(k) for k in groups)
    terms = items * widths[-1] if len(widths) > 3 else items
    reals = {
        "root": (entries,),
        "grown": (entries if setting.has_process_noise else 0,),
        "drift": (rows,),
        "near": (rows,),
        "plain": (rounded_up(network.size, lanes) // lanes + 1,),
        "steps": (most, items),
        "slopes": (rows, outputs),
        "bends": (most, outputs),
        "gains": (most, max(2, outputs + 1)),
        "cross": (most, outputs),
        "outputs_at": (items + 2 * terms + 2 * widest,),
        "towards": (terms, outputs),
        "at_mean": (2 * (len(widths) - 1), items, rounded_up(widest, lanes) // lanes),
    }
    doubles = {
        "mean": (network.size,),
        "directions": (nodes, stride),
        "centers": (nodes, stride),
        "squares": (nodes,),
        "small": (4, stride, stride),
        "wide_small": (2, outputs, outputs, _WIDE),
        "features": (items, widths[0]),
        "readout": (items * widths[-1], outputs),
        "offset": (outputs,),
        "measured": (outputs,),
        "predicted": (outputs,),
        "innovation": (outputs,),
        "covariance": (outputs, outputs),
    }
    arrays = {name: aligned((*shape, lanes), real) for name, shape in reals.items()}
    arrays |= {name: aligned(shape, np.dtype(float)) for name, shape in doubles.items()}
    arrays["widths"] = np.array(widths, np.int32)
    arrays["offset"][:] = network.offset
    _lay_out(setting.process_noise, widths, arrays["drift"])
    return arrays


def _lay_out(values: Array, widths: Sequence[int], rows: Array) -> None:
    """Numbers of the weights, (n,), as rows of groups, (rows, lanes)."""
    start, row, lanes = 0, 0, rows.shape[1]
    for below, above in pairwise(widths):
        middle, end = start + below * above, start + (below + 1) * above
        layer = np.vstack([values[start:middle].reshape(above, below).T, values[middle:end]])
        for first in range(0, above, lanes):
            part = layer[:, first : first + lanes]
            rows[row : row + below + 1, : part.shape[1]] = part
            row += below + 1
        start = end


def _structure(setting: FilterNumbers, arrays: dict[str, Array]) -> _Node:
    network = as_perceptron(setting.network)
    return _Node(
        weights=network.size,
        outputs=network.outputs,
        stride=arrays["centers"].shape[1],
        items=network.items,
        layers=len(network.perceptron.widths) - 1,
        activation=ACTIVATION_CODES[network.perceptron.activation],
        drifts=setting.has_process_noise,
        growth=1.0 / np.sqrt(setting.forgetting_factor),
        **setting.rule._asdict(),
        **{name: array.ctypes.data for name, array in arrays.items()},
    )


def _entries(size: int) -> int:
    """Entries of a root of k rows, packed by bands of four."""
    full = size // 4
    return 8 * full * (full + 1) + (size % 4) * size
