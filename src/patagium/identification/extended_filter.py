"""Filters of weights with the network linear around them: H = dy/dW in place of points.

Neglected: curvature of the network over the spread of its weights.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from patagium.identification.array_filter import ArrayFilter, FilterSetting
from patagium.identification.block_filter import BlockFilter
from patagium.identification.root import transformed_root
from patagium.identification.spread import Moments

Array = NDArray[np.float64]


class ExtendedFilter(ArrayFilter):
    """The square-root step with Z = S' H' and M = R, S not triangular."""

    _measured = staticmethod(transformed_root)

    def _moments(self, x: Array, root: Array) -> Moments:
        return linear_moments(self.setting, x, self.mean, root)


class ExtendedBlockFilter(BlockFilter):
    """The same for independent blocks, each triangular."""

    def _moments(self, x: Array, root: Array) -> Moments:
        return linear_moments(self.setting, x, self.mean, root)


def linear_moments(setting: FilterSetting, x: Array, mean: Array, root: Array) -> Moments:
    """Moments of y with the network linear around the mean.

    Args:
        setting: What the filter is made of.
        x: Input, (n_x,).
        mean: W, (n,).
        root: S, (n, n).
    """
    y, slope = setting.network.linearized(setting.network.encode_one(x), mean)
    return Moments(y, root.T @ slope.T, np.diag(setting.noise))
