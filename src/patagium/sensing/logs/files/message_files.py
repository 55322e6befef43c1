"""Readers of recordings of messages: ROS 1 and ROS 2 bags by rosbags, and MCAP files.

Numbers inside messages are named by dotted path, whatever library decoded the message. Paths are
`pose.pose.position.x` or `position[2]`. Brackets also take a name: that of a joint where
the message lists names beside its arrays, that of a frame or an id where the message holds parts
(`transforms[base_link]`). What the first message lacks is found in the first 200 of a topic: named
parts, parts that are absent or null in JSON or Protobuf, and a stamp that is not 0, which is none.
Message definitions that a log lacks come from rosbags' collections, and a note says so. The parts
of one recording are read as one log. Attachments and metadata of MCAP files are not read.
"""

from __future__ import annotations

import heapq
import json
import math
import re
from bz2 import BZ2Decompressor
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from importlib import import_module
from itertools import islice, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from patagium.errors import LogError, PatagiumError
from patagium.reading import check_room, expanded
from patagium.sensing.logs.files.channels import (
    NO_STAMP,
    Block,
    Channel,
    LogFile,
    Request,
    StampSource,
    Topic,
    one_line,
    reading,
)

_STEP = re.compile(r"\.?([^.\[\]]+)|\[((?:[^\[\]]|\[[^\[\]]*\])*)\]")
_END = re.compile(r"[.\[]|$")
_MOST_ENTRIES = 64
_MOST_PARTS = 16
_MOST_WORDS = 200
"""Characters of an error in a description."""
_FIRST = 200
"""Messages of a topic among which what the first of them lacks is found."""
_ROWS = 4096
_NAMES = ("name", "names", "joint_names")
_KEYS = ("child_frame_id", "name", "id")
_NULL = "absent or null in the first messages"
NO_MESSAGE = "no message in the log"
"""Problem of a topic without messages."""
_SECONDS = ("sec", "secs", "seconds")
_NUMBERS = {"bool": bool | np.bool_, "int": int | np.integer, "float": float | np.floating}
_NANOS = ("nanosec", "nsec", "nsecs", "nanos", "nanoseconds")


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


def message_topic(
    name: str, kind: str, count: int | None, decode: Callable[[], Any], known: Topic | None = None
) -> Topic:
    """Topic of messages, described by its first message and by what that lacks and others have.

    A message that cannot be decoded makes a topic with a `problem`, so that one damaged topic
    does not prevent the others from being read.

    Args:
        name: Name of the topic.
        kind: Type of its messages.
        count: Number of messages, if known.
        decode: Function that returns a decoded message.
        known: The topic by the messages before it, which is returned if it cannot be decoded.
    """
    held = known or Topic(name, kind, count)
    channels, aliases, unplaced = dict(held.channels), dict(held.aliases), dict(held.unplaced)
    own = dict[str, str]()
    try:
        first = decode()
        for path, dtype, other in _leaves(first, "", None):
            if not dtype:
                unplaced[path] = other
                continue
            own[path] = path
            channels.setdefault(path, Channel(path, dtype, unit_in_message(kind, path)))
            if other:
                aliases.setdefault(other, path)
    except Exception as problem:  # decoders raise their own errors
        ours = isinstance(problem, LogError)
        reason = str(problem) if ours else f"cannot be decoded: {one_line(problem, _MOST_WORDS)}"
        return known or Topic(name, kind, count, problem=reason)
    parts = {path[: mark.start()] for path in channels for mark in _END.finditer(path)}
    unplaced = {path: why for path, why in unplaced.items() if path not in parts}
    place, stamp = _first_stamp(first, own_stamp(own, next(iter(channels), "")))
    stamped, headed = held.stamped or bool(place), held.base.kind == "header" or bool(stamp)
    return replace(
        held,
        channels=channels,
        base=StampSource("header" if headed else "received", held.base.column or place),
        aliases=aliases,
        guess=f"{name}: its stamps are 0; it is stamped as received" * (stamped and not headed),
        unplaced=unplaced,
        stamped=stamped,
        varied=held.varied or bool(aliases) or (bool(known) and own.keys() != held.channels.keys()),
    )


