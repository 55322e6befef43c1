"""State of a learner across runs of a verb: resumed, and kept at the end or on Ctrl-C.

A second Ctrl-C stops at once and keeps nothing.
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
    """Ctrl-C between two samples of a learner."""


def resumed(learner: Any, state: Path | None) -> Any:
    """Learner of a state file if there is one, with a new clock; the given learner otherwise.

    Args:
        learner: New learner; the state may have other centers and scales.
        state: File; None, or a file that is not there yet: the new learner.

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
    """Write the state of a learner, if there is a file for it.

    Args:
        learner: Learner.
        state: File, or None.
    """
    if state is not None:
        learner.save(state)
        typer.echo(f"The state after {learner.count} samples is in {state}", err=True)


@contextmanager
def interrupted_between_samples(progress: Progress) -> Iterator[Progress]:
    """Ctrl-C held back until the learner is between two samples.

    Args:
        progress: Function called between samples.

    Yields:
        Function that calls it, and raises `Interrupted` after Ctrl-C.
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
