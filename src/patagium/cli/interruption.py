"""Ctrl-C and SIGTERM as requests to end the work, not the program."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


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
