"""Reader of CSV files: one line a row, names in the first line, plain or gzip.

The separator is a comma, a semicolon or a tab. Line ends within quotes, comments and thousands
separators are not supported.
"""

from __future__ import annotations

import csv
import gzip
import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import BLOCK, Block, Request, Topic, reading
from patagium.sensing.logs.files.tables import columns_of, distinct, table_block, table_topic

_LOOK = 200
"""Lines from which types are found."""
_PACKED = 4.0
"""Typical size of a CSV text over that of its gzip."""


class CsvFile:
    """Open CSV file; see `LogFile`.

    Args:
        path: The file, plain or gzip.

    Raises:
        LogError: If the file cannot be read, or has no names in its first line.
    """

    format = "CSV"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        with reading(path, "CSV"), self._opened() as text:
            header = text.readline()
            self._separator = max(",;\t", key=header.count)
            names = next(csv.reader([header], delimiter=self._separator), [])
            look = "".join(line for _, line in zip(range(_LOOK), text, strict=False))
        self._names = distinct(name.strip() for name in names)
        if not any(self._names) or "\x00" in header:
            raise LogError(f"{path}: cannot be read as CSV: expected names in the first line")
        if not self._is_gzip() and not _ends_with_line(path):
            self.notes.append("the last line has no end: it may be cut off")
        self._decimal = "," if self._separator == ";" and _comma_decimal(look) else "."
        self.topics: dict[str, Topic] = {"": self._table(look)}

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows, one pass through the file for each request."""
        for key, one in enumerate(wanted):
            with reading(self.path, "CSV"), self._opened() as text:
                text.readline()
                row = 0
                for frame in self._frames(text, columns_of(one)):
                    columns = {
                        name: _calendar(frame[name]) if name in self._calendar else frame[name]
                        for name in frame
                    }
                    yield table_block(key, one, columns, row, len(frame), str(self.path))
                    row += len(frame)

    def close(self) -> None:
        """Do nothing: the file is open only while it is read."""

    def _frames(self, text: io.TextIOBase, chosen: list[str] | None) -> Iterator[Any]:
        try:
            with pd.read_csv(
                text,
                header=None,
                names=self._names,
                usecols=chosen,
                index_col=False,
                sep=self._separator,
                decimal=self._decimal,
                chunksize=BLOCK,
                skip_blank_lines=False,
                low_memory=False,
            ) as reader:
                yield from reader
        except pd.errors.EmptyDataError:
            return

    def _table(self, look: str) -> Topic:
        with reading(self.path, "CSV"):
            frames = list(self._frames(io.StringIO(look), None))
        types = {
            name: str(frames[0][name].dtype) if frames else "float64"
            for name in self._names
            if not frames or _numeric(frames[0][name])
        }
        others = [name for name in self._names if name not in types]
        self._calendar = [name for name in others if _is_calendar(frames[0][name])]
        types.update(dict.fromkeys(self._calendar, "timestamp"))
        topic = table_topic(types, None, stamped=dict.fromkeys(self._calendar, 1.0))
        lines = look.count("\n") or 1
        size = self.path.stat().st_size * (_PACKED if self._is_gzip() else 1.0)
        return replace(topic, about=int(size * lines / max(1, len(look))))

    def _opened(self) -> io.TextIOWrapper:
        binary: Any = gzip.open(self.path) if self._is_gzip() else self.path.open("rb")
        return io.TextIOWrapper(binary, encoding="utf-8-sig", newline="")

    def _is_gzip(self) -> bool:
        with self.path.open("rb") as file:
            return file.read(2) == b"\x1f\x8b"


def _ends_with_line(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 1))
        return file.read() in (b"\n", b"\r")


def _numeric(column: Any) -> bool:
    if column.dtype.kind in "fiub":
        return True
    numbers = pd.to_numeric(column, errors="coerce")
    return bool(numbers.notna().mean() > 0.5)


def _calendar(column: Any) -> Any:
    stamps = pd.to_datetime(column, format="ISO8601", errors="coerce", utc=True)
    return stamps.dt.tz_localize(None)


def _is_calendar(column: Any) -> bool:
    return bool(_calendar(column.astype(str)).notna().mean() > 0.5)


def _comma_decimal(look: str) -> bool:
    fields = look.replace("\n", ";").split(";")
    return any("," in field for field in fields) and not any("." in field for field in fields)
