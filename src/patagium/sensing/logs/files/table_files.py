"""Readers of tables: CSV, Parquet, MATLAB and PX4 ULog files.

A table has columns with one unit each, one of which has the stamps. Where a file does not name its
column of time, a guess is made for `inspect` alone, and the log notes say that it is a guess.
Neglected: in CSV files line ends within quotes, comments and thousands separators; in Parquet files
columns of lists; MATLAB objects such as timetables, and version 7.3, which is HDF5.
"""

from __future__ import annotations

import csv
import gzip
import io
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import (
    BLOCK,
    Array,
    Block,
    Channel,
    Request,
    StampSource,
    Topic,
    nanoseconds,
    reading,
)

_HEADER = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*$")
_NANOSECONDS = {"s": 1e9, "sec": 1e9, "ms": 1e6, "us": 1e3, "usec": 1e3, "µs": 1e3, "ns": 1.0}
_TIME = re.compile(
    r"^(time|t|timestamp|stamp|tout|clock)(?:[_ .(\[]*(s|sec|ms|us|usec|µs|ns)\W?)?$"
)
_SUFFIXES = {
    "_rad_s": "rad/s", "_rad": "rad", "_deg_s": "deg/s", "_deg": "deg", "_m_s2": "m/s^2",
    "_m_s": "m/s", "_mm": "mm", "_pa": "Pa", "_celsius": "degC", "_ms": "ms", "_us": "µs",
    "_ns": "ns",
}  # fmt: skip


def table_topic(
    columns: Mapping[str, str],
    count: int | None,
    units: Mapping[str, str] | None = None,
    *,
    stamped: Mapping[str, float] | None = None,
) -> Topic:
    """Topic of a table.

    Args:
        columns: Type of each column with numbers, by its name in the file.
        count: Number of rows, if known.
        units: Units that the file states.
        stamped: Columns that hold calendar time, with their unit [ns].
    """
    channels, aliases = {}, {}
    for column, dtype in columns.items():
        plain = column.strip()
        match = _HEADER.match(plain)
        bracketed = match is not None and not match["unit"].isdigit() and "[" not in match["name"]
        unit = (units or {}).get(column) or (match["unit"] if match and bracketed else "")
        channels[column] = Channel(column, dtype, unit or unit_of_suffix(plain))
        if plain != column:
            aliases[plain] = column
        if match and bracketed:
            aliases.setdefault(match["name"], column)
    base, guess = _guessed_base(channels, stamped or {})
    return Topic("", "table", count, channels, base, aliases=aliases, guess=guess)


def unit_of_suffix(name: str) -> str:
    """Unit that the end of a name states, such as `_m_s2`; empty if it states none."""
    stem = re.sub(r"(\[\d+\]|\.[wxyz])+$", "", name.lower())
    if stem.startswith("gyro") and stem.endswith("_rad"):
        return "rad/s"  # as PX4 has it
    return next((unit for end, unit in _SUFFIXES.items() if stem.endswith(end)), "")


def _guessed_base(
    channels: Mapping[str, Channel], stamped: Mapping[str, float]
) -> tuple[StampSource, str]:
    for column, factor in stamped.items():
        return StampSource("column", column, factor), ""
    for column in channels:
        match = _TIME.match(column.strip().lower())
        if match:
            unit = match[2] or channels[column].unit or "s"
            plain = not match[2] and unit == "s"
            guess = f"column {column!r} taken for time in s; a mapping says it better"
            return StampSource(
                "column", column, _NANOSECONDS.get(unit, 1e9)
            ), guess if plain else ""
    return StampSource("rows"), "no column is named like time; rows are counted instead"


def as_numbers(raw: Any, column: str, where: str, first: int) -> Array:
    """Column of numbers as floats; empty text becomes NaN.

    Args:
        raw: Column, (k,) [any unit].
        column: Its name.
        where: The file, for messages.
        first: Row of the first entry.

    Raises:
        LogError: If an entry is text that is no number, or a complex number.
    """
    array = np.asarray(raw)
    if array.dtype.kind in "fiub":
        return array.astype(float)
    if array.dtype.kind == "c":
        raise LogError(f"{where}: column {column}: expected real numbers, found complex ones")
    return _from_words(array, column, where, first)


