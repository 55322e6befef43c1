"""Reader of ROS 1 and ROS 2 bags, by rosbags; the parts of one recording are read as one log.

A bag may be compressed, and a ROS 2 bag may be stored in SQLite or MCAP. Message definitions that
the bag lacks come from rosbags' collections, and a note says so.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import Block, Request, Topic, reading
from patagium.sensing.logs.files.messages import (
    NO_MESSAGE,
    Message,
    message_blocks,
    message_topic,
)
from patagium.sensing.logs.files.ros_types import MessageTypes


class BagFile:
    """Open bag, or the open parts of one; see `LogFile`.

    Args:
        paths: `.bag` files; or `.db3` files, or folders with a metadata.yaml.

    Raises:
        LogError: If a bag cannot be read.
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

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows in the order of the bag."""
        topics = {one.topic for one in wanted}
        with reading(self.path, self.format):
            streams = [self._messages(reader, topics) for reader in self._readers]
            yield from message_blocks(streams, wanted)

    def close(self) -> None:
        """Close the files."""
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

        def first() -> Any:
            for reader, connection in held:
                for _, _, content in reader.messages(connections=[connection]):
                    return self._decoder(connection)(content)
            raise LogError(NO_MESSAGE)

        topic = message_topic(name, kind, count, first)
        return replace(topic, count=0) if topic.problem == NO_MESSAGE else topic

    def _decoder(self, connection: Any) -> Any:
        language = "idl" if connection.msgdef.format.name == "IDL" else "msg"
        return self._types.decoder(connection.msgtype, connection.msgdef.data, language)

    def _messages(self, reader: Any, topics: set[str]) -> Iterator[Message]:
        chosen = [one for one in reader.connections if one.topic in topics]
        for connection, stamp, content in reader.messages(connections=chosen) if chosen else ():
            decode = partial(self._decoder(connection), content)
            yield Message(connection.topic, stamp, decode)