def _is_open(topic: Topic, encoding: str = "") -> bool:
    """Whether messages may have what those before lack: parts, or a stamp that is not 0."""
    lacks = topic.varied or _NULL in topic.unplaced.values() or encoding == "json"
    return not topic.problem and (lacks or bool(topic.guess))


def message_blocks(
    streams: Sequence[Iterable[Message]], wanted: Sequence[Request]
) -> Iterator[Block]:
    """Requested rows in the order in which messages were received.

    A part that a message lacks is NaN; a message without any that is requested makes no row.

    Args:
        streams: Messages of each file of a recording, by the time they were received.
        wanted: Requests.

    Raises:
        Exception: That of a damaged message, after the rows before it.
    """
    rows = [_Rows(key, one) for key, one in enumerate(wanted)]
    listeners: dict[str, list[_Rows]] = defaultdict(list)
    for row in rows:
        listeners[wanted[row.key].topic].append(row)
    rest = (row.block() for row in rows if row.stamps)
    try:
        for message in heapq.merge(*streams, key=lambda message: message.received):
            if not listeners[message.topic]:
                continue
            content = message.decode()
            for row in listeners[message.topic]:
                row.add(content, message.received)
                if len(row.stamps) >= _ROWS:
                    yield row.block()
    except Exception:  # libraries raise their own; what was read comes first
        yield from rest
        raise
    yield from rest


class _Rows:
    """Rows of one request that are collected for a block."""

    def __init__(self, key: int, wanted: Request) -> None:
        self.key, self.wanted = key, wanted
        self.getters = [getter(path) for path in wanted.fields]
        self._stamp = getter(wanted.base.column)
        self.stamps: list[int] = []
        self.values: list[list[float]] = []

    def add(self, content: Any, received: int) -> None:
        values = [math.nan] * len(self.getters)
        found = not values
        for k, get in enumerate(self.getters):
            with suppress(KeyError, IndexError, TypeError):  # a part, where others have a number
                value = get(content)
                values[k], found = math.nan if value is None else float(value), True
        if not found:
            return
        stamp, base = NO_STAMP, self.wanted.base
        with suppress(KeyError, IndexError, TypeError):  # of a part that the message lacks
            whole = base.kind == "received"
            stamp = received if whole else _as_stamp(self._stamp(content), base.factor)
        self.stamps.append(stamp if abs(stamp) < 2**62 else NO_STAMP)
        self.values.append(values)

    def block(self) -> Block:
        stamps = np.array(self.stamps, np.int64)
        values = np.array(self.values, float).reshape(len(stamps), len(self.getters))
        self.stamps, self.values = [], []
        return Block(self.key, stamps, values)


def getter(path: str) -> Callable[[Any], Any]:
    """Function that takes the value at a path out of a message.

    Args:
        path: Names with dots, indices or names in brackets; of the keys of a dict, which may hold
            dots themselves, the longest that it begins with is taken.

    Returns:
        The function; it raises KeyError or IndexError if a message has no such part, and a null
        has None as any part.
    """
    steps = [*_STEP.finditer(path)]
    ends = [(step.end(), k) for k, step in enumerate(steps, 1)]
    keys = [[(path[a.start(1) : b], k) for b, k in ends[n:][::-1]] for n, a in enumerate(steps)]

    def get(message: Any) -> Any:
        above, value, k = None, message, 0
        while k < len(steps) and value is not None:
            name, key = steps[k].groups()
            if name:
                held = value if isinstance(value, dict) else ()
                name, k = next((one for one in keys[k] if one[0] in held), keys[k][-1])
                above, value = value, member(value, name)
            else:
                above, value, k = value, _entry(above, value, key), k + 1
        return value

    return get


