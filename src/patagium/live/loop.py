"""A learner beside a robot in flight: packets from a queue, learned as they come, told and kept.

The loop takes whatever waits, sends it through the pipeline in one call, and now and then says
how it goes and keeps the state. It ends when the source ends or somebody stops it. Neglected:
what else the machine does; what it could not take in time is counted by the queue.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from patagium.live.pipeline import Pipeline, Records
from patagium.live.sources import PacketQueue
from patagium.live.tally import Tally

Array = NDArray[np.float64]

BLOCK = 512
"""Packets that go through the pipeline in one call at most."""
PATIENCE = 0.1
"""How long nothing may come before the loop looks around [s]."""
_SPAN = 0.1  # s that a rate is counted over at least
_USUAL = 5  # steps that show what is usual
_QUANTILES = {"p50": 0.5, "p99": 0.99, "p999": 0.999, "slowest": 1.0}


class Sink(Protocol):
    """Something that keeps packets and their records."""

    def append(self, packets: Array, records: Records) -> None:
        """Keep more of them."""
        ...


@dataclass
class Status:
    """How a stream goes.

    Attributes:
        tally: Running scores.
        elapsed: Wall-clock time since the first packet [s].
        flown: Time that the packets' stamps span [s].
        busy: Time spent in calls [s].
        rate: Packets a second since the last status [1/s].
        gaps: Steps of the stamps that are longer than 1.5 usual ones (the median of a call).
    """

    tally: Tally
    elapsed: float = 0.0
    flown: float = 0.0
    busy: float = 0.0
    rate: float = float("nan")
    gaps: int = 0

    @property
    def load(self) -> float:
        """Time in calls over the time flown: above 1, the learner cannot follow; NaN at first."""
        return self.busy / self.flown if self.flown > 0 else float("nan")


@dataclass(frozen=True)
class Rhythm:
    """Something done again and again.

    Attributes:
        period: Between two times [s].
        action: What.
    """

    period: float
    action: Callable[[], object]


def follow(
    queue: PacketQueue,
    pipeline: Pipeline,
    status: Status,
    stop: threading.Event,
    *,
    sink: Sink | None = None,
    rhythms: tuple[Rhythm, ...] = (),
    most: int | None = None,
) -> None:
    """Learn packets as they come, until there are no more.

    Args:
        queue: Where they wait.
        pipeline: What they go through.
        status: Kept up to date.
        stop: Ends it, once what waits is learned or dropped.
        sink: Keeps packets and records.
        rhythms: What else is done, each at its period, between two calls.
        most: Packets to learn at most; None: all.

    Raises:
        LogError: If reading failed.
        FilterDiverged: If a covariance that was to be opened is lost.
    """
    due = [time.monotonic() + rhythm.period for rhythm in rhythms]
    clock = _Clock(status)
    while most is None or status.tally.samples < most:
        left = BLOCK if most is None else min(BLOCK, most - status.tally.samples)
        packets = queue.take(left, PATIENCE)
        if packets is None or (stop.is_set() and not len(packets)):
            break
        if len(packets):
            clock.start()
            records = pipeline.run(packets)
            clock.passed(packets, records)
            if sink is not None:
                sink.append(packets, records)
        now = time.monotonic()
        for number, rhythm in enumerate(rhythms):
            if now >= due[number]:
                clock.look(now)
                rhythm.action()
                due[number] = now + rhythm.period


def summary(status: Status, queue: PacketQueue, pipeline: Pipeline) -> dict[str, Any]:
    """A stream in numbers, as JSON-able values.

    Args:
        status: How it went.
        queue: What it read from.
        pipeline: What it went through.
    """
    tally = status.tally
    names = pipeline.learner.network.output_names
    return {
        "samples": tally.samples,
        "learned": tally.learned,
        "failed": tally.failed,
        **queue.intake.counts,
        "gaps": status.gaps,
        "memory_resets": pipeline.memory_resets,
        "events": dict(pipeline.learner.events),
        "compiled": pipeline.compiled,
        "elapsed": status.elapsed,
        "flown": status.flown,
        "load": status.load,
        "nmse": dict(zip(names, tally.nmse.tolist(), strict=True)),
        "nmse_mean": tally.nmse_mean,
        "coverage": tally.coverage,
        "coverage_in_all": tally.coverage_in_all,
        "time_per_call": {name: tally.duration(share) for name, share in _QUANTILES.items()},
    }


class _Clock:
    """Times of a stream."""

    def __init__(self, status: Status) -> None:
        self._status = status
        self._began: float | None = None
        self._seen, self._counted = 0.0, 0
        self._last_stamp, self._usual = float("nan"), float("inf")

    def start(self) -> None:
        if self._began is None:
            self._began = self._seen = time.monotonic()

    def passed(self, packets: Array, records: Records) -> None:
        status = self._status
        status.tally.add(records)
        status.busy += float(records.duration.sum())
        status.elapsed = time.monotonic() - (self._began or 0.0)
        steps = np.diff(packets[:, 0], prepend=self._last_stamp)
        ahead = steps[steps > 0]
        status.flown += float(ahead.sum())
        if len(ahead) >= _USUAL:
            self._usual = float(np.median(ahead))
        status.gaps += int((ahead > 1.5 * self._usual).sum())
        self._last_stamp = float(packets[-1, 0])

    def look(self, now: float) -> None:
        status = self._status
        if self._began is None or now <= self._seen + _SPAN:
            return
        status.rate = (status.tally.samples - self._counted) / (now - self._seen)
        self._seen, self._counted = now, status.tally.samples
