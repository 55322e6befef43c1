"""Ctrl-C, SIGTERM and SIGHUP as requests to end the work, not the program."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from patagium.cli.words import Progress
from patagium.errors import Interrupted


def hear_again() -> None:
    """Ask for Ctrl-C again where Python drops it: in a destructor or a weak reference's callback.

    After long work in compiled code, such as drawing, that is often where it arrives.
    """
    tell = sys.unraisablehook

    def answer(dropped: sys.UnraisableHookArgs) -> None:
        if dropped.exc_type is KeyboardInterrupt:
            again = threading.Timer(0.02, os.kill, (os.getpid(), signal.SIGINT))  # s; over by then
            again.daemon = True
            again.start()
        else:
            tell(dropped)

    sys.unraisablehook = answer


@contextmanager
def interrupted(answers: Iterable[Callable[[], None]]) -> Iterator[None]:
    """Signals answered in order by functions; one more Ctrl-C ends the program.

    SIGTERM and SIGHUP ask once, however often they come: a terminal that is closed sends several.
    SIGHUP stays ignored where it is, as under `nohup`. Outside of the main thread signals cannot
    be caught, and nothing is done.

    Args:
        answers: Functions, one for each signal.
    """
    left, asked = iter(answers), False

    def answer(number: int, frame: object) -> None:
        nonlocal asked
        if asked and number != signal.SIGINT:
            return
        asked = True
        act = next(left, None)
        if act is None:
            raise KeyboardInterrupt
        act()

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, answer) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def interruptible(progress: Progress) -> Iterator[Progress]:
    """Context in which Ctrl-C ends the work after the current step; a second one ends it at once.

    Yields:
        Function that calls it, and raises `Interrupted` after Ctrl-C.
    """
    pressed = threading.Event()

    def tell(done: int, total: int) -> None:
        progress(done, total)
        if pressed.is_set() and done < total:
            raise Interrupted

    with interrupted([pressed.set]):
        yield tell
