"""A mapping held against what a log holds: which numbers to read, and what becomes of them."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

import numpy as np

from patagium.errors import LogError
from patagium.sensing.logs.axes import attitude_in_ours, axes_of
from patagium.sensing.logs.files.channels import (
    Array,
    Base,
    LogFile,
    Topic,
    Wanted,
    components_are_named,
    find_fields,
    find_topic,
)
from patagium.sensing.logs.mapping import TableMapping, ValueColumn, conversion

LONGEST_NAME = 255
"""Of a variable of a netCDF file [bytes]."""
_SOUND = re.compile(
    "[A-Za-z0-9_\x80-\ud7ff\ue000-\U0010ffff]"
    "(?:[^\0-\x1f\x7f\ud800-\udfff]*[^\0-\x20\x7f\ud800-\udfff])?"
)
"""A name that such a file takes: no control characters, no halves of a surrogate pair."""


@dataclass(frozen=True)
class Item:
    """A quantity of the mapping, found in the log.

    Attributes:
        column: Its words.
        role: "input", "output" or "channel".
        stream: Which stream has it.
        places: Its components among the numbers of the stream.
        factor: From its unit to that the model sees.
        unit: The unit the model sees.
        si_factor: From its unit to SI.
        si: Its SI unit.
        order: Of a quaternion as it was found.
    """

    column: ValueColumn
    role: str
    stream: int
    places: tuple[int, ...]
    factor: float
    unit: str
    si_factor: float
    si: str
    order: str | None

    @property
    def is_attitude(self) -> bool:
        """Whether it is an attitude."""
        return self.order is not None

    def converted(self, raw: Array) -> Array:
        """Numbers of the log in our units and axes.

        Args:
            raw: Components, (k, size).

        Returns:
            (k, 1), (k, 3), or quaternions (k, 4) [-].
        """
        words = self.column
        if self.order is not None:
            scaled = raw * self.si_factor if self.order == "rpy" else raw
            return attitude_in_ours(
                scaled, self.order, _axes(words.frame), _axes(words.body), inverted=words.inverted
            )
        values = (raw - words.offset) * self.factor
        return values if words.frame is None else values @ _axes(words.frame).T

    def bounds(self) -> list[tuple[float, float]]:
        """Range to expect of each label, in the unit the model sees; NaN where not stated."""
        words = self.column
        if words.range is None:
            return [(np.nan, np.nan)] * len(words.labels)
        low, high = ((bound - words.offset) * self.factor for bound in words.range)
        ends = np.array([[low] * 3, [high] * 3]) @ _axes(words.frame).T
        rows = np.sort(ends, axis=0).T.tolist()
        return [(row[0], row[1]) for row in rows[: len(words.labels)]]


@dataclass(frozen=True)
class Plan:
    """What to read and what becomes of it.

    Attributes:
        wanted: Streams: a topic with its stamps.
        names: How to call each stream in messages.
        items: Quantities, in the order of the mapping.
        counts: Rows of each stream, or an estimate; 0 where unknown.
    """

    wanted: tuple[Wanted, ...]
    names: tuple[str, ...]
    items: tuple[Item, ...]
    counts: tuple[int, ...]

    def stream_of(self, topic: str) -> int | None:
        """The first stream of a topic; None if it has none."""
        names = [one.topic for one in self.wanted]
        return names.index(topic) if topic in names else None


def plan_import(log: LogFile, mapping: TableMapping, source: str) -> Plan:
    """What a mapping asks of a log.

    Args:
        log: The log, open.
        mapping: What its fields mean.
        source: Name of the mapping, for messages.

    Raises:
        LogError: If the log does not hold it, with what it does hold.
    """
    streams: dict[tuple[str, Base], list[str]] = {}
    topics: dict[str, Topic] = {}
    found, taken = [], {"time"}
    for role, columns in (
        ("inputs", mapping.inputs), ("outputs", mapping.outputs), ("channels", mapping.channels),
    ):  # fmt: skip
        for index, column in enumerate(columns):
            where = f"{source}: {role}.{index}"
            topic = find_topic(log, column.topic, where)
            topics[topic.name] = topic
            base = _base(topic, column, mapping, source)
            fields = find_fields(topic, column.source, column.size, where)
            _take_names(column, taken, where)
            held = streams.setdefault((topic.name, base), [])
            held.extend(field for field in fields if field not in held)
            found.append((role[:-1], column, (topic.name, base), fields))
    if mapping.time.like is not None:
        topic = find_topic(log, mapping.time.like, f"{source}: time.like")
        topics[topic.name] = topic
        if not any(name == topic.name for name, _ in streams):
            streams[(topic.name, _base(topic, None, mapping, source))] = []
    keys = list(streams)
    items = tuple(
        _item(role, column, keys.index(key), [streams[key].index(f) for f in fields], fields)
        for role, column, key, fields in found
    )
    wanted = tuple(Wanted(name, base, tuple(streams[name, base])) for name, base in keys)
    names = tuple((name or "table") + _suffix(base, keys, name) for name, base in keys)
    return Plan(wanted, names, items, tuple(topics[n].count or topics[n].about for n, _ in keys))


def variable_name(label: str) -> str:
    """How a file calls a number: its label without slashes, composed as netCDF does it.

    Args:
        label: Of the number, as the mapping has it.
    """
    return unicodedata.normalize("NFC", label.replace("/", "|"))


def _take_names(column: ValueColumn, taken: set[str], where: str) -> None:
    """Note the names of a quantity's numbers, or refuse those that no file can hold.

    Raises:
        LogError: If one is taken, too long, or has characters that no name may have.
    """
    for label in column.labels:
        name = variable_name(label)
        if name in taken:
            raise LogError(f"{where}.name: expected one that is not taken, found {label!r}")
        if not _SOUND.fullmatch(name) or len(name.encode()) > LONGEST_NAME:
            raise LogError(
                f"{where}.name: expected at most {LONGEST_NAME} bytes, the first a letter, a digit "
                f"or _, no control characters and no space at the end, found {label!r}"
            )
        taken.add(name)


def _base(topic: Topic, column: ValueColumn | None, mapping: TableMapping, source: str) -> Base:
    time = mapping.time
    stamp = (column.stamp if column is not None else "") or time.column
    if stamp:
        where = f"{source}: time" if not column or not column.stamp else f"{source}: stamp"
        field = find_fields(topic, stamp, 1, where)[0]
        if topic.channels[field].dtype == "timestamp":
            return Base("column", field, 1.0)
        return Base("column", field, conversion(time.unit, "s", where)[0] * 1e9)
    if time.base is not None:
        if topic.base.kind not in ("header", "received"):
            raise LogError(f"{source}: time.base: {topic.kind} has no {time.base} stamps; name a "
                           "column")  # fmt: skip
        if time.base == "header" and topic.base.kind != "header":
            raise LogError(
                f"{source}: time.base: expected a stamp in the header of topic {topic.name!r} "
                f"({topic.kind}), found none; use received"
            )
        return Base(time.base)
    if topic.kind == "table":
        raise LogError(f"{source}: time.column: expected the column with stamps of a table; it "
                       f"holds {', '.join(list(topic.channels)[:12])}")  # fmt: skip
    return topic.base


def _item(
    role: str, column: ValueColumn, stream: int, places: list[int], fields: list[str]
) -> Item:
    si_factor, si = conversion(column.unit, None, column.label)
    factor, unit = conversion(column.unit, column.as_unit, column.label)
    order: str | None = column.order
    if order in ("wxyz", "xyzw") and components_are_named(fields, 4):
        order = "wxyz"
    if order is not None:
        factor, unit = 1.0, "1"
    return Item(column, role, stream, tuple(places), factor, unit, si_factor, si, order)


def _suffix(base: Base, keys: list[tuple[str, Base]], name: str) -> str:
    return f" by {base.column}" if sum(other == name for other, _ in keys) > 1 else ""


def _axes(words: str | None) -> Array:
    found = axes_of(words or "flu")
    return np.eye(3) if found is None else found
