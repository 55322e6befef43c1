"""Numbers inside messages, by dotted path, whatever library made the message.

`pose.pose.position.x`, `position[2]`; in brackets also a name: of a joint where the message
lists names beside its arrays, of a frame or an id where it holds parts (`transforms[base_link]`).
Neglected: paths through parts whose kind changes from message to message.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from patagium.sensing.logs.files.channels import (
    NO_STAMP,
    Base,
    Block,
    Channel,
    Topic,
    Wanted,
)
from patagium.sensing.logs.files.ros_units import unit_in_message

_STEP = re.compile(r"\.?([^.\[\]]+)|\[([^\]]*)\]")
_MOST_ENTRIES = 64
_MOST_PARTS = 16
_ROWS = 4096
_NAMES = ("name", "names", "joint_names")
_KEYS = ("child_frame_id", "name", "id")
_SECONDS = ("sec", "secs", "seconds")
_NANOS = ("nanosec", "nsec", "nsecs", "nanos", "nanoseconds")

Getter = Callable[[Any], Any]


class Message(NamedTuple):
    """A message that may yet have to be decoded.

    Attributes:
        topic: Its name.
        received: When it was written to the log [ns].
        decode: What makes the message of its bytes.
    """

    topic: str
    received: int
    decode: Callable[[], Any]


def message_topic(name: str, kind: str, count: int | None, first: Any) -> Topic:
    """The topic of messages like its first one.

    Args:
        name: Its name.
        kind: Its type.
        count: Messages, if known.
        first: Its first message.
    """
    channels, aliases = {}, {}
    for path, dtype, other in _leaves(first, "", None):
        channels[path] = Channel(path, dtype, unit_in_message(kind, path))
        if other:
            aliases[other] = path
    stamp = _stamp(first, _stamp_path(first, list(channels)))
    base = Base("header" if stamp not in (None, 0) else "received")
    return Topic(name, kind, count, channels, base, aliases=aliases)


def message_blocks(
    messages: Iterable[Message], wanted: Sequence[Wanted], skip: Sequence[int]
) -> Iterator[Block]:
    """Rows of what is wanted, as messages come.

    A message that does not hold a part that was asked for by name makes no row.

    Args:
        messages: In the order of the log.
        wanted: What to read.
        skip: Messages of each that were read before.
    """
    rows = [_Rows(key, one) for key, one in enumerate(wanted)]
    listeners: dict[str, list[_Rows]] = defaultdict(list)
    for row in rows:
        listeners[wanted[row.key].topic].append(row)
    passed: dict[str, int] = defaultdict(int)
    for message in messages:
        passed[message.topic] += 1
        number = passed[message.topic]
        eager = [row for row in listeners[message.topic] if number > skip[row.key]]
        if not eager:
            continue
        content = message.decode()
        for row in eager:
            row.add(content, message.received, number)
            if len(row.stamps) >= _ROWS:
                yield row.block()
    for row in rows:
        if row.stamps:
            yield row.block()


class _Rows:
    """Rows of one wanted topic that wait to be a block."""

    def __init__(self, key: int, wanted: Wanted) -> None:
        self.key, self.wanted = key, wanted
        self.getters = [getter(path) for path in wanted.fields]
        self.stamps: list[int] = []
        self.values: list[list[float]] = []
        self.consumed = 0
        self._path: str | None = None

    def add(self, content: Any, received: int, number: int) -> None:
        self.consumed = number
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
        return Block(self.key, stamps, values, self.consumed)

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
    """What takes the value at a path out of a message.

    Args:
        path: Names with dots, indices or names in brackets.
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
    """What a message or a dict holds by a name; KeyError if nothing."""
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
    """Path, type and other path of every number."""
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
    """Path of the stamp a message carries, that of its named part first."""
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
