"""The cubature filter in C: memory of one learner, laid out for `kernels/cubature.c`.

One foreign call a sample; the arrays live here and are shared by address.
Neglected: two threads on one learner.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.errors import Outcome
from patagium.identification.array_filter import ArrayFilter, FilterSetting, Prediction
from patagium.identification.network import Network
from patagium.identification.root import with_noise
from patagium.native import load_kernel

Array = NDArray[np.float64]

_INTEGERS = ("weights", "rows", "outputs", "stride", "items", "layers", "activation", "unused")
_NUMBERS = ("spread", "growth", "bend_gain", "centered", "shift_gain", "largest")
_STATE = ("mean", "noise", "root", "near")
_WORK = ("slopes", "bends", "steps", "shrinks", "cross", "points", "at_mean", "weighting", "small")
_ENCODER = ("encode", "encode_arguments", "encode_results")
_SAMPLE = ("features", "readout", "offset", "measured")
_RESULT = ("predicted", "innovation", "covariance")
_ARRAYS = (*_STATE, *_WORK, *_SAMPLE, *_RESULT)
_ACTIVATIONS = {"softplus": 0, "tanh": 1}


class _Cubature(ctypes.Structure):
    """`cubature` of the kernel, field by field."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in _INTEGERS),
        ("widths", ctypes.c_void_p),
        *((name, ctypes.c_double) for name in _NUMBERS),
        *((name, ctypes.c_void_p) for name in (*_STATE, *_WORK, *_ENCODER, *_SAMPLE, *_RESULT)),
    ]


def load_cubature(dtype: str) -> ctypes.CDLL | None:
    """The kernel for one precision, or None without a compiler."""
    single = dtype == "float32"
    defines = {"REAL": "float" if single else "double", "SINGLE": int(single)}
    return load_kernel("cubature", defines)


class KernelFilter:
    """Square-root filter, compiled; its equations are `ArrayFilter`'s.

    An update costs about n^2 (n_y + 8) multiplications and additions and two passes over
    half a matrix; process noise adds a factorization of order n^3.

    Args:
        setting: What it is made of.
        mean: Weights to start from, (n,).
        root: The lower triangular square root of their covariance, (n, n).
        library: The compiled kernel.
    """

    def __init__(
        self, setting: FilterSetting, mean: Array, root: Array, library: ctypes.CDLL
    ) -> None:
        self.setting = setting
        self._lanes = int(library.cubature_lanes())
        self._arrays = _allocate(setting, self._lanes)
        self._struct = _structure(setting, self._arrays)
        self._x, self._keep = _install_encoder(setting.network, self._struct, self._arrays)
        self._address = ctypes.addressof(self._struct)
        self._predict, self._update = (_function(library, name) for name in ("predict", "update"))
        self._features, self._readout = self._arrays["features"], self._arrays["readout"]
        self._offset, self._measured = self._arrays["offset"], self._arrays["measured"]
        self._arrays["mean"][:] = mean
        self._arrays["noise"][:] = setting.noise
        self._before_noise: Array | None = None
        self._put_root(np.asarray(root))

    def __reduce__(self) -> tuple[Any, ...]:
        return restore, (self.setting, self.mean, self.root())

    @property
    def mean(self) -> Array:
        """W, (n,)."""
        return self._arrays["mean"].copy()

    def predict(self, x: Array) -> Prediction:
        """y at x, before it is measured."""
        self._add_process_noise()
        self._take(x)
        self._predict(self._address)
        return self._prediction()

    def update(self, x: Array, y: Array) -> tuple[Outcome, Prediction]:
        """Learn one sample; whatever is not COMPLETED changed nothing."""
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
        count = self.setting.network.size
        whole = np.zeros((self._struct.rows, self._struct.rows))
        for columns, panel in self._panels():
            whole[columns.start :, columns] = panel
        return whole[:count, :count]

    def covariance(self) -> Array:
        """P after the last sample, (n, n)."""
        root = self.root()
        return np.asarray(root @ root.T)

    def _panels(self) -> Iterator[tuple[slice, Array]]:
        """Columns of every panel, and its rows from the first of them on."""
        width, rows, start = 2 * self._lanes, self._struct.rows, 0
        for first in range(0, rows, width):
            end = start + (rows - first) * width
            yield slice(first, first + width), self._arrays["root"][start:end].reshape(-1, width)
            start = end

    def _put_root(self, root: Array) -> None:
        whole = np.zeros((self._struct.rows, self._struct.rows))
        whole[: len(root), : len(root)] = root
        for columns, panel in self._panels():
            panel[:] = whole[columns.start :, columns]
        self._struct.largest = float(np.linalg.norm(whole, axis=1).max())

    def _add_process_noise(self) -> None:
        """P / forgetting + Q, once a sample; without Q the kernel forgets by itself."""
        setting = self.setting
        if not setting.has_process_noise or self._before_noise is not None:
            return
        root = self.root()
        grown = root / np.sqrt(setting.forgetting_factor)
        self._put_root(with_noise(grown, setting.process_noise))
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


