"""MCAP files: messages of ROS 1 and ROS 2, JSON, and Protobuf where its package is there.

A file whose recording was cut off has no index: it is read from its start to where it ends, and a
note says so. Neglected: attachments, metadata, other encodings.
"""

from __future__ import annotations

import heapq
import json
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import Base, Block, Topic, Wanted, reading
from patagium.sensing.logs.files.messages import Message, message_blocks, message_topic
from patagium.sensing.logs.files.ros_types import MessageTypes


class McapFile:
    """An MCAP file, or the parts of one recording; see `LogFile`.

    Args:
        paths: The parts.
    """

    format = "MCAP"

    def __init__(self, paths: list[Path]) -> None:
        self.path = paths[0] if len(paths) == 1 else paths[0].parent
        self.notes: list[str] = []
        self._paths, self._types = paths, MessageTypes(ros2=True)
        self._old_types = MessageTypes(ros2=False)
        self._decoders: dict[tuple[Any, ...], Callable[[bytes], Any]] = {}
        self._cut: set[Path] = set()
        with reading(self.path, self.format):
            self.topics: dict[str, Topic] = self._look()
        for types in (self._types, self._old_types):
            for kind, named in sorted(types.borrowed.items()):
                self.notes.append(f"no definition of {kind} in the file: that of {named} is used")

    def blocks(self, wanted: tuple[Wanted, ...], skip: tuple[int, ...]) -> Iterator[Block]:
        """Rows of what is wanted, as they are mixed in the file."""
        with reading(self.path, self.format):
            yield from message_blocks(self._messages({w.topic for w in wanted}), wanted, skip)

    def close(self) -> None:
        """Nothing is held."""

    def _look(self) -> dict[str, Topic]:
        counts: Counter[str] = Counter()
        topics: dict[str, Topic] = {}
        for path in self._paths:
            for schema, channel, message in self._records(path, None, counts):
                if channel.topic not in topics:
                    topics[channel.topic] = self._topic(schema, channel, message)
        for name in [name for name in counts if name not in topics]:
            topics[name] = Topic(name, "", 0, {}, Base("received"), "no message in the log")
        return {
            name: Topic(name, t.kind, counts[name], t.channels, t.base, t.problem, t.aliases)
            for name, t in sorted(topics.items())
        }

    def _records(
        self, path: Path, topics: set[str] | None, counts: Counter[str] | None = None
    ) -> Iterator[tuple[Any, Any, Any]]:
        """Messages by the time they were logged; all of them when the file has no index.

        With `counts`, only the first of each topic if the index knows how many there are.
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
                yield from _first(reader.iter_messages(topics=[channel.topic]))

    def _summary(self, path: Path, file: Any) -> Any:
        from mcap.exceptions import InvalidMagic, McapError
        from mcap.reader import SeekingReader

        try:
            summary = SeekingReader(file).get_summary()
            if summary is not None and summary.statistics and summary.chunk_indexes:
                return summary
            reason = "it has no index"
        except InvalidMagic:
            raise
        except (McapError, OSError, ValueError, StopIteration, Exception) as problem:
            reason = f"its end cannot be read ({type(problem).__name__})"
        self._cut.add(path)
        self.notes.append(f"{path.name}: {reason}; it is read from its start")
        return None

    def _from_start(self, path: Path, topics: set[str] | None) -> Iterator[tuple[Any, Any, Any]]:
        from mcap.exceptions import McapError
        from mcap.reader import NonSeekingReader

        with path.open("rb") as file:
            messages = NonSeekingReader(file).iter_messages(topics=topics, log_time_order=False)
            got = 0
            while True:
                try:
                    record = next(messages, None)
                except (McapError, Exception) as problem:
                    if not got:
                        raise
                    note = f"{path.name}: breaks off after {got} message(s): {_short(problem)}"
                    if topics is None:
                        self.notes.append(note)
                    return
                if record is None:
                    return
                got += 1
                yield record

    def _topic(self, schema: Any, channel: Any, message: Any) -> Topic:
        kind = schema.name if schema is not None else channel.message_encoding
        try:
            first = self._decoder(schema, channel)(message.data)
            return message_topic(channel.topic, kind, None, first)
        except LogError as problem:
            reason = str(problem)
        except Exception as problem:  # one topic that cannot be read spoils no other
            reason = f"cannot be decoded: {_short(problem)}"
        return Topic(channel.topic, kind, None, {}, Base("received"), reason)

    def _messages(self, topics: set[str]) -> Iterator[Message]:
        streams = [self._records(path, topics) for path in self._paths]
        for schema, channel, message in heapq.merge(*streams, key=lambda r: r[2].log_time):
            decoder = self._decoder(schema, channel)
            yield Message(
                channel.topic,
                message.log_time,
                lambda d=decoder, c=message.data: d(c),  # type: ignore[misc]
            )

    def _decoder(self, schema: Any, channel: Any) -> Callable[[bytes], Any]:
        name, content = ("", b"") if schema is None else (schema.name, schema.data)
        key = (channel.message_encoding, name, content)
        if key not in self._decoders:
            self._decoders[key] = self._make(channel.message_encoding, schema)
        return self._decoders[key]

    def _make(self, encoding: str, schema: Any) -> Callable[[bytes], Any]:
        if encoding == "json":
            return json.loads
        if encoding == "protobuf" and schema is not None:
            return _protobuf(schema)
        if encoding in ("cdr", "ros1") and schema is not None:
            types = self._types if encoding == "cdr" else self._old_types
            language = "idl" if schema.encoding == "ros2idl" else "msg"
            return types.decoder(schema.name, schema.data.decode("utf-8", "replace"), language)
        raise LogError(f"expected messages of ROS, JSON or Protobuf, found {encoding!r}")


def _protobuf(schema: Any) -> Callable[[bytes], Any]:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    for file in files.file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    return kind.FromString  # type: ignore[no-any-return]


def _first(messages: Iterator[Any]) -> Iterator[Any]:
    for message in messages:
        yield message
        return


def _short(problem: Exception) -> str:
    return " ".join(str(problem).split())[:200] or type(problem).__name__
