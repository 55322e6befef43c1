"""Ctrl-C and SIGTERM end what runs, not the program."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def interrupted(*answers: Callable[[], None]) -> Iterator[None]:
    """The first signal is answered by the first of these, and so on; one more ends the program.

    Beside the main thread, where signals cannot be caught, nothing is.

    Args:
        answers: What to do.
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
