"""Loop of a learner of a robot in flight: packets from a queue are learned as they come.

The loop takes whatever waits, sends it through the pipeline in one call, and now and then reports
progress and keeps the state. It ends when the source ends or somebody stops it. What could not be
taken in time is counted by the queue. Means of running scores are exponential, with a memory
counted in samples, so that what is shown is the present.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from patagium.arrays import Array
from patagium.errors import Outcome
from patagium.learning.scores import ErrorSums, IntervalSums
from patagium.live.pipeline import Pipeline, Records
from patagium.live.sources import PacketQueue

BLOCK = 512
"""Largest number of packets that go through the pipeline in one call."""
PATIENCE = 0.1
"""Longest wait for a packet before the loop looks at what else is due [s]."""
_SPAN = 0.1  # s: shortest time over which a rate is counted
_USUAL, _RECENT = 5, 50  # fewest and most steps whose median is the usual step
_JUMP = 10.0  # usual steps that one step counts at most, as in the learner
_BINS = np.concatenate([[0.0], np.geomspace(1e-7, 10.0, 1600)])  # s: steps of 1.2 %
_QUANTILES = {"p50": 0.5, "p99": 0.99, "p999": 0.999, "slowest": 1.0}


class Sink(Protocol):
    """Something that keeps packets and their records."""

    def append(self, packets: Array, records: Records) -> None:
        """Keep more packets and their records."""
        ...


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

    samples = learned = failed = 0
    _slowest = 0.0

    def __init__(self, outputs: int, memory: float) -> None:
        self._keep = 1.0 - 1.0 / memory
        self._errors, self._lately = ErrorSums(outputs), IntervalSums(outputs)
        self._all = IntervalSums(outputs)
        self._bins = np.zeros(len(_BINS), np.int64)

    def add(self, records: Records) -> None:
        """Count more samples, in order."""
        guess = records.prediction
        counted = np.isfinite(guess) & ~records.left_out
        y = np.where(counted, records.measurement, np.nan)
        self._errors.add(y, guess, keep=self._keep)
        self._lately.add(y - guess, records.std, self._keep)
        self._all.add(y - guess, records.std)
        outcome, duration = records.outcome, records.duration
        self.samples += len(records)
        self.learned += int((outcome == Outcome.COMPLETED).sum())
        lost = (outcome == Outcome.NOT_FINITE) | (outcome == Outcome.COVARIANCE_LOST)
        self.failed += int(lost.sum())
        self._bins += np.bincount(np.searchsorted(_BINS[:-1], duration), minlength=len(_BINS))
        self._slowest = max(self._slowest, float(duration.max(initial=0.0)))

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
        """Quantile of the durations of the calls [s]; its relative error is at most 1.2 %.

        Args:
            share: Probability of the quantile, 0 to 1; 1 gives the longest duration.
        """
        if share >= 1.0 or not self.samples:
            return self._slowest if self.samples else float("nan")
        place = int(np.searchsorted(np.cumsum(self._bins), share * self.samples))
        return float(min(_BINS[place], self._slowest))


@dataclass
class Status:
    """Progress of a stream.

    Attributes:
        counters: Running scores.
        elapsed: Wall-clock time since the first packet [s].
        flown: Time that the stamps of packets in order span [s]; jumps count as ten usual steps.
        busy: Time spent in calls [s].
        rate: Packets a second since the last status [1/s].
        gaps: Steps of the stamps longer than 1.5 usual ones: the median of the 50 up to it.
    """

    counters: Counters
    elapsed: float = 0.0
    flown: float = 0.0
    busy: float = 0.0
    rate: float = float("nan")
    gaps: int = 0
    _began: float | None = None
    _seen: float = 0.0
    _counted: int = 0
    _last_stamp: float = float("nan")
    _recent: Array = field(default_factory=lambda: np.full(_RECENT, np.nan))

    def start(self) -> None:
        """Begin to count, at the first packet."""
        if self._began is None:
            self._began = self._seen = time.monotonic()

    def count(self, packets: Array, records: Records) -> None:
        """Count packets, (N, columns) [units of the columns], that were learned."""
        self.counters.add(records)
        self.busy += float(records.duration.sum())
        self.elapsed = time.monotonic() - (self._began or 0.0)
        stamps = packets[~np.isin(records.outcome, (Outcome.LATE, Outcome.DUPLICATE)), 0]
        stamps = np.concatenate([[self._last_stamp], stamps[np.isfinite(stamps)]])
        steps = np.diff(stamps)
        ahead = steps[steps > 0]
        steps = np.concatenate([self._recent, ahead])
        self._recent = steps[-_RECENT:]
        lately = np.sort(sliding_window_view(steps, _RECENT)[1:], axis=1)  # NaN before the first
        rows, known = np.arange(len(ahead)), np.isfinite(lately).sum(axis=1)
        usual = (lately[rows, (known - 1) // 2] + lately[rows, known // 2]) / 2
        usual[known < _USUAL] = np.inf
        self.flown += float(np.minimum(ahead, _JUMP * usual).sum())
        self.gaps += int((ahead > 1.5 * usual).sum())
        self._last_stamp = float(stamps[-1])

    def update_rate(self, now: float) -> None:
        """Count the rate up to now [s], unless it was counted a moment ago."""
        if self._began is not None and now > self._seen + _SPAN:
            self.rate = (self.counters.samples - self._counted) / (now - self._seen)
            self._seen, self._counted = now, self.counters.samples

    @property
    def load(self) -> float:
        """Time in calls over the time flown; above 1 the learner cannot follow; NaN at first."""
        return self.busy / self.flown if self.flown > 0 else float("nan")


@dataclass(frozen=True)
class Rhythm:
    """Action repeated at a period.

    Attributes:
        period: Time between two calls [s].
        action: Function that is called.
    """

    period: float
    action: Callable[[], object]


def follow(
    queue: PacketQueue,
    pipeline: Pipeline,
    status: Status,
    stop: threading.Event,
    *,
    sinks: Sequence[Sink] = (),
    rhythms: tuple[Rhythm, ...] = (),
    most: int | None = None,
) -> None:
    """Learn packets as they come, until there are no more.

    Args:
        queue: Queue of the packets.
        pipeline: Pipeline that learns them.
        status: Progress, kept up to date.
        stop: Ends the loop, once what waits is learned or dropped.
        sinks: Each keeps packets and records.
        rhythms: Actions between two calls, each at its period.
        most: Packets to learn at most; None: all.

    Raises:
        LogError: If reading failed.
        FilterDiverged: If a covariance that was to be opened is lost.
    """
    due = [time.monotonic() + rhythm.period for rhythm in rhythms]
    while most is None or status.counters.samples < most:
        left = BLOCK if most is None else min(BLOCK, most - status.counters.samples)
        packets = queue.take(left, PATIENCE)
        if packets is None or (stop.is_set() and not len(packets)):
            break
        if len(packets):
            status.start()
            records = pipeline.run(packets)
            records.rows[:, -1] += 1e9 * queue.spent
            status.count(packets, records)
            for sink in sinks:
                sink.append(packets, records)
        now = time.monotonic()
        for number, rhythm in enumerate(rhythms):
            if now >= due[number]:
                status.update_rate(now)
                rhythm.action()
                due[number] = now + rhythm.period


def summary(status: Status, queue: PacketQueue, pipeline: Pipeline) -> dict[str, Any]:
    """Summary of a stream, as JSON values."""
    counters = status.counters
    names = pipeline.learner.network.output_names
    return {
        "samples": counters.samples,
        "learned": counters.learned,
        "failed": counters.failed,
        **queue.intake.counts,
        "gaps": status.gaps,
        "memory_resets": pipeline.memory_resets,
        "events": dict(pipeline.learner.events),
        "compiled": pipeline.compiled,
        "elapsed": status.elapsed,
        "flown": status.flown,
        "load": status.load,
        "nmse": dict(zip(names, counters.nmse.tolist(), strict=True)),
        "nmse_mean": counters.nmse_mean,
        "coverage": counters.coverage,
        "coverage_in_all": counters.coverage_in_all,
        "time_per_call": {name: counters.duration(share) for name, share in _QUANTILES.items()},
    }
