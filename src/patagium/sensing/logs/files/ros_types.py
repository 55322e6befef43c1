"""Decoders of ROS 1 and ROS 2 messages, by the definitions in a log or in rosbags' collections."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from patagium.errors import LogError

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
        self._decoders: dict[tuple[str, str], Decoder] = {}
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
        key = (kind, definition)
        if key not in self._decoders:
            self._decoders[key] = self._make(kind, definition, language)
        return self._decoders[key]

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
        if self._ros2:
            return lambda content: store.deserialize_cdr(content, kind)
        return lambda content: store.deserialize_ros1(content, kind)

    def _collection(self) -> tuple[Any, str]:
        from rosbags.typesys import Stores, get_typestore

        if not self._ros2:
            return get_typestore(Stores.ROS1_NOETIC), "ROS 1 Noetic"
        wanted = f"ros2_{(self._distribution or '').lower()}"
        for store in Stores:
            if store.value == wanted:
                return get_typestore(store), f"ROS 2 {self._distribution}"
        return get_typestore(Stores.LATEST), "the latest ROS 2"


def _idl(definition: str, parse: Callable[[str], Any]) -> dict[str, Any]:
    line = "=" * 80 + "\n"
    if not definition.startswith(f"{line}IDL: "):
        return dict(parse(definition))
    types: dict[str, Any] = {}
    for part in definition.split(line)[1:]:
        types.update(parse(part.partition("\n")[2]))
    return types
