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

_MAIN = threading.main_thread()
_waiting: list[threading.Timer] = []


def stop_repeating() -> None:
    """End the repetitions of a Ctrl-C that the program has answered."""
    for timer in _waiting:
        timer.cancel()


@contextmanager
def repeated_interrupt() -> Iterator[None]:
    """Context in which Ctrl-C is repeated every 0.1 s until it has ended the work.

    One KeyboardInterrupt is not enough: CasADi discards exceptions of Python code that it calls,
    and Python those of destructors and of callbacks of weak references.
    """
    before, tell = signal.getsignal(signal.SIGINT), sys.unraisablehook
    repeats = threading.Event()

    def repeat() -> None:
        repeats.set()
        os.kill(os.getpid(), signal.SIGINT)

    def answer(number: int, frame: object) -> None:
        cause, repeated = sys.exception(), repeats.is_set()
        repeats.clear()
        stop_repeating()
        _waiting[:] = [threading.Timer(0.1, repeat)]  # s
        _waiting[0].daemon = True
        _waiting[0].start()
        while cause is not None and not isinstance(cause, KeyboardInterrupt):
            cause = cause.__context__
        if cause is None or not repeated:  # a repetition leaves `finally` blocks alone
            raise KeyboardInterrupt

    if before is not signal.default_int_handler or threading.current_thread() is not _MAIN:
        yield
        return
    sys.unraisablehook = lambda lost: lost.exc_type is KeyboardInterrupt or tell(lost)
    signal.signal(signal.SIGINT, answer)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        sys.unraisablehook = tell
        stop_repeating()


@contextmanager
def interrupted(answers: Iterable[Callable[[], None]]) -> Iterator[None]:
    """Signals answered in order by functions; one more Ctrl-C ends the program.

    SIGTERM and SIGHUP ask once, however often they come: a terminal that is closed sends several.
    SIGHUP stays ignored where it is, as under `nohup`. Outside of the main thread signals cannot
    be caught, and nothing is done.
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

    if threading.current_thread() is not _MAIN:
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
