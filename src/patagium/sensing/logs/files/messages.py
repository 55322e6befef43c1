"""Numbers inside messages by dotted path, whatever library decoded the message.

Paths are `pose.pose.position.x` or `position[2]`. Brackets also take a name: that of a joint where
the message lists names beside its arrays, that of a frame or an id where the message holds parts
(`transforms[base_link]`). All messages of a topic are expected to have the parts of its first one.
"""

from __future__ import annotations

import heapq
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import (
    NO_STAMP,
    Block,
    Channel,
    Request,
    StampSource,
    Topic,
)
from patagium.sensing.logs.files.ros_units import unit_in_message

_STEP = re.compile(r"\.?([^.\[\]]+)|\[([^\]]*)\]")
_MOST_ENTRIES = 64
_MOST_PARTS = 16
_ROWS = 4096
_NAMES = ("name", "names", "joint_names")
_KEYS = ("child_frame_id", "name", "id")
NO_MESSAGE = "no message in the log"
"""Problem of a topic without messages."""
_SECONDS = ("sec", "secs", "seconds")
_NANOS = ("nanosec", "nsec", "nsecs", "nanos", "nanoseconds")

Getter = Callable[[Any], Any]


class Message(NamedTuple):
    """Message that is decoded when its content is needed.

    Attributes:
        topic: Name of its topic.
        received: Time at which it was written to the log [ns].
        decode: Function that returns the decoded content.
    """

    topic: str
    received: int
    decode: Callable[[], Any]


def message_topic(name: str, kind: str, count: int | None, decode: Callable[[], Any]) -> Topic:
    """Topic of messages, described by its first message.

    A message that cannot be decoded makes a topic with a `problem`, so that one damaged topic
    does not prevent the others from being read.

    Args:
        name: Name of the topic.
        kind: Type of its messages.
        count: Number of messages, if known.
        decode: Function that returns the decoded first message.
    """
    channels, aliases = {}, {}
    try:
        first = decode()
        for path, dtype, other in _leaves(first, "", None):
            channels[path] = Channel(path, dtype, unit_in_message(kind, path))
            if other:
                aliases[other] = path
    except LogError as problem:
        return unreadable_topic(name, kind, count, str(problem))
    except Exception as problem:  # decoders raise their own errors
        return unreadable_topic(name, kind, count, f"cannot be decoded: {one_line(problem)}")
    stamp = _stamp(first, _stamp_path(first, list(channels)))
    base = StampSource("header" if stamp not in (None, 0) else "received")
    return Topic(name, kind, count, channels, base, aliases=aliases)


def message_blocks(
    streams: Sequence[Iterable[Message]], wanted: Sequence[Request]
) -> Iterator[Block]:
    """Requested rows in the order in which messages were received.

    A message without a part that is requested by name makes no row.

    Args:
        streams: Messages of each file of a recording, by the time they were received.
        wanted: Requests.
    """
    rows = [_Rows(key, one) for key, one in enumerate(wanted)]
    listeners: dict[str, list[_Rows]] = defaultdict(list)
    for row in rows:
        listeners[wanted[row.key].topic].append(row)
    for message in heapq.merge(*streams, key=lambda message: message.received):
        if not listeners[message.topic]:
            continue
        content = message.decode()
        for row in listeners[message.topic]:
            row.add(content, message.received)
            if len(row.stamps) >= _ROWS:
                yield row.block()
    for row in rows:
        if row.stamps:
            yield row.block()


def unreadable_topic(name: str, kind: str, count: int | None, problem: str) -> Topic:
    """Topic without numbers that says why it cannot be read."""
    return Topic(name, kind, count, {}, StampSource("received"), problem)


def one_line(problem: Exception) -> str:
    """Message of an error on one line of at most 200 characters."""
    return " ".join(str(problem).split())[:200] or type(problem).__name__


class _Rows:
    """Rows of one request that are collected for a block."""

    def __init__(self, key: int, wanted: Request) -> None:
        self.key, self.wanted = key, wanted
        self.getters = [getter(path) for path in wanted.fields]
        self.stamps: list[int] = []
        self.values: list[list[float]] = []
        self._path: str | None = None

    def add(self, content: Any, received: int) -> None:
        try:
            values = [float(get(content)) for get in self.getters]
        except (KeyError, IndexError):
            return
        self.stamps.append(self._stamp(content, received))
        self.values.append(values)

    def block(self) -> Block:
        stamps = np.array(self.stamps, np.int64)
        values = np.array(self.values, float).reshape(len(stamps), len(self.getters))
        self.stamps, self.values = [], []
        return Block(self.key, stamps, values)

    def _stamp(self, content: Any, received: int) -> int:
        kind = self.wanted.base.kind
        if kind == "received":
            return received
        if kind == "column":
            return _as_stamp(getter(self.wanted.base.column)(content), self.wanted.base.factor)
        if self._path is None:
            self._path = _stamp_path(content, list(self.wanted.fields)) or ""
        stamp = _stamp(content, self._path)
        return NO_STAMP if stamp is None else stamp


