"""Centers and scales of a network's inputs and outputs: physical units stay outside.

Scales are fixed when the network is made; they do not follow the samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ParameterError, ShapeError

Array = NDArray[np.float64]


def center_of(name: str, value: ArrayLike, size: int) -> Array:
    """A scalar or vector as a read-only vector of finite numbers, (size,).

    Raises:
        ShapeError: If it is neither scalar nor (size,).
        ParameterError: If a number is not finite.
    """
    array = np.asarray(value, float)
    if array.shape not in ((), (size,)):
        raise ShapeError(name, f"() or ({size},)", array.shape)
    if not np.isfinite(array).all():
        raise ParameterError(name, "finite numbers", value)
    whole = np.broadcast_to(array, (size,)).copy()
    whole.setflags(write=False)
    return whole


def scale_of(name: str, value: ArrayLike, size: int) -> Array:
    """A scalar or vector as a read-only vector of positive numbers, (size,).

    Raises:
        ShapeError: If it is neither scalar nor (size,).
        ParameterError: If a number is not positive.
    """
    whole = center_of(name, value, size)
    if not (whole > 0).all():
        raise ParameterError(name, "positive numbers", value)
    return whole
