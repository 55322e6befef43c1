"""A learner's state across runs of a verb: gone on from, and kept at the end or on Ctrl-C.

Neglected: Ctrl-C twice; the second stops at once and keeps nothing.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import typer

from patagium.cli.words import Progress


class Interrupted(Exception):
    """Somebody pressed Ctrl-C; the learner stands between two samples."""


def resumed(learner: Any, state: Path | None) -> Any:
    """The learner of a state, where there is one that fits; another log, another clock.

    Args:
        learner: The learner asked for; centers and scales may be others.
        state: The file; None, or one that is not there yet: the learner as it is.

    Raises:
        LogError: If the file is damaged or of another learner.
    """
    if state is None or not state.exists():
        return learner
    from patagium.learning import load_learner

    found = load_learner(state, like=learner)
    found.restart_clock()
    typer.echo(f"Going on from {state}: {found.count} samples learned before.", err=True)
    return found


def keep_state(learner: Any, state: Path | None) -> None:
    """Write the state, where one is kept.

    Args:
        learner: What learned.
        state: The file.
    """
    if state is not None:
        learner.save(state)
        typer.echo(f"The state after {learner.count} samples is in {state}", err=True)


@contextmanager
def interrupted_between_samples(progress: Progress) -> Iterator[Progress]:
    """Ctrl-C held back until the learner is not in the middle of a sample.

    Args:
        progress: Called between samples.

    Yields:
        A progress that raises `Interrupted` once Ctrl-C was pressed.
    """
    pressed: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        if pressed:
            raise KeyboardInterrupt
        pressed.append(number)

    def tell(done: int, total: int) -> None:
        progress(done, total)
        if pressed and done < total:
            raise Interrupted

    before = signal.signal(signal.SIGINT, note)
    try:
        yield tell
    finally:
        signal.signal(signal.SIGINT, before)