def restore(setting: FilterSetting, mean: Array, root: Array) -> KernelFilter | ArrayFilter:
    """A filter in the state given, compiled where there is a compiler.

    Args:
        setting: What it is made of.
        mean: Weights, (n,).
        root: The lower triangular square root of their covariance, (n, n).
    """
    library = load_cubature(setting.dtype)
    if library is None:
        return ArrayFilter(setting, mean, root)
    return KernelFilter(setting, mean, root, library)


def _function(library: ctypes.CDLL, name: str) -> Any:
    function = getattr(library, f"cubature_{name}")
    function.argtypes, function.restype = [ctypes.c_void_p], ctypes.c_int
    return function


def _allocate(setting: FilterSetting, lanes: int) -> dict[str, Array]:
    """Zeroed arrays of the sizes `cubature.h` names, on cache lines."""
    network, outputs = setting.network, len(setting.noise)
    widths, items = network.perceptron.widths, network.items
    panel, layers, widest = 2 * lanes, len(widths) - 1, max(widths)
    rows, stride = _up(network.size, panel), _up(outputs, max(lanes, 4))
    panels = rows // panel
    reals = {
        "root": (panel * (panels * rows - panel * panels * (panels - 1) // 2),),
        "near": (rows,),
        "slopes": (rows, stride),
        "bends": (rows, stride),
        "steps": (panels, outputs, panel),
        "shrinks": (rows,),
        "cross": (rows, stride),
        "points": (2, items, widest, panel),
        "at_mean": (2, layers, _up(items * widest, lanes)),
        "weighting": (items * widths[-1], stride),
    }
    doubles = {
        "mean": (network.size,),
        "noise": (outputs,),
        "small": (5, stride, stride),
        "features": (items, widths[0]),
        "readout": (items * widths[-1], outputs),
        "offset": (outputs,),
        "measured": (outputs,),
        "predicted": (outputs,),
        "innovation": (outputs,),
        "covariance": (outputs, outputs),
    }
    arrays = {name: _aligned(shape, np.dtype(setting.dtype)) for name, shape in reals.items()}
    arrays |= {name: _aligned(shape, np.dtype(float)) for name, shape in doubles.items()}
    arrays["widths"] = np.array(widths, np.int32)
    arrays["offset"][:] = network.offset
    return arrays


def _structure(setting: FilterSetting, arrays: dict[str, Array]) -> _Cubature:
    network = setting.network
    forgets = 1.0 if setting.has_process_noise else setting.forgetting_factor
    return _Cubature(
        weights=network.size,
        rows=len(arrays["near"]),
        outputs=network.outputs,
        stride=arrays["slopes"].shape[1],
        items=network.items,
        layers=len(network.perceptron.widths) - 1,
        activation=_ACTIVATIONS[network.perceptron.activation],
        growth=1.0 / np.sqrt(forgets),
        **setting.rule._asdict(),
        **{name: arrays[name].ctypes.data for name in (*_ARRAYS, "widths")},
    )


def _install_encoder(
    network: Network, struct: _Cubature, arrays: dict[str, Array]
) -> tuple[Array | None, tuple[Any, ...]]:
    """Let the kernel call a compiled encoder itself; gives the x it reads, or None."""
    compiled = network.compiled_encoder()
    if compiled is None:
        return None, ()
    address, constants = compiled
    x = np.zeros(network.inputs)
    arguments = (ctypes.c_void_p * 2)(x.ctypes.data, constants.ctypes.data)
    results = (ctypes.c_void_p * 2)(struct.features, struct.readout)
    struct.encode = address
    struct.encode_arguments = ctypes.addressof(arguments)
    struct.encode_results = ctypes.addressof(results)
    return x, (arguments, results, constants)


def _aligned(shape: tuple[int, ...], dtype: Any) -> Any:
    size = int(np.prod(shape)) * dtype.itemsize
    raw = np.zeros(size + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + size].view(dtype).reshape(shape)


def _up(count: int, multiple: int) -> int:
    return -(-count // multiple) * multiple