def _from_words(words: NDArray[Any], column: str, where: str, first: int) -> Array:
    numbers = np.full(len(words), np.nan)
    for row, word in enumerate(words.tolist()):
        if word is None or (isinstance(word, str) and not word.strip()):
            continue
        try:
            numbers[row] = float(word)
        except (TypeError, ValueError):
            raise LogError(
                f"{where}: column {column}: expected numbers, found {str(word)[:40]!r} "
                f"in row {first + row + 1}"
            ) from None
    return numbers


def columns_of(wanted: Request) -> list[str]:
    """Columns to read for a request, each once."""
    stamped = (wanted.base.column,) if wanted.base.kind == "column" else ()
    return list(dict.fromkeys((*stamped, *wanted.fields)))


def table_block(
    key: int, wanted: Request, columns: Mapping[str, Any], first: int, count: int, where: str
) -> Block:
    """Block of consecutive rows of a table.

    Args:
        key: Place of the request.
        wanted: Request.
        columns: Columns by name, (count,) each; those that `columns_of` names.
        first: Row of the first entry.
        count: Number of rows.
        where: The file, for messages.

    Raises:
        LogError: If a column holds text or complex numbers.
    """
    values = np.empty((count, len(wanted.fields)))
    for k, field in enumerate(wanted.fields):
        values[:, k] = as_numbers(columns[field], field, where, first)
    if wanted.base.kind == "rows":
        return Block(key, np.arange(first, first + count, dtype=np.int64) * 10**9, values)
    raw = np.asarray(columns[wanted.base.column])
    if raw.dtype.kind not in "iuM":
        raw = as_numbers(raw, wanted.base.column, where, first)
    return Block(key, nanoseconds(raw, wanted.base.factor), values)


def column_blocks(
    key: int, wanted: Request, columns: Mapping[str, NDArray[Any]], where: str
) -> Iterator[Block]:
    """Blocks of a table that is in memory.

    Args:
        key: Place of the request.
        wanted: Request.
        columns: Whole columns by name, (N,) each [any unit].
        where: The file, for messages.

    Raises:
        LogError: If columns differ in length, or one holds no real numbers.
    """
    chosen = {name: columns[name] for name in columns_of(wanted)}
    sizes = {name: len(column) for name, column in chosen.items()} or {"": 0}
    first_name, count = next(iter(sizes.items()))
    for name, size in sizes.items():
        if size != count:
            raise LogError(
                f"{where}: {name}: expected {count} rows as {first_name!r} has, found {size}; "
                "name its own stamp"
            )
    for first in range(0, count, BLOCK):
        rows = {name: column[first : first + BLOCK] for name, column in chosen.items()}
        yield table_block(key, wanted, rows, first, min(BLOCK, count - first), where)


def distinct(names: Iterable[str]) -> list[str]:
    """Names with a number added to those that repeat, like the names of pandas."""
    seen: dict[str, int] = {}
    names_in_order = []
    for name in names:
        count = seen.get(name, 0)
        seen[name] = count + 1
        names_in_order.append(f"{name}.{count}" if count else name)
    return names_in_order


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


