"""The cubature filter in C: memory of one learner, laid out for `kernels/cubature.c`.

One foreign call a sample; the arrays live here and are shared by address.
Neglected: two threads on one learner.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.errors import Outcome
from patagium.learning.filters.array import ArrayFilter, Prediction
from patagium.learning.filters.block import BlockFilter, scattered, setting_blocks
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
from patagium.learning.models.perceptron import (
    PerceptronNetwork,
    as_perceptron,
    evaluated,
)
from patagium.learning.models.structure import Indices
from patagium.native import load_kernel

Array = NDArray[np.float64]

_INTEGERS = ("weights", "rows", "outputs", "stride", "items", "layers", "activation", "blocks")
_NUMBERS = ("spread", "growth", "bend_gain", "centered", "shift_gain", "largest", "nis")
_LAYOUT = ("widths", "starts", "counts")
_STATE = ("mean", "screen", "root", "near")
_WORK = ("slopes", "bends", "steps", "shrinks", "cross", "points", "at_mean", "weighting", "small")
_ENCODER = ("encode", "encode_arguments", "encode_results")
_SAMPLE = ("features", "readout", "offset", "measured")
_RESULT = ("predicted", "innovation", "covariance")
_ARRAYS = (*(name for name in _STATE if name != "screen"), *_WORK, *_SAMPLE, *_RESULT)


class CubatureMemory(ctypes.Structure):
    """`cubature` of the kernel, field by field."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in _INTEGERS),
        *((name, ctypes.c_void_p) for name in _LAYOUT),
        *((name, ctypes.c_double) for name in _NUMBERS),
        *((name, ctypes.c_void_p) for name in (*_STATE, *_WORK, *_ENCODER, *_SAMPLE, *_RESULT)),
    ]


def load_cubature(dtype: str) -> ctypes.CDLL | None:
    """The kernel for one precision, or None without a compiler."""
    single = dtype == "float32"
    defines = {"REAL": "float" if single else "double", "SINGLE": int(single)}
    return load_kernel("cubature", defines)


