"""Which filter of weights a structure of the covariance takes, compiled where it can be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from patagium.learning.filters.array import CholeskyFilter, WeightFilter
from patagium.learning.filters.block import BlockFilter, scattered, setting_blocks
from patagium.learning.filters.extended_kernel import restore_extended
from patagium.learning.filters.kernel import restore
from patagium.learning.filters.low_rank import Precision
from patagium.learning.filters.low_rank_kernel import restore_low_rank
from patagium.learning.filters.node import NodeFilter, load_node
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.models.perceptron import PerceptronNetwork
from patagium.learning.settings import LowRank

Array = NDArray[np.float64]


def weight_filter(numbers: FilterNumbers, mean: Array) -> WeightFilter:
    """Weight filter for a covariance structure, compiled where it can be.

    Args:
        numbers: Numbers of the filter.
        mean: Weights to start from, (n,).
    """
    std = np.sqrt(numbers.prior_variance)
    if numbers.settings.square_root == "cholesky":
        return CholeskyFilter(numbers, mean, np.diag(std))
    return (extended_filter if numbers.linear else cubature_filter)(numbers, mean, std)


def cubature_filter(setting: FilterNumbers, mean: Array, std: Array) -> WeightFilter:
    """A cubature filter whose weights start independent.

    Args:
        setting: What it is made of.
        mean: Weights, (n,).
        std: Their standard deviations, (n,).
    """
    if isinstance(setting.structure, LowRank):
        return restore_low_rank(setting, mean, independent(setting, std))
    if setting.structure == "node":
        roots = [np.diag(std[block]) for block in setting_blocks(setting)]
        return restore_nodes(setting, mean, roots)
    return restore(setting, mean, np.diag(std))


def extended_filter(setting: FilterNumbers, mean: Array, std: Array) -> WeightFilter:
    """The same with the network linear around its weights.

    Args:
        setting: What it is made of.
        mean: Weights, (n,).
        std: Their standard deviations, (n,).
    """
    if isinstance(setting.structure, LowRank):
        return restore_low_rank(setting, mean, independent(setting, std), linear=True)
    return restore_extended(setting, mean, np.diag(std))


def independent(setting: FilterNumbers, std: Array) -> Precision:
    """The inverse of a diagonal covariance, with columns of zeros."""
    rank = min(setting.structure.rank, len(std)) if isinstance(setting.structure, LowRank) else 0
    return Precision(1.0 / std**2, np.zeros((len(std), rank)))


def restore_nodes(
    setting: FilterNumbers, mean: Array, roots: Sequence[Array]
) -> NodeFilter | BlockFilter:
    """A filter of one block a neuron in the state given, compiled where that can be.

    Args:
        setting: What it is made of.
        mean: Weights, (n,).
        roots: The lower triangular square root of each neuron's covariance, (k, k).
    """
    library = load_node(setting.dtype)
    if library is None or not isinstance(setting.network, PerceptronNetwork):
        return BlockFilter(setting, mean, scattered(roots, setting_blocks(setting)))
    return NodeFilter(setting, mean, roots, library)
