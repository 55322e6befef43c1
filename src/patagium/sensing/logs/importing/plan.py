"""Import plan: which numbers of a log to read, and how each becomes a quantity of the mapping."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from patagium.arrays import Array, Bools
from patagium.errors import LogError
from patagium.robot import Robot
from patagium.sensing.force.air_force import PARTS, flight_labels
from patagium.sensing.logs.axes import attitude_in_ours, axes_of
from patagium.sensing.logs.files.channels import (
    LogFile,
    Request,
    StampSource,
    Topic,
    find_fields,
    find_topic,
)
from patagium.sensing.logs.files.message_files import find_stamp, own_stamp
from patagium.sensing.logs.files.table_files import nanoseconds_in
from patagium.sensing.logs.mapping import TableMapping, ValueColumn, conversion

LONGEST_NAME = 255
"""Longest name of a variable of a netCDF file [bytes]."""
_ALIKE = 0.9
"""Share of their rows in which columns that are filled together have a number."""
_SOUND = re.compile(
    "[A-Za-z0-9_\x80-\ud7ff\ue000-\U0010ffff]"
    "(?:[^\0-\x1f\x7f\ud800-\udfff]*[^\0-\x20\x7f\ud800-\udfff])?"
)
"""Pattern of the names that a netCDF file takes: no control characters, no lone surrogates."""


@dataclass(frozen=True)
class Quantity:
    """Quantity of the mapping, located in the log.

    Attributes:
        column: Its entry in the mapping.
        role: "input", "output" or "channel".
        stream: Stream that holds it.
        places: Its components among the numbers of the stream.
        factor: Factor from the unit in the log to the unit that the model sees.
        unit: Unit that the model sees.
        si_factor: Factor from the unit in the log to the SI unit.
        si: SI unit of the same dimension.
        order: Order of the components of an attitude; None for other quantities.
    """

    column: ValueColumn
    role: str
    stream: int
    places: list[int]
    factor: float
    unit: str
    si_factor: float
    si: str
    order: str | None

    @property
    def label(self) -> str:
        """Name in results."""
        return self.column.label

    @property
    def is_attitude(self) -> bool:
        """Whether the quantity is an attitude."""
        return self.order is not None

    @property
    def to_si(self) -> float:
        """Factor from the unit that the model sees to the SI unit."""
        return 1.0 if self.is_attitude else self.si_factor / self.factor

    @property
    def needed(self) -> bool:
        """Whether no sample is made without it: all but outputs and forces of joints."""
        part = self.label.partition(".")[0]
        return part in PARTS[:3] or (self.role != "output" and part != PARTS[3])

    @property
    def turn(self) -> float:
        """Change after which the numbers begin again, in the unit of the log; 0 if they do not."""
        angle = self.si == "rad" and self.column.size == 1
        return self.column.turn or (2 * np.pi / self.si_factor if angle else 0.0)

    def converted(self, raw: Array) -> Array:
        """Values in the unit that the model sees and in our axes.

        Args:
            raw: Components in the unit of the log, (k, size).

        Returns:
            Numbers (k, 1), vectors (k, 3) or quaternions (k, 4) [-].
        """
        words = self.column
        if self.order is not None:
            scaled = raw * self.si_factor if self.order in ("rpy", "rotvec") else raw
            return attitude_in_ours(
                scaled, self.order, _axes(words.frame), _axes(words.body), inverted=words.inverted
            )
        values: Array = (raw - words.offset) * (-self.factor if words.negated else self.factor)
        return values if words.frame is None else values @ _axes(words.frame).T

    def bounds(self) -> Array:
        """Expected range of each quantity, (n, 2) [unit of the model]; NaN if none is stated."""
        words = self.column
        if words.range is None:
            return np.full((len(words.labels), 2), np.nan)
        factor = -self.factor if words.negated else self.factor
        bounds = (np.array(words.range)[:, None] - words.offset) * factor  # (2, 1) or (2, 3)
        ends = np.broadcast_to(bounds, (2, 3)) @ _axes(words.frame).T
        return np.sort(ends, axis=0).T[: len(words.labels)]


def coordinates(items: Sequence[Quantity], robot: Robot | None) -> dict[str, Quantity]:
    """Coordinates of a flight by label, such as `q.x`, each a quantity of one number.

    A vector named q, v or a holds three where numbers of its part, such as `q.roll`, stand beside.
    """
    wanted = flight_labels(robot)
    found = {one.label: one for one in items if one.label in wanted}
    parts = {label.partition(".")[0] for label in found}
    for one in items:
        if one.label in parts and not one.is_attitude:
            words, offset = one.column, np.broadcast_to(one.column.offset, 3)
            for label, row in zip(words.labels, _axes(words.frame), strict=True):
                k = int(np.abs(row).argmax())
                turned = {"negated": words.negated != (row[k] < 0), "offset": float(offset[k])}
                column = words.model_copy(update={"name": label, "frame": None, **turned})
                found[label] = replace(one, column=column, places=[one.places[k]])
    return {label: one for label, one in found.items() if label in wanted}


@dataclass(frozen=True)
class Plan:
    """Streams to read from a log, and the quantities of the mapping.

    Attributes:
        log: The open log.
        mapping: The mapping.
        source: Name of the mapping, for messages.
        robot: Robot that the mapping names; None if it names none.
        wanted: Streams: a topic with one source of stamps and some of its numbers.
        names: Name of each stream in messages.
        items: Quantities, in the order of the mapping.
        counts: Number of rows of each stream, or an estimate; 0 where unknown.
        rates: Rate at which the rows of each stream are restamped [Hz]; None to keep stamps.
        zero: Units of numbers that the log lacks and that are zero, by name.
    """

    log: LogFile
    mapping: TableMapping
    source: str
    robot: Robot | None
    wanted: tuple[Request, ...]
    names: tuple[str, ...]
    items: tuple[Quantity, ...]
    counts: tuple[int, ...]
    rates: tuple[float | None, ...]
    zero: dict[str, str] = field(default_factory=dict)


def plan_import(log: LogFile, mapping: TableMapping, source: str, robot: Robot | None) -> Plan:
    """Import plan of a mapping for a log.

    Args:
        log: The open log.
        mapping: The mapping.
        source: Name of the mapping, for messages.
        robot: Robot that the mapping names.

    Raises:
        LogError: If the log lacks a topic or field of the mapping; the message names those it has.
    """
    streams: dict[tuple[str, StampSource], list[str]] = {}
    found, taken = [], {"time"}
    for role in ("inputs", "outputs", "channels"):
        for index, column in enumerate(getattr(mapping, role)):
            where = f"{source}: {role}.{index}"
            topic = find_topic(log, column.topic, where)
            fields = find_fields(topic, column.source, column.size, where)
            base = _base(topic, column, mapping, source, fields)
            _take_names(column, taken, where)
            held = streams.setdefault((topic.name, base), [])
            held.extend(field for field in fields if field not in held)
            found.append((role[:-1], column, (topic.name, base), fields))
    if mapping.time.like is not None:
        topic = find_topic(log, mapping.time.like, f"{source}: time.like")
        if not any(name == topic.name for name, _ in streams):
            streams[(topic.name, _base(topic, None, mapping, source, []))] = []
    keys = list(streams)
    items = [
        _item(role, column, keys.index(key), [streams[key].index(f) for f in fields], fields)
        for role, column, key, fields in found
    ]
    wanted, names, stamped = _requests(log, streams, items, whole=mapping.time.rate is None)
    topics = (log.topics[one.topic] for one in wanted)
    counts = tuple(topic.count or topic.about for topic in topics)
    rates = _restamp_rates(mapping, stamped, source)
    return Plan(log, mapping, source, robot, wanted, names, tuple(items), counts, rates)


def _requests(
    log: LogFile,
    streams: dict[tuple[str, StampSource], list[str]],
    items: list[Quantity],
    *,
    whole: bool,
) -> tuple[tuple[Request, ...], tuple[str, ...], list[str]]:
    """Streams to read, with their names in messages and under `restamp`.

    Args:
        log: The open log.
        streams: Fields of each topic and source of stamps.
        items: Quantities, which are given their places in the streams.
        whole: Whether rows are kept whole where all that is needed is in them.
    """
    count, owners = Counter(name for name, _ in streams), [item.stream for item in items]
    wanted, names, stamped = list[Request](), list[str](), list[str]()
    for stream, ((name, base), every) in enumerate(streams.items()):
        every_row = Request(name, base, tuple(every))
        own = {k: item for k, item in enumerate(items) if owners[k] == stream}
        beside = [item for item in own.values() if item.needed and whole]
        groups = filled_in_turn(log, every_row, [every[k] for item in beside for k in item.places])
        if len(groups) > 1 and base.column in every:
            groups[0].append(base.column)  # which every row has
        for group in groups:
            inside = {k: item for k, item in own.items() if every[item.places[0]] in group}
            if len(groups) == 1:
                wanted.append(every_row)
                names.append((name or "table") + f" by {base.column}" * (count[name] > 1))
                stamped.append(name or base.column or "table")
            elif inside:
                held = [*dict.fromkeys(every[k] for one in inside.values() for k in one.places)]
                wanted.append(Request(name, base, tuple(held), filled=True))
                names.append(next(iter(inside.values())).column.label)
                stamped.append(names[-1])
            for k, item in inside.items():
                places = [wanted[-1].fields.index(every[place]) for place in item.places]
                items[k] = replace(item, stream=len(wanted) - 1, places=places)
    return tuple(wanted), tuple(names), stamped


def filled_in_turn(log: LogFile, wanted: Request, beside: Sequence[str] = ()) -> list[list[str]]:
    """Columns that are filled in the same rows or messages; one list unless some skip rows.

    A column skips rows, and is not merely lost for a while, if most of its numbers in the first
    rows of the table have none in the row before. Where there are several lists, the log notes it.

    Args:
        log: The open log.
        wanted: The table with its columns, or the messages with their named parts; a table
            without a column of stamps has one list.
        beside: Columns all of which most rows of any column have, if that makes it one list.
    """
    fields = [name for name in wanted.fields if name != wanted.base.column]
    found: list[tuple[Bools, list[str]]] = []
    skips, first, topic = False, None, log.topics[wanted.topic]
    stamped = wanted.base.kind == "column" if topic.kind == "table" else topic.varied
    if stamped and fields:
        with suppress(LogError):  # of a column of text, which is told where it is read
            first = next(iter(log.blocks((wanted._replace(fields=tuple(fields)),))), None)
    if first is None:
        return [[*wanted.fields]]
    for name, filled in zip(fields, np.isfinite(first.values).T, strict=True):
        rows = np.flatnonzero(filled)
        skips |= len(rows) > 2 and float(np.median(np.diff(rows))) > 1.0
        for mask, names in found:
            if not len(rows) or (mask & filled).sum() >= _ALIKE * max(mask.sum(), len(rows)):
                names.append(name)
                break
        else:
            found.append((filled, [name]))
    needed = [fields.index(name) for name in beside if name in fields]
    full = np.isfinite(first.values[:, needed]).all(axis=1)
    if needed and all((mask & full).sum() >= _ALIKE * mask.sum() for mask, _ in found):
        skips = False
    if not skips or len(found) < 2:
        return [[*wanted.fields]]
    log.notes.append(
        "columns are filled in turn; each is taken at the stamps of its own rows, and brought to "
        f"the `rate` under time: {'; '.join(', '.join(names) for _, names in found)}"
    )
    return [names for _, names in found]


def _restamp_rates(
    mapping: TableMapping, names: list[str], source: str
) -> tuple[float | None, ...]:
    """Rate at which each stream is restamped [Hz]; None for those that keep their stamps.

    Raises:
        LogError: If it is not clear which stream a rate is of.
    """
    given, where = mapping.time.restamp, f"{source}: time.restamp"
    if isinstance(given, float) and len({*names}) > 1:
        example = ", ".join(f"{name}: {given:g} Hz" for name in dict.fromkeys(names))
        expected = f"a rate for each stream, such as {{{example}}}"
        raise LogError(where, expected, f"{given:g} Hz for {len({*names})} streams")
    rates = given if isinstance(given, dict) else dict.fromkeys(names, given)
    unknown = [key for key in rates if key not in names]
    if unknown:
        raise LogError(where, f"names of streams ({', '.join(names)})", f"{unknown[0]!r}")
    return tuple(rates.get(name) for name in names)


def variable_name(label: str) -> str:
    """Name of a netCDF variable: a label without slashes, in Unicode's composed form."""
    return unicodedata.normalize("NFC", label.replace("/", "|"))