def member(value: Any, name: str) -> Any:
    """Part of a message or a dict by its name; a map of Protobuf is a dict with keys of text.

    Raises:
        KeyError: If there is no such part, or Protobuf has a default in place of an absent one.
    """
    if isinstance(value, dict):
        return value[name]
    if described := getattr(value, "DESCRIPTOR", None):
        field = described.fields_by_name[name]
        if field.has_presence and not (field.has_default_value or value.HasField(name)):
            raise KeyError(name)
    try:
        part = getattr(value, name)
    except AttributeError:
        raise KeyError(name) from None
    return {str(key): one for key, one in part.items()} if isinstance(part, Mapping) else part


def _entry(above: Any, value: Any, key: str) -> Any:
    if isinstance(value, dict):
        return value[key]
    names = _names(above, value)
    if key in names:
        return value[names.index(key)]
    if not key.isdigit() or (names and names[int(key)]):
        raise KeyError(key)
    return value[int(key)]


def _held(value: Any, names: Sequence[str]) -> Iterator[Any]:
    """Parts of a message under those of the names that it has."""
    for name in names:
        if name in value if isinstance(value, dict) else hasattr(value, name):
            with suppress(KeyError):  # of Protobuf
                yield member(value, name)


def _names(above: Any, value: Any) -> list[str]:
    """Names of the elements of a list, from a field beside it or their own; "" where none is."""
    for names in _held(above, _NAMES):
        if isinstance(names, Sequence) and not isinstance(names, str) and len(names) == len(value):
            return [*map(str, names)]
    if isinstance(value, np.ndarray) or isinstance(next(iter(value), 0), int | float | str):
        return []
    held = ([key for key in _held(part, _KEYS) if isinstance(key, str)] for part in value)
    return [next(filter(None, keys), "") for keys in held]


def _leaves(value: Any, path: str, above: Any) -> Iterator[tuple[str, str, str]]:
    """Path, type and alternative path of every number; of all else, no type and the reason."""
    kind = next((word for word, types in _NUMBERS.items() if isinstance(value, types)), "")
    if kind:
        yield path, kind, ""
    elif isinstance(value, str):
        yield path, "", f"text such as {value[:40]!r}"
    elif isinstance(value, bytes) or value is None:
        yield path, "", _NULL if value is None else "bytes"
    elif hasattr(value, "__getitem__") and not isinstance(value, dict):  # or a field of Protobuf
        yield from _entries(value, path, above)
    else:
        for name, inner in _members(value):
            if not (path == "" and name == "header"):
                yield from _leaves(inner, f"{path}.{name}" if path else name, value)


def _entries(value: Any, path: str, above: Any) -> Iterator[tuple[str, str, str]]:
    names = _names(above, value)
    numeric = isinstance(value, np.ndarray)
    if numeric and value.dtype == np.uint8 and len(value) > _MOST_ENTRIES:
        yield path, "", f"{len(value)} bytes, as of an image or a cloud of points"
        return
    most = _MOST_ENTRIES if numeric else _MOST_PARTS
    if not len(value):
        yield path, "", "a list that is empty in the first message"
    if len(value) > most:
        yield f"{path}[{most}] to [{len(value) - 1}]", "", f"only the first {most} are read"
    for index, entry in enumerate(value[:most]):
        key = names[index] if names else ""
        own = f"{path}[{key or index}]"
        for leaf, dtype, other in _leaves(entry, own, value):
            numbered = f"{path}[{index}]{leaf[len(own) :]}" if key else ""
            yield leaf, dtype, numbered if dtype else other


def _members(value: Any) -> Iterable[tuple[str, Any]]:
    """Parts of a dict, of a message of rosbags, which is a dataclass, or of one of Protobuf.

    One that is absent in Protobuf is null.
    """
    if isinstance(value, dict):
        return value.items()
    names = [n for n in getattr(value, "__dataclass_fields__", ()) if not n.startswith("_")]
    names += [field.name for field in getattr(getattr(value, "DESCRIPTOR", None), "fields", ())]
    return [(name, next(_held(value, [name]), None)) for name in names]


