"""Readers of tables: CSV, Parquet, MATLAB, HDF5 and PX4 ULog files.

A table has columns with one unit each, one of which has the stamps. Where a file does not name its
column of time, a guess is made for `inspect` alone, and the log notes say that it is a guess. Lists
in a cell, "[a, b, c]", are columns `name[0]`, `name[1]`, ... What is not read is listed with the
reason (`Topic.unplaced`). Neglected: in CSV files line ends within quotes, comments among the rows
and thousands separators; MATLAB objects such as timetables; cells of MATLAB 7.3, which is HDF5.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import os
import re
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, redirect_stdout
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from patagium.arrays import Array
from patagium.errors import LogError
from patagium.netcdf_file import open_netcdf
from patagium.reading import check_room
from patagium.sensing.logs.files.channels import (
    BLOCK,
    NO_STAMP,
    Block,
    Channel,
    ColumnError,
    LogFile,
    Request,
    StampSource,
    Topic,
    first_bytes,
    nanoseconds,
    reading,
)
from patagium.sensing.logs.files.mat_elements import check_elements
from patagium.sensing.logs.mapping import si_of

_HEADER = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*$")
TIME_NAME = re.compile(
    r"^(time|ts?(?![a-zµ])|x_value|timestamp|stamp|tout|clock|elapsed|(?=sec|milli|micro))"
    r"(?:(?:[_ ]in[_ ]|[_ .(\[/]*)(s|secs?|seconds|ms|millis|us|usec|µs|micros|ns)\W?)?$"
)
_UNITS = {"millis": "ms", "us": "µs", "usec": "µs", "micros": "µs"}
_OF_DAY = re.compile(
    r"(?:^|\s)(?P<clock>\d{1,2}:\d\d:\d\d(?:[.,]\d+)?)(?:\s*(?P<half>[AaPp])[Mm])?\s*$"
)
_SPAN = re.compile(r"(?i)(^|[^a-z])(delay|latency|lag|dt|period|duration|interval)([^a-z]|$)")
_SECONDS = re.compile(r"(?i)(?:secs?|seconds)$")
_FINE = re.compile(r"(?i)(?:nanos|micros|(?:nano|n|micro|[uµμ])(?:secs?|seconds))$")
_MICROS = re.compile(r"(?i)(?:micro|[uµμ])s[a-z]*$")
_IN_GRAVITIES = re.compile(r"(^|[^a-z])a(cc[a-z]*)?[_. ]?[xyz]?_g$")
_TIMED = re.compile(r"(^|_)(time[a-z]*|stamp|clock|delay|latency|dt|period)_(\w+_)?(ms|us|ns)$")
_SUFFIXES = {
    "_rad_s2": "rad/s^2", "_rad_s": "rad/s", "_rad": "rad", "_radians": "rad", "_deg_s": "deg/s",
    "_deg": "deg", "_degrees": "deg", "_m_s2": "m/s^2", "_ms2": "m/s^2", "_mm_s2": "mm/s^2",
    "_m_s": "m/s", "_mm_s": "mm/s", "_cm_s": "cm/s", "_mm": "mm", "_cm": "cm", "_pa": "Pa",
    "_kpa": "kPa", "_hpa": "hPa", "_celsius": "degC", "_nm": "N m", "_n_m": "N m", "_nmm": "N mm",
    "_mnm": "mN m", "fx_n": "N", "fy_n": "N", "fz_n": "N", "force_n": "N", "lift_n": "N",
    "drag_n": "N", "thrust_n": "N", "_mN": "mN", "_gf": "gf", "_hz": "Hz", "_mps": "m/s",
    "_dps": "deg/s", "rpm": "rpm", "_mV": "mV", "_mA": "mA",
}  # fmt: skip


def table_topic(
    columns: Mapping[str, str],
    count: int | None,
    units: Mapping[str, str] | None = None,
    *,
    rows: Mapping[str, int] | None = None,
    unplaced: Mapping[str, str] | None = None,
) -> Topic:
    """Topic of a table.

    Args:
        columns: Type of each column with numbers, by its name in the file; "timestamp" of one
            that holds calendar time.
        count: Number of rows, if known.
        units: Units that the file states.
        rows: Number of rows of each column, where columns differ in length.
        unplaced: Content that is not read, with the reason.
    """
    rows = rows or {}
    channels, aliases, pairs = {}, {}, stamp_pairs(columns, rows)
    parts = {one: f"it is a part of the stamps {name!r}" for name in pairs for one in pairs[name]}
    for column, dtype in [*dict.fromkeys(pairs, "timestamp").items(), *columns.items()]:
        if column in parts:
            continue
        plain = column.lstrip("#%").strip()
        short, unit = _parted(plain)
        unit = (units or {}).get(column) or unit
        unit = (unit_of_suffix(f"{short}_g") or unit) if unit == "g" else unit
        own = rows.get(pairs.get(column, (column,))[0])
        channels[column] = Channel(column, dtype, unit or unit_of_suffix(plain), own)
        if plain != column:
            aliases[plain] = column
        if short != plain:
            aliases.setdefault(short, column)
    base, guess = guessed_base(channels)
    parts |= unplaced or {}
    return Topic("", "table", count, channels, base, aliases=aliases, guess=guess, unplaced=parts)


def stamp_pairs(columns: Collection[str], rows: Mapping[str, int]) -> dict[str, tuple[str, str]]:
    """Columns of seconds and of nano- or microseconds within them, by what their names share.

    Args:
        columns: Names of columns with numbers, such as `header.stamp.sec` and `.nanosec`.
        rows: Number of rows of each, where columns differ in length.
    """
    seconds, fine = (
        {end.sub("", one).strip("#%._/ ") or "stamp": one for one in columns if end.search(one)}
        for end in (_SECONDS, _FINE)
    )
    return {
        name: (one, fine[name])
        for name, one in seconds.items()
        if name in fine and rows.get(one) == rows.get(fine[name])
        if name not in columns and not _SPAN.search(name)
    }


def _parted(name: str) -> tuple[str, str]:
    """Name and unit of a header such as `gyro [deg/s]`; the unit is empty if there is none."""
    match = _HEADER.match(name)
    if match is None or match["unit"].isdigit() or "[" in match["name"]:
        return name, ""
    return match["name"], match["unit"]


def unit_of_suffix(name: str) -> str:
    """Unit that the end of a name states, such as `_m_s2`; empty if it states none."""
    written = re.sub(r"[ -]+", "_", re.sub(r"(\[\d+\]|\.[wxyz])+$", "", name))
    stem = written.lower()
    if stem.startswith("gyro") and stem.endswith("_rad"):
        return "rad/s"  # as PX4 has it
    timed = TIME_NAME.match(stem.rpartition(".")[2]) or _TIMED.search(stem)
    if timed and timed[timed.re.groups]:
        unit = timed[timed.re.groups]
        return "s" if unit.startswith("sec") else _UNITS.get(unit, unit)
    if _IN_GRAVITIES.search(stem):
        return "g_0"
    ends = _SUFFIXES.items()
    return next((u for end, u in ends if (stem if end.islower() else written).endswith(end)), "")


def guessed_base(channels: Mapping[str, Channel]) -> tuple[StampSource, str]:
    """Stamps that the types and names of columns suggest, and a note that says so."""
    for column, channel in channels.items():
        if channel.dtype == "timestamp":
            return StampSource("column", column), ""
    for column in channels:
        stem = column.lower().lstrip("#%").strip(" '*_").rpartition(".")[2].rpartition("'/'")[2]
        if match := TIME_NAME.match(stem):
            unit = (match[2] and unit_of_suffix(stem)) or channels[column].unit or "s"
            plain = not match[2] and unit == "s"
            guess = f"column {column!r} taken for time in s; a mapping says it better"
            return StampSource("column", column, nanoseconds_in(unit) or 1e9), guess * plain
    for column in [*channels][:1]:
        factor = 0.0 if _SPAN.search(column) else nanoseconds_in(channels[column].unit)
        if factor:
            guess = f"first column {column!r} taken for time; a mapping says it better"
            return StampSource("column", column, factor), guess
    return StampSource("rows"), "no column is named like time; rows are counted instead"


def nanoseconds_in(unit: str) -> float:
    """Nanoseconds in a unit of time; 0 of another unit."""
    factor, si = si_of(unit)
    return float(round(1e9 * factor)) if si == "s" else 0.0


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
        raise ColumnError(where, column, "real numbers", "complex ones")
    numbers = np.full(len(array), np.nan)
    for row, word in enumerate(array.tolist()):
        if word is None or (isinstance(word, str) and not word.strip()):
            continue
        try:
            numbers[row] = float(word)
        except (TypeError, ValueError):
            place = f"in row {first + row + 1}; an empty cell is a missing number"
            raise ColumnError(where, column, "numbers", f"{str(word)[:40]!r} {place}") from None
    return numbers


@np.errstate(invalid="ignore")  # an infinite number is a missing one
def _joined(both: Mapping[str, Any], where: str, first: int) -> NDArray[Any]:
    """Stamps of seconds and of what stamp_pairs joins, (k,), not-a-time where one is missing."""
    seconds, rest = (as_numbers(raw, one, where, first) for one, raw in both.items())
    unit = 1e3 if _MICROS.search([*both][1]) else 1.0
    whole, rest = nanoseconds(np.floor(seconds + 0 * rest), 1e9), rest % (1e9 / unit)
    stamps = np.where(whole == NO_STAMP, NO_STAMP, whole + nanoseconds(rest, unit))
    return stamps.view("datetime64[ns]")


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
            close = [one for one, column in columns.items() if len(column) == size]
            own = guessed_base({one: Channel(one, "") for one in close})[0].column
            stamps = "its stamps " if wanted.base.kind == "column" else ""
            raise LogError(
                f"{where}: {name}: expected {count} rows as {stamps}{first_name!r} have, "
                f"found {size}; give it stamps of its own in the mapping "
                f"(`stamp: {own or 'COLUMN'}`, of {size} rows) and a `rate` under time"
            )
    for first in range(0, count, BLOCK):
        rows = {name: column[first : first + BLOCK] for name, column in chosen.items()}
        yield table_block(key, wanted, rows, first, min(BLOCK, count - first), where)


def distinct(names: Iterable[str]) -> list[str]:
    """Names with a number added to those that repeat, like the names of pandas."""
    seen, found = Counter[str](), list[str]()
    for name in names:
        found.append(f"{name}.{seen[name]}" if seen[name] else name)
        seen[name] += 1
    return found


_DAY = pd.Timedelta(days=1)
_BEGINNING = 1 << 16
"""Bytes from which the encoding is found."""
_LOOK = 200
"""Lines from which types are found."""
_PACKED = 4.0
"""Typical size of a CSV text over that of its gzip."""
_SEPARATORS = ",;\t"
_BEYOND = "\0beyond the names"
"""Name of the column that takes entries of a line beyond the last name."""
_ALIKE = 0.9
"""Share of the lines below the names that have as many entries."""
_BRACKETS = str.maketrans("[](){},;", " " * 8)
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
_MOST_TEXT = 20
"""Most rows of text at the end that are left out; more are a column that turned to text."""
_OLDER = "save it again in MATLAB with save('log.mat', ..., '-v7')"
_AS_MAT = (
    "save its arrays as MAT: f = h5py.File('log.h5'); scipy.io.savemat('log.mat', "
    "{name: f[name][()] for name in ('t', 'fz')})"
)
_MOST_COLUMNS = 64
"""Most entries of an array or list that are read as columns."""


def header_place(lines: Sequence[str]) -> int:
    """Place of the line of names among the first lines of a CSV text; 0 if no line is one.

    Names have no number among them. The lines below have as many entries, and the second or third
    of them has about as many numbers as lines have further down: one alone may hold ids. Lines
    without empty names come first: a spreadsheet fills up the lines above with empty cells.
    """
    cells = {mark: [_cells(line, mark) for line in lines] for mark in (*_SEPARATORS, " ")}
    for full in (True, False):
        for place, line in enumerate(lines):
            rows = cells[_separator(line)]
            names, below = rows[place], [row for row in rows[place + 1 :] if row]
            if not below or not any(names) or any(map(_is_number, names)):
                continue
            if full and not all(name.strip() for name in names):
                continue
            numbers = [sum(map(_is_number, row)) for row in below]
            typical = numbers[len(numbers) // 2]
            sizes = {len(names), len(names) - (names[-1].strip() == "Comment")}  # of LabVIEW
            alike = sum(len(row) in sizes for row in below) >= _ALIKE * len(below)
            if not alike or not typical or 2 * max(numbers[1:3] or numbers) < typical:
                continue
            if numbers[0] or _units_below(below, len(names)) is not None:
                return place
    return 0


def _with_marker_names(lines: list[str]) -> tuple[int, list[str]]:
    """Place of the line of names, and lines with one made of Qualisys's MARKER_NAMES above them."""
    marked = next((k for k, line in enumerate(lines) if line.startswith("MARKER_NAMES")), None)
    rows = range(len(lines) if marked is None else marked + 1, len(lines))
    first = next((k for k in rows if _is_number(_cells(lines[k], "\t")[0])), None)
    if marked is None or first is None:
        return 0, lines
    size = len(_cells(lines[first].rstrip(), "\t"))
    markers = [one for one in _cells(lines[marked].rstrip(), "\t")[1:] if one]
    if len(markers) != size // 3:
        markers = [f"marker {k + 1}" for k in range(size // 3)]
    names = [*("Frame", "Time")[: size % 3], *(f"{one} {c}" for one in markers for c in "XYZ")]
    return first, [*lines[:first], "\t".join(names), *lines[first:]]


def _groups(lines: Sequence[str], separator: str, names: Sequence[str]) -> list[str]:
    """Columns whose names repeat, with the words in the lines above them; none if none repeats."""
    plain = [name.strip() for name in names]
    held, count = distinct(plain), Counter(plain)
    repeated = {one for one, name in zip(held, plain, strict=True) if name and count[name] > 1}
    said = [""] * len(names)
    for line in lines:
        cells = [cell.strip() for cell in _cells(line, separator)]
        if len(cells) != len(names) or any(map(_is_number, cells)) or not any(cells):
            continue
        for k in range(1, len(cells)):  # the first cell of a group alone may name it
            near = said[k] == said[k - 1] or not plain[k]
            cells[k] = cells[k] or cells[k - 1] * near
        said = [f"{one} {cell}".strip() for one, cell in zip(said, cells, strict=True)]
    groups = defaultdict[str, list[str]](list)
    for one, words in zip(held, said, strict=True):
        groups[words].append(one)
    told = [words for words, ones in groups.items() if words and repeated.intersection(ones)]
    return [f"{', '.join(groups[words])}: {words!r}" for words in told]


def _separator(line: str) -> str:
    """Mark between the entries of a line: the most frequent one, or spaces if there is none."""
    mark = max(_SEPARATORS, key=line.count)
    return mark if mark in line or len(line.split()) < 2 else " "


def _units_below(rows: Sequence[Sequence[str]], count: int) -> list[str] | None:
    """Units of the columns in the first row below the names; None if that row holds samples."""
    if len(rows) < 2 or len(rows[0]) > count or not any(map(_is_number, rows[1])):
        return None
    units = [cell.strip().strip("[]()") for cell in rows[0]]
    if not any(units) or any(map(_is_number, rows[0])):
        return None
    known = ["" if unit in ("", "-") or not si_of(unit)[1] else unit for unit in units]
    return known if sum(map(bool, known)) * 2 >= sum(map(bool, units)) else None


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.lstrip("#%").split()
    try:
        return next(csv.reader([line.rstrip("\r\n")], delimiter=separator), [])
    except csv.Error:
        return []


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _entries_of(word: Any) -> list[float] | None:
    """Numbers of a cell with a list, such as "[1, 2, 3]" or "1 2 3"; None for any other cell.

    A comma between digits is a decimal point where spaces or semicolons separate the entries.
    """
    if not isinstance(word, str):
        return None
    parts = re.findall(r"[^\s;]*\d[^\s;]*", word) if "," in word and "." not in word else []
    if len(parts) > 1 and max(len(_DECIMAL_COMMA.findall(part)) for part in parts) == 1:
        word = _DECIMAL_COMMA.sub(".", word)
    try:
        return [float(entry) for entry in word.translate(_BRACKETS).split()]
    except ValueError:
        return None


def _list_entries(where: str, column: str, cells: Any, size: int, first: int) -> Array:
    """Numbers of lists in cells, (k, size); NaN where a cell is empty."""
    numbers = np.full((len(cells), size), np.nan)
    for row, cell in enumerate(cells):
        text = isinstance(cell, str)
        if cell is None or isinstance(cell, float) or (text and not cell.strip()):
            continue
        entries = _entries_of(cell) if text else _flat(cell)
        if entries is None or len(entries) != size:
            found = repr(cell[:40]) if text or entries is None else len(entries)
            place = f"in row {first + row + 1}; mend or remove the row"
            raise ColumnError(where, column, f"a list of {size} numbers", f"{found} {place}")
        numbers[row] = entries
    return numbers


def _list_size(column: Any) -> int:
    """Number of entries of the lists in a column of text; 0 if it holds no lists of one size."""
    lists = [_entries_of(word) for word in column if isinstance(word, str) and word.strip()]
    sizes = Counter(len(entries) for entries in lists if entries)
    if not sizes:
        return 0
    size, count = sizes.most_common(1)[0]
    return size if 2 * count > len(lists) and size <= _MOST_COLUMNS else 0


class _Headed(io.TextIOBase):
    """Text after a line of its own, which tells pandas how many entries a line may have."""

    def __init__(self, head: str, text: io.TextIOBase) -> None:
        self._head, self._text = head, text

    def read(self, size: int | None = -1, /) -> str:
        head, self._head = self._head, ""
        return head or self._text.read(size)


class _RowsFile(LogFile):
    """Table that is read in parts of some rows; each entry of the lists in a column is a column."""

    _parts: Callable[..., Iterator[Any]]  # some of its columns, as Pandas or Arrow has them

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._lists: dict[str, tuple[str, int]] = {}  # column of the lists, and place in them
        self._pairs: dict[str, tuple[str, str]] = {}  # columns of seconds and their parts

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows, one pass through the file for each request."""
        for key, one in enumerate(wanted):
            with reading(self.path, self.format):
                row, names = 0, columns_of(one)
                held = [part for name in names for part in self._pairs.get(name, (name,))]
                sources = dict.fromkeys(self._lists.get(name, (name, 0))[0] for name in held)
                for part in self._parts(list(sources)):
                    columns = self._columns(part, names, row)
                    yield table_block(key, one, columns, row, len(part), str(self.path))
                    row += len(part)

    def _columns(self, part: Any, names: Iterable[str], row: int) -> dict[str, Any]:
        """Columns of some rows by name: as they are, or the entries of lists."""
        columns, parsed = dict[str, Any](), dict[str, Array]()
        for name in names:
            if name in self._pairs:
                both = {one: self._column(part, one, row) for one in self._pairs[name]}
                columns[name] = _joined(both, str(self.path), row)
                continue
            source, place = self._lists.get(name, ("", 0))
            if source and source not in parsed:
                own, cells = name.rpartition("[")[0], part[source].to_numpy()
                size = sum(one == source for one, _ in self._lists.values())
                parsed[source] = _list_entries(str(self.path), own, cells, size, row)
            columns[name] = parsed[source][:, place] if source else self._column(part, name, row)
        return columns

    def _entries(self, source: str, plain: str, size: int) -> list[str]:
        """Names of the columns that the entries of the lists in a column are from now on."""
        names = [f"{plain}[{k}]" for k in range(size)]
        self._lists |= {name: (source, k) for k, name in enumerate(names)}
        return names

    def _column(self, part: Any, name: str, row: int) -> Any:
        """Column of a part that begins with a row."""
        return part[name].to_numpy()


class CsvFile(_RowsFile):
    """Open CSV file.

    Args:
        path: The file, plain or gzip.
        skip_rows: Number of lines before the line of names; found if None.
        content: Text to read in place of that of the file.

    Raises:
        LogError: If the file cannot be read, or has no line of names.
    """

    format = "CSV"

    def __init__(self, path: Path, skip_rows: int | None = None, content: bytes = b"") -> None:
        super().__init__(path)
        self._content = content
        self._encoding = "utf-8-sig"
        with reading(path, "CSV"), self._opened() as text:
            self._encoding = _encoding(bytes(text.buffer.read(_BEGINNING)))
        with reading(path, "CSV"), self._opened() as text:
            lines = list(islice(text, (skip_rows or 0) + _LOOK))
        head = header_place(lines) if skip_rows is None else skip_rows
        if head >= len(lines):
            where = f" after {head} line(s) (skip_rows)" if head else ""
            raise LogError(f"{path}: cannot be read as CSV", f"names{where}", "no line")
        if head and skip_rows is None:
            self.notes.append(
                f"{head} line(s) before the names are skipped; `skip_rows` in the mapping says "
                "another number"
            )
        count = len(lines)
        if not head and skip_rows is None:
            head, lines = _with_marker_names(lines)
        made = len(lines) - count
        if made:
            self.notes.append(
                f"the file has no line of names; by those of its markers and its first row it is "
                f"{', '.join(lines[head].split(chr(9)))}"
            )
        header = lines[head]
        self._separator = _separator(header)
        names, *below = [_cells(line, self._separator) for line in lines[head : head + 3]]
        if self._separator == " " and len(names) not in map(len, below):
            self._separator, names = ",", [header.strip()]  # one name of several words
            below = [_cells(line, ",") for line in lines[head + 1 : head + 3]]
        self._names = distinct(name.strip() for name in names)
        if not any(self._names) or "\x00" in header:
            raise LogError(f"{path}: cannot be read as CSV: expected names in the first line")
        units = _units_below(below, len(names))
        self._skip = head + 1 - made + (units is not None)
        above = _groups(lines[:head], self._separator, names) if skip_rows is None else []
        if above:
            self.notes.append(f"the lines above the names say: {'; '.join(above)}")
        if units is not None:
            self.notes.append(f"line {head + 2} is taken for the units of the columns")
        if not self._is_gzip() and not _ends_with_line(path):
            self.notes.append("the last line has no end: it may be cut off")
        look = lines[self._skip + made :]
        rows = [_cells(line, self._separator) for line in look]
        self._decimal = "," if self._separator != "," and _comma_decimal(rows) else "."
        self._commas = list(self._names) if self._decimal == "," else []
        self._numbers: list[str] = []
        self._days: dict[str, tuple[Any, int]] = {}
        stated = dict(zip(self._names, units or (), strict=False))
        try:
            topic = self._table("".join(look), stated)
        except LogError as problem:  # which `inspect` lists
            topic = Topic("", "table", None, problem=str(problem).removeprefix(f"{path}: "))
        self.topics = {"": topic}

    def _parts(self, sources: list[str]) -> Iterator[Any]:
        with self._opened() as text:
            for _ in range(self._skip):
                text.readline()
            yield from self._frames(text, sources)

    def _column(self, frame: Any, name: str, row: int) -> Any:
        if name in self._calendar:
            return self._after_midnight(name, _calendar(frame[name]), row)
        if name in self._commas and frame[name].dtype.kind not in "fiub":
            return frame[name].astype(str).str.replace(",", ".")
        return frame[name]

    def _after_midnight(self, name: str, stamps: Any, row: int) -> Any:
        """Times of the day that go on over midnight; times with a date as they are."""
        if not len(stamps):
            return stamps
        last, days = self._days[name] if row else (pd.NaT, 0)
        known = stamps.ffill().fillna(last)
        of_day = known.max() < pd.Timestamp(0) + _DAY
        passed = known.shift(fill_value=last) - known > _DAY / 2
        counted = days + (passed & of_day).cumsum()
        self._days[name] = known.iloc[-1], int(counted.iloc[-1])
        return stamps + pd.to_timedelta(counted, unit="D")

    def _frames(self, text: io.TextIOBase, chosen: list[str] | None) -> Iterator[Any]:
        """Blocks of rows, of some columns or all.

        Raises:
            LogError: If a line has more entries than there are names.
        """
        expected, row = f"{len(self._names)} entries a line, as there are names", 0
        remedy = (
            "put lists and text with separators in quotes, name every column, or state the lines "
            "before the names as `skip_rows`"
        )
        try:
            with pd.read_csv(
                _Headed(self._separator.join("." * (len(self._names) + 1)) + "\n", text),
                header=0,
                names=[*self._names, _BEYOND],
                usecols=None if chosen is None else [*chosen, _BEYOND],
                index_col=False,
                sep=r"\s+" if self._separator == " " else self._separator,
                decimal=self._decimal,
                chunksize=BLOCK,
                skip_blank_lines=False,
                low_memory=False,
            ) as reader:
                while True:
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore", pd.errors.ParserWarning)  # refused below
                        frame = next(reader, None)
                    if frame is None:
                        return
                    more = np.flatnonzero(frame.pop(_BEYOND).notna())
                    if len(more):
                        found = f"more in row {row + int(more[0]) + 1}; {remedy}"
                        raise LogError(self.path, expected, found)
                    row += len(frame)
                    yield frame if len(frame) == BLOCK else self._without_text(frame)
        except pd.errors.EmptyDataError:
            return
        except pd.errors.ParserError as problem:
            found = f"more in row {row + 1} or below ({problem}); {remedy}"
            raise LogError(self.path, expected, found) from problem

    def _table(self, look: str, units: Mapping[str, str]) -> Topic:
        """Topic of the columns, by the first lines.

        Raises:
            LogError: If there is no line of names, or a line has more entries than names.
        """
        if any(_is_number(name) and not re.fullmatch(r"\.?\d+", name) for name in self._names):
            remedy = "write one above them, such as `t [s],gyro.x [rad/s],...`"
            found = f"numbers in line {self._skip}; {remedy}"
            raise LogError(self.path, "a line of names", found)
        with reading(self.path, "CSV"):
            frames = list(self._frames(io.StringIO(look), None))
        if not frames or not len(frames[0]):
            raise LogError(self.path, "samples below the line of names", "none")
        types, unplaced, stated = {}, {}, dict(units)
        commas = [name for name in self._names if _has_decimal_commas(frames[0][name])]
        self._commas += commas
        self.notes += [f"commas are decimal points in {', '.join(commas)}"] if commas else []
        self._calendar: list[str] = []
        for name in self._names:
            column = frames[0][name]
            if re.fullmatch(r"(\.\d+)?", name) and column.isna().all():
                continue  # a separator at the end of each line
            if name in commas or _numeric(column):
                self._numbers.append(name)
                types[name] = "float64" if name in commas else str(column.dtype)
            elif size := _list_size(column):
                plain, unit = _parted(name)
                entries = self._entries(name, plain, size)
                types |= dict.fromkeys(entries, "list")
                stated |= dict.fromkeys(entries, units.get(name, unit))
            elif _calendar(column.astype(str)).notna().mean() > 0.5:
                self._calendar.append(name)
                types[name] = "timestamp"
            else:
                words = [word for word in column if isinstance(word, str)]
                found = next((word for word in words if not _is_number(word)), "")
                unplaced[name] = f"text such as {found[:40]!r}"
        topic = table_topic(types, None, stated, unplaced=unplaced)
        self._pairs = stamp_pairs(types, {})
        hint = (
            "if these are no names, state the lines before the names as `skip_rows` in the mapping"
        )
        lines = look.count("\n") or 1
        packed = self.path.stat().st_size * (_PACKED if self._is_gzip() else 1.0)
        return replace(topic, hint=hint, about=int(packed * lines / max(1, len(look))))

    def _without_text(self, frame: Any) -> Any:
        """Last rows of the file, less those of text at its end."""
        tail = frame.filter(self._numbers).tail(_MOST_TEXT)
        text = tail.map(lambda word: isinstance(word, str) and not _is_number(word)).any(axis=1)
        samples = np.flatnonzero(~text & tail.notna().any(axis=1))
        last = samples[-1] + 1 if len(samples) else len(tail)
        if not text[last:].any():
            return frame
        note = f"rows of text at the end are left out, such as {tail[text].iloc[-1].iloc[0]!r}"
        self.notes.extend([note] if note not in self.notes else [])
        return frame.head(len(frame) - len(tail) + last)

    def _opened(self) -> io.TextIOWrapper:
        binary: Any = io.BytesIO(self._content)
        if not self._content:
            binary = gzip.open(self.path) if self._is_gzip() else self.path.open("rb")
        return io.TextIOWrapper(binary, encoding=self._encoding, newline="")

    def _is_gzip(self) -> bool:
        return first_bytes(self.path, 2) == b"\x1f\x8b"


_TABLE = re.compile(
    rb"(?m)^([A-Za-z][\w ]*?)[,;\t ]*\r?\n(\d+(?:\.\d+)?)[,;\t ]*\r?\n(?=(?:.*\n)?Frame\b)"
)
"""Head of a table in an export of Vicon Nexus: its name, its rate [Hz], then a line with Frame."""


class CsvTables(LogFile):
    """CSV file of several tables with their names and rates, such as an export of Vicon Nexus.

    Rows of each table are stamped by its rate from zero.

    Args:
        path: The file.
        content: Its content, which is held in memory.
        found: Heads of its tables.
    """

    format = "CSV of several tables"

    def __init__(self, path: Path, content: bytes, found: Sequence[re.Match[bytes]]) -> None:
        super().__init__(path)
        ends = [*(one.start() for one in found[1:]), len(content)]
        names = distinct(one[1].decode() for one in found)
        self._parts: dict[str, tuple[CsvFile, float]] = {}
        self.topics = {}
        for name, one, end in zip(names, found, ends, strict=True):
            part = CsvFile(path, content=content[one.start() : end].rstrip(b"\r\n,;\t ") + b"\n")
            rate = float(one[2])
            self._parts[name] = part, rate
            self.notes += [f"{name}: rows are stamped at {rate:g} Hz from 0, as the file says"]
            self.notes += [f"{name}: {note}" for note in part.notes if "skip_rows" not in note]
            base = StampSource(f"{rate:g} Hz")
            self.topics[name] = replace(
                part.topics[""], name=name, kind="rows", base=base, guess=""
            )

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows, table by table."""
        for key, one in enumerate(wanted):
            part, rate = self._parts[one.topic]
            counted = one.base.kind != "column"
            inner = one._replace(base=StampSource("rows")) if counted else one
            for block in part.blocks((inner,)):
                stamps = np.rint(block.stamps / rate).astype(np.int64) if counted else block.stamps
                yield Block(key, stamps, block.values)


def csv_file(path: Path) -> LogFile:
    """Open CSV file, of one table or several.

    Raises:
        LogError: If the file cannot be read, or has no line of names.
    """
    if _TABLE.match(first_bytes(path, _BEGINNING)) is None:
        return CsvFile(path)
    check_room(path, path.stat().st_size)
    content = path.read_bytes()
    found = [*_TABLE.finditer(content)]
    return CsvTables(path, content, found) if len(found) > 1 else CsvFile(path, content=content)


def _encoding(head: bytes) -> str:
    """Encoding of a text by its first bytes: UTF-8, that of Windows, or UTF-16 with its mark."""
    if head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def _ends_with_line(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 1))
        return file.read() in (b"\n", b"\r")


def _has_decimal_commas(column: Any) -> bool:
    """Whether most entries of a text column are numbers that have a comma as decimal point."""
    words = [word for word in column if isinstance(word, str) and word.strip()]
    numbers = [word for word in words if _is_number(word)]
    commas = [word for word in numbers if "," in word]
    decimal = len(commas) == len(words) or any(len(w.partition(",")[2]) != 3 for w in commas)
    return bool(commas) and decimal and 2 * len(numbers) > len(words)


def _numeric(column: Any) -> bool:
    known = pd.to_numeric(column, errors="coerce").notna()
    return column.dtype.kind in "fiub" or bool(known.mean() > 0.5)


def _calendar(column: Any) -> Any:
    """Calendar times of a column of text: ISO 8601, else times of the day, on the first of 1970."""
    stamps = pd.to_datetime(column, format="ISO8601", errors="coerce", utc=True)
    if 2 * stamps.notna().sum() > len(stamps) or not len(stamps):
        return stamps.dt.tz_localize(None)
    part = column.astype(str).str.extract(_OF_DAY)
    time, half = pd.to_timedelta(part["clock"].str.replace(",", ".")), part["half"].str.lower()
    time %= pd.to_timedelta(np.where(half.isna(), 24, 12), unit="h")
    return pd.Timestamp(0) + time + pd.to_timedelta(12 * half.eq("p"), unit="h")


def _comma_decimal(rows: Sequence[Sequence[str]]) -> bool:
    numbers = [cell for row in rows for cell in row if _is_number(cell)]
    return any("," in cell for cell in numbers) and not any("." in cell for cell in numbers)


class ParquetFile(_RowsFile):
    """Open Parquet file."""

    format = "Parquet"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with reading(path, "Parquet"):
            from pyarrow import parquet

            self._file = parquet.ParquetFile(path)
            schema = _flattened(self._file.schema_arrow.empty_table()).schema
            first = next(self._parts(None, 1), None)
            found, units, unplaced = dict[str, str](), dict[str, str](), dict[str, str]()
            for field in schema:
                name, kind, held = field.name, field.type, field.metadata or {}
                stated = held.get(b"unit", held.get(b"units", b""))
                units[name] = stated.decode("utf-8", "replace")
                if _is_any(kind, "timestamp"):
                    found[name] = "timestamp"
                elif _is_any(kind, *_NUMERIC):
                    found[name] = str(kind)
                elif _is_list_type(kind) and first is not None:
                    size = np.size(_flat(first[name].to_numpy()[0]))
                    if 0 < size <= _MOST_COLUMNS:
                        found |= dict.fromkeys(self._entries(name, name, size), str(kind))
                    else:
                        unplaced[name] = f"a list of {size} entries; 1 to {_MOST_COLUMNS} are read"
                else:
                    unplaced[name] = f"of type {kind}, no numbers"
        count = int(self._file.metadata.num_rows)
        self._pairs = stamp_pairs(found, {})
        self.topics = {"": table_topic(found, count, units, unplaced=unplaced)}

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _parts(self, sources: list[str] | None, rows: int = BLOCK) -> Iterator[Any]:
        from pyarrow import Table

        for batch in self._file.iter_batches(rows, columns=sources, use_threads=False):
            yield _flattened(Table.from_batches([batch]))


def _flat(entries: Any) -> Array:
    """Numbers of a list or of lists in it, (n,); NaN for entries that are none."""
    array = np.asarray(() if entries is None else entries)
    if array.dtype.kind == "O":
        return np.concatenate([_flat(one) if one is not None else [np.nan] for one in array])
    return array.astype(float).ravel()


def _flattened(table: Any) -> Any:
    """Table whose structures are columns of their own, named by dotted path."""
    while any(_is_any(kind, "struct") for kind in table.schema.types):
        table = table.flatten()
    return table


_NUMERIC = ("integer", "floating", "boolean", "decimal")


def _is_any(kind: Any, *words: str) -> bool:
    """Whether a type of Arrow is one of those that Arrow has a test for by these words."""
    from pyarrow import types

    return any(getattr(types, f"is_{word}")(kind) for word in words)


def _is_list_type(kind: Any) -> bool:
    listed = _is_any(kind, "list", "large_list", "fixed_size_list")
    return listed and (_is_any(kind.value_type, *_NUMERIC) or _is_list_type(kind.value_type))


class ColumnsFile(LogFile):
    """Log of tables whose columns are read as a whole, not block by block."""

    _columns: Callable[[str], Mapping[str, NDArray[Any]]]  # of a topic, by name

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows, topic by topic."""
        for key, one in enumerate(wanted):
            with reading(self.path, self.format):
                columns = self._columns(one.topic)
            yield from column_blocks(key, one, columns, str(self.path))


class _HeldFile(ColumnsFile):
    """Log whose tables are in memory, as columns by name."""

    _tables: dict[str, dict[str, Any]]

    def _hold(
        self, columns: dict[str, Any], unplaced: Mapping[str, str], units: Mapping[str, str]
    ) -> None:
        """Take columns of one table; of several lengths, each has its own."""
        lengths = Counter(len(column) for column in columns.values())
        if not lengths:
            some = [f"{name} ({reason})" for name, reason in list(unplaced.items())[:6]]
            found = f"none{', but ' * bool(some)}{', '.join(some)}"
            raise LogError(self.path, "arrays of numbers", found)
        if len(lengths) > 1:
            described = ", ".join(f"{n} of {rows} rows" for rows, n in lengths.most_common(4))
            self.notes.append(f"arrays of several lengths: {described}; each needs its own stamp")
        types = {name: str(column.dtype) for name, column in columns.items()}
        most = lengths.most_common(1)[0][0]
        own = {name: len(column) for name, column in columns.items() if len(lengths) > 1}
        topic = table_topic(types, most, units, rows=own, unplaced=unplaced)
        for name, both in stamp_pairs(types, own).items():
            columns[name] = _joined({one: columns[one] for one in both}, str(self.path), 0)
        self.topics, self._tables = {"": topic}, {"": columns}

    def _columns(self, topic: str) -> Mapping[str, NDArray[Any]]:
        return self._tables[topic]

    def close(self) -> None:
        """Release the memory."""
        self._tables = {}


class MatFile(_HeldFile):
    """MATLAB file in memory; of version 7.3, which is HDF5, the arrays of numbers."""

    format = "MAT"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        if b"7.3 MAT" in first_bytes(path, 16):
            with reading(path, "MAT 7.3", otherwise=_OLDER):
                return self._hold(*_hdf5_columns(path, reversed_axes=True))
        columns: dict[str, Any] = {}
        unplaced: dict[str, str] = {}
        with reading(path, "MAT"):
            from scipy.io import loadmat

            check_elements(path)
            held = loadmat(path, squeeze_me=True, struct_as_record=False)
            for name, value in held.items():
                if not name.startswith("__"):
                    _place(name, value, columns, unplaced)
        self._hold(columns, unplaced, {})


class Hdf5File(_HeldFile):
    """HDF5 or netCDF4 file in memory, arrays of its groups by dotted path."""

    format = "HDF5"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with reading(path, "HDF5", otherwise=_AS_MAT):
            self._hold(*_hdf5_columns(path))


def _hdf5_columns(
    path: Path, *, reversed_axes: bool = False
) -> tuple[dict[str, Any], dict[str, str], dict[str, str]]:
    """Arrays of an HDF5 file as columns, content that is not read with the reason, and units.

    Args:
        path: The file.
        reversed_axes: Whether the axes are in the opposite order, as MATLAB stores them.

    Raises:
        Unreadable: If its arrays would take too much memory.
    """
    from netCDF4 import VLType  # has entries of any length, text included

    missing = {"_FillValue", "missing_value", "valid_min", "valid_max", "valid_range"}
    columns: dict[str, Any] = {}
    unplaced, units = dict[str, str](), dict[str, str]()
    with closing(open_netcdf(path)) as file:
        groups = [("", file)]
        for place, group in groups:  # which grows
            held = group.groups.items()
            groups += [(f"{place}{name}.", one) for name, one in held if not name.startswith("#")]
        found = [
            (f"{at}{name}", one) for at, group in groups for name, one in group.variables.items()
        ]
        check_room(path, sum(8 * one.size for _, one in found))
        if "#refs#" in file.groups:
            unplaced["#refs#"] = "cells or arrays of structures, no array of numbers"
        for name, one in found:
            known, kind = set(columns), getattr(one, "MATLAB_class", "")
            if isinstance(one.datatype, VLType) or kind in ("char", "cell"):
                unplaced[name] = "text, lists or half precision, no array of numbers"
                continue
            if hasattr(one, "MATLAB_empty"):  # its numbers are its sizes
                unplaced[name] = "an empty array, no samples"
                continue
            if not hasattr(file, "_NCProperties") and missing.isdisjoint(one.ncattrs()):
                one.set_auto_mask(False)  # netCDF's own fill values are numbers of other programs
            try:
                values = one[...]
            except RuntimeError as problem:  # such as a filter that the library lacks
                remedy = "take the filter away: h5repack -f NONE log.h5 plain.h5"
                unplaced[name] = f"{problem}; {remedy}"
                continue
            for part in values.dtype.names or ("",):
                array = np.ma.getdata(values[part] if part else values)
                if np.ma.is_masked(values):
                    array = np.ma.filled(values.astype(float), np.nan)
                array = np.squeeze(array.T if reversed_axes else array)
                _place(f"{name}.{part}" if part else name, array, columns, unplaced)
            unit = str(getattr(one, "units", getattr(one, "unit", "")))
            units |= dict.fromkeys((column for column in columns if column not in known), unit)
    return columns, unplaced, units


def _place(name: str, value: Any, columns: dict[str, Any], unplaced: dict[str, str]) -> None:
    """Add the columns of a MATLAB value, or the reason why it has none.

    The longest side of an array is that of the samples.
    """
    fields = getattr(value, "_fieldnames", None)  # of SciPy's mat_struct
    if fields is not None:
        for inner in fields:
            _place(f"{name}.{inner}", getattr(value, inner), columns, unplaced)
        return
    array = np.asarray(value)
    if array.dtype.kind not in "fiub":
        kinds = {"U": "text", "S": "text", "c": "complex numbers", "O": "cells or an array of "
                 "structures", "V": "an object of MATLAB, such as a timetable"}  # fmt: skip
        unplaced[name] = f"{kinds.get(array.dtype.kind, array.dtype)}, no array of numbers"
        return
    if array.size < 2 or array.ndim > 3:
        what = f"array of {array.ndim} dimensions" if array.ndim > 3 else f"{array.size} number(s)"
        unplaced[name] = f"{what}, no samples"
        return
    if array.ndim == 1:
        columns[name] = array
        return
    side = max(range(array.ndim), key=lambda axis: (array.shape[axis], -axis))
    entries = np.moveaxis(array, side, 0)
    places = list(np.ndindex(entries.shape[1:]))
    for place in places[:_MOST_COLUMNS]:
        ending = "".join(f"[{k}]" for k in place)
        columns[name + ending] = np.ascontiguousarray(entries[(slice(None), *place)])
    if len(places) > _MOST_COLUMNS:
        unplaced[name] = f"{len(places)} columns, of which {_MOST_COLUMNS} are read"


class UlogFile(_HeldFile):
    """ULog file in memory."""

    format = "PX4 ULog"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with reading(path, "ULog"), redirect_stdout(io.StringIO()):
            from pyulog import ULog

            with path.open("rb") as file:
                watched = _Watched(file)
                log = ULog(watched)
            if watched.cut:
                self.notes.append("the file ends within a record: it was cut off")
            parts = defaultdict[str, list[Any]](list)
            for part in sorted(log.data_list, key=lambda p: (p.name, p.multi_id)):
                name = f"{part.name}/{part.multi_id}" if part.multi_id else part.name
                if "timestamp" in part.data:
                    parts[name].append(part.data)
                else:
                    self.notes.append(f"{name}: without a field `timestamp`; it is not read")
            self._tables = {name: _in_turn(found) for name, found in parts.items()}
        self.topics = {name: _topic(name, part) for name, part in self._tables.items()}
        if log.file_corruption:
            cause = "has data appended" if log.has_data_appended else "is damaged"
            self.notes.append(f"the file {cause}: what could not be read was left out")
        lost = [gap.duration for gap in log.dropouts]
        if lost:
            self.notes.append(
                f"{len(lost)} dropout(s) of the logger, {sum(lost) / 1e3:.4g} s in all, "
                f"the longest {max(lost) / 1e3:.4g} s"
            )


class _Watched:
    """Binary file that records whether a read came back short, and ends reads in a circle."""

    def __init__(self, file: Any) -> None:
        self._file, self.cut = file, False
        self.seek, self.tell, self.close = file.seek, file.tell, file.close
        self._left = 64 * os.fstat(file.fileno()).st_size  # B; each is needed a few times

    def read(self, size: int = -1) -> bytes:
        content: bytes = self._file.read(size)
        self._left -= len(content)
        if self._left < 0:
            raise EOFError("its messages lead back to where they began")
        self.cut = 0 < len(content) < size
        return content


def _in_turn(parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Columns of a topic that was subscribed one time or several, by time; NaN where one is not."""
    if len(parts) == 1:
        return parts[0]
    whole = pd.concat(map(pd.DataFrame, parts)).sort_values("timestamp", kind="stable")
    return {str(name): column.to_numpy() for name, column in whole.items()}


def _topic(name: str, columns: Any) -> Topic:
    channels = {}
    for field, values in columns.items():
        unit = "us" if field.startswith("timestamp") else unit_of_suffix(field)
        channels[field] = Channel(field, str(np.asarray(values).dtype), unit)
    base = StampSource("column", "timestamp", 1e3)
    return Topic(name, "ULog", len(columns["timestamp"]), channels, base)
