"""Covariance of independent blocks of weights by square roots, P_b = S_b S_b', in NumPy.

    P_b <- P_b - S_b Z_b P_yy^-1 Z_b' S_b'

is the block of the posterior over all weights; what lies between blocks is forgotten after
each sample. One block of all weights is the full filter. The readable form of the kernels
`node.c`, `cubature.c` and `extended.c`. `WHOLE` carries P_b itself and factorizes it at every
sample: Algorithm 1 of the paper, and what the kernels do where noise is added between samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import TypeAlias

import numpy as np

from patagium.arrays import Array, Indices
from patagium.errors import Outcome
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import (
    MatrixLost,
    inverse_root,
    lower_factor,
    measured_root,
    transformed_root,
    with_noise,
)
from patagium.learning.filters.spread import Moments, moments_of
from patagium.learning.filters.state import packed, symmetric, unpacked, vector
from patagium.learning.filters.structure import Look, Structure
from patagium.learning.filters.weight_covariance import BlockCovariance, block_covariance, scattered
from patagium.learning.models.structure import blocks_of

Roots: TypeAlias = Sequence[Array]
"""Square root of each block, (k, k): lower triangular, but for the full filter linearized."""
_POINTS_AT_ONCE = 256


def blocks_in(numbers: FilterNumbers) -> tuple[Indices, ...]:
    """Weights of each block, (k,)."""
    return blocks_of(numbers.network, str(numbers.structure))


def _drifted(numbers: FilterNumbers, roots: Roots, growth: float, noise: Array | None) -> Roots:
    grown = [np.sqrt(growth) * root.astype(float) for root in roots]
    if noise is not None:
        each = zip(grown, blocks_in(numbers), strict=True)
        grown = [with_noise(root, noise[block]) for root, block in each]
    return [np.ascontiguousarray(root, numbers.dtype) for root in grown]


def _moments(roots: Roots, look: Look) -> tuple[Moments, Array]:
    root = scattered(roots, blocks_in(look.numbers))
    if not look.numbers.linear:
        return point_moments(look, root), root
    y, slope = look.numbers.network.linearized(look.encoding, look.mean)
    return Moments(y, root.T @ slope.T, np.diag(look.noise)), root


def _learned(
    roots: Roots, look: Look, root: Array, moments: Moments, gain: Array
) -> tuple[Array, Roots]:
    slopes, remainder = moments.slopes, moments.remainder
    if len(roots) == 1:
        change = transformed_root if look.numbers.linear else measured_root
        changed = [change(root, slopes, remainder)]
    else:
        blocks = blocks_in(look.numbers)
        grams = [slopes[block].T @ slopes[block] for block in blocks]
        nothing = np.zeros_like(remainder)
        before = list(accumulate(grams[:-1], initial=nothing))
        behind = list(accumulate(grams[:0:-1], initial=nothing))[::-1]
        changed = [
            measured_root(part, slopes[block], remainder + first + last)
            for part, block, first, last in zip(roots, blocks, before, behind, strict=True)
        ]
    mean = look.mean.copy()
    for block, (_, cross, _) in zip(blocks_in(look.numbers), changed, strict=True):
        mean[block] += cross @ gain
    if not all(np.isfinite(after).all() for after, _, _ in changed):
        raise MatrixLost(Outcome.NOT_FINITE)
    return mean, [np.ascontiguousarray(after, root.dtype) for after, _, _ in changed]


def _covariance(numbers: FilterNumbers, roots: Roots) -> BlockCovariance:
    doubles = [root.astype(float) for root in roots]
    parts = [np.asarray(root @ root.T) for root in doubles]
    return block_covariance(numbers.network, str(numbers.structure), parts)


def _variances(numbers: FilterNumbers, roots: Roots) -> Array:
    found = np.empty(numbers.network.size)
    for block, root in zip(blocks_in(numbers), roots, strict=True):
        whole = root.astype(float)
        found[block] = np.einsum("ij,ij->i", whole, whole)
    return found


def _packed(numbers: FilterNumbers, roots: Roots) -> dict[str, Array]:
    """Lower triangles, or the square where the only root is not triangular."""
    if len(roots) == 1 and np.triu(roots[0], 1).any():
        return {"square": roots[0].astype(float)}
    return {"root": packed(roots).astype(numbers.dtype)}


def _unpacked(numbers: FilterNumbers, state: Mapping[str, Array]) -> Roots:
    size = numbers.network.size
    if "square" in state:
        return [vector(state, "square", size, size)]
    sizes = [len(block) for block in blocks_in(numbers)]
    roots = unpacked(np.asarray(state["root"], float), sizes)
    return [root.astype(numbers.dtype) for root in roots]


BLOCKS = Structure(
    start=lambda numbers, std: [
        np.diag(std[block]).astype(numbers.dtype) for block in blocks_in(numbers)
    ],
    drifted=_drifted,
    moments=_moments,
    learned=_learned,
    covariance=_covariance,
    variances=_variances,
    packed=_packed,
    unpacked=_unpacked,
)
"""Square roots of blocks of weights; the state is one root a block."""


def _whole_drifted(
    numbers: FilterNumbers, parts: Sequence[Array], growth: float, noise: Array | None
) -> Sequence[Array]:
    grown = [growth * part for part in parts]
    if noise is not None:
        for part, block in zip(grown, blocks_in(numbers), strict=True):
            part[np.diag_indices_from(part)] += noise[block]
    return grown


def _whole_moments(parts: Sequence[Array], look: Look) -> tuple[Moments, Array]:
    dtype = look.numbers.dtype
    roots = [np.ascontiguousarray(lower_factor(part), dtype) for part in parts]
    return _moments(roots, look)


def _whole_learned(
    parts: Sequence[Array], look: Look, root: Array, moments: Moments, gain: Array
) -> tuple[Array, Sequence[Array]]:
    inverse = inverse_root(moments.covariance)
    cross = root.astype(float) @ moments.slopes
    whitened = cross @ inverse
    blocks = blocks_in(look.numbers)
    smaller = [
        part - whitened[block] @ whitened[block].T
        for part, block in zip(parts, blocks, strict=True)
    ]
    return look.mean + cross @ gain, [(part + part.T) / 2 for part in smaller]


def _whole_unpacked(numbers: FilterNumbers, state: Mapping[str, Array]) -> Sequence[Array]:
    if "covariance" not in state:  # of a version that kept square roots here too
        return [root.astype(float) @ root.astype(float).T for root in _unpacked(numbers, state)]
    lower = np.asarray(state["covariance"], float)
    sizes = [len(block) for block in blocks_in(numbers)]
    return [symmetric(part) for part in unpacked(lower, sizes)]


WHOLE: Structure = Structure(
    start=lambda numbers, std: [np.diag(std[block] ** 2) for block in blocks_in(numbers)],
    drifted=_whole_drifted,
    moments=_whole_moments,
    learned=_whole_learned,
    covariance=lambda numbers, parts: block_covariance(
        numbers.network, str(numbers.structure), [part.copy() for part in parts]
    ),
    variances=lambda numbers, parts: WHOLE.covariance(numbers, parts).variances(),
    packed=lambda numbers, parts: {"covariance": packed(parts)},
    unpacked=_whole_unpacked,
)
"""Covariances of blocks themselves, in double, factorized before every sample.

What is added between two samples costs n additions here, and order n^3 to a square root.
"""


def point_moments(look: Look, root: Array) -> Moments:
    """Moments of y at the cubature points around the weights.

    Args:
        look: Sample before it is measured.
        root: Square root S of P, (n, n) [1]; the points are evaluated in its precision.
    """
    network, rule = look.numbers.network, look.numbers.rule
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
