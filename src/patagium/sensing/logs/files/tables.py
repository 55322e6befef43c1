"""Tables of all formats: columns with one unit each, one of which has the stamps.

Where a file does not name its column of time, a guess is made for `inspect` alone, and the log
notes say that it is a guess.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
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
