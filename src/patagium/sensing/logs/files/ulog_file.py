"""Reader of PX4 ULog files, by pyulog; a second instance of a topic is `name/1`.

Stamps are the topics' `timestamp` [µs]. pyulog reads a file whole.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from patagium.sensing.logs.files.channels import (
    Block,
    Channel,
    Request,
    StampSource,
    Topic,
    reading,
)
from patagium.sensing.logs.files.tables import column_blocks, unit_of_suffix


class UlogFile:
    """ULog file in memory; see `LogFile`.

    Args:
        path: The file.

    Raises:
        LogError: If the file cannot be read.
    """

    format = "PX4 ULog"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        with reading(path, "ULog"), redirect_stdout(io.StringIO()):
            from pyulog import ULog

            with path.open("rb") as file:
                watched = _Watched(file)
                log = ULog(watched)
            if watched.cut:
                self.notes.append("the file ends within a record: it was cut off")
            self._parts: dict[str, Any] = {}
            for part in sorted(log.data_list, key=lambda p: (p.name, p.multi_id)):
                name = f"{part.name}/{part.multi_id}" if part.multi_id else part.name
                self._parts[name] = part.data
            self._note_damage(log)
        self.topics: dict[str, Topic] = {n: _topic(n, p) for n, p in self._parts.items()}

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows, topic by topic."""
        for key, one in enumerate(wanted):
            yield from column_blocks(key, one, self._parts[one.topic], str(self.path))

    def close(self) -> None:
        """Release the memory."""
        self._parts = {}

    def _note_damage(self, log: Any) -> None:
        if log.file_corruption:
            self.notes.append("the file is damaged: what could not be read was left out")
        lost = [gap.duration for gap in log.dropouts]
        if lost:
            self.notes.append(
                f"{len(lost)} dropout(s) of the logger, {sum(lost) / 1e3:.4g} s in all, "
                f"the longest {max(lost) / 1e3:.4g} s"
            )


class _Watched:
    """Binary file that records whether a read came back short."""

    def __init__(self, file: Any) -> None:
        self._file, self.cut = file, False
        self.seek, self.tell, self.close = file.seek, file.tell, file.close

    def read(self, size: int = -1) -> bytes:
        content: bytes = self._file.read(size)
        self.cut = 0 < len(content) < size
        return content


def _topic(name: str, columns: Any) -> Topic:
    channels = {
        field: Channel(field, str(np.asarray(values).dtype), unit_of_suffix(field))
        for field, values in columns.items()
    }
    count = len(next(iter(columns.values()), ()))
    return Topic(name, "ULog", count, channels, StampSource("column", "timestamp", 1e3))