class ParquetFile:
    """Open Parquet file; see `LogFile`.

    Args:
        path: The file.

    Raises:
        LogError: If the file cannot be read.
    """

    format = "Parquet"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        with reading(path, "Parquet"):
            from pyarrow import parquet, types

            self._file = parquet.ParquetFile(path)
            leaves = list(_leaves(self._file.schema_arrow, types))
        numbers = {name: str(kind) for name, kind, _ in leaves if not types.is_timestamp(kind)}
        stamped = {name: 1.0 for name, kind, _ in leaves if types.is_timestamp(kind)}
        units = {name: unit for name, _, unit in leaves if unit}
        count = int(self._file.metadata.num_rows)
        types_by_name = {**dict.fromkeys(stamped, "timestamp"), **numbers}
        topic = table_topic(types_by_name, count, units, stamped=stamped)
        self.topics: dict[str, Topic] = {"": topic}

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows, one pass through the file for each request."""
        for key, one in enumerate(wanted):
            with reading(self.path, "Parquet"):
                row, names = 0, columns_of(one)
                for batch in self._file.iter_batches(BLOCK, columns=names, use_threads=False):
                    columns = {name: _plain(batch, name) for name in names}
                    yield table_block(key, one, columns, row, len(batch), str(self.path))
                    row += len(batch)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _plain(batch: Any, path: str) -> Any:
    if path in batch.schema.names:
        return batch.column(path).to_numpy(zero_copy_only=False)
    head, _, rest = path.partition(".")
    column = batch.column(head)
    for part in rest.split("."):
        column = column.field(part)
    return column.to_numpy(zero_copy_only=False)


def _leaves(schema: Any, types: Any) -> Iterator[tuple[str, Any, str]]:
    for field in schema:
        yield from _leaf(field, field.name, types)


def _leaf(field: Any, path: str, types: Any) -> Iterator[tuple[str, Any, str]]:
    kind = field.type
    if types.is_struct(kind):
        for inner in kind:
            yield from _leaf(inner, f"{path}.{inner.name}", types)
    elif (
        types.is_integer(kind)
        or types.is_floating(kind)
        or types.is_boolean(kind)
        or types.is_decimal(kind)
        or types.is_timestamp(kind)
    ):
        words = field.metadata or {}
        unit = words.get(b"unit", words.get(b"units", b""))
        yield path, kind, unit.decode("utf-8", "replace")


_MOST_COLUMNS = 64


class MatFile:
    """MATLAB file in memory; see `LogFile`.

    Args:
        path: The file.

    Raises:
        LogError: If the file cannot be read, is of version 7.3, or holds no arrays of numbers.
    """

    format = "MAT"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        with reading(path, "MAT"):
            with path.open("rb") as file:
                if b"7.3 MAT" in file.read(16):
                    raise LogError(
                        f"{path}: MATLAB 7.3 files are not read; save it again with "
                        "save('log.mat', ..., '-v7')"
                    )
            from scipy.io import loadmat

            held = loadmat(path, squeeze_me=True, struct_as_record=False)
            self._columns: dict[str, Any] = {}
            for name, value in held.items():
                if not name.startswith("__"):
                    self._columns.update(_columns(name, value))
        lengths = Counter(len(column) for column in self._columns.values())
        if not lengths:
            raise LogError(f"{path}: expected arrays of numbers, found none")
        if len(lengths) > 1:
            described = ", ".join(f"{n} of {rows} rows" for rows, n in lengths.most_common(4))
            self.notes.append(f"arrays of several lengths: {described}; each needs its own stamp")
        types = {name: str(column.dtype) for name, column in self._columns.items()}
        self.topics: dict[str, Topic] = {"": table_topic(types, lengths.most_common(1)[0][0])}

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows, one request after the other."""
        for key, one in enumerate(wanted):
            yield from column_blocks(key, one, self._columns, str(self.path))

    def close(self) -> None:
        """Release the memory."""
        self._columns = {}


def _columns(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    fields = getattr(value, "_fieldnames", None)  # of SciPy's mat_struct
    if fields is not None:
        for inner in fields:
            yield from _columns(f"{name}.{inner}", getattr(value, inner))
        return
    array = np.asarray(value)
    if array.dtype.kind not in "fiub" or array.ndim not in (1, 2) or array.size < 2:
        return
    if array.ndim == 1:
        yield name, array
        return
    tall = array if array.shape[0] >= array.shape[1] else array.T
    for k in range(min(tall.shape[1], _MOST_COLUMNS)):
        yield f"{name}[{k}]", np.ascontiguousarray(tall[:, k])


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
