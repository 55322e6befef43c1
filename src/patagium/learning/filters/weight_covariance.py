"""Covariance of weights in the size of what is kept of it: its blocks.

Filters give it, and learned models carry it: the variance of a prediction needs H P H' only,
never P as one matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from patagium.arrays import Array, Indices
from patagium.errors import ParameterError, ShapeError
from patagium.learning.models.structure import Layered, blocks_of

MOST_WEIGHTS = 5000
"""Of a structured covariance that is given as one matrix: 200 MB of it."""


def scattered(parts: Sequence[Array], blocks: Sequence[Indices]) -> Array:
    """Blocks in one matrix of all weights, (n, n).

    Args:
        parts: Matrix of each block, (k, k) [1].
        blocks: Indices of the weights of each block, (k,).
    """
    if len(parts) == 1:
        return parts[0]
    whole = np.zeros((sum(map(len, blocks)),) * 2, parts[0].dtype)
    for part, block in zip(parts, blocks, strict=True):
        whole[np.ix_(block, block)] = part
    return whole


@dataclass(frozen=True)
class BlockCovariance:
    """Blocks of weights that vary together, independent of each other.

    Attributes:
        structure: "full", "layer" or "node".
        blocks: Indices of the weights of each block, (k,).
        parts: Covariance of each block, (k, k) [1].
    """

    structure: str
    blocks: tuple[Indices, ...] = field(repr=False)
    parts: tuple[Array, ...] = field(repr=False)

    @property
    def size(self) -> int:
        """Number of weights, n."""
        return sum(map(len, self.blocks))

    def dense(self, most: int = MOST_WEIGHTS) -> Array:
        """P, (n, n).

        Args:
            most: Number of weights above which several blocks are refused as one matrix.

        Raises:
            ParameterError: If there are more weights than that.
        """
        if len(self.parts) == 1:
            return self.parts[0].copy()
        if self.size > most:
            raise ParameterError("covariance", f"at most {most} weights for one matrix", self.size)
        return scattered(self.parts, self.blocks)

    def variances(self) -> Array:
        """Diagonal of P, variances of the weights, (n,) [unit of W squared]."""
        found = np.empty(self.size)
        for block, part in zip(self.blocks, self.parts, strict=True):
            found[block] = np.diagonal(part)
        return found

    def seen_by(self, slope: Array) -> Array:
        """H P H', (n_y, n_y).

        Args:
            slope: H, (n_y, n) [unit of y].
        """
        seen = np.zeros((len(slope), len(slope)))
        for block, part in zip(self.blocks, self.parts, strict=True):
            seen += slope[:, block] @ part @ slope[:, block].T
        return seen


def block_covariance(weights: Layered, structure: str, parts: Sequence[Array]) -> BlockCovariance:
    """Covariance of the blocks of a structure.

    Args:
        weights: Whose, a network or the part of it with weights.
        structure: "full", "layer" or "node".
        parts: Covariance of each block, (k, k) [1].

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