def _take_names(column: ValueColumn, taken: set[str], where: str) -> None:
    """Add the names of the numbers of a quantity to the names that are taken.

    Raises:
        LogError: If a name is taken already, is too long, or has characters that a file refuses.
    """
    for label in column.labels:
        name = variable_name(label)
        if name in taken:
            raise LogError(f"{where}.name", "a name of its own", f"{label!r} twice")
        if not _SOUND.fullmatch(name) or len(name.encode()) > LONGEST_NAME:
            raise LogError(
                f"{where}.name: expected at most {LONGEST_NAME} bytes, the first a letter, a digit "
                f"or _, no control characters and no space at the end, found {label!r}"
            )
        taken.add(name)


def _base(
    topic: Topic, column: ValueColumn | None, mapping: TableMapping, source: str, fields: list[str]
) -> StampSource:
    """Source of the stamps of some fields: a column, the messages' own, or rows at a rate."""
    time = mapping.time
    stamp = (column and column.stamp) or time
    messages = topic.base.kind in ("header", "received")
    if stamp.column:
        where = f"{source}: {'time' if stamp is time else 'stamp'}"
        if messages:
            own = find_stamp(topic.known, stamp.column)
            if own or stamp.column == topic.base.column:
                return StampSource("header", own or stamp.column)
        field = find_fields(topic, stamp.column, 1, where)[0]
        if topic.channels[field].dtype == "timestamp":
            return StampSource("column", field, 1.0)
        stated = nanoseconds_in(topic.channels[field].unit)
        shared = not stated or time.column in ("", stamp.column)
        unit = stamp.unit or (time.unit if shared else None)
        factor = conversion(unit, "s", where)[0] * 1e9 if unit else stated or 1e9
        return StampSource("column", field, factor)
    if time.base is not None:
        if not messages:
            raise LogError(
                f"{source}: time.base: {topic.kind} has no {time.base} stamps; name a column"
            )
        if time.base == "header" and not topic.stamped:
            expected = f"a stamp in the header of topic {topic.name!r} ({topic.kind})"
            raise LogError(f"{source}: time.base", expected, "none; use received")
        return header_of(topic, topic.base._replace(kind=time.base), fields)
    if topic.kind == "table":
        if time.restamp is not None:
            return StampSource("rows")
        raise LogError(
            f"{source}: time.column: expected the column with stamps of a table (or, without one, "
            f"`restamp: RATE`); it holds {', '.join(list(topic.channels)[:12])}"
        )
    return header_of(topic, topic.base, fields)


def header_of(topic: Topic, base: StampSource, fields: Sequence[str]) -> StampSource:
    """Stamps of some fields: of headers, the one of the part that holds the first of them."""
    own = own_stamp(topic.known, fields[0]) if fields and base.kind == "header" else ""
    return StampSource("header", own) if own else base


def _item(
    role: str, column: ValueColumn, stream: int, places: list[int], fields: list[str]
) -> Quantity:
    si_factor, si = conversion(column.unit, None, column.label)
    factor, unit = conversion(column.unit, column.as_unit, column.label)
    order: str | None = column.order
    if order == "xyzw" and [name[-1:] for name in fields] == list("wxyz"):  # as they are named
        order = "wxyz"
    if order is not None:
        factor, unit = 1.0, "1"
    return Quantity(column, role, stream, places, factor, unit, si_factor, si, order)


def _axes(words: str | None) -> Array:
    found = axes_of(words or "flu")
    return np.eye(3) if found is None else found
