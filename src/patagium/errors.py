"""Exceptions of patagium, which carry their evidence.

Every exception of patagium is a `PatagiumError`, and also the builtin a caller
would catch by habit. Inside compiled numerics nothing is raised: an `Outcome`
is returned, and turned into an exception at the door.
"""

from __future__ import annotations

import errno
import os
import shlex
import sys
from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches
from enum import IntEnum
from math import isfinite
from numbers import Real
from pathlib import Path
from types import MappingProxyType
from typing import Any

from patagium.limits import PROBLEMS, SHOWN

__all__ = [
    "CompilerError",
    "FilterDiverged",
    "FlightError",
    "LinkageError",
    "LogError",
    "Outcome",
    "OutputError",
    "ParameterError",
    "PatagiumError",
    "PathError",
    "RobotFileError",
    "RobotFileWarning",
    "ShapeError",
    "SimulationFailed",
    "Unreadable",
]


class PatagiumError(Exception):
    """Root of everything patagium raises on purpose.

    Args:
        name: What is wrong; the whole message where nothing else is given.
        expected: What it may be, in words.
        found: What it is.
    """

    def __init__(self, name: object = "", expected: object = None, found: object = "") -> None:
        told = "" if expected is None else f": expected {expected}, found {found}"
        super().__init__(f"{name}{told}")

    def __reduce__(self) -> Any:
        """Words and evidence for `pickle`, by which pools of processes send what was raised."""
        return type(self).__new__, (type(self),), {**vars(self), "args": self.args}


class ShapeError(PatagiumError, ValueError):
    """An array of the wrong shape.

    Args:
        name: The argument.
        expected: Expected shape, in words or as a tuple.
        found: Shape found.
    """

    def __init__(self, name: str, expected: object, found: object) -> None:
        word = "" if str(expected)[0].isalpha() else "shape "
        super().__init__(name, f"{word}{expected}", found)
        self.name, self.expected, self.found = name, expected, found


class ParameterError(PatagiumError, ValueError):
    """An argument outside of what it may be.

    Args:
        name: The argument.
        expected: What it may be, in words.
        found: What it was.
        known: Words it may be; one that is similar to what was found is suggested.
    """

    def __init__(self, name: str, expected: str, found: object, known: Iterable[str] = ()) -> None:
        seen = "nothing" if found is None else shown(plain(found), 400) + similar(found, known)
        super().__init__(name, expected, seen)
        self.name, self.expected, self.found = name, expected, found