def find_stamp(known: Mapping[str, str], path: str) -> str:
    """Path of a stamp of seconds and nanoseconds among known ones; "" if it is none."""
    for ends in product(_SECONDS, _NANOS):
        if all(f"{path}.{end}" in known for end in ends):
            return known[f"{path}.{ends[0]}"].rpartition(".")[0]
    return ""


def own_stamp(known: Mapping[str, str], field: str) -> str:
    """Path of the stamp in the header of the innermost entry that holds a number; "" if none."""
    while field := field.rpartition("]")[0]:
        if own := find_stamp(known, f"{field}].header.stamp"):
            return own
    return ""


def _first_stamp(message: Any, own: str) -> tuple[str, int]:
    """Path of the stamp of a message, that of a part before its own, and the stamp [ns]."""
    for place in (own, "header.stamp", "timestamp", "stamp", "time"):
        with suppress(KeyError, IndexError, TypeError):
            if place and (stamp := _whole(getter(place)(message))) is not None:
                return place, stamp
    return "", 0


def _whole(stamp: Any) -> int | None:
    for seconds, nanos in product(_held(stamp, _SECONDS), _held(stamp, _NANOS)):
        with suppress(TypeError, ValueError):
            return int(seconds) * 10**9 + int(nanos)
    return None


def _as_stamp(value: Any, factor: float) -> int:
    if isinstance(value, int | np.integer):
        return int(value) * round(factor) if factor >= 1 else round(int(value) * factor)
    whole = _whole(value)
    if whole is not None:
        return whole or NO_STAMP
    number = math.nan if value is None else float(value) * factor
    return round(number) if math.isfinite(number) else NO_STAMP


_BY_TYPE = (
    ("Imu", "linear_acceleration", "m/s^2"),
    ("Imu", "angular_velocity", "rad/s"),
    ("MagneticField", "magnetic_field.", "T"),
    ("FluidPressure", "fluid_pressure", "Pa"),
    ("Temperature", "temperature", "degC"),
    ("Range", "range", "m"),
    ("JointState", "position", "rad"),
    ("JointState", "vel", "rad/s"),
    ("JointState", "", "N m"),
)
_BY_PATH = {
    "1": ("orientation", "rotation"),
    "m/s^2": ("linear_acceleration",),
    "rad/s": ("angular_velocity", "angular."),
    "m": ("position.", "translation.", "point."),
    "m/s": ("linear.",),
    "N": ("force.",),
    "N m": ("torque.",),
}
_SHARED = ("geometry_msgs", "nav_msgs", "sensor_msgs", "tf2_msgs", "tf")


def unit_in_message(kind: str, path: str) -> str:
    """Unit of a number of a message; empty where the definition states none.

    Args:
        kind: Type of the message, such as `sensor_msgs/msg/Imu`.
        path: Path of the number.
    """
    package, _, name = kind.rpartition("/")
    if package.partition("/")[0] not in _SHARED or "covariance" in path:
        return ""
    if name == "JointState" and path[-3:] in ("[x]", "[y]", "[z]"):
        return ""  # of a joint that slides
    for own, start, unit in _BY_TYPE:
        if name == own and path.startswith(start):
            return unit
    words = path if "." in path else ""
    told = (unit for unit, parts in _BY_PATH.items() if any(part in words for part in parts))
    unit = next(told, "")
    return f"{unit}^2" if unit and name.startswith("Accel") else unit


Decoder = Callable[[bytes], Any]


