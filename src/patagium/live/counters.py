"""Running scores of a stream: error, coverage and times of the calls, lately and in all.

Means are exponential, with a memory counted in samples, so that what is shown is the present.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from patagium.errors import Outcome
from patagium.learning.scores import ErrorSums, IntervalSums
from patagium.live.pipeline import Records

Array = NDArray[np.float64]

_BINS = np.concatenate([[0.0], np.geomspace(1e-7, 10.0, 1600)])  # s: steps of 1.2 %


class Counters:
    """Running scores and counts of a stream.

    Args:
        outputs: Number of channels n_y.
        memory: Samples that running means reach back.

    Attributes:
        samples: Number of packets so far.
        learned: Number of those that were learned.
        failed: Number of those at which the learner failed.
    """

    def __init__(self, outputs: int, memory: float) -> None:
        self._keep = 1.0 - 1.0 / memory
        self._errors, self._lately = ErrorSums(outputs), IntervalSums(outputs)
        self._all = IntervalSums(outputs)
        self._bins = np.zeros(len(_BINS), np.int64)
        self._slowest = 0.0
        self.samples, self.learned, self.failed = 0, 0, 0

    def add(self, records: Records) -> None:
        """Count more samples, in order.

        Args:
            records: What became of them.
        """
        guess = records.prediction
        counted = np.isfinite(guess) & ~records.left_out
        y = np.where(counted, records.measurement, np.nan)
        self._errors.add(y, guess, keep=self._keep)
        self._lately.add(y - guess, records.std, self._keep)
        self._all.add(y - guess, records.std)
        self._count(records)

    @property
    def nmse(self) -> Array:
        """Running mean square error over the running variance, (n_y,) [-]; NaN where silent."""
        return self._errors.nmse

    @property
    def nmse_mean(self) -> float:
        """Mean of `nmse` over the channels that are not silent; NaN before there is one."""
        values = self.nmse
        return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")

    @property
    def coverage(self) -> float:
        """Running share of measurements in their predicted 95 % interval; NaN before any."""
        return self._lately.coverage_in_all

    @property
    def coverage_in_all(self) -> float:
        """Share of all measurements in their predicted 95 % interval; NaN before any."""
        return self._all.coverage_in_all

    def duration(self, share: float) -> float:
        """Quantile of the times of the calls [s], to 1.2 %.

        Args:
            share: Of the calls that took no longer, 0 to 1; 1 gives the slowest.
        """
        if share >= 1.0 or not self.samples:
            return self._slowest if self.samples else float("nan")
        place = int(np.searchsorted(np.cumsum(self._bins), share * self.samples))
        return float(min(_BINS[place], self._slowest))

    def _count(self, records: Records) -> None:
        outcome, duration = records.outcome, records.duration
        self.samples += len(records)
        self.learned += int((outcome == Outcome.COMPLETED).sum())
        lost = (outcome == Outcome.NOT_FINITE) | (outcome == Outcome.COVARIANCE_LOST)
        self.failed += int(lost.sum())
        self._bins += np.bincount(np.searchsorted(_BINS[:-1], duration), minlength=len(_BINS))
        self._slowest = max(self._slowest, float(duration.max(initial=0.0)))