def shown(value: object, most: int = SHOWN) -> str:
    """Text of any object for a message, cut to a number of characters."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # a number of thousands of digits
        text = type(value).__name__
    if len(text) > SHOWN and type(value).__module__.startswith(("patagium", "xarray")):
        reason = getattr(value, "reason", "")  # of a NoOrbit
        name = type(value).__name__
        return f"{'an' if name[0] in 'AEIOU' else 'a'} {name}" + (f": {reason}" if reason else "")
    return text if len(text) <= most else text[: most - 3] + "..."


def command(words: str, *files: object) -> str:
    """Words of a command with files, quoted for a shell and no options, in place of `{}`."""
    names = (f"./{one}" if f"{one}".startswith("-") else str(one) for one in files)
    return words.format(*map(shlex.quote, names))


def similar(word: object, known: Iterable[str]) -> str:
    """Hint such as "; did you mean mass?", or nothing where no known word is similar.

    Args:
        word: What was written.
        known: What may be written, or a mapping from that to what to write today.
    """
    today = known if isinstance(known, Mapping) else {name: name for name in known}
    names = {name.lower(): name for name in today}
    text = word.lower()[:SHOWN] if isinstance(word, str) else ""
    longer = [name for name in names if len(text) > 2 and name.startswith(text)]
    tried = ((names, 0.85), (longer, 0.0), (names, 0.6))  # a slip, an abbreviation, anything near
    near = next(filter(None, (get_close_matches(text, one, 1, least) for one, least in tried)), [])
    return f"; did you mean {today[names[near[0]]]}?" if near else ""


def unknown_name(module: str, name: str, known: Iterable[str]) -> AttributeError:
    """Error of a name that a module does not have, with a similar one that it has.

    Args:
        module: Dotted name of the module.
        name: What was asked for.
        known: Its public names, or a mapping from these to what to write today.
    """
    return AttributeError(f"module {module!r} has no attribute {name!r}{similar(name, known)}")


def suggest_names(module: str) -> None:
    """Let a module answer an unknown name with a similar one of its public names.

    Args:
        module: Dotted name of the module, which has `__all__`.
    """
    names = vars(sys.modules[module])

    def absent(name: str) -> Any:
        raise unknown_name(module, name, names["__all__"])

    names["__getattr__"] = absent  # not declared, so that type checkers know what is absent


def told_problems(
    file: str, problems: Iterable[tuple[str, str, str]], lines: Mapping[str, int]
) -> str:
    """Lines of a message: the first few problems of a `RobotFileError`, and how many more."""
    told = [
        f"{file}: {f'line {lines[where]}, ' if where in lines else ''}{where[:300] or 'file'}: "
        f"expected {want[:1000]}, found {got[:300]}"
        for where, want, got in problems
    ]
    more = [f"and {len(told) - PROBLEMS} more problems"] if len(told) > PROBLEMS else []
    return "\n".join([*told[:PROBLEMS], *more])


def plain(value: Any) -> Any:
    """Number of an array without axes, also of those within a dictionary; else what was given."""
    if type(value) is dict:
        return {name: plain(one) for name, one in value.items()}
    lone = getattr(value, "shape", None) == () and not hasattr(value, "mask")
    return value.item() if lone and hasattr(value, "item") else value


class RobotFileError(PatagiumError, ValueError):
    """A robot file that does not describe a robot.

    Args:
        file: The file.
        problems: One `(path in the file, expected, found)` a problem.
        lines: Number of the line of a path, where it is known.
    """

    def __init__(
        self,
        file: str,
        problems: list[tuple[str, str, str]],
        lines: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        super().__init__(told_problems(file, problems, lines))
        self.file, self.problems = file, problems


class RobotFileWarning(UserWarning):
    """Warning: a robot file has what a robot cannot represent, or what is likely a slip."""


class PathError(PatagiumError, ValueError):
    """A path that an arm cannot follow.

    Args:
        time: When it first cannot [s].
        joint: The joint that cannot, or "" if it is the arm as a whole.
        quantity: What is beyond its limit, such as "speed".
        value: How much of it is asked for.
        limit: How much of it there is.
        unit: Unit of both.
    """

    def __init__(
        self, time: float, joint: str, quantity: str, value: float, limit: float, unit: str
    ) -> None:
        who = f"{joint}: " if joint else ""
        super().__init__(
            f"path: at t = {time:.4g} s {who}expected {quantity} "
            f"within {limit:.4g} {unit}, found {value:.4g} {unit}".rstrip()
        )
        self.time, self.joint, self.quantity = time, joint, quantity
        self.value, self.limit, self.unit = value, limit, unit


class LinkageError(PatagiumError, ValueError):
    """A linkage whose bars cannot meet.

    Args:
        loop: The loop that stays open, by its two members.
        phase: Crank phase where it first does [rad].
        lengths: The two bars that would have to meet [m].
        distance: Between their far ends [m].
    """

    def __init__(
        self, loop: str, phase: float, lengths: tuple[float, float], distance: float
    ) -> None:
        first, second = (1e3 * k for k in lengths)
        super().__init__(
            f"linkage: at phase {phase:.4g} rad the loop of {loop} cannot close: expected bars "
            f"that span {1e3 * distance:.4g} mm with a bend, "
            f"found {first:.4g} mm and {second:.4g} mm"
        )
        self.loop, self.phase, self.lengths, self.distance = loop, phase, lengths, distance


class LogError(PatagiumError, ValueError):
    """A table or flight that cannot be used as it stands."""


class Unreadable(LogError):
    """A file or text that cannot be read within the bounds of `patagium.limits`.

    Args:
        file: The file.
        where: Place in it; empty for all of it.
        expected: What it may be, in words.
        found: What it is.
    """

    def __init__(self, file: object, where: str, expected: str, found: str) -> None:
        super().__init__(f"{file}: {where}" if where else file, expected, found)
        self.file, self.where, self.expected, self.found = str(file), where, expected, found


class FlightError(PatagiumError, ValueError):
    """A flight record that misses a quantity or contradicts itself."""


class OutputError(PatagiumError, OSError):
    """An output that cannot be written; what was there before is as it was.

    Args:
        path: The output.
        problem: Why it cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str], problem: Exception) -> None:
        number = getattr(problem, "errno", None)
        folder = Path(os.path.realpath(path) if os.path.islink(path) else path).parent
        remedy = command(_REMEDIES.get(number or 0, "name another place"), folder)
        reason = getattr(problem, "strerror", None) or problem
        super().__init__(f"{path}: cannot be written: {reason}; {remedy}")
        self.path, self.errno = path, number


