"""Statistics of the stamps and numbers of a log, from one pass, block by block in little memory.

Time steps are counted in bins of 0.5 %, so their median is right to that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from patagium.sensing.logs.files.channels import NO_STAMP, Array, LogFile, Request, Stamps

Progress = Callable[[int, int], None]
Keep = Callable[[int, Stamps, Array], None]

_WIDTH = 0.005
_BINS = 7600  # to 3e16 ns, a year
_NEAR = 0.1
"""Share of the median step below which a step is nearly a duplicate."""
SECOND = 1_000_000_000
"""One second [ns]."""


class StampSurvey:
    """Statistics of the stamps of one stream in the order of the file.

    Attributes:
        rows: Number of rows.
        kept: Rows whose stamp is later than all before.
        missing: Rows without a usable stamp.
        duplicates: Rows that repeat the latest stamp.
        backwards: Rows stamped before the latest stamp.
        furthest_back: Longest step back [ns].
        first: First stamp [ns]; None before there is one.
        last: Latest stamp [ns].
        longest: Longest step forward [ns].
        longest_at: Stamp before the longest step [ns].
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
        """Add more stamps to the statistics.

        Args:
            stamps: Stamps, (k,) [ns].

        Returns:
            Whether each stamp is later than all before it, (k,).
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
        """Median step, as the mean of its bin [s]; NaN with less than two stamps."""
        total = int(self._bins.sum())
        if not total:
            return float("nan")
        place = int(np.searchsorted(np.cumsum(self._bins), (total + 1) // 2))
        return float(self._sums[place] / self._bins[place]) / SECOND

    def gaps(self, factor: float) -> int:
        """Number of steps that are longer than `factor` medians."""
        median = self.median
        if not np.isfinite(median):
            return 0
        limit = factor * median * SECOND
        count = int(self._bins[int(np.ceil(np.log(limit) / _WIDTH)) :].sum())
        return max(count, int(self.longest > limit))

    @property
    def near_duplicates(self) -> int:
        """Number of steps that are shorter than a tenth of the median."""
        median = self.median
        if not np.isfinite(median):
            return 0
        return int(self._bins[: max(0, int(np.log(_NEAR * median * SECOND) / _WIDTH))].sum())

    @property
    def duration(self) -> float:
        """Time from the first to the latest stamp [s]."""
        return 0.0 if self.first is None else (self.last - self.first) / SECOND


class ValueSurvey:
    """Statistics of the numbers of one stream, channel by channel.

    Args:
        channels: Number of channels n.

    Attributes:
        count: Number of finite entries of each channel, (n,) [-].
        missing: Number of other entries of each channel, (n,) [-].
        low: Lowest number, (n,), in the unit of the file.
        high: Highest number, (n,), in the unit of the file.
    """

    def __init__(self, channels: int) -> None:
        self.count = np.zeros(channels, np.int64)
        self.missing = np.zeros(channels, np.int64)
        self.low, self.high = np.full(channels, np.inf), np.full(channels, -np.inf)
        self._sum, self._square = np.zeros(channels), np.zeros(channels)

    def add(self, values: Array) -> None:
        """Add more rows, (k, n) in the unit of the file, to the statistics."""
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

    @property
    def mean(self) -> Array:
        """Mean of each channel, (n,); NaN where nothing is finite."""
        return np.asarray(self._sum / np.where(self.count, self.count, np.nan))

    @property
    def rms(self) -> Array:
        """Root mean square of each channel, (n,); NaN where nothing is finite."""
        return np.asarray(np.sqrt(self._square / np.where(self.count, self.count, np.nan)))


@dataclass(frozen=True)
class StreamSurvey:
    """Statistics of one stream.

    Attributes:
        stamps: Statistics of its stamps.
        values: Statistics of its numbers.
    """

    stamps: StampSurvey
    values: ValueSurvey


def survey_streams(
    log: LogFile,
    wanted: tuple[Request, ...],
    total: int,
    *,
    keep: Keep | None = None,
    progress: Progress | None = None,
) -> tuple[StreamSurvey, ...]:
    """Statistics of the requested streams from one pass through a log.

    Args:
        log: The open log.
        wanted: Requests, one a stream.
        total: Number of rows of all streams, or an estimate, for `progress`.
        keep: Called with the place of the stream, stamps (k,) [ns] and values (k, n) of the rows
            whose stamps advance; statistics of the values are then of these rows alone.
        progress: Called now and then with the rows read and the rows in all.

    Raises:
        LogError: If the log is damaged, or a column holds text.
    """
    streams = tuple(StreamSurvey(StampSurvey(), ValueSurvey(len(one.fields))) for one in wanted)
    done = 0
    for block in log.blocks(wanted):
        advances = streams[block.key].stamps.add(block.stamps)
        values = block.values
        if keep is not None:
            values = values[advances]
            keep(block.key, block.stamps[advances], values)
        streams[block.key].values.add(values)
        done += len(block.stamps)
        if progress is not None:
            progress(done, max(total, done))
    return streams
