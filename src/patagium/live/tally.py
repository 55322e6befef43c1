"""How a stream goes: error, coverage and times of the calls, over its last samples and in all.

Means are exponential, with a memory counted in samples, so that what is shown is the present.
Neglected: correlation of samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from patagium.errors import Outcome
from patagium.learning.scores import INTERVAL, SILENT_RATIO
from patagium.live.pipeline import Records

Array = NDArray[np.float64]

_BINS = np.concatenate([[0.0], np.geomspace(1e-7, 10.0, 1600)])  # s: steps of 1.2 %


class Tally:
    """Running scores of a stream.

    Args:
        outputs: Number of channels n_y.
        memory: Samples that running means reach back.
    """

    def __init__(self, outputs: int, memory: float) -> None:
        self._keep = 1.0 - 1.0 / memory
        self._weight = np.zeros(outputs)
        self._sums = np.zeros((4, outputs))  # of y, y^2, error^2, hits
        self._hits, self._scored = 0.0, 0
        self._bins = np.zeros(len(_BINS), np.int64)
        self._slowest = 0.0
        self.samples, self.learned, self.failed = 0, 0, 0

    def add(self, records: Records) -> None:
        """More samples, in order."""
        y, guess = records.measurement, records.prediction
        heard = np.isfinite(y) & np.isfinite(guess) & ~records.left_out
        error = np.where(heard, y - guess, 0.0)
        inside = heard & (np.abs(error) <= INTERVAL * records.std)
        known = np.where(heard, y, 0.0)
        fading = self._keep ** np.arange(len(y) - 1, -1, -1.0)
        fresh = np.einsum("k,rko->ro", fading, np.stack([known, known**2, error**2, inside]))
        self._sums = self._sums * self._keep ** len(y) + fresh
        self._weight = self._weight * self._keep ** len(y) + fading @ heard
        self._hits += float(inside.sum())
        self._scored += int(heard.sum())
        self._count(records)

    @property
    def nmse(self) -> Array:
        """Running mean square error over the running variance, (n_y,); NaN where silent."""
        mean, square, error, _ = self._running
        variance = square - mean**2
        heard = variance > (SILENT_RATIO * np.sqrt(np.nanmax(square, initial=0.0))) ** 2
        return np.where(heard, error / np.where(heard, variance, 1.0), np.nan)

    @property
    def nmse_mean(self) -> float:
        """The same over all channels that are not silent; NaN before there is one."""
        values = self.nmse
        return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")

    @property
    def coverage(self) -> float:
        """Running share of measurements in their predicted 95 % interval; NaN before any."""
        weight = self._weight.sum()
        return float(self._sums[3].sum() / weight) if weight else float("nan")

    @property
    def coverage_in_all(self) -> float:
        """The same over the whole stream."""
        return self._hits / self._scored if self._scored else float("nan")

    def duration(self, share: float) -> float:
        """Time that so large a share of the calls did not exceed [s], to 1.2 %; 1: the slowest."""
        if share >= 1.0 or not self.samples:
            return self._slowest if self.samples else float("nan")
        place = int(np.searchsorted(np.cumsum(self._bins), share * self.samples))
        return float(min(_BINS[place], self._slowest))

    @property
    def _running(self) -> Array:
        with np.errstate(invalid="ignore"):
            return self._sums / np.where(self._weight, self._weight, np.nan)

    def _count(self, records: Records) -> None:
        outcome, duration = records.outcome, records.duration
        self.samples += len(records)
        self.learned += int((outcome == Outcome.COMPLETED).sum())
        lost = (outcome == Outcome.NOT_FINITE) | (outcome == Outcome.COVARIANCE_LOST)
        self.failed += int(lost.sum())
        self._bins += np.bincount(np.searchsorted(_BINS[:-1], duration), minlength=len(_BINS))
        self._slowest = max(self._slowest, float(duration.max(initial=0.0)))
