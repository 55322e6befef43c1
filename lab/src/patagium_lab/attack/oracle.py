"""Oracle of a case: what may come of hostile material, and what may not.

A case ends in a refusal by a `PatagiumError` or in an answer. Whatever else comes is a finding:
another exception, a wrong number, a lost state, a case beyond its time.
"""

from __future__ import annotations

import signal
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from patagium.errors import PatagiumError
from patagium_lab.attack.mutation import Draw

LIMIT = 10.0
"""Longest duration of a case [s]."""
KINDS = ("crash", "wrong", "lost", "hang")
"""Kinds of findings: exception or death, silent wrong number, lost state, beyond its time."""


class WrongNumber(Exception):
    """A number that differs from that of clean material, without a refusal."""


class LostState(Exception):
    """A state that was saved and cannot be had again."""


class Refusal(PatagiumError):
    """Refusal with words of a program that was run by a server."""


class Hang(BaseException):
    """A case that took longer than `LIMIT`; no handler of `Exception` holds it."""


@dataclass(frozen=True)
class Target:
    """Target of an attack: one reader, one source, or programs.

    Attributes:
        area: Area of the campaign.
        name: Name among the targets.
        cases: Share of the cases of a campaign [1].
        prepare: Function that makes the material in a folder and gives the case: a function that
            receives the generator of the case, refuses by a `PatagiumError`, and raises
            `WrongNumber` or `LostState` where it finds them.
        limit: Longest duration of a case [s]; a case that watches a program may take longer.
    """

    area: str
    name: str
    cases: float
    prepare: Callable[[Path], Callable[[Draw], object]]
    limit: float = LIMIT


@dataclass(frozen=True)
class Finding:
    """Case that ended as none may.

    Attributes:
        target: Name of the target.
        number: Number of the case; with the seed of the campaign it can be made again.
        kind: One of `KINDS`.
        words: Exception, or what differs.
    """

    target: str
    number: int
    kind: str
    words: str


def judged(case: Callable[[], object], limit: float = LIMIT) -> tuple[str, str]:
    """Verdict on a case: "answered", "refused" or one of `KINDS`, and words on a finding.

    Args:
        case: The case; it is called.
        limit: Longest duration [s].
    """
    try:
        with _time_limit(limit):
            case()
    except PatagiumError as refusal:
        if not str(refusal).strip():
            return "crash", f"{type(refusal).__name__} without words"
        if len(str(refusal)) > 20_000:
            return "crash", f"{type(refusal).__name__} of {len(str(refusal))} characters"
        return "refused", ""
    except WrongNumber as found:
        return "wrong", str(found)
    except LostState as found:
        return "lost", str(found)
    except Hang:
        return "hang", f"more than {limit:g} s"
    except (Exception, SystemExit) as problem:
        frames = traceback.extract_tb(problem.__traceback__)
        ours = [f for f in frames if "patagium" in f.filename] or list(frames)
        where = f"{Path(ours[-1].filename).name}:{ours[-1].lineno}" if ours else "?"
        return "crash", f"{type(problem).__name__}: {str(problem)[:200]} ({where})"
    return "answered", ""


def starved(process: int | str = "self") -> float:
    """Time that a process was ready and got no processor [s]; 0 where the system does not tell.

    Args:
        process: Number of the process.
    """
    try:
        return 1e-9 * float(Path(f"/proc/{process}/schedstat").read_text().split()[1])
    except (OSError, IndexError, ValueError):
        return 0.0


@contextmanager
def _time_limit(limit: float) -> Iterator[None]:
    """Raise `Hang` in a block that takes too long; code that never returns is for the parent.

    Time in which other programs held the processor does not count.
    """
    end_at, before_it = time.monotonic() + limit, starved()

    def end(number: int, frame: object) -> None:
        left = end_at + starved() - before_it - time.monotonic()
        if left <= 0:
            raise Hang
        signal.setitimer(signal.ITIMER_REAL, left)

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
