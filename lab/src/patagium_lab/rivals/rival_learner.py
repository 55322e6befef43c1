"""Base of the learners that no filter moves, which learners of the library are compared with.

They follow the `Learner` protocol, refuse and count the same samples as the library's filters do,
and are neither saved nor compiled. Neglected: memory of a network between samples that come one
by one.
"""

from __future__ import annotations

from abc import abstractmethod
from time import perf_counter_ns

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, Bools
from patagium.learning.filters.screening import EVENTS, Screen
from patagium.learning.learners.learner import Learner, Stopwatch, shaped_sample
from patagium.learning.models.network import Network


class RivalLearner(Learner):
    """Learner whose child learns the channels of a sample that are usable.

    Args:
        network: Network whose weights are learned.
        screen: Screening of the samples.
    """

    def __init__(self, network: Network, screen: Screen) -> None:
        self._network, self._screen, self._stopwatch = network, screen, Stopwatch()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.count} samples learned by {self._network!r}>"

    @property
    def network(self) -> Network:
        """Network whose weights are learned."""
        return self._network

    @property
    def events(self) -> dict[str, int]:
        """Number of samples of each event; see `screening.EVENTS`."""
        return self._screen.events

    @property
    def count(self) -> int:
        """Number of samples learned."""
        return self._stopwatch.count

    @property
    def time_per_update(self) -> float:
        """Median wall-clock time of an update [s]; NaN before the first."""
        return self._stopwatch.median

    def update(self, x: ArrayLike, y: ArrayLike, time: float | None = None) -> Array:
        """Learn one sample.

        Args:
            x: Input, (n_x,) [units of x].
            y: Measurement, (n_y,) [unit of y]; channels that are no numbers are left out.
            time: Of the sample [s]; None: not known, and it comes after the one before.

        Returns:
            Innovation y - mean, (n_y,) [unit of y]; NaN where nothing was learned.

        Raises:
            ShapeError: If an argument has another shape.
            FilterDiverged: If the new weights are not finite or the covariance is lost; the
                learner is then as it was before.
        """
        started = perf_counter_ns()
        sample, measured = shaped_sample(self._network, x, y)
        kept = self._usable_channels(sample, measured, time)
        if kept is None:
            return np.full(len(measured), np.nan)
        innovation = self._learn(sample, measured, kept)
        self._stopwatch.add(perf_counter_ns() - started)
        return np.where(kept, innovation, np.nan)

    @abstractmethod
    def _learn(self, x: Array, y: Array, kept: Bools) -> Array:
        """Innovation of a sample, (n_y,) [unit of y], once its channels kept, (n_y,), are learned.

        Args:
            x: Input, (n_x,) [units of x].
            y: Measurement, (n_y,) [unit of y].
            kept: Whether a channel is learned, (n_y,).
        """

    def _usable_channels(self, x: Array, y: Array, time: float | None) -> Bools | None:
        """Channels of a sample that are numbers, (n_y,); None where it is not to be learned."""
        screen = self._screen
        screen.stamp(time)
        if screen.admit():
            return None
        within = screen.bounded(x, y)
        if within is None:
            return None
        kept = np.isfinite(within)
        screen.counts[EVENTS.index("missing")] += int((~kept).sum())
        if not kept.any():
            screen.note("blind")
            return None
        return kept
