"""Covariance of weights in the size of what is kept of it: blocks, or diagonal and few columns.

What a learned model carries: the variance of its prediction needs H P H' only, never P as one
matrix. Neglected: changing it; learners do that by their square roots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from patagium.errors import ParameterError, ShapeError
from patagium.learning.filters.low_rank import Precision
from patagium.learning.filters.state import packed, symmetric, unpacked
from patagium.learning.models.structure import Indices, Layered, blocks_of
from patagium.learning.settings import BLOCKS, OWN_BLOCKS, LowRank, Structure

Array = NDArray[np.float64]

MOST_WEIGHTS = 5000
"""Of a structured covariance that is given as one matrix: 200 MB of it."""


class WeightCovariance(Protocol):
    """Covariance P of n weights, as much of it as is kept."""

    @property
    def size(self) -> int:
        """Number of weights, n."""
        ...

    def dense(self) -> Array:
        """P, (n, n).

        Raises:
            ParameterError: If it would be more numbers than are kept, and very many.
        """
        ...

    def variances(self) -> Array:
        """Diagonal of P, variances of the weights, (n,) [unit of W squared]."""
        ...

    def seen_by(self, slope: Array) -> Array:
        """H P H', (n_y, n_y).

        Args:
            slope: H, (n_y, n).
        """
        ...

    def arrays(self) -> tuple[str, dict[str, Array]]:
        """Name of the structure, and its arrays."""
        ...


@dataclass(frozen=True)
class BlockCovariance:
    """Blocks of weights that vary together, independent of each other.

    Attributes:
        structure: "full", "layer" or "node".
        blocks: Weights of each block, (k,).
        parts: Covariance of each, (k, k).
    """

    structure: str
    blocks: tuple[Indices, ...] = field(repr=False)
    parts: tuple[Array, ...] = field(repr=False)

    @property
    def size(self) -> int:
        """Number of weights, n."""
        return sum(map(len, self.blocks))

    def dense(self) -> Array:
        """P, (n, n)."""
        if len(self.parts) == 1:
            return self.parts[0].copy()
        whole = _zeros(self.size)
        for block, part in zip(self.blocks, self.parts, strict=True):
            whole[np.ix_(block, block)] = part
        return whole

    def variances(self) -> Array:
        """Diagonal of P, variances of the weights, (n,) [unit of W squared]."""
        found = np.empty(self.size)
        for block, part in zip(self.blocks, self.parts, strict=True):
            found[block] = np.diagonal(part)
        return found

    def seen_by(self, slope: Array) -> Array:
        """H P H', (n_y, n_y)."""
        seen = np.zeros((len(slope), len(slope)))
        for block, part in zip(self.blocks, self.parts, strict=True):
            seen += slope[:, block] @ part @ slope[:, block].T
        return seen

    def arrays(self) -> tuple[str, dict[str, Array]]:
        """Lower triangles of the blocks, one after the other."""
        return self.structure, {"lower": packed(self.parts)}


@dataclass(frozen=True)
class LowRankCovariance:
    """The inverse of a diagonal and few columns.

    Attributes:
        precision: P^-1.
    """

    precision: Precision = field(repr=False)

    @property
    def size(self) -> int:
        """Number of weights, n."""
        return len(self.precision.diagonal)

    def dense(self) -> Array:
        """P, (n, n)."""
        np.fill_diagonal(whole := _zeros(self.size), 1.0)
        return self.precision.solve(whole)

    def variances(self) -> Array:
        """Diagonal of P, variances of the weights, (n,) [unit of W squared]."""
        return self.precision.variances()

    def seen_by(self, slope: Array) -> Array:
        """H P H', (n_y, n_y)."""
        seen = slope @ self.precision.solve(slope.T)
        return np.asarray((seen + seen.T) / 2)

    def arrays(self) -> tuple[str, dict[str, Array]]:
        """Diagonal and columns of P^-1, row by row."""
        diagonal, columns = self.precision
        return "low rank", {"diagonal": diagonal, "columns": columns.ravel()}


def block_covariance(weights: Layered, structure: str, parts: Sequence[Array]) -> BlockCovariance:
    """Covariance of the blocks of a structure.

    Args:
        weights: Whose, a network or the part of it with weights.
        structure: "full", "layer" or "node".
        parts: Of each block, (k, k).

    Raises:
        ShapeError: If a part is not of its block.
    """
    blocks = blocks_of(weights, structure)
    expected = [(len(block),) * 2 for block in blocks]
    found = [part.shape for part in parts]
    if found != expected:
        odd = next(
            (pair for pair in zip(expected, found, strict=False) if pair[0] != pair[1]), None
        )
        raise ShapeError("covariance", *(odd or (f"{len(expected)} parts", f"{len(found)}")))
    return BlockCovariance(structure, blocks, tuple(parts))


def covariance_of_state(
    weights: Layered, structure: Structure, state: Mapping[str, Array]
) -> WeightCovariance:
    """Covariance of the weights from the state of a filter.

    Args:
        weights: Whose, a network or the part of it with weights.
        structure: Covariance structure.
        state: Of the filter, between two samples; its arrays are left alone.
    """
    if isinstance(structure, LowRank):
        return LowRankCovariance(
            Precision(*(np.array(state[name], float) for name in ("diagonal", "columns")))
        )
    sizes = [len(block) for block in blocks_of(weights, structure)]
    if "covariance" in state:
        parts = [symmetric(part) for part in unpacked(_double(state["covariance"]), sizes)]
    else:
        square = "square" in state
        roots = [state["square"]] if square else unpacked(_double(state["root"]), sizes)
        parts = [np.asarray(root @ root.T) for root in roots]
    return block_covariance(weights, structure, parts)


def covariance_from(weights: Layered, kind: str, arrays: Mapping[str, Array]) -> WeightCovariance:
    """Covariance from the arrays of `WeightCovariance.arrays`.

    Args:
        weights: Whose, a network or the part of it with weights.
        kind: Name of the structure.
        arrays: Arrays by name.

    Raises:
        KeyError: If an array is missing.
        ParameterError: If there is no such kind.
        ShapeError: If an array has another length.
    """
    if kind == "low rank":
        diagonal, columns = arrays["diagonal"], arrays["columns"]
        if diagonal.shape != (weights.size,) or columns.size % weights.size:
            raise ShapeError("covariance", (weights.size,), diagonal.shape)
        return LowRankCovariance(Precision(diagonal, columns.reshape(weights.size, -1)))
    if kind not in {*BLOCKS, *OWN_BLOCKS}:
        known = (*BLOCKS, *sorted(OWN_BLOCKS), "low rank")
        raise ParameterError("covariance", f"one of {', '.join(known)}", kind)
    sizes = [len(block) for block in blocks_of(weights, kind)]
    parts = [symmetric(lower) for lower in unpacked(arrays["lower"], sizes)]
    return block_covariance(weights, kind, parts)


def _zeros(size: int) -> Array:
    if size > MOST_WEIGHTS:
        raise ParameterError(
            "covariance", f"at most {MOST_WEIGHTS} weights to give it as one matrix", size
        )
    return np.zeros((size, size))


def _double(values: Array) -> Array:
    return np.asarray(values, float)
