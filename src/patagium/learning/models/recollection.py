"""A log as a network recalls it while its weights change: block by block between updates.

Neglected: what was recalled before an update is not recalled anew; it is moved along its
slopes (`Network.corrected`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ShapeError
from patagium.learning.models.network import Carried, Network
from patagium.learning.models.structure import Indices

Array = NDArray[np.float64]


class Observed(NamedTuple):
    """What was seen of a log, and which samples of it are used.

    Attributes:
        time: Increasing, (N,) [s].
        x: What is measured of the network's inputs, (N, n_measured).
        gaps: First sample after each gap.
        used: Samples used, increasing, (U,).
    """

    time: Array
    x: Array
    gaps: Indices
    used: Indices

    def part(self, begin: int, end: int) -> Observed:
        """Used samples of a span, and those between them.

        Args:
            begin: First used sample, by its number among them.
            end: One past the last.
        """
        used = self.used[begin:end]
        first, last = int(used[0]), int(used[-1]) + 1
        gaps = self.gaps[(self.gaps > first) & (self.gaps < last)]
        return Observed(self.time[first:last], self.x[first:last], gaps - first, used - first)


class Recollection:
    """Inputs of a log's samples in order, with what the network remembers at each.

    Args:
        network: The network.
        time: Increasing, (N,) [s].
        x: What is measured of its inputs, (N, n_measured), or all of them, (N, n_x).
        gaps: First sample after each gap, where memory begins anew.

    Raises:
        ShapeError: If x has another shape.
    """

    def __init__(self, network: Network, time: Array, x: Array, gaps: ArrayLike = ()) -> None:
        if x.ndim != 2 or x.shape[1] not in (network.measured_inputs, network.inputs):
            expected = f"(N, {network.measured_inputs})"
            raise ShapeError("x", expected, x.shape)
        self._network, self._time, self._x = network, time, x
        self._gaps = np.asarray(gaps, int)
        self._plain = x.shape[1] == network.inputs
        self._reached, self._carried = 0, None

    def upto(self, end: int, weights: Array) -> Array:
        """Inputs from where it stands up to a sample; it goes on from there.

        Args:
            end: One past the last sample.
            weights: That hold over them, (n,).
        """
        rows, self._carried = self._recalled(end, weights)
        self._reached = end
        return rows

    def ahead(self, end: int, weights: Array) -> Array:
        """The same, and it stays where it is."""
        return self._recalled(end, weights)[0]

    def heed(self, change: Array) -> None:
        """An update moved the weights.

        Args:
            change: By how much, (n,).
        """
        if not self._plain:
            self._carried = self._network.corrected(self._carried, change)

    def _recalled(self, end: int, weights: Array) -> tuple[Array, Carried]:
        part = slice(self._reached, end)
        if self._plain:
            return self._x[part], None
        gaps = self._gaps[(self._gaps >= part.start) & (self._gaps < end)] - part.start
        return self._network.recall(weights, self._time[part], self._x[part], self._carried, gaps)
