"""Interface of all log files: topics with named numbers, read in blocks with time stamps.

A topic is a group of numbers that share one stamp: the messages of one name, or a whole table
(its name is then empty). Stamps are whole nanoseconds, so that clocks of days lose nothing.
Text, images and other content without numbers is not read.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from patagium.arrays import Array, Indices
from patagium.errors import LogError, PatagiumError

Stamps = Indices

NO_STAMP = np.iinfo(np.int64).min
"""Stamp of a row without a usable stamp."""
BLOCK = 1 << 16
"""Rows of a table that are read at once."""
_DAY, _BEFORE_1970, _YEARS = 86400e9, 719529.0, 5e5
"""A day [ns], days before 1970 in MATLAB's count from the year 0, and days that are of it."""
_CLOSE = 3


class StampSource(NamedTuple):
    """Source of the stamps of a topic.

    Attributes:
        kind: "header" or "received" for messages, "column" for a column or field, "rows" for
            counted rows.
        column: Name of the column or field, or path of the stamp in messages.
        factor: Its unit [ns].
    """

    kind: str
    column: str = ""
    factor: float = 1.0


class Request(NamedTuple):
    """Request for some numbers of a topic.

    Attributes:
        topic: Name of the topic.
        base: Source of the stamps.
        fields: Paths of the numbers.
        filled: Whether only rows count in which one of them is a number.
    """

    topic: str
    base: StampSource
    fields: tuple[str, ...]
    filled: bool = False


class Block(NamedTuple):
    """Some rows of a topic, in the order of the file.

    Attributes:
        key: Place of the request in the list of requests.
        stamps: Stamps of the rows, (k,) [ns].
        values: Numbers in the units of the file, (k, number of fields).
    """

    key: int
    stamps: Stamps
    values: Array


@dataclass(frozen=True)
class Channel:
    """Number of a topic.

    Attributes:
        name: Path of the number.
        dtype: Name of its type in the file.
        unit: Unit that the file or the message type states; empty if neither does.
        rows: Number of its rows, where the columns of a table differ in length.
    """

    name: str
    dtype: str
    unit: str = ""
    rows: int | None = None


@dataclass(frozen=True)
class Topic:
    """Group of numbers that share one stamp.

    Attributes:
        name: Name of the topic; empty for a table.
        kind: Type of its messages, or "table".
        count: Number of rows; None if the file does not state it.
        channels: Its numbers, by path.
        base: Source of its stamps unless a mapping names another.
        problem: Reason why the topic cannot be read; empty if it can.
        aliases: Other ways to write a path.
        about: Estimated number of rows where `count` is None.
        guess: Note about stamps that had to be guessed without a mapping.
        unplaced: Content that is not read, by path, with the reason.
        hint: Remedy where a mapping names a path that the topic does not have.
        stamped: Whether its messages have stamps, which may be zero.
        varied: Whether some of its messages have numbers that others lack.
    """

    name: str
    kind: str
    count: int | None
    channels: Mapping[str, Channel] = field(default_factory=dict)
    base: StampSource = StampSource("rows")
    problem: str = ""
    aliases: Mapping[str, str] = field(default_factory=dict)
    about: int = 0
    guess: str = ""
    unplaced: Mapping[str, str] = field(default_factory=dict)
    hint: str = ""
    stamped: bool = False
    varied: bool = False

    @property
    def known(self) -> dict[str, str]:
        """Path of each number, by the ways to write it."""
        return {**self.aliases, **{name: name for name in self.channels}}


