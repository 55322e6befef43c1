"""Inspection of a log without a mapping: topics, rates, gaps, ranges and findings, in one pass.

Units are those that the file or the definitions of its messages state. A number without a unit is
judged by its stamps and missing entries alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from patagium.arguments import Progress, checked
from patagium.arrays import brief
from patagium.errors import LogError
from patagium.sensing.logs.files.channels import ColumnError, LogFile, Request, StampSource, Topic
from patagium.sensing.logs.files.message_files import NO_MESSAGE
from patagium.sensing.logs.files.opening import open_log
from patagium.sensing.logs.files.table_files import TIME_NAME, guessed_base
from patagium.sensing.logs.importing.findings import (
    SECOND,
    SENSED,
    Finding,
    StreamSurvey,
    number_findings,
    recorder_findings,
    sizes_of,
    stamp_findings,
    survey_streams,
    unit_findings,
)
from patagium.sensing.logs.importing.plan import filled_in_turn, header_of
from patagium.sensing.logs.mapping import si_of

GAP = 3.0
"""Length from which a step is a gap, in median steps."""
_LOOK = 1 << 19
"""Numbers of a part that are looked at for what a recorder made."""
_VECTOR = ((".x", ".y", ".z"), ("[0]", "[1]", "[2]"), ("_x", "_y", "_z"))
_TIMES = "time is read as numbers or as ISO 8601, such as 2026-03-01 12:00:00.5"


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
        unplaced: Content that is not read, by path, with the reason.
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
    unplaced: dict[str, str] = field(default_factory=dict)


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
    __repr__ = brief


@checked
def inspect_log(
    paths: str | Path | Sequence[str | Path],
    *,
    skip_rows: int | None = None,
    progress: Progress | None = None,
) -> Inspection:
    """Content of a log: topics, rates, gaps, ranges, and suspicious facts.

    What cannot be read as numbers is listed with the reason, and the rest is read without it.

    Args:
        paths: A log file of any format that `import_log` reads, or the parts of a recording.
        skip_rows: Number of lines before the line of names of a CSV file; found if None.
        progress: Called now and then with the rows read and the rows in all.

    Raises:
        LogError: If no topic of the log can be read, or it holds nothing at all.
    """
    with closing(open_log(paths, skip_rows=skip_rows)) as log:
        topics = log.topics.values()
        lost = [topic for topic in topics if topic.problem]
        parts = [part for topic in topics if not topic.problem for part in _parts(log, topic)]
        readable, surveys, broken = _surveyed(log, parts, progress)
        starts = [one.stamps.first for one in surveys if one.stamps.first is not None]
        origin = min(starts, default=0)
        facts, found = [], []
        for part, survey in zip(readable, surveys, strict=True):
            facts.append(_topic_facts(part, survey, origin))
            found += [*_findings(part, survey), *_recorder_notes(part, survey)]
        facts += [_topic_facts(_Part(one, one.name), StreamSurvey(0), 0) for one in lost]
        damaged = [topic for topic in lost if topic.problem != NO_MESSAGE]
        found += [Finding("warning", one.name, "unreadable", one.problem) for one in damaged]
        if broken:
            found.append(Finding("warning", str(log.path), "breaks off", broken))
        if not damaged and not any(topic.rows or topic.unplaced for topic in facts):
            reason = f": {broken}" if broken else ""
            raise LogError(log.path, "samples", f"none in {log.format}{reason}")
        guesses = [part.topic.guess for part in readable if part.topic.guess]
        notes = tuple(dict.fromkeys([*log.notes, *guesses]))
        return Inspection(str(log.path), log.format, tuple(facts), tuple(found), notes)


@dataclass(frozen=True)
class _Part:
    """Numbers of a topic that have the same number of rows.

    Attributes:
        topic: The topic with these numbers alone.
        label: Its name in results.
        filled: Whether only rows count in which one of them is a number.
    """

    topic: Topic
    label: str
    filled: bool = False

    @property
    def fields(self) -> list[str]:
        """Paths of the numbers."""
        channels = self.topic.channels.items()
        return [name for name, channel in channels if channel.dtype != "timestamp"]

    @property
    def request(self) -> Request:
        """Request for the numbers."""
        base = header_of(self.topic, self.topic.base, self.fields)
        return Request(self.topic.name, base, tuple(self.fields), self.filled)

    def without(self, column: str, reason: str) -> _Part:
        """Part without a column, or the entries of a list, which are listed as not read."""
        held = self.topic.channels
        own = column in held
        gone = {n for n in held if n == column or (not own and n.startswith(f"{column}["))}
        if not gone:
            return self
        base = self.topic.base
        topic = replace(
            self.topic,
            channels={name: channel for name, channel in held.items() if name not in gone},
            unplaced={**self.topic.unplaced, column: reason},
            base=StampSource("rows") if base.column in gone else base,
        )
        return replace(self, topic=topic)


def _parts(log: LogFile, topic: Topic) -> list[_Part]:
    """Parts of a topic whose columns have the same rows."""
    lengths = sorted({c.rows for c in topic.channels.values() if c.rows is not None}, reverse=True)
    parts = list[_Part]()
    if not lengths:
        whole = _Part(topic, topic.name)
        groups = filled_in_turn(log, whole.request)
        for names in groups if len(groups) > 1 else ():
            kept = {*names, topic.base.column}
            held = {name: one for name, one in topic.channels.items() if name in kept}
            label = names[0] if topic.kind == "table" else topic.name
            parts.append(_Part(replace(topic, channels=held), label, filled=True))
        return parts or [whole]
    for place, rows in enumerate(lengths):
        held = {name: c for name, c in topic.channels.items() if c.rows == rows}
        base, guess = guessed_base(held)
        unplaced = topic.unplaced if place == 0 else {}
        part = replace(topic, channels=held, count=rows, base=base, guess=guess, unplaced=unplaced)
        parts.append(_Part(part, f"{topic.name or 'table'} of {rows} rows"))
    return parts


def _surveyed(
    log: LogFile, parts: list[_Part], progress: Progress | None
) -> tuple[list[_Part], tuple[StreamSurvey, ...], str]:
    """Statistics of the numeric columns of each part; other columns are dropped from it.

    Returns:
        The parts, their statistics, and the reason why the file breaks off; empty if it does not.
    """
    while True:
        surveys = tuple(StreamSurvey(len(part.fields), _LOOK) for part in parts)
        total = sum(part.topic.count or part.topic.about for part in parts)
        try:
            requests = tuple(part.request for part in parts)
            survey_streams(log, requests, total, surveys=surveys, progress=progress)
            return parts, surveys, ""
        except LogError as problem:
            reason, fewer = str(problem).removeprefix(f"{log.path}: "), parts
            if isinstance(problem, ColumnError):
                fewer = [part.without(problem.column, reason) for part in parts]
            if fewer == parts:
                return parts, surveys, reason
            parts = fewer


def _topic_facts(part: _Part, survey: StreamSurvey, origin: int) -> TopicFacts:
    """Facts of a part of a log: stamps, rate, gaps and columns."""
    topic, stamps, median = part.topic, survey.stamps, survey.stamps.median
    facts = TopicFacts(
        name=part.label,
        kind=topic.kind,
        rows=stamps.rows,
        stamps=topic.base.column if topic.base.kind == "column" else topic.base.kind,
        begin=((stamps.first or origin) - origin) / SECOND,
        duration=stamps.duration,
        rate=1.0 / median if median > 0 else math.nan,
        gaps=stamps.gaps(GAP),
        longest=stamps.longest / SECOND,
        duplicates=stamps.duplicates,
        near_duplicates=stamps.near_duplicates,
        backwards=stamps.backwards,
        channels=_channel_facts(part, survey),
        unplaced=dict(topic.unplaced),
    )
    nan, count = math.nan, topic.count or 0
    if topic.base.kind == "rows" or topic.problem:  # and no stamp is known
        facts = replace(facts, duration=nan, rate=nan, gaps=0, longest=nan, near_duplicates=0)
    if topic.problem:
        facts = replace(facts, rows=count, stamps="", begin=nan, problem=topic.problem)
    return facts


def _channel_facts(part: _Part, survey: StreamSurvey) -> tuple[ChannelFacts, ...]:
    values, held = survey.values, part.topic.channels
    ends = (np.where(values.count > 0, end, np.nan) for end in (values.low, values.high))
    columns = (one.tolist() for one in (*ends, values.mean, values.rms, values.missing))
    rows = zip(part.fields, *columns, strict=True)
    return tuple(ChannelFacts(name, held[name].dtype, held[name].unit, *row) for name, *row in rows)


def _findings(part: _Part, survey: StreamSurvey) -> Iterator[Finding]:
    """Findings about the stamps, units and numbers of a part of a log."""
    topic, values, fields = part.topic, survey.values, part.fields
    where = part.label or "table"
    written = topic.base.kind == "column" and topic.kind == "table"
    yield from stamp_findings(where, survey.stamps, GAP, written=written)
    never = [name for name, count in zip(fields, values.count, strict=True) if not count]
    if survey.stamps.rows <= 1 < (topic.count or 0):
        text = f"{survey.stamps.rows} of {topic.count} messages has all the numbers of the first"
        yield Finding("warning", where, "no rows", text)
    if never and survey.stamps.rows:
        yield Finding("note", where, "no number", ", ".join(never))
    lost = [n for n in topic.unplaced if topic.base.kind == "rows" and TIME_NAME.match(n.lower())]
    for name in lost:
        text = f"column {name!r} cannot be read: {topic.unplaced[name]}; {_TIMES}"
        yield Finding("warning", where, "time", text)
    bare = [n for n in fields if not topic.channels[n].unit and n != topic.base.column]
    if bare and topic.kind == "table":
        text = f"no unit found for: {', '.join(bare)}; taken as a plain number"
        yield Finding("note", where, "unit", text)
    for k, name in enumerate(fields):
        own = f"{topic.name} {name}".strip()
        unit = topic.channels[name].unit
        if not values.count[k]:
            continue
        constant = "note" if topic.kind == "table" else ""  # a column need not be mapped
        yield from number_findings(own, values, [k], constant)
        si = si_of(unit)[1]  # a unit that the file states need not be one that we know
        places = _vector(fields, k) if si == "m/s^2" else [k]
        if not (unit and si and places):
            continue
        others = [i for i, one in enumerate(fields) if topic.channels[one].unit == unit]
        for one in unit_findings(own, sizes_of(values, places, unit, others=others)):
            doubt = {"level": "note", "text": f"{one.text} Or is it an acceleration?"}
            yield replace(one, **doubt) if "Twist" in topic.kind else one  # by custom alone


def _recorder_notes(part: _Part, survey: StreamSurvey) -> list[Finding]:
    """Notes on marks of missing numbers, clipped samples and jumps in the first rows of a part."""
    found, (stamps, values) = list[Finding](), survey.first
    for name, column in zip(part.fields, values.T, strict=True):
        factor, si = si_of(part.topic.channels[name].unit)
        turn = 2 * math.pi / factor if si == "rad" else 0.0
        own = f"{part.topic.name} {name}".strip()
        found += recorder_findings(own, stamps, column, GAP, measured=si in SENSED, turn=turn)
    return [replace(one, level="note") for one in found]


def _vector(fields: list[str], k: int) -> list[int]:
    """Places of the three components of a vector whose first component is at k; else none."""
    for ends in _VECTOR:
        names = [fields[k].removesuffix(ends[0]) + end for end in ends]
        if names[0] == fields[k] and {*names} <= {*fields}:
            return [fields.index(name) for name in names]
    return []
