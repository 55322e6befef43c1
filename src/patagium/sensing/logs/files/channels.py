"""What all log files have in common: topics with named numbers, read in blocks with stamps.

A topic is whatever is stamped together: the messages of one name, or a whole table (its name is
then empty). Stamps are whole nanoseconds, so that clocks of days lose nothing. Neglected: text,
images, and whatever else is no number.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from patagium.errors import LogError, PatagiumError

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

NO_STAMP = np.iinfo(np.int64).min
"""In place of a stamp that is missing or no number."""
BLOCK = 1 << 16
"""Rows read at once."""
_SHOWN = 12
_CLOSE = 3


class Base(NamedTuple):
    """Where the stamps of a topic come from.

    Attributes:
        kind: "header", "received", "auto" (the header's where there is one), "column" or "rows".
        column: Its name.
        factor: Nanoseconds of its unit.
    """

    kind: str
    column: str = ""
    factor: float = 1.0


class Wanted(NamedTuple):
    """What to read of a topic.

    Attributes:
        topic: Its name.
        base: Where its stamps come from.
        fields: Paths of numbers.
    """

    topic: str
    base: Base
    fields: tuple[str, ...]


class Block(NamedTuple):
    """Some rows of a topic, in the order of the file.

    Attributes:
        key: Place in the list of what was wanted.
        stamps: (k,) [ns].
        values: (k, number of fields), as in the file.
        consumed: Rows of the topic passed so far, in all.
    """

    key: int
    stamps: Stamps
    values: Array
    consumed: int


@dataclass(frozen=True)
class Channel:
    """A number of a topic.

    Attributes:
        name: Its path.
        dtype: Its type in the file, in words.
        unit: Its unit where the file or its type tells; empty otherwise.
    """

    name: str
    dtype: str
    unit: str = ""


@dataclass(frozen=True)
class Topic:
    """What is stamped together.

    Attributes:
        name: Its name; empty for a table.
        kind: Type of its messages, or "table".
        count: Rows, where the file tells without being read.
        channels: Its numbers, by path.
        base: What stamps it unless a mapping says otherwise.
        problem: Why it cannot be read; empty if it can.
        aliases: Other ways to write a path.
        about: Rows, where they can only be estimated.
        guess: What was guessed of its stamps, for want of a mapping.
    """

    name: str
    kind: str
    count: int | None
    channels: Mapping[str, Channel]
    base: Base
    problem: str = ""
    aliases: Mapping[str, str] = field(default_factory=dict)
    about: int = 0
    guess: str = ""


class LogFile(Protocol):
    """A log that is open.

    Attributes:
        path: Where it is.
        format: What it is.
        notes: What had to be assumed to read it, and what is wrong with it.
        topics: What it holds.
    """

    path: Path
    format: str
    notes: list[str]
    topics: dict[str, Topic]

    def blocks(self, wanted: tuple[Wanted, ...], skip: tuple[int, ...]) -> Iterator[Block]:
        """Rows of what is wanted, topic by topic or as they are mixed in the file.

        Args:
            wanted: What to read.
            skip: Rows of each that were read before.
        """
        ...

    def close(self) -> None:
        """Let the file go."""
        ...


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Whatever a library raises on a broken file, as one sentence.

    Args:
        path: The file.
        kind: What it was taken for.

    Raises:
        LogError: For anything but our own errors; damaged lengths may ask for all memory.
    """
    try:
        yield
    except PatagiumError:
        raise
    except ModuleNotFoundError as problem:
        raise LogError(
            f"{path}: reading {kind} needs the package {problem.name!r}: "
            "pip install 'patagium[logs]'"
        ) from problem
    except Exception as problem:  # libraries raise their own, struct's, zlib's and Python's
        reason = " ".join(str(problem).split())[:300] or type(problem).__name__
        raise LogError(f"{path}: cannot be read as {kind}: {reason}") from problem


def nanoseconds(raw: NDArray[Any], factor: float) -> Stamps:
    """Stamps of a column as whole nanoseconds; what is no number becomes `NO_STAMP`.

    Args:
        raw: The column.
        factor: Nanoseconds of its unit.
    """
    if raw.dtype.kind == "M":
        stamps = raw.astype("datetime64[ns]").astype(np.int64)
        return np.asarray(stamps, np.int64)  # not-a-time is the same integer as NO_STAMP
    if raw.dtype.kind in "iu" and factor == round(factor):
        most = (2**62) // max(1, round(factor))
        inside = (raw >= -most) & (raw <= most) if raw.dtype.kind == "i" else raw <= most
        stamps = np.where(inside, raw, 0).astype(np.int64) * round(factor)
        return np.where(inside, stamps, NO_STAMP)
    scaled = raw.astype(float) * factor
    inside = np.abs(scaled) < 2.0**62
    return np.where(inside, np.rint(np.where(inside, scaled, 0.0)), NO_STAMP).astype(np.int64)


def find_topic(log: LogFile, name: str, where: str) -> Topic:
    """A topic by its name.

    Args:
        log: The log.
        name: Wanted.
        where: Named in messages.

    Raises:
        LogError: If there is none, with what there is; or it cannot be read.
    """
    topic = log.topics.get(name) or log.topics.get(name.removesuffix("/0"))
    if topic is None:
        raise LogError(
            f"{where}: {log.path} holds no topic {name!r}"
            f"{_closest(name, log.topics)}; it holds {_some(t or 'a table' for t in log.topics)}"
        )
    if topic.problem:
        raise LogError(f"{where}: topic {name!r} of {log.path}: {topic.problem}")
    return topic


def find_fields(topic: Topic, source: str | tuple[str, ...], size: int, where: str) -> list[str]:
    """Paths of the components of a quantity.

    Args:
        topic: Where it is.
        source: Its path, or those of its components.
        size: Number of components: 1, 3 or 4.
        where: Named in messages.

    Raises:
        LogError: If a path is not there, with the closest ones that are.
    """
    if not isinstance(source, str):
        return [find_fields(topic, one, 1, where)[0] for one in source]
    if size == 1:
        found = _known(topic, source)
        if found is not None:
            return [found]
        parts = [name for name in topic.channels if re.match(re.escape(source) + r"[.\[_]", name)]
        if parts:
            raise LogError(
                f"{where}: {source!r} is no number; expected one of its parts: {_some(parts)}"
            )
        raise LogError(_missing(topic, source, where))
    letters = "wxyz" if size == 4 else "xyz"
    for pattern in (".{}", "_{}", "{}", "[{}]", ".{}[0]"):
        keys = [str(k) for k in range(size)] if pattern == "[{}]" else list(letters)
        paths = [_known(topic, source + pattern.format(key)) for key in keys]
        if all(path is not None for path in paths):
            return [str(path) for path in paths]
    held = [n for n in topic.channels if n == source or re.match(re.escape(source) + r"[.\[_]", n)]
    if held:
        raise LogError(
            f"{where}: expected {size} components under {source!r}, such as {source}.x or "
            f"{source}[0], found {_some(held)}"
        )
    raise LogError(_missing(topic, source, where))


def components_are_named(fields: list[str], size: int) -> bool:
    """Whether four components were found by the names w, x, y, z rather than by their order."""
    return size == 4 and [name[-1:] for name in fields] == list("wxyz")


def _known(topic: Topic, path: str) -> str | None:
    if path in topic.channels:
        return path
    return topic.aliases.get(path)


def _missing(topic: Topic, path: str, where: str) -> str:
    held = f"topic {topic.name!r}" if topic.name else "the file"
    kind = f" ({topic.kind})" if topic.name else ""
    stems = {re.split(r"\.[^.]*$|\[[^\[]*$", name)[0] for name in topic.channels}
    return (
        f"{where}: expected {path!r}, but {held}{kind} holds "
        f"{_some(topic.channels)}{_closest(path, [*topic.channels, *sorted(stems)])}"
    )


def _closest(name: str, names: Any) -> str:
    folded = {known.lower(): known for known in names}
    near = get_close_matches(name.lower(), folded, _CLOSE, 0.5)
    if not near:
        near = [known for known in folded if name.lower().strip("/") in known][:_CLOSE]
    return f"; closest: {', '.join(folded[one] for one in near)}" if near else ""


def _some(names: Any) -> str:
    listed = list(names)
    more = f" and {len(listed) - _SHOWN} more" if len(listed) > _SHOWN else ""
    return (", ".join(listed[:_SHOWN]) or "nothing with numbers") + more
