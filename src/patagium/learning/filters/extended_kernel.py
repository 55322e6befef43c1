"""The extended filter in C: memory of one learner, laid out for `kernels/extended.c`.

Neglected: networks that are neither a perceptron between encoder and readout nor one of strips
with lags; those take NumPy.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.learning.filters.array import WeightFilter
from patagium.learning.filters.extended import ExtendedBlockFilter, ExtendedFilter
from patagium.learning.filters.kernel import CubatureMemory, KernelFilter
from patagium.learning.filters.kernel_memory import aligned, install_encoder, rounded_up
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import triangular
from patagium.learning.filters.state import vector
from patagium.learning.models.hidden_strip import HiddenStripNetwork, StripLags
from patagium.learning.models.perceptron import PerceptronNetwork, evaluated
from patagium.native import load_kernel

Array = NDArray[np.float64]

_COUNTS = ("measured", "states", "remembered", "own", "directions")
_CALLS = ("encode", "slopes")
_NUMBERS = ("constants", "prior", "reach", "x", "coded", "state", "sample", "moved", "along")
_FOUND = ("of_features", "of_y")


class _Lags(ctypes.Structure):
    """`lags` of the kernel, field by field."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in _COUNTS),
        *((name, ctypes.c_void_p) for name in (*_CALLS, *_NUMBERS, *_FOUND)),
        ("constants_count", ctypes.c_int32),
    ]


class _Extended(ctypes.Structure):
    """`extended` of the kernel, field by field."""

    _fields_ = [
        ("filter", CubatureMemory),
        *((name, ctypes.c_void_p) for name in ("lags", "derivative", "seeds")),
    ]


class ExtendedKernel(KernelFilter):
    """Square-root extended filter, compiled, of one block or one a layer.

    Its equations are those of `ExtendedFilter` and `ExtendedBlockFilter`, with S triangular. With
    b weights a block, an update costs about the sum of b^2 (n_y + 8) multiplications and additions.
    """

    _kernel = "extended"

    def __reduce__(self) -> tuple[Any, ...]:
        return restore_extended, (self.setting, self.mean, self.root()), self.screen.arrays

    def resume(self, state: Mapping[str, Array]) -> None:
        """Go on from a state, also of the filter in NumPy, whose root is any square."""
        if "square" not in state:
            return super().resume(state)
        size = len(self.mean)
        mean, square = vector(state, "mean", size), vector(state, "square", size, size)
        self._arrays["mean"][:], self._struct.nis = mean, float(state["nis"])
        self._put_root(triangular(square))
        self._before_noise = None

    def _installed(self) -> tuple[Array | None, tuple[Any, ...]]:
        network, stride = evaluated(self.setting.network), self._struct.stride
        whole = _Extended(filter=self._struct)
        self._struct = whole.filter
        room = 2 * network.items * max(network.perceptron.widths)
        real = np.dtype(float)
        arrays = {
            "derivative": aligned((network.size, stride), real),
            "seeds": aligned((room, stride), real),
        }
        for name, array in arrays.items():
            setattr(whole, name, array.ctypes.data)
        if isinstance(network, PerceptronNetwork):
            x, keep = install_encoder(network, self._struct, self._arrays)
            return x, (keep, arrays, whole)
        lags = network.compiled_encoder() if isinstance(network, HiddenStripNetwork) else None
        if lags is None:
            raise TypeError(
                f"expected a network with compiled lags, found {type(network).__name__}"
            )
        x, keep = _install_lags(network, lags, whole)
        return x, (keep, arrays, whole)


def _install_lags(network: Any, lags: StripLags, whole: _Extended) -> tuple[Array, tuple[Any, ...]]:
    """Let the kernel see a sample of a network whose encoder has weights."""
    own, states, real = len(lags.prior), lags.states, np.dtype(float)
    directions, outputs = rounded_up(own, 8), network.items * network.perceptron.widths[-1]
    seen = network.items * network.perceptron.widths[0]
    known = network.measured_inputs + states + own + outputs + len(lags.constants)
    arrays = {
        **{name: np.array(getattr(lags, name)) for name in ("constants", "prior", "reach")},
        "x": np.zeros(network.inputs),
        "coded": np.zeros(own),
        "state": np.zeros(states),
        "sample": np.zeros(known),
        "moved": np.zeros((own, states)),
        "along": np.eye(own),
        "of_features": aligned((seen, directions), real),
        "of_y": aligned((network.outputs, directions), real),
    }
    counts = network.measured_inputs, states, lags.parameters, own, directions
    found = _Lags(
        **dict(zip(_COUNTS, counts, strict=True)),
        encode=lags.encode,
        slopes=lags.slopes,
        constants_count=len(lags.constants),
        **{name: arrays[name].ctypes.data for name in (*_NUMBERS, *_FOUND)},
    )
    whole.lags = ctypes.addressof(found)
    return arrays["x"], (found, arrays)


def restore_extended(setting: FilterNumbers, mean: Array, root: Array) -> WeightFilter:
    """An extended filter in the state given, compiled where that can be.

    Args:
        setting: What it is made of; its structure keeps full matrices.
        mean: Weights, (n,).
        root: The lower triangular square root of their covariance, (n, n).
    """
    library, network = load_kernel("extended"), setting.network
    lags = network.compiled_encoder() if isinstance(network, HiddenStripNetwork) else None
    known = isinstance(network, PerceptronNetwork) or lags is not None
    if library is not None and known and setting.structure != "node":
        return ExtendedKernel(setting, mean, root, library)
    kind = ExtendedFilter if setting.structure == "full" else ExtendedBlockFilter
    return kind(setting, mean, root)
