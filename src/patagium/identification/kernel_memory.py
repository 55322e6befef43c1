"""Memory shared with compiled filters by address: arrays on cache lines, the encoder's call.

Neglected: who frees what; arrays live as long as the filter that holds them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.identification.network import Network

Array = NDArray[np.float64]

ACTIVATION_CODES = {"softplus": 0, "tanh": 1}
"""Names of activations to the integers of the kernels."""


def kernel_function(library: ctypes.CDLL, name: str) -> Any:
    """A function of a kernel that takes the address of its memory and gives an outcome."""
    function = getattr(library, name)
    function.argtypes, function.restype = [ctypes.c_void_p], ctypes.c_int
    return function


def install_encoder(
    network: Network, struct: Any, arrays: Mapping[str, Array]
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


def aligned(shape: tuple[int, ...], dtype: Any) -> Any:
    """A zeroed array that begins on a cache line."""
    size = int(np.prod(shape)) * dtype.itemsize
    raw = np.zeros(size + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + size].view(dtype).reshape(shape)


def rounded_up(count: int, multiple: int) -> int:
    """The next multiple of a number."""
    return -(-count // multiple) * multiple
