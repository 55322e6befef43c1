"""CSV and its kin: one line a row, names in the first, comma, semicolon or tab between.

Neglected: line ends within quotes, comments, thousands separators.
"""

from __future__ import annotations

import csv
import gzip
import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import (
    BLOCK,
    Array,
    Block,
    Stamps,
    Topic,
    Wanted,
    nanoseconds,
    reading,
)
from patagium.sensing.logs.files.tables import as_numbers, distinct, table_topic

_LOOK = 200
_PACKED = 4.0
"""Size of such a text over that of its gzip, about."""


class CsvFile:
    """A CSV file that is open; see `LogFile`.

    Args:
        path: The file, plain or gzip.
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

    def blocks(self, wanted: tuple[Wanted, ...], skip: tuple[int, ...]) -> Iterator[Block]:
        """Rows of what is wanted, one pass for each."""
        for key, one in enumerate(wanted):
            with reading(self.path, "CSV"):
                yield from self._pass(key, one, skip[key])

    def close(self) -> None:
        """Nothing is held."""

    def _pass(self, key: int, wanted: Wanted, skip: int) -> Iterator[Block]:
        stamped = (wanted.base.column,) if wanted.base.kind == "column" else ()
        chosen = list(dict.fromkeys((*stamped, *wanted.fields)))
        with self._opened() as text:
            text.readline()
            for _ in range(skip):
                text.readline()
            row = skip
            for frame in self._frames(text, chosen):
                stamps = self._stamps(frame, wanted, row)
                columns = [as_numbers(frame[f], f, str(self.path), row) for f in wanted.fields]
                values = _stacked(columns, len(frame))
                row += len(frame)
                yield Block(key, stamps, values, row)

    def _stamps(self, frame: Any, wanted: Wanted, row: int) -> Stamps:
        if wanted.base.kind == "rows":
            return np.arange(row, row + len(frame), dtype=np.int64) * 10**9
        column = frame[wanted.base.column]
        if wanted.base.column in self._calendar:
            return nanoseconds(_calendar(column).to_numpy(), 1.0)
        if column.dtype.kind in "iu":
            return nanoseconds(column.to_numpy(), wanted.base.factor)
        numbers = as_numbers(column, wanted.base.column, str(self.path), row)
        return nanoseconds(numbers, wanted.base.factor)

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
        return replace(topic, about=self._rows_about(look))

    def _rows_about(self, look: str) -> int:
        lines = look.count("\n") or 1
        size = self.path.stat().st_size * (_PACKED if self._is_gzip() else 1.0)
        return int(size * lines / max(1, len(look)))

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


def _stacked(columns: list[Array], count: int) -> Array:
    return np.column_stack(columns) if columns else np.empty((count, 0))