class MessageTypes:
    """Decoders of ROS messages, one for each type.

    Args:
        ros2: Whether messages are of ROS 2 (CDR).
        distribution: ROS distribution that wrote the log; its collection of types is used where
            the log has no definition. None takes the latest.

    Attributes:
        borrowed: Types without a definition in the log, and the collection that has theirs.
    """

    def __init__(self, *, ros2: bool, distribution: str | None = None) -> None:
        self._ros2, self._distribution = ros2, distribution
        self._made = cache(self._make)
        self.borrowed: dict[str, str] = {}

    def decoder(self, kind: str, definition: str, language: str) -> Decoder:
        """Function that decodes messages of a type.

        Args:
            kind: Name of the type, such as `sensor_msgs/msg/Imu`.
            definition: Its definition; empty takes that of a collection.
            language: "msg" or "idl".

        Raises:
            LogError: If there is no definition, or it cannot be read.
        """
        if kind.count("/") == 1:
            kind = kind.replace("/", "/msg/")  # as ROS 1 has it
        return self._made(kind, definition, language)

    def _make(self, kind: str, definition: str, language: str) -> Decoder:
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

        if not definition.strip():
            store, named = self._collection()
            if kind not in store.fielddefs:
                raise LogError(
                    f"the log carries no definition of {kind}, and rosbags' types of {named} "
                    "have none"
                )
            self.borrowed[kind] = named
        else:
            store = get_typestore(Stores.EMPTY)
            try:
                if language == "idl":
                    types = _idl(definition, get_types_from_idl)
                else:
                    types = get_types_from_msg(definition, kind)
                store.register({name: it for name, it in types.items() if name not in store.types})
            except Exception as problem:  # parsers raise their own
                raise LogError(f"the definition of {kind} cannot be read: {problem}") from problem
        read = store.deserialize_cdr if self._ros2 else store.deserialize_ros1
        return lambda content: read(content, kind)

    def _collection(self) -> tuple[Any, str]:
        from rosbags.typesys import Stores, get_typestore

        if not self._ros2:
            return get_typestore(Stores.ROS1_NOETIC), "ROS 1 Noetic"
        with suppress(ValueError):  # of one that rosbags does not know
            wanted = Stores(f"ros2_{(self._distribution or '').lower()}")
            return get_typestore(wanted), f"ROS 2 {self._distribution}"
        return get_typestore(Stores.LATEST), "the latest ROS 2"


def _idl(definition: str, parse: Callable[[str], Any]) -> dict[str, Any]:
    line = "=" * 80 + "\n"
    parts = [definition]
    if definition.startswith(f"{line}IDL: "):
        parts = [part.partition("\n")[2] for part in definition.split(line)[1:]]
    plain = (re.sub(r"(?m)^\s*#.*", "", part) for part in parts)  # what it includes is in others
    return {name: found for part in plain for name, found in parse(part).items()}


