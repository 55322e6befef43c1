"""The filter whose covariance keeps blocks only, in NumPy: layers or neurons by themselves.

    P_b <- P_b - S_b Z_b P_yy^-1 Z_b' S_b'

is the block of the posterior over all weights; what lies between blocks is forgotten after
each sample. The readable form of the kernels `node.c` and, with a block a layer,
`cubature.c`. Neglected: speed, and memory: the blocks stand in a matrix of all weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from patagium.learning.filters.array import ArrayFilter
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import lower_factor, measured_root
from patagium.learning.models.structure import Indices, blocks_of

Array = NDArray[np.float64]


class BlockFilter(ArrayFilter):
    """Square-root filter of independent blocks of weights.

    Args:
        setting: What it is made of; its structure is "full", "layer" or "node".
        mean: Weights to start from, (n,).
        root: The lower triangular square roots of the blocks in one matrix, (n, n).
    """

    def __init__(self, setting: FilterNumbers, mean: Array, root: Array) -> None:
        super().__init__(setting, mean, root)
        self._blocks = setting_blocks(setting)

    def _measured(self, root: Array, slopes: Array, remainder: Array) -> tuple[Array, Array, Array]:
        """`root.measured_root` block by block, each with what the others leave of P_yy."""
        grams = [slopes[block].T @ slopes[block] for block in self._blocks]
        nothing = np.zeros_like(remainder)
        before = list(accumulate(grams[:-1], initial=nothing))
        behind = list(accumulate(grams[:0:-1], initial=nothing))[::-1]
        after, cross = np.zeros_like(root), np.zeros((len(root), len(remainder)), root.dtype)
        for block, first, last in zip(self._blocks, before, behind, strict=True):
            part = np.ix_(block, block)
            after[part], cross[block], _ = measured_root(
                root[part], slopes[block], remainder + first + last
            )
        lower = lower_factor(sum(grams, remainder))
        return after, cross, np.asarray(np.linalg.inv(lower).T)

    def roots(self) -> list[Array]:
        """Square roots of the blocks of the covariance, (k, k) each."""
        root = self.root()
        return [root[np.ix_(block, block)] for block in self._blocks]

    def _joined(self, roots: list[Array]) -> Array:
        return scattered(roots, self._blocks)


def setting_blocks(setting: FilterNumbers) -> tuple[Indices, ...]:
    """Weights that a filter keeps together."""
    return blocks_of(setting.network, str(setting.structure))


def scattered(roots: Sequence[Array], blocks: Sequence[Indices]) -> Array:
    """Blocks in a matrix of all weights, (n, n)."""
    whole = np.zeros((sum(map(len, blocks)),) * 2)
    for root, block in zip(roots, blocks, strict=True):
        whole[np.ix_(block, block)] = root
    return whole
