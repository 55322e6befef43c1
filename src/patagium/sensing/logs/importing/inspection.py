"""Inspection of a log without a mapping: topics, rates, gaps, ranges and findings, in one pass.

Units are those that the file or the definitions of its messages state. A number without a unit is
judged by its stamps and missing entries alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import Request, Topic
from patagium.sensing.logs.files.opening import open_log
from patagium.sensing.logs.importing.findings import (
    SECOND,
    Finding,
    Progress,
    StampSurvey,
    StreamSurvey,
    ValueSurvey,
    missing_findings,
    sizes_of,
    stamp_findings,
    survey_streams,
    unit_findings,
)

GAP = 3.0
"""Length from which a step is a gap, in median steps."""
_VECTOR = (".x", "[0]", "_x")


@dataclass(frozen=True)
class ChannelFacts:
    """Facts about a number of a topic, in the unit of the file.

    Attributes:
        name: Path of the number, as a mapping names it.
        dtype: Type in the file.
        unit: Unit that the file or its message definitions state; empty if there is none.
        low: Lowest value; NaN if none is finite.
        high: Highest value.
        mean: Mean.
        rms: Root mean square.
        missing: Number of entries that are not finite.
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
    """Facts about a topic.

    Attributes:
        name: Name of the topic; empty for a table.
        kind: Type of its messages.
        rows: Number of rows.
        stamps: Source of its stamps.
        begin: First stamp, from the first stamp of the log [s].
        duration: Time from the first to the last stamp [s].
        rate: Rows a second, by the median step [Hz].
        gaps: Number of steps longer than 3 medians.
        longest: Longest step [s].
        duplicates: Number of stamps that repeat the one before.
        near_duplicates: Number of steps shorter than a tenth of the median.
        backwards: Number of stamps before an earlier one.
        channels: Facts about its numbers.
        problem: Reason why the topic cannot be read; empty if it can.
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
    """Facts about a log and findings.

    Attributes:
        path: Path of the log.
        format: Name of its format.
        topics: Facts about its topics.
        findings: Suspicious facts.
        notes: Assumptions made to read the file.
    """

    path: str
    format: str
    topics: tuple[TopicFacts, ...]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]

    def plain(self) -> dict[str, Any]:
        """Inspection as a dict for JSON."""
        return asdict(self)


def inspect_log(
    paths: str | Path | Sequence[str | Path], *, progress: Progress | None = None
) -> Inspection:
    """Content of a log: topics, rates, gaps, ranges, and suspicious facts.

    Args:
        paths: A log file of any format that `import_log` reads, or the parts of a recording.
        progress: Called now and then with the rows read and the rows in all.

    Raises:
        LogError: If the log cannot be read, or holds no samples.
    """
    with closing(open_log(paths)) as log:
        readable = [topic for topic in log.topics.values() if not topic.problem]
        lost = [topic for topic in log.topics.values() if topic.problem]
        wanted = tuple(Request(one.name, one.base, tuple(_fields(one))) for one in readable)
        total = sum(topic.count or topic.about for topic in readable)
        surveys = survey_streams(log, wanted, total, progress=progress)
        starts = [one.stamps.first for one in surveys if one.stamps.first is not None]
        origin = min(starts, default=0)
        facts, found = [], []
        for topic, survey in zip(readable, surveys, strict=True):
            facts.append(_topic_facts(topic, survey, origin))
            found += _findings(topic, survey)
        facts += [_unreadable(topic) for topic in lost]
        found += [
            Finding("warning", topic.name, "unreadable", topic.problem)
            for topic in lost
            if topic.count
        ]
        if not any(topic.rows for topic in facts):
            raise LogError(f"{log.path}: expected samples, found none in {log.format}")
        guesses = [topic.guess for topic in readable if topic.guess]
        notes = tuple(dict.fromkeys([*log.notes, *guesses]))
        return Inspection(str(log.path), log.format, tuple(facts), tuple(found), notes)


def _fields(topic: Topic) -> list[str]:
    return [name for name, channel in topic.channels.items() if channel.dtype != "timestamp"]


def _topic_facts(topic: Topic, survey: StreamSurvey, origin: int) -> TopicFacts:
    stamps, counted = survey.stamps, topic.base.kind == "rows"
    median = stamps.median
    return TopicFacts(
        name=topic.name,
        kind=topic.kind,
        rows=stamps.rows,
        stamps=topic.base.column or topic.base.kind,
        begin=((stamps.first or origin) - origin) / SECOND,
        duration=math.nan if counted else stamps.duration,
        rate=math.nan if counted or not median > 0 else 1.0 / median,
        gaps=0 if counted else stamps.gaps(GAP),
        longest=math.nan if counted else stamps.longest / SECOND,
        duplicates=stamps.duplicates,
        near_duplicates=0 if counted else stamps.near_duplicates,
        backwards=stamps.backwards,
        channels=_channel_facts(topic, survey),
    )


def _channel_facts(topic: Topic, survey: StreamSurvey) -> tuple[ChannelFacts, ...]:
    values = survey.values
    present, mean, rms = values.count > 0, values.mean, values.rms
    low, high = (np.where(present, ends, np.nan) for ends in (values.low, values.high))
    return tuple(
        ChannelFacts(
            name=name,
            dtype=topic.channels[name].dtype,
            unit=topic.channels[name].unit,
            low=float(low[k]),
            high=float(high[k]),
            mean=float(mean[k]),
            rms=float(rms[k]),
            missing=int(values.missing[k]),
        )
        for k, name in enumerate(_fields(topic))
    )


def _unreadable(topic: Topic) -> TopicFacts:
    empty = _topic_facts(topic, StreamSurvey(StampSurvey(), ValueSurvey(0)), 0)
    nothing = math.nan
    return replace(
        empty, rows=topic.count or 0, stamps="", begin=nothing, duration=nothing, rate=nothing,
        longest=nothing, problem=topic.problem,
    )  # fmt: skip


def _findings(topic: Topic, survey: StreamSurvey) -> list[Finding]:
    where, values, fields = topic.name or "table", survey.values, _fields(topic)
    found = stamp_findings(where, survey.stamps, GAP, column=topic.base.kind == "column")
    never = [name for name, count in zip(fields, values.count, strict=True) if not count]
    if never and survey.stamps.rows:
        found.append(Finding("note", where, "no number", ", ".join(never)))
    for k, name in enumerate(fields):
        own = f"{topic.name} {name}".strip()
        unit = topic.channels[name].unit
        if not values.count[k]:
            continue
        found += missing_findings(own, values, [k])
        if not unit:
            continue
        with suppress(LogError):  # a unit that the file states need not be one that we know
            sizes = sizes_of(values, [k], unit)
            places = _vector(fields, k) if sizes.si == "m/s^2" else [k]
            found += unit_findings(own, sizes_of(values, places, unit)) if places else []
    return found


def _vector(fields: list[str], k: int) -> list[int]:
    """Places of the three components of a vector whose first component is at k; else none."""
    for end in _VECTOR:
        if fields[k].endswith(end):
            others = [fields[k][: -len(end)] + end.translate(table) for table in _NEXT]
            if all(name in fields for name in others):
                return [k, *(fields.index(name) for name in others)]
    return []


_NEXT = (str.maketrans("x0", "y1"), str.maketrans("x0", "z2"))