class _Recording(LogFile):
    """Open recording of messages, in one part or several."""

    _parts: list[Any]
    _messages: Callable[[Any, set[str]], Iterator[Message]]  # of a part, on some topics

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows in the order in which their messages were received."""
        topics = {one.topic for one in wanted}
        with reading(self.path, self.format):
            streams = [self._messages(part, topics) for part in self._parts]
            yield from message_blocks(streams, wanted)


class BagFile(_Recording):
    """Open bag, or the open parts of one.

    Args:
        paths: `.bag` files; or `.db3` files, or folders with a metadata.yaml.

    Raises:
        LogError: If a bag cannot be read.
    """

    def __init__(self, paths: list[Path]) -> None:
        super().__init__(*paths)
        self._ros2 = paths[0].suffix != ".bag"
        self.format = "ROS 2 bag" if self._ros2 else "ROS 1 bag"
        self._parts = []
        try:
            with reading(self.path, self.format):
                self._parts = [self._open(path) for path in paths]
                metadata = getattr(getattr(self._parts[0], "storage", None), "metadata", None)
                distribution = getattr(metadata, "ros_distro", None)
                self._types = MessageTypes(ros2=self._ros2, distribution=distribution)
                held: dict[str, list[tuple[Any, Any]]] = defaultdict(list)
                for reader in self._parts:
                    for connection in reader.connections:
                        held[connection.topic].append((reader, connection))
                self.topics = {name: self._topic(name, held[name]) for name in sorted(held)}
        except BaseException:
            self.close()
            raise
        for kind, named in sorted(self._types.borrowed.items()):
            self.notes.append(f"the bag carries no definition of {kind}: that of {named} is used")

    def close(self) -> None:
        """Close the files."""
        for reader in self._parts:
            with suppress(Exception):  # one that failed to open
                reader.close()
        self._parts = []

    def _open(self, path: Path) -> Any:
        reader: Any = import_module(f"rosbags.rosbag{1 + self._ros2}").Reader(path)
        reader.open()
        if not self._ros2:
            _bound_chunks(path, reader)
        return reader

    def _topic(self, name: str, held: list[tuple[Any, Any]]) -> Topic:
        """Topic of a bag, described by the first messages of its publishers."""
        kind = held[0][1].msgtype
        count = sum(connection.msgcount for _, connection in held)

        decoded = (
            self._decoder(connection)(content)
            for reader, connection in held
            for _, _, content in islice(reader.messages(connections=[connection]), _FIRST)
        )

        def following() -> Any:
            for content in decoded:
                return content
            raise LogError(NO_MESSAGE)

        topic, known = message_topic(name, kind, count, following), None
        while _is_open(topic) and topic is not known:  # to the last message, or a damaged one
            topic, known = message_topic(name, kind, count, following, topic), topic
        return replace(topic, count=0) if topic.problem == NO_MESSAGE else topic

    def _decoder(self, connection: Any) -> Any:
        language = "idl" if connection.msgdef.format.name == "IDL" else "msg"
        return self._types.decoder(connection.msgtype, connection.msgdef.data, language)

    def _messages(self, reader: Any, topics: set[str]) -> Iterator[Message]:
        chosen = [one for one in reader.connections if one.topic in topics]
        for connection, stamp, content in reader.messages(connections=chosen) if chosen else ():
            decode = partial(self._decoder(connection), content)
            yield Message(connection.topic, stamp, decode)


def _bound_chunks(path: Path, reader: Any) -> None:
    """Let a reader of ROS 1 refuse compressed chunks that the memory has no room for."""
    from rosbags.rosbag1.reader import decompressors

    lz4 = import_module("lz4.frame").LZ4FrameDecompressor  # that of rosbags, without types
    streams = {decompressors["bz2"]: BZ2Decompressor, decompressors["lz4"]: lz4}
    for place, chunk in reader.chunks.items():
        if chunk.decompressor in streams:
            stream = streams[chunk.decompressor]
            bounded = partial(lambda make, content: expanded(path, make(), content), stream)
            reader.chunks[place] = chunk._replace(decompressor=bounded)


class McapFile(_Recording):
    """Open MCAP file, or the parts of one recording."""

    format = "MCAP"

    def __init__(self, paths: list[Path]) -> None:
        super().__init__(*paths)
        self._parts = paths
        self._types = {"cdr": MessageTypes(ros2=True), "ros1": MessageTypes(ros2=False)}
        self._decoder = cache(self._make)
        self._cut: set[Path] = set()
        with reading(self.path, self.format):
            self.topics = self._look()
        for types in self._types.values():
            for kind, named in sorted(types.borrowed.items()):
                self.notes.append(f"no definition of {kind} in the file: that of {named} is used")

    def _look(self) -> dict[str, Topic]:
        counts: Counter[str] = Counter()
        looked: Counter[str] = Counter()
        self.topics = topics = dict[str, Topic]()
        for path in self._parts:
            for schema, channel, message in self._records(path, None, counts):
                name, encoding = channel.topic, channel.message_encoding
                known = topics.get(name)
                if known is None or (_is_open(known, encoding) and looked[name] < _FIRST):
                    kind = schema.name if schema is not None else encoding
                    decode = partial(self._decoded, schema, channel, message)
                    looked[name] += 1
                    topics[name] = message_topic(name, kind, None, decode, known)
        for name in counts:
            topics.setdefault(name, Topic(name, "", 0, problem=NO_MESSAGE))
        return {name: replace(topics[name], count=counts[name]) for name in sorted(topics)}

    def _records(
        self, path: Path, topics: set[str] | None, counts: Counter[str] | None = None
    ) -> Iterator[tuple[Any, Any, Any]]:
        """Messages by the time they were logged, or as they come if the file has no index.

        With `counts`, only the first message of each topic, or the first ones if others may have
        what it lacks, are read where the index states how many there are.
        """
        from mcap.reader import SeekingReader

        with path.open("rb") as file:
            summary = None if path in self._cut else self._summary(path, file)
            if summary is None:
                for record in self._from_start(path, topics):
                    if counts is not None:
                        counts[record[1].topic] += 1
                    yield record
                return
            reader = SeekingReader(file)
            if counts is None:
                yield from reader.iter_messages(topics=topics)
                return
            for key, channel in summary.channels.items():
                counts[channel.topic] += summary.statistics.channel_message_counts.get(key, 0)
                for record in islice(reader.iter_messages(topics=[channel.topic]), _FIRST):
                    yield record
                    if not _is_open(self.topics[channel.topic], channel.message_encoding):
                        break

    def _summary(self, path: Path, file: Any) -> Any:
        from mcap.exceptions import InvalidMagic
        from mcap.reader import SeekingReader

        try:
            summary = SeekingReader(file).get_summary()
            if summary is not None and summary.statistics and summary.chunk_indexes:
                largest = max(chunk.uncompressed_size for chunk in summary.chunk_indexes)
                check_room(path, largest, "a chunk")
                return summary
            reason = "it has no index"
        except (InvalidMagic, PatagiumError):
            raise
        except Exception as problem:
            reason = f"its end cannot be read ({type(problem).__name__})"
        self._cut.add(path)
        self.notes.append(f"{path.name}: {reason}; it is read from its start")
        return None

    def _from_start(self, path: Path, topics: set[str] | None) -> Iterator[tuple[Any, Any, Any]]:
        from mcap.reader import NonSeekingReader

        with path.open("rb") as file:
            messages = NonSeekingReader(file).iter_messages(topics=topics, log_time_order=False)
            got = 0
            try:
                for record in messages:
                    got += 1
                    yield record
            except Exception as problem:  # libraries raise their own
                if not got:
                    raise
                if topics is None:
                    reason = one_line(problem, _MOST_WORDS)
                    self.notes.append(f"{path.name}: breaks off after {got} message(s): {reason}")

    def _messages(self, path: Path, topics: set[str]) -> Iterator[Message]:
        for schema, channel, message in self._records(path, topics):
            decode = partial(self._decoded, schema, channel, message)
            yield Message(channel.topic, message.log_time, decode)

    def _decoded(self, schema: Any, channel: Any, message: Any) -> Any:
        told = (schema.name, schema.encoding, schema.data) if schema else ("", "", b"")
        return self._decoder(channel.message_encoding, *told)(message.data)

    def _make(self, encoding: str, name: str, written: str, definition: bytes) -> Decoder:
        if encoding == "json":
            return json.loads
        if encoding == "protobuf" and name:
            return _protobuf(name, definition)
        if encoding in self._types and name:
            language, text = written.removeprefix("ros2"), definition.decode("utf-8", "replace")
            return self._types[encoding].decoder(name, text, language)
        raise LogError(f"expected messages of ROS, JSON or Protobuf, found {encoding!r}")


def _protobuf(name: str, definition: bytes) -> Decoder:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

    pool = descriptor_pool.DescriptorPool()
    stamp = descriptor_pb2.FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
    files = descriptor_pb2.FileDescriptorSet.FromString(definition).file
    waiting = {file.name: file for file in [stamp, *files]}

    def add(name: str) -> None:
        if file := waiting.pop(name, None):
            for one in file.dependency:
                add(one)
            pool.Add(file)

    while waiting:  # in any order
        add(next(iter(waiting)))
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
    return kind.FromString  # type: ignore[no-any-return]