class LogFile(Protocol):
    """Open log file.

    Args:
        *paths: The file, or the parts of one log.

    Raises:
        LogError: If it cannot be read.

    Attributes:
        path: Path of the log.
        format: Name of its format.
        notes: Assumptions made to read it, and damage found in it.
        topics: Its topics, by name.
    """

    path: Path
    format: str
    notes: list[str]
    topics: dict[str, Topic]

    def __init__(self, *paths: Path) -> None:
        self.path = paths[0] if len(paths) == 1 else paths[0].parent
        self.notes = []

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows, topic by topic or interleaved as in the file.

        Raises:
            LogError: If the file is damaged, or a column holds text.
        """
        ...

    def close(self) -> None:
        """Close the file, if it is open between two reads."""
        return


class ColumnError(LogError):
    """Column of a log that cannot be read as numbers, while others can.

    Args:
        where: The file.
        column: Its name.
        expected: What it may hold, in words.
        found: What it holds, with the remedy.
    """

    def __init__(self, where: str, column: str, expected: str, found: str) -> None:
        super().__init__(f"{where}: column {column}", expected, found)
        self.column = column


@contextmanager
def reading(path: Path, kind: str, extra: str = "logs", otherwise: str = "") -> Iterator[None]:
    """Guard that turns errors of a reading library into a `LogError` of one sentence.

    Args:
        path: The file.
        kind: Format the file was taken for.
        extra: Extra of the package that installs the library.
        otherwise: Remedy without the library, or where it cannot read the file.

    Raises:
        LogError: If the library is missing, or fails in any way on a damaged file.
    """
    remedy = f"; {otherwise}" if otherwise else ""
    try:
        yield
    except PatagiumError:
        raise
    except ModuleNotFoundError as problem:
        raise LogError(
            f"{path}: reading {kind} needs the package {(problem.name or '').partition('.')[0]!r}: "
            f"pip install 'patagium[{extra}]'{remedy}"
        ) from problem
    except Exception as problem:  # libraries raise their own, struct's, zlib's and Python's
        reason = one_line(problem, 300)
        raise LogError(f"{path}: cannot be read as {kind}: {reason}{remedy}") from problem


def first_bytes(path: Path, count: int) -> bytes:
    """Bytes at the beginning of a file, at most so many."""
    with path.open("rb") as file:
        return file.read(count)


def one_line(problem: Exception, most: int) -> str:
    """Message of an error on one line of at most so many characters."""
    return " ".join(str(problem).split())[:most] or type(problem).__name__


def nanoseconds(raw: NDArray[Any], factor: float) -> Stamps:
    """Stamps of a column in whole nanoseconds, `NO_STAMP` where the column has no number.

    Args:
        raw: Column, (k,) [unit].
        factor: Its unit [ns].

    Returns:
        Stamps, (k,) [ns].
    """
    if raw.dtype.kind == "M":
        stamps = raw.astype("datetime64[ns]").astype(np.int64)
        return np.asarray(stamps, np.int64)  # not-a-time is the same integer as NO_STAMP
    if raw.dtype.kind in "iu" and factor == round(factor):
        most = (2**62) // max(1, round(factor))
        inside = (raw >= -most) & (raw <= most) if raw.dtype.kind == "i" else raw <= most
        stamps = np.where(inside, raw, 0).astype(np.int64) * round(factor)
        return np.where(inside, stamps, NO_STAMP)
    plain = raw.astype(float)
    if factor == _DAY:
        plain = np.where(plain > _YEARS, plain - _BEFORE_1970, plain)
    scaled = plain * factor
    inside = np.abs(scaled) < 2.0**62
    return np.where(inside, np.rint(np.where(inside, scaled, 0.0)), NO_STAMP).astype(np.int64)


def find_topic(log: LogFile, name: str, where: str) -> Topic:
    """Topic of a name.

    Raises:
        LogError: If the log has no such topic, or the topic cannot be read.
    """
    topic = log.topics.get(name) or log.topics.get(name.removesuffix("/0"))
    if topic is None:
        raise LogError(
            f"{where}: {log.path} holds no topic {name!r}"
            f"{_closest(name, log.topics)}; it holds {some(t or 'a table' for t in log.topics)}"
        )
    if topic.problem:
        of = f"topic {name!r} of {log.path}" if name else str(log.path)
        raise LogError(f"{where}: {of}: {topic.problem}")
    return topic


def find_fields(topic: Topic, source: str | tuple[str, ...], size: int, where: str) -> list[str]:
    """Paths of the components of a quantity.

    Args:
        topic: Topic that holds the quantity.
        source: Path of the quantity, or the paths of its components.
        size: Number of components: 1, 3, 4, or 9 of a matrix row by row.
        where: Place in the mapping, for messages.

    Raises:
        LogError: If the topic has no such path; the message names the closest ones.
    """
    if not isinstance(source, str):
        return [find_fields(topic, one, 1, where)[0] for one in source]
    known = topic.known
    for endings in _endings(size):
        paths = [source + ending for ending in endings]
        longer = endings[-1] == f"[{size - 1}]" and f"{source}[{size}]" in known
        if all(path in known for path in paths) and not longer:
            return [known[path] for path in paths]
    held = [n for n in topic.channels if n == source or re.match(re.escape(source) + r"[.\[_]", n)]
    if held and size == 1:
        raise LogError(f"{where}: {source!r} is no number; expected one of its parts: {some(held)}")
    if held:
        raise LogError(
            f"{where}: expected {size} components under {source!r}, such as {source}.x or "
            f"{source}[0], found {some(held)}; a list of names takes some of them"
        )
    raise LogError(_missing(topic, source, where))


def _endings(size: int) -> Iterator[list[str]]:
    """Ways in which the names of the components of a quantity may end."""
    counted = [str(k) for k in range(size)]
    if size == 1:
        yield [""]
        return
    if size == 9:
        for first in (0, 1):
            places = [f"{first + k // 3}{first + k % 3}" for k in range(9)]
            for pattern in (".{}{}", "_{}{}", "{}{}", "[{}][{}]", "[{},{}]", "_{}_{}"):
                yield [pattern.format(*place) for place in places]
        yield [f"[{k}]" for k in counted]
        yield from ([f"_{k + first}" for k in range(9)] for first in (0, 1))
        return
    letters = "wxyz" if size == 4 else "xyz"
    for pattern in (".{}", "_{}", "{}", "[{}]", ".{}[0]"):
        yield [pattern.format(key) for key in (counted if pattern == "[{}]" else letters)]


def _missing(topic: Topic, path: str, where: str) -> str:
    for name, reason in topic.unplaced.items():
        if path in (name, re.split(r"\s*[\[(]", name)[0]):  # the name alone, or with its unit
            return f"{where}: {path!r} cannot be read as numbers: {reason}"
    held = f"topic {topic.name!r} ({topic.kind})" if topic.name else "the file"
    stems = {re.split(r"\.[^.]*$|\[[^\[]*$", name)[0] for name in topic.channels}
    closest = _closest(path, [*topic.channels, *sorted(stems)])
    remedy = closest + f"; {topic.hint}" * bool(topic.hint)
    return f"{where}: expected {path!r}, but {held} holds {some(topic.channels)}{remedy}"


def _closest(name: str, names: Any) -> str:
    folded = {known.lower(): known for known in names}
    near = get_close_matches(name.lower(), folded, _CLOSE, 0.5)
    if not near:
        near = [known for known in folded if name.lower().strip("/") in known][:_CLOSE]
    return f"; closest: {', '.join(folded[one] for one in near)}" if near else ""


def some(names: Iterable[str], most: int = 12) -> str:
    """First of some names for a message, and how many more there are."""
    listed = list(names)
    more = f" and {len(listed) - most} more" if len(listed) > most else ""
    return (", ".join(listed[:most]) or "nothing with numbers") + more
