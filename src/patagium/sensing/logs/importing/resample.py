"""Resampling of quantities with stamps of their own on one time base.

Rows wait in temporary files between reading and resampling, so that memory stays small. The files
have no name: the system removes them when the program ends, however it ends. Numbers and vectors
are interpolated linearly, attitudes by slerp, angles the short way round. No sample is made within
a gap of a quantity. Neglected: aliasing; nothing is filtered before it is resampled.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from patagium.arguments import Progress
from patagium.arrays import Array, Bools
from patagium.errors import LogError
from patagium.sensing.logs.axes import continuous, slerp
from patagium.sensing.logs.files.channels import NO_STAMP, Block, Stamps
from patagium.sensing.logs.importing.findings import (
    SECOND,
    Finding,
    StampSurvey,
    StreamSurvey,
    survey_streams,
)
from patagium.sensing.logs.importing.plan import Plan, Quantity
from patagium.sensing.logs.importing.restamp import restamped


class Spool(AbstractContextManager["Spool"]):
    """Streams of a log on disk, each with the rows whose stamps advance, or restamped.

    Args:
        plan: Streams to read; their log is read once, from start to end.
        folder: Folder whose disk takes the rows, eight bytes a number.
        progress: Called now and then with the rows read and the rows in all.

    Attributes:
        plan: Streams that were read.
        surveys: Statistics of each stream, after it was restamped.
        findings: Findings about the streams that were restamped.
        angles: Last value of each angle that was resampled, by its name, from which it goes on.

    Raises:
        LogError: If the log is damaged, a column holds text, or a stream was not sampled at the
            rate that the mapping states.
        OSError: If the disk does not take the rows.
    """

    def __init__(self, plan: Plan, folder: Path, progress: Progress | None = None) -> None:
        self.plan = plan
        self.findings: list[Finding] = []
        self.angles: dict[str, float] = {}
        with ExitStack() as stack:
            self._stamps, self._values = (
                [stack.enter_context(TemporaryFile(dir=folder)) for _ in plan.wanted]
                for _ in ("stamps", "values")
            )
            self.surveys = tuple(StreamSurvey(len(one.fields)) for one in plan.wanted)
            self._latest = [NO_STAMP for _ in plan.wanted]
            survey_streams(
                plan.log, plan.wanted, sum(plan.counts), surveys=self.surveys, keep=self._keep,
                progress=progress,
            )  # fmt: skip
            for file in (*self._stamps, *self._values):
                file.flush()
            for stream in range(len(plan.wanted)):
                self._restamp(stream)
            self._files = stack.pop_all()

    def __exit__(self, *_: object) -> None:
        self._files.close()

    def stamps_of(self, stream: int) -> Stamps:
        """Stamps of a stream, increasing, (N,) [ns], as a map of its file."""
        return np.memmap(self._stamps[stream], np.int64, "r")

    def values_of(self, item: Quantity, begin: int, end: int) -> Array:
        """Components of a quantity in some rows, (end - begin, size) in the unit of the log."""
        columns, file = len(self.plan.wanted[item.stream].fields), self._values[item.stream]
        file.seek(begin * columns * 8)
        content = np.fromfile(file, float, (end - begin) * columns)
        return content.reshape(-1, columns)[:, item.places]

    def blocks_of(self, item: Quantity) -> Iterator[Array]:
        """Components of a quantity, some rows at a time, (k, size) in the unit of the log."""
        count = self.surveys[item.stream].stamps.kept
        for begin in range(0, count, CHUNK):
            yield self.values_of(item, begin, min(begin + CHUNK, count))

    def _keep(self, block: Block, advances: Bools) -> Array:
        """Rows of a block that are kept, which go to the files."""
        stream, stamps, values = block.key, block.stamps, block.values
        if self.plan.rates[stream] is not None:
            advances = np.ones(len(stamps), np.bool_)
        kept = values[advances]
        if self.plan.mapping.time.duplicates == "keep-last" and len(stamps):
            latest = np.maximum(np.maximum.accumulate(stamps), self._latest[stream])
            group = np.cumsum(advances) - 1
            same = (stamps == latest) & (stamps != NO_STAMP)
            inside = same & (group >= 0)
            kept[group[inside]] = values[inside]  # of equal indices, the last one counts
            before = np.flatnonzero(same & (group < 0))
            if len(before):
                file = self._values[stream]
                file.seek(-8 * values.shape[1], 2)
                file.write(values[before[-1]].tobytes())
            self._latest[stream] = int(latest[-1])
        self._stamps[stream].write(stamps[advances].tobytes())
        self._values[stream].write(kept.tobytes())
        return kept

    def _restamp(self, stream: int) -> None:
        plan, rate, name = self.plan, self.plan.rates[stream], self.plan.names[stream]
        survey = self.surveys[stream]
        if rate is None or survey.stamps.rows < 2:
            return
        counted = plan.wanted[stream].base.kind == "rows"
        held = np.memmap(self._stamps[stream], np.int64, "r+")
        stamps = np.full(len(held), NO_STAMP) if counted else np.array(held)
        held[:], text = restamped(stamps, rate, plan.mapping.gap, f"{plan.log.path}: {name}")
        held.flush()
        self.findings.append(Finding("note", name, "restamped", text))
        survey.stamps = StampSurvey()
        survey.stamps.add(np.array(held))


_OWN_RATE = 0.01  # relative difference of rates below which a stream has that of the time base
CHUNK = 1 << 16
_MARGIN = 64
"""Rows read beyond both ends of a chunk, in case rows at the ends are no numbers."""


@dataclass(frozen=True)
class TimeBase:
    """Stamps at which all quantities are resampled.

    Attributes:
        origin: First stamp [ns].
        count: Number of stamps.
        step: Time between stamps, or its median [s].
        stream: Stream whose stamps are taken; None if stamps are evenly spaced.
        first: Row of that stream with the first stamp.
    """

    origin: int
    count: int
    step: float
    stream: int | None
    first: int

    def describe(self, plan: Plan) -> str:
        """Time base in words."""
        if self.stream is None:
            return f"{self.count} samples {self.step:.6g} s apart"
        return f"{self.count} stamps of {plan.names[self.stream]}, {self.step:.4g} s apart (median)"


def time_base(spool: Spool) -> TimeBase:
    """Common time base over the span in which all streams have samples.

    Raises:
        LogError: If the streams do not overlap in time, or the mapping names no time base where
            there are several streams.
    """
    plan, time, source = spool.plan, spool.plan.mapping.time, spool.plan.source
    used = sorted({item.stream for item in plan.items})
    begins = [spool.surveys[k].stamps.first or 0 for k in used]
    ends = [spool.surveys[k].stamps.last for k in used]
    begin, end = max(begins), min(ends)
    if end <= begin:
        described = "; ".join(
            f"{plan.names[k]} from {(b - min(begins)) / SECOND:.6g} s to "
            f"{(e - min(begins)) / SECOND:.6g} s"
            for k, b, e in zip(used, begins, ends, strict=True)
        )
        raise LogError(source, "streams that overlap in time", described)
    if time.end is not None:
        end = min(end, begin + round(time.end * SECOND))
    begin += round((time.start or 0.0) * SECOND)
    stream = _stream(spool, used)
    if stream is None:
        rate = float(time.rate or 0.0)
        alike = [k for k in used if abs(rate * spool.surveys[k].stamps.median - 1) < _OWN_RATE]
        if alike:  # between samples of that rate, interpolation would smooth their noise
            stamps = spool.stamps_of(max(alike, key=lambda k: begins[used.index(k)]))
            place = int(np.searchsorted(stamps, begin - _OWN_RATE / rate * SECOND))
            begin = int(stamps[min(place, len(stamps) - 1)])
        count = int((end - begin) / SECOND * rate * (1 + 1e-12)) + 1 if end > begin else 0
        first, step = 0, 1.0 / rate
    else:
        stamps, step = spool.stamps_of(stream), spool.surveys[stream].stamps.median
        first, last = np.searchsorted(stamps, [begin, end + 1]).tolist()
        count = last - first
    if count < 2:
        found = f"{max(0, count)} in {max(0.0, (end - begin) / SECOND):.6g} s"
        raise LogError(source, "at least two samples on the time base", found)
    origin = begin if stream is None else int(stamps[first])
    return TimeBase(origin, count, step, stream, first)


def stamps_in(spool: Spool, base: TimeBase, begin: int, end: int) -> Stamps:
    """Stamps `begin` to `end` of a time base, (end - begin,) [ns]."""
    if base.stream is not None:
        return np.array(spool.stamps_of(base.stream)[base.first + begin : base.first + end])
    offsets: Stamps = np.rint(np.arange(begin, end) * (base.step * SECOND)).astype(np.int64)
    return offsets + base.origin


def after_gaps(spool: Spool, base: TimeBase, begin: int) -> int:
    """First sample of a time base, from `begin` on, in no gap of a stream that it needs."""
    step, items = base.step * SECOND, spool.plan.items
    needed = {item.stream for item in items if item.needed}
    former = -1
    while base.stream is None and former < begin < base.count:
        former = begin
        stamp = stamps_in(spool, base, begin, begin + 1)[0]
        for stream in needed or {item.stream for item in items}:
            known = spool.stamps_of(stream)
            longest = spool.plan.mapping.gap * spool.surveys[stream].stamps.median * SECOND
            right = int(np.searchsorted(known, stamp))
            if not 0 < right < len(known) or known[right] == stamp:
                continue
            if known[right] - known[right - 1] > longest:
                end = int(known[right]) - base.origin
                begin = max(begin, ceil((end - 0.5) / step))
    return begin


@np.errstate(all="ignore")  # numbers of a damaged log may be of any size
def resampled(spool: Spool, item: Quantity, stamps: Stamps) -> tuple[Array, Bools]:
    """Quantity at given increasing stamps, (k,) [ns].

    Returns:
        Values in the unit of the item, (k, 1), (k, 3) or (k, 4), and whether each is valid, (k,).
    """
    known = spool.stamps_of(item.stream)
    begin = max(0, int(np.searchsorted(known, stamps[0], "right")) - 1 - _MARGIN)
    end = min(len(known), int(np.searchsorted(known, stamps[-1], "left")) + 1 + _MARGIN)
    values = item.converted(spool.values_of(item, begin, end))
    finite = np.isfinite(values).all(axis=1)
    own, values = np.array(known[begin:end])[finite], values[finite]
    width = len(item.column.labels)
    if not len(own):
        return np.full((len(stamps), width), np.nan), np.zeros(len(stamps), bool)
    left = np.searchsorted(own, stamps, "right") - 1
    right = np.minimum(left + 1, len(own) - 1)
    exact = (left >= 0) & (own[left] == stamps)
    median = spool.surveys[item.stream].stamps.median
    near = own[right] - own[left] <= spool.plan.mapping.gap * median * SECOND
    valid = exact | ((left >= 0) & (right > left) & near)
    valid &= ~np.isin(stamps, np.array(known[begin:end])[~finite])
    seconds, wanted = ((one - own[0]) / SECOND for one in (own, stamps))
    found = _between(spool, item, seconds, values, np.clip(wanted, 0.0, seconds[-1]))
    return found, valid & np.isfinite(found).all(axis=1)


def _between(spool: Spool, item: Quantity, seconds: Array, values: Array, wanted: Array) -> Array:
    if item.is_attitude:
        return slerp(seconds, continuous(values), wanted)
    if item.turn:  # whole turns are taken off, also of blocks
        turn, name = item.turn * item.factor, item.label
        mixed = np.interp(wanted, seconds, np.unwrap(values[:, 0], period=turn))
        wraps = np.abs(np.diff(values[:, 0])).max(initial=0.0) > 0.5 * turn
        before = spool.angles.get(name, 0.0 if wraps else mixed[0])
        mixed += turn * np.rint((before - mixed[0]) / turn)
        spool.angles[name] = mixed[-1]
        return np.asarray(mixed)[:, None]
    return np.column_stack([np.interp(wanted, seconds, column) for column in values.T])


def _stream(spool: Spool, used: list[int]) -> int | None:
    plan, time = spool.plan, spool.plan.mapping.time
    if time.rate is not None:
        return None
    if time.like is not None:
        like = time.like.removesuffix("/0")
        return next((k for k, one in enumerate(plan.wanted) if one.topic == like), None)
    if all(np.array_equal(spool.stamps_of(k), spool.stamps_of(used[0])) for k in used[1:]):
        return used[0]
    rates = ", ".join(f"{plan.names[k]} {1 / spool.surveys[k].stamps.median:.4g} Hz" for k in used)
    raise LogError(
        f"{plan.source}: time: expected rate (such as 200 Hz) or like (a topic) for streams with "
        f"stamps of their own: {rates}"
    )