class KernelFilter:
    """Square-root filter, compiled, of one block or one a layer.

    Its equations are those of `ArrayFilter` and `BlockFilter`. With b weights a block, an update
    costs about the sum of b^2 (n_y + 8) multiplications and additions and two passes over half
    a matrix of each block; process noise adds factorizations of order b^3.

    Args:
        setting: What it is made of.
        mean: Weights to start from, (n,).
        root: The lower triangular square root of their covariance, (n, n).
        library: The compiled kernel.
    """

    _kernel = "cubature"

    def __init__(
        self, setting: FilterNumbers, mean: Array, root: Array, library: ctypes.CDLL
    ) -> None:
        self.setting = setting
        self._blocks = setting_blocks(setting)
        self._lanes = int(getattr(library, f"{self._kernel}_lanes")())
        self._arrays = _allocate(setting, self._lanes)
        self.screen = setting.screen()
        self._screening = screening_structure(self.screen)
        self._struct = _structure(setting, self._arrays)
        self._struct.screen = ctypes.addressof(self._screening)
        self._x, self._keep = self._installed()
        self._address = ctypes.addressof(self._struct)
        self._predict, self._update = (
            kernel_function(library, f"{self._kernel}_{name}") for name in ("predict", "update")
        )
        self._features, self._readout = self._arrays["features"], self._arrays["readout"]
        self._offset, self._measured = self._arrays["offset"], self._arrays["measured"]
        self._arrays["mean"][:] = mean
        self._before_noise: Array | None = None
        self._put_root(np.asarray(root))

    def __reduce__(self) -> tuple[Any, ...]:
        return restore, (self.setting, self.mean, self.root()), self.screen.arrays

    def __setstate__(self, arrays: dict[str, Array]) -> None:
        self.screen.restore(arrays)

    @property
    def mean(self) -> Array:
        """W, (n,)."""
        return self._arrays["mean"].copy()

    @property
    def nis(self) -> float:
        """Normalized innovation squared of the last sample learned."""
        return float(self._struct.nis)

    @property
    def compiled(self) -> Compiled | None:
        """The filter as C code meets it; None where a sample takes Python as well."""
        if self._x is None or self.setting.has_process_noise:
            return None
        calls = self._update, self._predict
        return compiled_filter(calls, self._struct, self._x, self._arrays, self.screen)

    def predict(self, x: Array) -> Prediction:
        """y at x, before it is measured."""
        self._add_process_noise()
        self._take(x)
        self._predict(self._address)
        return self._prediction()

    def update(self, x: Array, y: Array) -> tuple[Outcome, Prediction]:
        """Learn one sample; whatever is not COMPLETED changed neither mean nor covariance."""
        self._add_process_noise()
        self._take(x)
        self._measured[:] = y
        outcome = self._update(self._address)
        if outcome == 0:
            self._before_noise = None
        return Outcome(outcome), self._prediction()

    def root(self) -> Array:
        """The square root of the covariance after the last sample, (n, n)."""
        if self._before_noise is not None:
            return self._before_noise
        whole = np.zeros((self.setting.network.size,) * 2)
        for block, first, panel in self._panels():
            columns, rows = block[first : first + panel.shape[1]], block[first:]
            whole[np.ix_(rows, columns)] = panel[: len(rows), : len(columns)]
        return whole

    def covariance(self) -> Array:
        """P after the last sample, (n, n)."""
        root = self.root()
        return np.asarray(root @ root.T)

    def variances(self) -> Array:
        """Its diagonal, (n,)."""
        root = self.root()
        return np.asarray(np.einsum("ij,ij->i", root, root))

    def drift(self, growth: float, noise: Array) -> None:
        """P <- growth P + diag(noise), once."""
        self._put_root(self._drifted(growth, noise))
        self._before_noise = None

    def _installed(self) -> tuple[Array | None, tuple[Any, ...]]:
        """The kernel's way to see a sample: x it reads, or None; what must stay alive."""
        return install_encoder(as_perceptron(self.setting.network), self._struct, self._arrays)

    def _panels(self) -> Iterator[tuple[Indices, int, Array]]:
        """Every panel: weights of its block, its first column in it, its rows from there on."""
        width, start = 2 * self._lanes, 0
        for block in self._blocks:
            rows = rounded_up(len(block), width)
            for first in range(0, rows, width):
                end = start + (rows - first) * width
                yield block, first, self._arrays["root"][start:end].reshape(-1, width)
                start = end

    def _put_root(self, root: Array) -> None:
        for block, first, panel in self._panels():
            columns, rows = block[first : first + panel.shape[1]], block[first:]
            panel[: len(rows), : len(columns)] = root[np.ix_(rows, columns)]
        self._struct.largest = float(np.linalg.norm(root, axis=1).max())

    def _drifted(self, growth: float, noise: Array) -> Array:
        """The square root of growth P + diag(noise), block by block, (n, n)."""
        root: Array = np.sqrt(growth) * self.root()
        for block in self._blocks:
            part = np.ix_(block, block)
            root[part] = with_noise(root[part], noise[block])
        return np.asarray(root)

    def _add_process_noise(self) -> None:
        """P / forgetting + Q, once a sample; without Q the kernel forgets by itself."""
        setting = self.setting
        if not setting.has_process_noise or self._before_noise is not None:
            return
        root = self.root()
        self._put_root(self._drifted(1.0 / setting.forgetting_factor, setting.process_noise))
        self._before_noise = root

    def _take(self, x: Array) -> None:
        if self._x is not None:
            self._x[:] = x
            return
        encoding = self.setting.network.encode_one(x)
        self._features[...] = encoding.features
        self._readout[...] = encoding.readout.T

    def _prediction(self) -> Prediction:
        return Prediction(self._arrays["predicted"].copy(), self._arrays["covariance"].copy())

    def roots(self) -> list[Array]:
        """Square roots of the blocks of the covariance after the last sample, (k, k) each."""
        root = self.root()
        return [root[np.ix_(block, block)] for block in self._blocks]

    def state(self) -> dict[str, Array]:
        """All that the next samples depend on, as arrays by name."""
        return RootState(self.mean, self.nis, self.roots()).packed(self.setting.dtype)

    def resume(self, state: Mapping[str, Array]) -> None:
        """Go on from a state."""
        found = root_state(state, [len(block) for block in self._blocks])
        self._arrays["mean"][:], self._struct.nis = found.mean, found.nis
        self._put_root(scattered(found.roots, self._blocks))
        self._before_noise = None


