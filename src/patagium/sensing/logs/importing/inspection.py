"""`inspect_log`: what a log holds, as one pass through it tells, without a mapping.

Units are those that the file or the definitions of its messages state; where there is none, only
stamps and missing numbers are judged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import LogFile, Topic, Wanted
from patagium.sensing.logs.files.opening import open_log
from patagium.sensing.logs.importing.findings import (
    Finding,
    Sizes,
    stamp_findings,
    unit_findings,
    value_findings,
)
from patagium.sensing.logs.importing.spool import Progress
from patagium.sensing.logs.importing.survey import SECOND, StampSurvey, ValueSurvey
from patagium.sensing.logs.mapping import conversion

GAP = 3.0
"""A step longer than this many medians is a gap."""
_VECTOR = (".x", "[0]", "_x")


@dataclass(frozen=True)
class ChannelFacts:
    """A number of a topic.

    Attributes:
        name: Its path, as a mapping names it.
        dtype: Its type in the file.
        unit: Its unit, where the file or its definitions state one.
        low: Lowest; NaN if none is finite.
        high: Highest.
        mean: Mean.
        rms: Root of the mean square.
        missing: How many are no finite numbers.
    """

    name: str
    dtype: str
    unit: str
    low: float
    high: float
    mean: float
    rms: float
    missing: int


@dataclass(frozen=True)
class TopicFacts:
    """What is stamped together.

    Attributes:
        name: Its name; empty for a table.
        kind: Type of its messages.
        rows: How many.
        stamps: Where its stamps come from.
        begin: First stamp after that of the log [s].
        duration: From first to last stamp [s].
        rate: Rows a second, by the median step [Hz].
        gaps: Steps longer than 3 medians.
        longest: Longest step [s].
        duplicates: Stamps that repeat the one before.
        near_duplicates: Steps shorter than a tenth of the median.
        backwards: Stamps before an earlier one.
        channels: Its numbers.
        problem: Why it cannot be read; empty if it can.
    """

    name: str
    kind: str
    rows: int
    stamps: str
    begin: float
    duration: float
    rate: float
    gaps: int
    longest: float
    duplicates: int
    near_duplicates: int
    backwards: int
    channels: tuple[ChannelFacts, ...]
    problem: str = ""


@dataclass(frozen=True)
class Inspection:
    """What a log holds.

    Attributes:
        path: The log.
        format: What it is.
        topics: What it holds.
        findings: What is suspicious.
        notes: What had to be assumed to read it.
    """

    path: str
    format: str
    topics: tuple[TopicFacts, ...]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]

    def plain(self) -> dict[str, Any]:
        """As a dict for JSON."""
        return asdict(self)


def inspect_log(
    paths: str | Path | Sequence[str | Path], *, progress: Progress | None = None
) -> Inspection:
    """What is in a log: topics, rates, gaps, ranges, and what is suspicious.

    Args:
        paths: A log file of any format that `import_log` reads, or the parts of a recording.
        progress: Called now and then with rows read and rows in all.

    Raises:
        LogError: If it cannot be read.
    """
    log = open_log(paths)
    try:
        readable = [topic for topic in log.topics.values() if not topic.problem]
        wanted = tuple(_wanted(topic) for topic in readable)
        stamps = [StampSurvey() for _ in wanted]
        values = [ValueSurvey(len(one.fields)) for one in wanted]
        total = sum(topic.count or topic.about for topic in readable)
        done = 0
        for block in log.blocks(wanted, (0,) * len(wanted)):
            stamps[block.key].add(block.stamps)
            values[block.key].add(block.values)
            done += len(block.stamps)
            if progress is not None:
                progress(done, max(total, done))
        starts = [one.first for one in stamps if one.first is not None]
        origin = min(starts, default=0)
        facts, found = [], []
        for topic, one, counted in zip(readable, stamps, values, strict=True):
            facts.append(_topic_facts(topic, one, counted, origin))
            found += _findings(topic, one, counted)
        facts += [_unreadable(topic) for topic in log.topics.values() if topic.problem]
        found += [
            Finding("warning", topic.name, "unreadable", topic.problem)
            for topic in log.topics.values()
            if topic.problem and topic.count
        ]
        _refuse_nothing(log, facts)
        guesses = [topic.guess for topic in readable if topic.guess]
        notes = tuple(dict.fromkeys([*log.notes, *guesses]))
        return Inspection(str(log.path), log.format, tuple(facts), tuple(found), notes)
    finally:
        log.close()


def _wanted(topic: Topic) -> Wanted:
    fields = [n for n, c in topic.channels.items() if c.dtype != "timestamp"]
    return Wanted(topic.name, topic.base, tuple(fields))


def _topic_facts(topic: Topic, stamps: StampSurvey, values: ValueSurvey, origin: int) -> TopicFacts:
    names = _wanted(topic).fields
    mean, rms = values.mean, values.rms
    heard = values.count > 0
    low, high = (np.where(heard, ends, np.nan) for ends in (values.low, values.high))
    channels = tuple(
        ChannelFacts(
            name,
            topic.channels[name].dtype,
            topic.channels[name].unit,
            float(low[k]),
            float(high[k]),
            float(mean[k]),
            float(rms[k]),
            int(values.missing[k]),
        )
        for k, name in enumerate(names)
    )
    base = topic.base.column or topic.base.kind
    median = stamps.median
    counted = topic.base.kind == "rows"
    return TopicFacts(
        topic.name,
        topic.kind,
        stamps.rows,
        base,
        ((stamps.first or origin) - origin) / SECOND,
        math.nan if counted else stamps.duration,
        math.nan if counted else 1.0 / median if median > 0 else math.nan,
        0 if counted else stamps.gaps(GAP),
        math.nan if counted else stamps.longest / SECOND,
        stamps.duplicates,
        0 if counted else stamps.near_duplicates,
        stamps.backwards,
        channels,
    )


def _findings(topic: Topic, stamps: StampSurvey, values: ValueSurvey) -> list[Finding]:
    where = topic.name or "table"
    found = stamp_findings(where, stamps, GAP, column=topic.base.kind == "column")
    fields = list(_wanted(topic).fields)
    never = [name for name, count in zip(fields, values.count, strict=True) if not count]
    if never and stamps.rows:
        found.append(Finding("note", where, "no number", ", ".join(never)))
    for k, name in enumerate(fields):
        place = slice(k, k + 1)
        own = f"{topic.name} {name}".strip()
        if values.missing[k] and values.count[k]:
            found += value_findings(
                own, values.count[place], values.missing[place], np.zeros(1), np.ones(1)
            )
        unit = topic.channels[name].unit
        if not unit or not values.count[k]:
            continue
        try:
            factor, si = conversion(unit, None, own)
        except LogError:
            continue
        places = _vector(fields, k) if si == "m/s^2" else [k]
        if places:
            largest = float(np.abs([values.low[places], values.high[places]]).max())
            found += unit_findings(
                own,
                Sizes(unit, si, factor, values.mean[places] * factor, values.rms[places] * factor,
                      largest * factor),
            )  # fmt: skip
    return found


def _vector(fields: list[str], k: int) -> list[int]:
    """Places of a vector that begins at a number; none if it begins elsewhere."""
    for end in _VECTOR:
        if fields[k].endswith(end):
            others = [fields[k][: -len(end)] + end.translate(table) for table in _NEXT]
            if all(name in fields for name in others):
                return [k, *(fields.index(name) for name in others)]
    return []


_NEXT = (str.maketrans("x0", "y1"), str.maketrans("x0", "z2"))


def _unreadable(topic: Topic) -> TopicFacts:
    nothing = math.nan
    return TopicFacts(
        topic.name, topic.kind, topic.count or 0, "", nothing, nothing, nothing, 0, nothing, 0, 0,
        0, (), topic.problem,
    )  # fmt: skip


def _refuse_nothing(log: LogFile, facts: list[TopicFacts]) -> None:
    if not any(topic.rows for topic in facts):
        raise LogError(f"{log.path}: expected samples, found none in {log.format}")
