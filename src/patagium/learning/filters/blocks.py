"""Covariance of independent blocks of weights by square roots, P_b = S_b S_b', in NumPy.

    P_b <- P_b - S_b Z_b P_yy^-1 Z_b' S_b'

is the block of the posterior over all weights; what lies between blocks is forgotten after
each sample. One block of all weights is the full filter. The readable form of the kernels
`node.c`, `cubature.c` and `extended.c`. `BlockCovariances` carries P_b itself and factorizes it at
every sample: Algorithm 1 of the paper, and what the kernels do where noise is added between
samples. The state is that between two samples, or that before the next one, forgetting and process
noise done.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import NamedTuple, TypeAlias

import numpy as np

from patagium.arrays import Array, Indices
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import (
    inverse_root,
    lower_factor,
    measured_root,
    transformed_root,
)
from patagium.learning.filters.spread import Moments, moments_of
from patagium.learning.filters.state import packed, symmetric, unpacked, vector
from patagium.learning.filters.weight_covariance import BlockCovariance, block_covariance, scattered
from patagium.learning.models.network import Encoding
from patagium.learning.models.structure import blocks_of

Parts: TypeAlias = Sequence[Array]
"""State: of each block a matrix (k, k), its square root or its covariance."""
_POINTS_AT_ONCE = 256


class Look(NamedTuple):
    """Sample before it is measured.

    Attributes:
        mean: Weights W, (n,) [1].
        encoding: Features and readout of the network at the input.
        noise: Variances of the measurement, (n_y,) [y^2].
    """

    mean: Array
    encoding: Encoding
    noise: Array


def blocks_in(numbers: FilterNumbers) -> tuple[Indices, ...]:
    """Weights of each block, (k,)."""
    return blocks_of(numbers.network, numbers.settings.covariance)


class BlockRoots:
    """Square roots of blocks of weights, lower triangular but for the full filter linearized.

    Args:
        numbers: Numbers of the filter.
    """

    def __init__(self, numbers: FilterNumbers) -> None:
        self._numbers, self._blocks = numbers, blocks_in(numbers)

    def start(self, std: Array) -> Parts:
        """State of independent weights of some standard deviations, (n,) [1]."""
        return [np.diag(std[block]).astype(self._numbers.dtype) for block in self._blocks]

    def drifted(self, roots: Parts, growth: float, noise: Array | None) -> Parts:
        """State of growth P + diag(noise), noise (n,) [1]."""
        grown = [np.sqrt(growth) * root.astype(float) for root in roots]
        if noise is not None:
            each = zip(grown, self._blocks, strict=True)
            grown = [lower_factor(root @ root.T + np.diag(noise[block])) for root, block in each]
        return [np.ascontiguousarray(root, self._numbers.dtype) for root in grown]

    def moments(self, roots: Parts, look: Look) -> tuple[Moments, Array]:
        """Moments of y, and the square root of P, (n, n) [1], along which they are seen."""
        root = scattered(roots, self._blocks)
        if not self._numbers.linear:
            return self._point_moments(root, look), root
        y, slope = self._numbers.network.linearized(look.encoding, look.mean)
        return Moments(y, root.T @ slope.T, np.diag(look.noise)), root

    def _point_moments(self, root: Array, look: Look) -> Moments:
        """Moments of y at the cubature points, evaluated in the precision of the root."""
        network, rule = self._numbers.network, self._numbers.rule
        center = look.mean.astype(root.dtype)
        steps = np.asarray(rule.spread, root.dtype) * root.T
        values = [network.values(look.encoding, center[None])]
        for sign in (1, -1):
            for start in range(0, len(steps), _POINTS_AT_ONCE):
                part = center + sign * steps[start : start + _POINTS_AT_ONCE]
                values.append(network.values(look.encoding, part))
        y = np.concatenate(values)
        count = len(center)
        return moments_of(y[0], y[1 : count + 1], y[count + 1 :], look.noise, rule)

    def learned(
        self, roots: Parts, mean: Array, root: Array, moments: Moments, gain: Array
    ) -> tuple[Array, Parts]:
        """Weights, (n,) [1], and state after a sample.

        Args:
            roots: State before it.
            mean: Weights before it, (n,) [1].
            root: Square root of P, (n, n) [1], as `moments` gave it.
            moments: Moments of y as screened.
            gain: P_yy^-1 (y - mean), (n_y,) [1/y].

        Raises:
            MatrixLost: If a root is no longer finite or positive definite.
        """
        slopes, remainder = moments.slopes, moments.remainder
        change = transformed_root if self._numbers.linear and len(roots) == 1 else measured_root
        grams = [slopes[block].T @ slopes[block] for block in self._blocks]
        nothing = np.zeros_like(remainder)
        before = list(accumulate(grams[:-1], initial=nothing))
        behind = list(accumulate(grams[:0:-1], initial=nothing))[::-1]
        each = zip(roots, self._blocks, before, behind, strict=True)
        changed = [
            change(part, slopes[block], remainder + first + last)
            for part, block, first, last in each
        ]
        mean = mean.copy()
        for block, (_, cross) in zip(self._blocks, changed, strict=True):
            mean[block] += cross @ gain
        return mean, [np.ascontiguousarray(after, root.dtype) for after, _ in changed]

    def covariance(self, roots: Parts) -> BlockCovariance:
        """P, which shares no memory with the state."""
        network, structure = self._numbers.network, self._numbers.settings.covariance
        return block_covariance(network, structure, self._matrices(roots))

    def _matrices(self, roots: Parts) -> list[Array]:
        """P of each block, (k, k) [1], which shares no memory with the state."""
        doubles = [root.astype(float) for root in roots]
        return [root @ root.T for root in doubles]

    def variances(self, roots: Parts) -> Array:
        """Diagonal of P, (n,) [1]."""
        found = np.empty(self._numbers.network.size)
        for block, root in zip(self._blocks, roots, strict=True):
            whole = root.astype(float)
            found[block] = np.einsum("ij,ij->i", whole, whole)
        return found

    def packed(self, roots: Parts) -> dict[str, Array]:
        """Lower triangles, or the square where the only root is not triangular, by name."""
        if len(roots) == 1 and np.triu(roots[0], 1).any():
            return {"square": roots[0].astype(float)}
        return {"root": packed(roots).astype(self._numbers.dtype)}

    def unpacked(self, state: Mapping[str, Array]) -> Parts:
        """Inverse of `packed`."""
        if "square" in state:
            size = self._numbers.network.size
            return [vector(state, "square", size, size)]
        return [part.astype(self._numbers.dtype) for part in self._triangles(state["root"])]

    def _triangles(self, lower: Array) -> list[Array]:
        """Lower triangles of the blocks, (k, k) each, from one array."""
        return unpacked(np.asarray(lower, float), [len(block) for block in self._blocks])


class BlockCovariances(BlockRoots):
    """Covariances of blocks themselves, in double, factorized before every sample.

    What is added between two samples costs n additions here, and order n^3 to a square root.
    """

    def start(self, std: Array) -> Parts:
        """State of independent weights of some standard deviations, (n,) [1]."""
        return [np.diag(std[block] ** 2) for block in self._blocks]

    def drifted(self, parts: Parts, growth: float, noise: Array | None) -> Parts:
        """State of growth P + diag(noise), noise (n,) [1]."""
        grown = [growth * part for part in parts]
        if noise is not None:
            for part, block in zip(grown, self._blocks, strict=True):
                part[np.diag_indices_from(part)] += noise[block]
        return grown

    def moments(self, parts: Parts, look: Look) -> tuple[Moments, Array]:
        """Moments of y, and the square root of P, (n, n) [1], along which they are seen."""
        dtype = self._numbers.dtype
        return super().moments(
            [np.ascontiguousarray(lower_factor(part), dtype) for part in parts], look
        )

    def learned(
        self, parts: Parts, mean: Array, root: Array, moments: Moments, gain: Array
    ) -> tuple[Array, Parts]:
        """Weights, (n,) [1], and state after a sample; see `BlockRoots.learned`."""
        inverse = inverse_root(moments.covariance)
        cross = root.astype(float) @ moments.slopes
        whitened = cross @ inverse
        smaller = [
            part - whitened[block] @ whitened[block].T
            for part, block in zip(parts, self._blocks, strict=True)
        ]
        return mean + cross @ gain, [(part + part.T) / 2 for part in smaller]

    def _matrices(self, parts: Parts) -> list[Array]:
        """P of each block, (k, k) [1], which shares no memory with the state."""
        return [part.copy() for part in parts]

    def variances(self, parts: Parts) -> Array:
        """Diagonal of P, (n,) [1]."""
        return self.covariance(parts).variances()

    def packed(self, parts: Parts) -> dict[str, Array]:
        """Lower triangles, by name."""
        return {"covariance": packed(parts)}

    def unpacked(self, state: Mapping[str, Array]) -> Parts:
        """Inverse of `packed`; of a version that kept square roots here too, their squares."""
        if "covariance" in state:
            return [symmetric(part) for part in self._triangles(state["covariance"])]
        return super()._matrices(super().unpacked(state))
