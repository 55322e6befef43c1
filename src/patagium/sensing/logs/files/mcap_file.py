"""Reader of MCAP files with messages of ROS 1, ROS 2, JSON or Protobuf.

A file whose recording was cut off has no index: it is read from its start to where it ends, and a
note says so. Attachments and metadata are not read.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import Block, Request, Topic, reading
from patagium.sensing.logs.files.messages import (
    NO_MESSAGE,
    Message,
    message_blocks,
    message_topic,
    one_line,
    unreadable_topic,
)
from patagium.sensing.logs.files.ros_types import MessageTypes


class McapFile:
    """Open MCAP file, or the parts of one recording; see `LogFile`.

    Args:
        paths: The file, or the parts.

    Raises:
        LogError: If a file cannot be read.
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

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows in the order in which they were logged."""
        topics = {one.topic for one in wanted}
        with reading(self.path, self.format):
            yield from message_blocks([self._messages(p, topics) for p in self._paths], wanted)

    def close(self) -> None:
        """Do nothing: files are open only while they are read."""

    def _look(self) -> dict[str, Topic]:
        counts: Counter[str] = Counter()
        topics: dict[str, Topic] = {}
        for path in self._paths:
            for schema, channel, message in self._records(path, None, counts):
                if channel.topic not in topics:
                    kind = schema.name if schema is not None else channel.message_encoding
                    decode = partial(self._decoded, schema, channel, message)
                    topics[channel.topic] = message_topic(channel.topic, kind, None, decode)
        for name in counts:
            topics.setdefault(name, unreadable_topic(name, "", 0, NO_MESSAGE))
        return {name: replace(topics[name], count=counts[name]) for name in sorted(topics)}

    def _records(
        self, path: Path, topics: set[str] | None, counts: Counter[str] | None = None
    ) -> Iterator[tuple[Any, Any, Any]]:
        """Messages by the time they were logged, or as they come if the file has no index.

        With `counts`, only the first message of each topic is read where the index states how
        many there are.
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
                yield from islice(reader.iter_messages(topics=[channel.topic]), 1)

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
                    note = f"{path.name}: breaks off after {got} message(s): {one_line(problem)}"
                    if topics is None:
                        self.notes.append(note)
                    return
                if record is None:
                    return
                got += 1
                yield record

    def _messages(self, path: Path, topics: set[str]) -> Iterator[Message]:
        for schema, channel, message in self._records(path, topics):
            decode = partial(self._decoder(schema, channel), message.data)
            yield Message(channel.topic, message.log_time, decode)

    def _decoded(self, schema: Any, channel: Any, message: Any) -> Any:
        return self._decoder(schema, channel)(message.data)

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
