"""Memory that filters share with kernels by address: arrays, screening, encoder.

Arrays live as long as the filter that holds them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from patagium.arrays import Array, Indices
from patagium.learning.filters.bounds import MEMORY
from patagium.learning.filters.screening import Screen
from patagium.learning.models.perceptron import PerceptronNetwork
from patagium.native.structs import BOUNDS, SCREENING

ACTIVATION_CODES = {"softplus": 0, "tanh": 1}
"""Names of activations to the integers of the kernels."""


class Compiled(NamedTuple):
    """Filter as C code meets it: one sample is x, y and a stamp in, one call, moments out.

    Attributes:
        update: Address of `int f(void *memory)`: learns the sample; the integer is an Outcome.
        predict: Address of the same that only predicts it.
        memory: What both take.
        x: Input, (n_x,) [units of x], read by them.
        y: Measurement, (n_y,) [unit of y], read by update; NaN where a channel is missing.
        stamp: Time of the sample, (1,) [s], read by update; NaN: not known.
        mean: Predicted measurement, (n_y,) [unit of y], written by both.
        covariance: Predicted covariance with the noise, (n_y, n_y) [y^2], written by both.
        alarm: Written by update: not zero when a change was detected, (1,) of int64.
        left_out: Channels that were not learned from, (n_y,) of int64 [1], written by update.
        nis: Address of the normalized innovation squared, written by update.
        weights: Weights W, (n,) [1], moved by update.
    """

    update: int
    predict: int
    memory: int
    x: Array
    y: Array
    stamp: Array
    mean: Array
    covariance: Array
    alarm: Indices
    left_out: Indices
    nis: int
    weights: Array


def addresses(arrays: Mapping[str, NDArray[Any]]) -> dict[str, int]:
    """Addresses of arrays by name.

    Args:
        arrays: Arrays by name; they must outlive the addresses.
    """
    return {name: array.ctypes.data for name, array in arrays.items()}


def screening_memory(screen: Screen) -> tuple[Any, Any]:
    """Memory of a screening as a kernel takes it, and that of its bounds, which it points to.

    Args:
        screen: Screening, whose arrays are shared by address; it must outlive the memory.
    """
    bounds, misfit = screen.bounds, screen.misfit
    arrays = {**screen.arrays, "stated": screen.stated}
    arrays["spread"], arrays["told"] = misfit.levers
    shared = {name.removeprefix("bound_"): arrays.pop(name) for name in MEMORY}
    limits = BOUNDS.type(
        inputs=bounds.inputs,
        smooth=bounds.smooth,
        coordinates=bounds.coordinates,
        dof=bounds.dof,
        **addresses({**shared, "x": bounds.x, "scale": bounds.scale}),
    )
    whole = SCREENING.type(
        channels=len(arrays["noise"]),
        stuck_samples=screen.stuck_samples,
        strips=misfit.levers[0].shape[1],
        window=screen.monitor.window,
        reference=screen.monitor.reference,
        limit=screen.limit,
        share=screen.share,
        ratio=screen.monitor.ratio,
        relative=screen.relative,
        floor=misfit.floor,
        bounds=ctypes.addressof(limits),
        **addresses(arrays),
    )
    return whole, limits


def install_encoder(
    network: PerceptronNetwork, struct: Any, arrays: Mapping[str, Array]
) -> tuple[Array | None, tuple[Any, ...]]:
    """Let a kernel call a compiled encoder itself.

    Args:
        network: Whose encoder.
        struct: The kernel's memory, with the fields encode, encode_arguments, encode_results.
        arrays: Where features and readout are written.

    Returns:
        The x it reads, (n_x,), None without a compiled encoder; what must stay alive.
    """
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
    return x, (arguments, results, constants, arrays)


def aligned(shape: tuple[int, ...], dtype: str = "float64") -> Any:
    """Zeroed array that begins on a cache line."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    raw = np.zeros(size + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + size].view(dtype).reshape(shape)


def rounded_up(count: int, multiple: int) -> int:
    """Next multiple of a number."""
    return -(-count // multiple) * multiple
