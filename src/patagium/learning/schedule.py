"""Schedule of a prequential run: used samples, hold intervals and horizons.

Sample k is predicted before it is used, by weights that saw earlier samples only. With
one sample in `every` used, the weights hold for the `every` samples that follow, and all of
them count. A gap in time ends a hold interval, and no horizon reaches across one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ParameterError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_AHEAD = 40_000
"""A horizon is scored over windows of about this many samples in all, spread evenly."""
MOST_CHECKS = 500
"""The predicted interval is checked in at most this many hold intervals, spread evenly."""


class Hold(NamedTuple):
    """Interval of samples `begin` to `end - 1`, predicted by the same weights.

    Attributes:
        begin: First sample.
        end: One past the last sample.
        learns: Whether the last sample is then used for an update.
    """

    begin: int
    end: int
    learns: bool


def used_samples(count: int, every: int, gaps: ArrayLike = ()) -> Indices:
    """Samples that are used for an update: one in `every`, counted anew after each gap.

    Args:
        count: Number of samples N.
        every: 1 for each sample, 100 for one in 100.
        gaps: First sample after each gap.

    Raises:
        ParameterError: If `every` is below one.
    """
    if every < 1:
        raise ParameterError("every", "a whole number of at least 1", every)
    starts = [0, *np.asarray(gaps, int).tolist(), count]
    spans = [np.arange(a, b, every) for a, b in zip(starts[:-1], starts[1:], strict=True)]
    return np.concatenate(spans).astype(np.int64)


def holds(used: Indices, count: int) -> Iterator[Hold]:
    """Hold intervals in order; together they hold each sample once.

    Args:
        used: Samples used for an update, increasing.
        count: Number of samples N.
    """
    begin = 0
    for index in used.tolist():
        yield Hold(begin, index + 1, learns=True)
        begin = index + 1
    if begin < count:
        yield Hold(begin, count, learns=False)


@dataclass(frozen=True)
class Horizon:
    """Horizon: a span predicted with frozen weights.

    Attributes:
        label: Its name in the scores.
        duration: Asked for [s].
        length: Number of samples.
        begins: First sample of each window.
    """

    label: str
    duration: float
    length: int
    begins: Indices


def plan_horizons(
    durations: Mapping[str, float], time: NDArray[np.float64], used: Indices, gaps: Indices
) -> tuple[Horizon, ...]:
    """Windows that begin right after an update, do not cross a gap, and fit in the log.

    Args:
        durations: Label and length of each horizon [s].
        time: (N,) [s].
        used: Samples used for an update.
        gaps: First sample after each gap.

    Raises:
        ParameterError: If a duration is not positive.
    """
    step = float(np.median(np.diff(time)))
    planned = []
    for label, duration in durations.items():
        if not duration > 0:
            raise ParameterError(f"horizon {label!r}", "a positive time [s]", duration)
        length = max(1, round(duration / step))
        begins = used + 1
        begins = begins[begins + length <= len(time)]
        inside = np.searchsorted(gaps, begins + length) - np.searchsorted(gaps, begins)
        begins = begins[inside == 0]
        planned.append(Horizon(label, duration, length, thin(begins, max(2, MOST_AHEAD // length))))
    return tuple(planned)


def check_samples(intervals: list[Hold]) -> list[tuple[int, ...]]:
    """Samples at which the predicted interval is checked, for each hold interval.

    Its last sample (farthest from the last update), and one inside it that wanders
    from interval to interval, so that every distance to the update is seen.

    Args:
        intervals: The hold intervals in order.
    """
    chosen = set(thin(np.arange(len(intervals)), MOST_CHECKS).tolist())
    golden = 0.6180339887498949
    checks: list[tuple[int, ...]] = []
    for number, hold in enumerate(intervals):
        if number not in chosen:
            checks.append(())
            continue
        inside = hold.begin + int((number * golden) % 1.0 * (hold.end - hold.begin))
        checks.append(tuple(sorted({inside, hold.end - 1})))
    return checks


def thin(indices: Indices, most: int) -> Indices:
    """Indices thinned evenly to at most `most`; the first and the last are kept."""
    if len(indices) <= most:
        return indices
    return np.asarray(indices[np.linspace(0, len(indices) - 1, most).round().astype(int)])


class LogSamples(NamedTuple):
    """Measured inputs of a log, and which of its samples are used.

    Attributes:
        time: Increasing, (N,) [s].
        x: Measured inputs of the network, (N, n_measured) [units of x].
        gaps: First sample after each gap.
        used: Samples used, increasing, (U,).
    """

    time: Array
    x: Array
    gaps: Indices
    used: Indices

    def part(self, begin: int, end: int) -> LogSamples:
        """Part of the log from one used sample to another.

        Args:
            begin: First used sample, by its number among them.
            end: One past the last.
        """
        used = self.used[begin:end]
        first, last = int(used[0]), int(used[-1]) + 1
        gaps = self.gaps[(self.gaps > first) & (self.gaps < last)]
        return LogSamples(self.time[first:last], self.x[first:last], gaps - first, used - first)