def restore(setting: FilterNumbers, mean: Array, root: Array) -> KernelFilter | ArrayFilter:
    """A filter in the state given, compiled where there is a compiler and a perceptron.

    Args:
        setting: What it is made of.
        mean: Weights, (n,).
        root: The lower triangular square root of their covariance, (n, n).
    """
    library = load_cubature(setting.dtype)
    if library is None or not isinstance(setting.network, PerceptronNetwork):
        readable = ArrayFilter if setting.structure == "full" else BlockFilter
        return readable(setting, mean, root)
    return KernelFilter(setting, mean, root, library)


def _allocate(setting: FilterNumbers, lanes: int) -> dict[str, Array]:
    """Zeroed arrays of the sizes `cubature.h` names, on cache lines."""
    network, outputs = evaluated(setting.network), len(setting.noise)
    widths, items = network.perceptron.widths, network.items
    panel, layers, widest = 2 * lanes, len(widths) - 1, max(widths)
    counts = [len(block) for block in setting_blocks(setting)]
    heights = [rounded_up(count, panel) for count in counts]
    rows, stride = sum(heights), rounded_up(outputs, max(lanes, 4))
    reals = {
        "root": (sum(height * (height + panel) // 2 for height in heights),),
        "near": (rows,),
        "slopes": (rows, stride),
        "bends": (rows, stride),
        "steps": (rows // panel, outputs, panel),
        "shrinks": (rows,),
        "cross": (rows, stride),
        "points": (2, items, widest, panel),
        "at_mean": (2, layers, rounded_up(items * widest, lanes)),
        "weighting": (items * widths[-1], stride),
    }
    doubles = {
        "mean": (network.size,),
        "small": (5 + len(counts), stride, stride),
        "features": (items, widths[0]),
        "readout": (items * widths[-1], outputs),
        "offset": (outputs,),
        "measured": (outputs,),
        "predicted": (outputs,),
        "innovation": (outputs,),
        "covariance": (outputs, outputs),
    }
    arrays = {name: aligned(shape, np.dtype(setting.dtype)) for name, shape in reals.items()}
    arrays |= {name: aligned(shape, np.dtype(float)) for name, shape in doubles.items()}
    arrays["widths"], arrays["counts"] = np.array(widths, np.int32), np.array(counts, np.int32)
    arrays["starts"] = np.array([0, *np.cumsum(heights)], np.int32)
    if isinstance(network, PerceptronNetwork):
        arrays["offset"][:] = network.offset
    return arrays


def _structure(setting: FilterNumbers, arrays: dict[str, Array]) -> CubatureMemory:
    network = evaluated(setting.network)
    forgets = 1.0 if setting.has_process_noise else setting.forgetting_factor
    return CubatureMemory(
        weights=network.size,
        rows=len(arrays["near"]),
        outputs=network.outputs,
        stride=arrays["slopes"].shape[1],
        items=network.items,
        layers=len(network.perceptron.widths) - 1,
        activation=ACTIVATION_CODES[network.perceptron.activation],
        blocks=len(arrays["counts"]),
        growth=1.0 / np.sqrt(forgets),
        **setting.rule._asdict(),
        **{name: arrays[name].ctypes.data for name in (*_ARRAYS, *_LAYOUT)},
    )
