"""Tables: columns with one unit each, stamped by one of them.

What a file does not say is guessed for `inspect` alone, and said to be a guess.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import Array, Base, Channel, Topic

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
    name: str = "",
    stamped: Mapping[str, float] | None = None,
) -> Topic:
    """The topic of a table.

    Args:
        columns: Type of each column with numbers, by its name in the file.
        count: Rows, if known.
        units: Units the file states.
        name: Name of the topic.
        stamped: Columns that hold calendar time, and the nanoseconds of their unit.
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
    return Topic(name, "table", count, channels, base, aliases=aliases, guess=guess)


def unit_of_suffix(name: str) -> str:
    """The unit that the end of a name tells, such as `_m_s2`; empty if none."""
    stem = re.sub(r"(\[\d+\]|\.[wxyz])+$", "", name.lower())
    if stem.startswith("gyro") and stem.endswith("_rad"):
        return "rad/s"  # as PX4 has it
    return next((unit for end, unit in _SUFFIXES.items() if stem.endswith(end)), "")


def _guessed_base(
    channels: Mapping[str, Channel], stamped: Mapping[str, float]
) -> tuple[Base, str]:
    for column, factor in stamped.items():
        return Base("column", column, factor), ""
    for column in channels:
        match = _TIME.match(column.strip().lower())
        if match:
            unit = match[2] or channels[column].unit or "s"
            plain = not match[2] and unit == "s"
            guess = f"column {column!r} taken for time in s; a mapping says it better"
            return Base("column", column, _NANOSECONDS.get(unit, 1e9)), guess if plain else ""
    return Base("rows"), "no column is named like time; rows are counted instead"


def as_numbers(raw: Any, column: str, where: str, first: int) -> Array:
    """A column as floats; text that is no number is refused.

    Args:
        raw: The column.
        column: Its name.
        where: The file, for messages.
        first: Row of its first entry.
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


def distinct(names: Iterable[str]) -> list[str]:
    """Names, a second of the same told apart as pandas does."""
    seen: dict[str, int] = {}
    told = []
    for name in names:
        count = seen.get(name, 0)
        seen[name] = count + 1
        told.append(f"{name}.{count}" if count else name)
    return told
