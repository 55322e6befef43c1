"""What stamps and numbers of a log look like, counted block by block in little memory.

Steps of time are counted in bins of 0.5 %, so medians are right to that. Neglected: which
samples carry what; only counts, extremes and moments are kept.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.sensing.logs.files.channels import NO_STAMP, Array, Stamps

_WIDTH = 0.005
_BINS = 7600  # to 3e16 ns, a year
_NEAR = 0.1
"""A step shorter than this share of the median is nearly a duplicate."""
SECOND = 1_000_000_000
"""[ns]"""


class StampSurvey:
    """Stamps of one stream in the order of the file.

    Attributes:
        rows: Stamps seen.
        kept: Those that came after all before them.
        missing: Those that were no number.
        duplicates: Those that repeated the last.
        backwards: Those before the last.
        furthest_back: The longest step back [ns].
        first: The first stamp [ns]; None before there is one.
        last: The latest [ns].
        longest: The longest step forward [ns].
        longest_at: Stamp before it [ns].
    """

    def __init__(self) -> None:
        self.rows, self.kept, self.missing = 0, 0, 0
        self.duplicates, self.backwards, self.furthest_back = 0, 0, 0
        self.first: int | None = None
        self.last = NO_STAMP
        self.longest, self.longest_at = 0, 0
        self._bins = np.zeros(_BINS, np.int64)
        self._sums = np.zeros(_BINS)

    def add(self, stamps: Stamps) -> NDArray[np.bool_]:
        """Count more stamps.

        Args:
            stamps: (k,) [ns].

        Returns:
            Which of them come after all before, (k,).
        """
        self.rows += len(stamps)
        known = stamps != NO_STAMP
        self.missing += int((~known).sum())
        latest = np.maximum.accumulate(np.concatenate([[self.last], stamps]))
        advances = known & (stamps > latest[:-1])
        behind = latest[:-1][known] - stamps[known]
        if self.first is not None or (known.any() and len(behind)):
            started = latest[:-1][known] != NO_STAMP
            self.duplicates += int((behind[started] == 0).sum())
            back = behind[started][behind[started] > 0]
            self.backwards += len(back)
            self.furthest_back = max(self.furthest_back, int(back.max(initial=0)))
        self._count(stamps[advances])
        return np.asarray(advances, np.bool_)

    def _count(self, kept: Stamps) -> None:
        if not len(kept):
            return
        if self.first is None:
            self.first, steps, before = int(kept[0]), np.diff(kept), kept[:-1]
        else:
            before = np.concatenate([[self.last], kept[:-1]])
            steps = kept - before
        self.kept += len(kept)
        self.last = int(kept[-1])
        if not len(steps):
            return
        place = int(steps.argmax())
        if steps[place] > self.longest:
            self.longest, self.longest_at = int(steps[place]), int(before[place])
        bins = np.minimum((np.log(steps) / _WIDTH).astype(np.int64), _BINS - 1)
        self._bins += np.bincount(bins, minlength=_BINS)
        self._sums += np.bincount(bins, steps.astype(float), minlength=_BINS)

    @property
    def median(self) -> float:
        """Median step [s]: the mean of its bin; NaN with less than two stamps."""
        total = int(self._bins.sum())
        if not total:
            return float("nan")
        place = int(np.searchsorted(np.cumsum(self._bins), (total + 1) // 2))
        return float(self._sums[place] / self._bins[place]) / SECOND

    def gaps(self, factor: float) -> int:
        """How many steps are longer than so many medians."""
        median = self.median
        if not np.isfinite(median):
            return 0
        limit = factor * median * SECOND
        count = int(self._bins[int(np.ceil(np.log(limit) / _WIDTH)) :].sum())
        return max(count, int(self.longest > limit))

    @property
    def near_duplicates(self) -> int:
        """How many steps are shorter than a tenth of the median."""
        median = self.median
        if not np.isfinite(median):
            return 0
        return int(self._bins[: max(0, int(np.log(_NEAR * median * SECOND) / _WIDTH))].sum())

    @property
    def duration(self) -> float:
        """From first to latest stamp [s]."""
        return 0.0 if self.first is None else (self.last - self.first) / SECOND

    def state(self) -> dict[str, Any]:
        """All counts, JSON-able."""
        held = {key: value for key, value in vars(self).items() if not key.startswith("_")}
        heard = np.flatnonzero(self._bins)
        bins = [heard.tolist(), self._bins[heard].tolist(), self._sums[heard].tolist()]
        return {**held, "bins": bins}

    def resume(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        places, counts, sums = state["bins"]
        self._bins[:], self._sums[:] = 0, 0.0
        self._bins[places], self._sums[places] = counts, sums
        for key, value in state.items():
            if key != "bins":
                setattr(self, key, value)


class ValueSurvey:
    """Numbers of one stream, channel by channel.

    Args:
        channels: How many.

    Attributes:
        count: Finite numbers of each channel, (n,).
        missing: Others, (n,).
        low: Lowest, (n,).
        high: Highest, (n,).
        largest_step: Largest change from row to row, (n,).
    """

    def __init__(self, channels: int) -> None:
        self.count = np.zeros(channels, np.int64)
        self.missing = np.zeros(channels, np.int64)
        self.low, self.high = np.full(channels, np.inf), np.full(channels, -np.inf)
        self.largest_step = np.zeros(channels)
        self._sum, self._square = np.zeros(channels), np.zeros(channels)
        self._last = np.full(channels, np.nan)

    def add(self, values: Array) -> None:
        """Count more rows, (k, n)."""
        if not len(values) or not values.shape[1]:
            return
        finite = np.isfinite(values)
        plain = np.where(finite, values, 0.0)
        self.count += finite.sum(axis=0)
        self.missing += (~finite).sum(axis=0)
        self.low = np.minimum(self.low, np.where(finite, values, np.inf).min(axis=0))
        self.high = np.maximum(self.high, np.where(finite, values, -np.inf).max(axis=0))
        with np.errstate(over="ignore", invalid="ignore"):
            self._sum += plain.sum(axis=0)
            self._square += (plain**2).sum(axis=0)
            steps = np.abs(np.diff(np.vstack([self._last, values]), axis=0))
        steps = np.where(np.isfinite(steps), steps, 0.0)
        self.largest_step = np.maximum(self.largest_step, steps.max(axis=0))
        self._last = values[-1].copy()

    @property
    def mean(self) -> Array:
        """Of each channel, (n,); NaN where nothing is finite."""
        return np.asarray(self._sum / np.where(self.count, self.count, np.nan))

    @property
    def rms(self) -> Array:
        """Root of the mean square of each channel, (n,); NaN where nothing is finite."""
        return np.asarray(np.sqrt(self._square / np.where(self.count, self.count, np.nan)))

    def state(self) -> dict[str, Any]:
        """All counts, JSON-able."""
        return {key: value.tolist() for key, value in vars(self).items()}

    def resume(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        for key, value in state.items():
            setattr(self, key, np.array(value, getattr(self, key).dtype))