def getter(path: str) -> Getter:
    """Function that takes the value at a path out of a message.

    Args:
        path: Names with dots, indices or names in brackets.

    Returns:
        The function; it raises KeyError or IndexError if a message has no such part.
    """
    steps = [(a, b, bool(a)) for a, b in _STEP.findall(path)]

    def get(message: Any) -> Any:
        above, value = None, message
        for name, key, by_name in steps:
            if by_name:
                above, value = value, member(value, name)
            else:
                value = _entry(above, value, key)
        return value

    return get


def member(value: Any, name: str) -> Any:
    """Part of a message or a dict by its name.

    Raises:
        KeyError: If there is no such part.
    """
    if isinstance(value, dict):
        return value[name]
    try:
        return getattr(value, name)
    except AttributeError:
        raise KeyError(name) from None


def _entry(above: Any, value: Any, key: str) -> Any:
    if isinstance(value, dict):
        return value[key]
    if key.lstrip("-").isdigit():
        return value[int(key)]
    names = _names_beside(above, value)
    if names is not None and key in names:
        return value[names.index(key)]
    for part in value:
        if _key_of(part) == key:
            return part
    raise KeyError(key)


def _names_beside(above: Any, value: Any) -> list[str] | None:
    for word in _NAMES:
        try:
            names = member(above, word)
        except KeyError:
            continue
        if isinstance(names, Sequence) and not isinstance(names, str) and len(names) == len(value):
            return list(names)
    return None


def _key_of(part: Any) -> str | None:
    for word in _KEYS:
        try:
            key = member(part, word)
        except KeyError:
            continue
        if isinstance(key, str) and key:
            return key
    return None


def _leaves(value: Any, path: str, above: Any) -> Iterator[tuple[str, str, str]]:
    """Path, type and alternative path of every number."""
    if isinstance(value, bool | np.bool_):
        yield path, "bool", ""
    elif isinstance(value, int | np.integer):
        yield path, "int", ""
    elif isinstance(value, float | np.floating):
        yield path, "float", ""
    elif isinstance(value, str | bytes) or value is None:
        return
    elif isinstance(value, np.ndarray) or _is_list(value):
        yield from _entries(value, path, above)
    else:
        for name, inner in _members(value):
            if not (path == "" and name == "header"):
                yield from _leaves(inner, f"{path}.{name}" if path else name, value)


def _entries(value: Any, path: str, above: Any) -> Iterator[tuple[str, str, str]]:
    names = _names_beside(above, value) if len(value) else None
    numeric = isinstance(value, np.ndarray)
    if numeric and value.dtype == np.uint8 and len(value) > _MOST_ENTRIES:
        return  # an image, a cloud of points
    for index, entry in enumerate(value[: _MOST_ENTRIES if numeric else _MOST_PARTS]):
        key = names[index] if names is not None else _key_of(entry)
        own = f"{path}[{key if key else index}]"
        for leaf, dtype, _ in _leaves(entry, own, value):
            yield leaf, dtype, (f"{path}[{index}]{leaf[len(own) :]}" if key else "")


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple) or (
        hasattr(value, "__len__") and hasattr(value, "__getitem__") and not isinstance(value, dict)
    )


def _members(value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        yield from value.items()
        return
    fields = getattr(value, "__dataclass_fields__", None)
    if fields is not None:
        names = [name for name in fields if not name.startswith("_")]
    else:
        descriptor = getattr(value, "DESCRIPTOR", None)
        names = [field.name for field in descriptor.fields] if descriptor is not None else []
    for name in names:
        yield name, getattr(value, name)


def _stamp_path(message: Any, fields: list[str]) -> str | None:
    """Path of the stamp in a message; the stamp of the named part comes first."""
    prefix = fields[0].rpartition("]")[0] + "]" if fields and "]" in fields[0] else ""
    while prefix.count("]") > 1 and _stamp(message, f"{prefix}.header.stamp") is None:
        prefix = prefix[: prefix.rindex("[")].rpartition("]")[0] + "]"
    places = [f"{prefix}.header.stamp"] if prefix else []
    for place in [*places, "header.stamp", "timestamp", "stamp", "time"]:
        if _stamp(message, place) is not None:
            return place
    return None


def _stamp(message: Any, path: str | None) -> int | None:
    if not path:
        return None
    try:
        stamp = getter(path)(message)
    except (KeyError, IndexError, TypeError):
        return None
    for seconds in _SECONDS:
        for nanos in _NANOS:
            try:
                return int(member(stamp, seconds)) * 10**9 + int(member(stamp, nanos))
            except (KeyError, TypeError, ValueError):
                continue
    return None


def _as_stamp(value: Any, factor: float) -> int:
    whole = _stamp({"stamp": value}, "stamp")
    if whole is not None:
        return whole
    if isinstance(value, int | np.integer):
        return int(value) * round(factor) if factor >= 1 else round(int(value) * factor)
    number = float(value) * factor
    return round(number) if abs(number) < 2.0**62 else NO_STAMP
