"""ROS 1 and ROS 2 bags, by rosbags; parts of one recording are read as one.

A bag may be compressed, and a ROS 2 bag may store in SQLite or MCAP. Definitions that the bag
does not carry come from rosbags' collections, and a note says so.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import Base, Block, Topic, Wanted, reading
from patagium.sensing.logs.files.messages import Message, message_blocks, message_topic
from patagium.sensing.logs.files.ros_types import MessageTypes

_NOTHING = "no message in the log"


class BagFile:
    """A bag, or the parts of one, open; see `LogFile`.

    Args:
        paths: `.bag` files; or `.db3` files, or folders with a metadata.yaml.
    """

    def __init__(self, paths: list[Path]) -> None:
        self.path = paths[0] if len(paths) == 1 else paths[0].parent
        self.notes: list[str] = []
        self._ros2 = paths[0].suffix != ".bag"
        self.format = "ROS 2 bag" if self._ros2 else "ROS 1 bag"
        self._readers: list[Any] = []
        try:
            with reading(self.path, self.format):
                self._readers = [self._open(path) for path in paths]
                self._types = MessageTypes(ros2=self._ros2, distribution=self._distribution())
                self.topics: dict[str, Topic] = {
                    name: self._topic(name, held) for name, held in self._connections().items()
                }
        except BaseException:
            self.close()
            raise
        for kind, named in sorted(self._types.borrowed.items()):
            self.notes.append(f"the bag carries no definition of {kind}: that of {named} is used")

    def blocks(self, wanted: tuple[Wanted, ...], skip: tuple[int, ...]) -> Iterator[Block]:
        """Rows of what is wanted, as they are mixed in the bag."""
        with reading(self.path, self.format):
            yield from message_blocks(self._messages({w.topic for w in wanted}), wanted, skip)

    def close(self) -> None:
        """Let the files go."""
        for reader in self._readers:
            with suppress(Exception):  # one that failed to open
                reader.close()
        self._readers = []

    def _open(self, path: Path) -> Any:
        if self._ros2:
            from rosbags.rosbag2 import Reader

            reader: Any = Reader(path)
        else:
            from rosbags.rosbag1 import Reader as Reader1

            reader = Reader1(path)
        reader.open()
        return reader

    def _distribution(self) -> str | None:
        metadata = getattr(getattr(self._readers[0], "storage", None), "metadata", None)
        return getattr(metadata, "ros_distro", None)

    def _connections(self) -> dict[str, list[tuple[Any, Any]]]:
        held: dict[str, list[tuple[Any, Any]]] = defaultdict(list)
        for reader in self._readers:
            for connection in reader.connections:
                held[connection.topic].append((reader, connection))
        return dict(sorted(held.items()))

    def _topic(self, name: str, held: list[tuple[Any, Any]]) -> Topic:
        kind = held[0][1].msgtype
        count = sum(connection.msgcount for _, connection in held)
        try:
            for reader, connection in held:
                for _, _, content in reader.messages(connections=[connection]):
                    message = self._decoder(connection)(content)
                    return message_topic(name, kind, count, message)
            return Topic(name, kind, 0, {}, Base("received"), _NOTHING)
        except LogError as problem:
            return Topic(name, kind, count, {}, Base("received"), str(problem))
        except Exception as problem:  # one topic that cannot be read spoils no other
            return Topic(name, kind, count, {}, Base("received"), f"cannot be decoded: {problem}")

    def _decoder(self, connection: Any) -> Any:
        language = "idl" if connection.msgdef.format.name == "IDL" else "msg"
        return self._types.decoder(connection.msgtype, connection.msgdef.data, language)

    def _messages(self, topics: set[str]) -> Iterator[Message]:
        streams = []
        for reader in self._readers:
            chosen = [c for c in reader.connections if c.topic in topics]
            if chosen:
                streams.append(reader.messages(connections=chosen))
        for connection, stamp, content in heapq.merge(*streams, key=lambda entry: entry[1]):
            decoder = self._decoder(connection)
            yield Message(
                connection.topic,
                stamp,
                lambda d=decoder, c=content: d(c),  # type: ignore[misc]
            )
