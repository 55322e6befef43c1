"""Ctrl-C: one answer each, then the program ends; handlers are as they were."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading

import pytest

from patagium.cli.interruption import interrupted


def test_ctrl_c_is_answered_in_turn_and_one_more_ends_it() -> None:
    number, heard = signal.SIGINT, list[str]()
    before = signal.getsignal(number)
    with (
        pytest.raises(KeyboardInterrupt),
        interrupted([lambda: heard.append("first"), lambda: heard.append("second")]),
    ):
        for count in range(3):
            assert len(heard) == count
            signal.raise_signal(number)
    assert heard == ["first", "second"]
    assert signal.getsignal(number) is before


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_request_to_end_counts_once(number: signal.Signals) -> None:
    heard: list[str] = []
    before = signal.getsignal(number)
    with interrupted([lambda: heard.append("first")]):
        for _ in range(3):
            signal.raise_signal(number)
    assert heard == ["first"]
    assert signal.getsignal(number) is before


def test_a_hang_up_that_is_ignored_stays_so() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interrupted([]):
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_beside_the_main_thread_nothing_is_caught() -> None:
    found: list[object] = []
    before = signal.getsignal(signal.SIGINT)

    def look() -> None:
        with interrupted([lambda: None]):
            found.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert found == [before]


def test_ctrl_c_that_a_destructor_drops_is_heard_again() -> None:
    program = """
import time
from patagium.cli.interruption import hear_again

class Held:
    def __del__(self):
        raise KeyboardInterrupt

hear_again()
Held()
try:
    time.sleep(60)  # s; the test waits for less
except KeyboardInterrupt:
    print("heard")
"""
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=30, check=True
    )
    assert ran.stdout == "heard\n"
    assert not ran.stderr, "Python's own words on what it ignored"
