"""Ctrl-C and SIGTERM as requests to end the work, not the program."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from patagium.cli.words import Progress


@contextmanager
def interrupted(*answers: Callable[[], None]) -> Iterator[None]:
    """Signals answered in order by functions; one more signal ends the program.

    Outside of the main thread signals cannot be caught, and nothing is done.

    Args:
        answers: Functions, one for each signal.
    """
    left = iter(answers)

    def answer(number: int, frame: object) -> None:
        act = next(left, None)
        if act is None:
            raise KeyboardInterrupt
        act()

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, answer) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class Interrupted(Exception):
    """Ctrl-C between two samples of a learner."""


@contextmanager
def interrupted_between_samples(progress: Progress) -> Iterator[Progress]:
    """Ctrl-C held back until the learner is between two samples; a second one stops at once.

    Args:
        progress: Function called between samples.

    Yields:
        Function that calls it, and raises `Interrupted` after Ctrl-C.
    """
    pressed = threading.Event()

    def tell(done: int, total: int) -> None:
        progress(done, total)
        if pressed.is_set() and done < total:
            raise Interrupted

    with interrupted(pressed.set):
        yield tell
