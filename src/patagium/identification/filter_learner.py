"""What the filters of weights have in common: one state, predicted and updated alike.

A filter differs from another in how it finds mean, slopes and remainder of y; see
`array_filter`. Neglected: two threads on one learner.
"""

from __future__ import annotations

from time import perf_counter_ns

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import Outcome
from patagium.identification.array_filter import WeightFilter
from patagium.identification.learner import Stopwatch, as_input, as_sample, diverged
from patagium.identification.network import Network
from patagium.identification.root import MatrixLost

Array = NDArray[np.float64]


class FilterLearner:
    """An estimate of weights with a covariance, moved by one sample at a time.

    Args:
        network: The network whose weights are learned.
        weight_filter: Mean and covariance of the weights, and the step over them.
    """

    def __init__(self, network: Network, weight_filter: WeightFilter) -> None:
        self._network, self._filter = network, weight_filter
        self._stopwatch = Stopwatch()
        self._innovation_covariance = np.full((network.outputs, network.outputs), np.nan)

    @property
    def network(self) -> Network:
        """The network whose weights are learned."""
        return self._network

    @property
    def weights(self) -> Array:
        """The estimate W, (n,)."""
        return self._filter.mean.copy()

    @property
    def covariance(self) -> Array:
        """Covariance P of the weights after the last sample, (n, n); symmetric."""
        return self._filter.covariance()

    @property
    def innovation_covariance(self) -> Array:
        """P_yy of the last sample learned, before it was used, (n_y, n_y)."""
        return self._innovation_covariance

    @property
    def count(self) -> int:
        """Samples learned."""
        return self._stopwatch.count

    @property
    def time_per_update(self) -> float:
        """Median wall-clock time of an update, all in [s]; NaN before the first."""
        return self._stopwatch.median

    def predict(self, x: ArrayLike) -> tuple[Array, Array]:
        """Measurement at x before it is made, as `update` would see it.

        Args:
            x: Input, (n_x,).

        Returns:
            Mean, (n_y,), and covariance with the noise of the measurement, (n_y, n_y).

        Raises:
            ShapeError: If x has another shape.
            FilterDiverged: If it is not finite, or the covariance was lost.
        """
        sample = as_input(self._network, x)
        nothing = np.zeros(0)
        if not np.isfinite(sample).all():
            raise diverged(Outcome.NOT_FINITE, self.count, sample, nothing)
        try:
            mean, covariance = self._filter.predict(sample)
        except MatrixLost as lost:
            raise diverged(lost.outcome, self.count, sample, nothing) from None
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            raise diverged(Outcome.NOT_FINITE, self.count, sample, nothing)
        return mean, covariance

    def update(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Learn one sample.

        Args:
            x: Input, (n_x,).
            y: Measurement, (n_y,).

        Returns:
            Innovation y - mean, (n_y,).

        Raises:
            ShapeError: If an argument has another shape.
            FilterDiverged: If a number is not finite or the covariance is lost; the
                learner is then as it was before.
        """
        started = perf_counter_ns()
        sample, measured = as_sample(self._network, self.count, x, y)
        outcome, prediction = self._filter.update(sample, measured)
        if outcome is not Outcome.COMPLETED:
            raise diverged(outcome, self.count, sample, measured)
        self._innovation_covariance = prediction.covariance
        self._stopwatch.add(perf_counter_ns() - started)
        return measured - prediction.mean


def compact(values: Array) -> float | list[float]:
    """A vector as one number where all are equal, for descriptions."""
    return float(values[0]) if (values == values[0]).all() else [float(v) for v in values]