_REMEDIES = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), "free space, or name another place"),
    **dict.fromkeys((errno.EACCES, errno.EPERM, errno.EROFS), "name a place that may be written"),
    **dict.fromkeys((errno.ENOENT, errno.ENOTDIR), "make its folder first: mkdir -p {}"),
    errno.EISDIR: "name a file, not a folder",
    errno.EAGAIN: "end that process, or name another file",
}


class Outcome(IntEnum):
    """Outcome of a compiled computation; the integers are those of the C kernels."""

    COMPLETED = 0
    NOT_FINITE = 1
    COVARIANCE_LOST = 2
    LIMIT_REACHED = 3
    BAD_INPUT = 4
    LATE = 5
    DUPLICATE = 6
    BLIND = 7
    STEP_TOO_LONG = 8
    INTERRUPTED = 9

    @property
    def remedy(self) -> str:
        """Advice to the user."""
        return {
            Outcome.COMPLETED: "nothing to mend",
            Outcome.NOT_FINITE: "reduce the time step, or check gait, mount and initial state",
            Outcome.COVARIANCE_LOST: "raise measurement_std or add process noise",
            Outcome.LIMIT_REACHED: "the motion left the model's range; see the named quantity",
            Outcome.BAD_INPUT: "check the sensors of the inputs; the sample was not learned from",
            Outcome.LATE: "check the order of the samples; this one was not learned from",
            Outcome.DUPLICATE: "check the source of the samples; this one was not learned from",
            Outcome.BLIND: "check the sensors of the outputs; no channel was usable",
            Outcome.STEP_TOO_LONG: "shorten the time step",
            Outcome.INTERRUPTED: "run it again from the start, or for a shorter time",
        }[self]


class Interrupted(Exception):
    """Request to end the work now, raised by a function that is told of progress."""


class SimulationFailed(PatagiumError, RuntimeError):
    """A run that stopped early.

    Args:
        message: When and why it stopped, and the remedy.
        flight: The flight up to there (an `xarray.Dataset`).
        outcome: Why it stopped.
    """

    def __init__(self, message: str, flight: Any, outcome: Outcome) -> None:
        super().__init__(message)
        self.flight, self.outcome = flight, outcome


class FilterDiverged(PatagiumError, RuntimeError):
    """A learner whose estimate or covariance was lost.

    Args:
        message: When and why, and the remedy.
        outcome: Why it stopped.
    """

    def __init__(self, message: str, outcome: Outcome) -> None:
        super().__init__(message)
        self.outcome = outcome


class CompilerError(PatagiumError, RuntimeError):
    """A compiler that is there but failed; carries its output."""


def is_finite(value: Any) -> bool:
    """Whether a value is a real number that a float can hold, and finite."""
    number = plain(value)
    try:
        flag = isinstance(number, bool)
        return not flag and isinstance(number, Real) and isfinite(float(number))
    except (TypeError, OverflowError):  # a duration of NumPy, or hundreds of digits
        return False


def finite(name: str, value: Any) -> float:
    """A finite number.

    Raises:
        ParameterError: If it is not.
    """
    if not is_finite(value):
        raise ParameterError(name, "a finite number", value)
    return float(value)


def positive(name: str, value: Any, expected: str = "a positive number") -> float:
    """A finite number above zero.

    Args:
        name: The argument.
        value: What was given.
        expected: What it may be, in words.

    Raises:
        ParameterError: If it is not.
    """
    if not (is_finite(value) and float(value) > 0):
        raise ParameterError(name, expected, value)
    return float(value)


def not_negative(record: object, *names: str) -> None:
    """Refuse a record with a number below zero.

    Raises:
        ParameterError: If one of these fields is.
    """
    for name in names:
        if not getattr(record, name) >= 0:
            raise ParameterError(name, "zero or more", getattr(record, name))


def check_names(
    what: str,
    given: Iterable[Any],
    known: Collection[str],
    words: str = "one of",
    near: bool = False,
) -> None:
    """Refuse names of which one is not known.

    Args:
        what: The argument.
        given: Names.
        known: Names that are.
        words: Words before these in the message.
        near: Whether a similar one is suggested.

    Raises:
        ParameterError: If there is such a name.
    """
    for name in given:
        if name not in known:
            raise ParameterError(what, f"{words} {', '.join(known)}", name, [*known] * near)


suggest_names(__name__)
