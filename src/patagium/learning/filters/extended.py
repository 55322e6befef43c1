"""Filters of weights with the network linear around them: H = dy/dW in place of points.

Neglected: curvature of the network over the spread of its weights.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from patagium.learning.filters.array import ArrayFilter
from patagium.learning.filters.block import BlockFilter
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.root import transformed_root
from patagium.learning.filters.spread import Moments
from patagium.learning.filters.state import vector
from patagium.learning.models.network import Encoding

Array = NDArray[np.float64]


class ExtendedFilter(ArrayFilter):
    """The square-root step with Z = S' H' and M = R, S not triangular."""

    _measured = staticmethod(transformed_root)

    def state(self) -> dict[str, Array]:
        """All that the next samples depend on, as arrays by name."""
        return {"mean": self.mean.copy(), "nis": np.array(self.nis), "square": self.root()}

    def resume(self, state: Mapping[str, Array]) -> None:
        """Go on from a state, also of the compiled filter, whose root is triangular."""
        if "square" not in state:
            return super().resume(state)
        size = len(self.mean)
        mean, square = vector(state, "mean", size), vector(state, "square", size, size)
        self.mean, self.nis, self._root, self._grown = mean, float(state["nis"]), square, None

    def _moments(self, encoding: Encoding, root: Array) -> Moments:
        noise = self.screen.noise(encoding.readout)
        return linear_moments(self.setting, encoding, noise, self.mean, root)


class ExtendedBlockFilter(BlockFilter):
    """The same for independent blocks, each triangular."""

    def _moments(self, encoding: Encoding, root: Array) -> Moments:
        noise = self.screen.noise(encoding.readout)
        return linear_moments(self.setting, encoding, noise, self.mean, root)


def linear_moments(
    setting: FilterNumbers, encoding: Encoding, noise: Array, mean: Array, root: Array
) -> Moments:
    """Moments of y with the network linear around the mean.

    Args:
        setting: What the filter is made of.
        encoding: What the network sees of its input.
        noise: Variances of the measurement, (n_y,).
        mean: W, (n,).
        root: S, (n, n).
    """
    y, slope = setting.network.linearized(encoding, mean)
    return Moments(y, root.T @ slope.T, np.diag(noise))
