"""State of a filter as few vectors of a file: square roots by their lower triangles.

Numbers keep the precision of the filter, so that they come back bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.arrays import Array
from patagium.errors import ParameterError, ShapeError


def vector(state: Mapping[str, Array], name: str, *shape: int) -> Array:
    """Array of a state in double precision, C-contiguous.

    Args:
        state: Arrays by name.
        name: Which one.
        shape: Expected of it.

    Raises:
        KeyError: If it is missing.
        ShapeError: If it has another shape.
    """
    found = np.array(state[name], float, order="C")
    if found.shape != shape:
        raise ShapeError(name, shape, found.shape)
    return found


def arrays_like(
    expected: Mapping[str, NDArray[np.generic]], state: Mapping[str, NDArray[np.generic]]
) -> dict[str, NDArray[np.generic]]:
    """Arrays of a state that others can be replaced by.

    Raises:
        ParameterError: If one is missing.
        ShapeError: If one has another shape.
    """
    for name, array in expected.items():
        if name not in state:
            raise ParameterError("state", f"an array {name}", "none")
        if state[name].shape != array.shape:
            raise ShapeError(name, array.shape, state[name].shape)
    return {name: state[name] for name in expected}


def part(state: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Part of a state whose names have a prefix, without it."""
    return {
        name.removeprefix(prefix): value for name, value in state.items() if name.startswith(prefix)
    }


def packed(squares: Sequence[Array]) -> Array:
    """Lower triangles row by row, one matrix after the other.

    Args:
        squares: Symmetric matrices, (k, k) each [1].
    """
    return np.concatenate([square[np.tril_indices(len(square))] for square in squares])


def unpacked(values: Array, sizes: Sequence[int]) -> list[Array]:
    """Inverse of `packed`, with zeros above the diagonals.

    Args:
        values: Lower triangles.
        sizes: k of each matrix.

    Raises:
        ShapeError: If they are not as many numbers as that.
    """
    ends = np.cumsum([size * (size + 1) // 2 for size in sizes]).tolist()
    if values.shape != (ends[-1],):
        raise ShapeError("lower triangles", (ends[-1],), values.shape)
    squares = [np.zeros((size, size), values.dtype) for size in sizes]
    for square, lower in zip(squares, np.split(values, ends[:-1]), strict=True):
        square[np.tril_indices(len(square))] = lower
    return squares


def symmetric(lower: Array) -> Array:
    """Symmetric matrix from its lower triangle, (k, k)."""
    return np.asarray(lower + np.tril(lower, -1).T, order="C")
