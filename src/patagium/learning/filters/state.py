"""The state of a filter as few vectors, to be kept in a file: roots by their lower triangles.

Numbers keep the precision the filter holds them in, so that they come back bit for bit.
Neglected: what a filter derives from its state; it is derived again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from patagium.errors import ShapeError

Array = NDArray[np.float64]


class RootState(NamedTuple):
    """What a square-root filter is between two samples.

    Attributes:
        mean: Weights W, (n,).
        nis: Normalized innovation squared of the last sample.
        roots: Lower triangular square roots of the covariance's blocks, (k, k) each.
    """

    mean: Array
    nis: float
    roots: list[Array]

    def packed(self, dtype: DTypeLike) -> dict[str, Array]:
        """As vectors by name.

        Args:
            dtype: Of the roots.
        """
        return {
            "mean": np.array(self.mean, float),
            "nis": np.array(self.nis),
            "root": packed(self.roots).astype(dtype),
        }


def root_state(state: Mapping[str, Array], sizes: Sequence[int]) -> RootState:
    """Inverse of `RootState.packed`.

    Args:
        state: Vectors by name.
        sizes: Weights of each block, k.

    Raises:
        KeyError: If a vector is missing.
        ShapeError: If one has another length.
    """
    mean = vector(state, "mean", sum(sizes))
    return RootState(mean, float(state["nis"]), unpacked(np.asarray(state["root"], float), sizes))


def vector(state: Mapping[str, Array], name: str, *shape: int) -> Array:
    """An array of a state in double precision, C-contiguous.

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

    Args:
        expected: The others, by name.
        state: Arrays by name.

    Raises:
        KeyError: If one is missing.
        ShapeError: If one has another shape.
    """
    for name, array in expected.items():
        if state[name].shape != array.shape:
            raise ShapeError(name, array.shape, state[name].shape)
    return {name: state[name] for name in expected}


def part(state: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """What of a state has a prefix, without it.

    Args:
        state: Values by name.
        prefix: Of the names wanted.
    """
    return {
        name.removeprefix(prefix): value for name, value in state.items() if name.startswith(prefix)
    }


def packed(squares: Sequence[Array]) -> Array:
    """Lower triangles row by row, one matrix after the other.

    Args:
        squares: Matrices, (k, k) each.
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
    lengths = [size * (size + 1) // 2 for size in sizes]
    if values.shape != (sum(lengths),):
        raise ShapeError("lower triangles", (sum(lengths),), values.shape)
    squares, start = [], 0
    for size, length in zip(sizes, lengths, strict=True):
        square = np.zeros((size, size), values.dtype)
        square[np.tril_indices(size)] = values[start : start + length]
        squares.append(square)
        start += length
    return squares


def symmetric(lower: Array) -> Array:
    """A symmetric matrix from its lower triangle, (k, k).

    Args:
        lower: The triangle, zeros above it.
    """
    return np.asarray(lower + np.tril(lower, -1).T, order="C")
