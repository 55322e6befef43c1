"""Ctrl-C: one answer each, then the program ends; handlers are as they were."""

from __future__ import annotations

import signal
import threading

import pytest

from patagium.cli.interruption import interrupted


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_are_answered_in_turn_and_one_more_ends_it(number: signal.Signals) -> None:
    heard: list[str] = []
    before = signal.getsignal(number)
    with (
        pytest.raises(KeyboardInterrupt),
        interrupted(lambda: heard.append("first"), lambda: heard.append("second")),
    ):
        for count in range(3):
            assert len(heard) == count
            signal.raise_signal(number)
    assert heard == ["first", "second"]
    assert signal.getsignal(number) is before


def test_beside_the_main_thread_nothing_is_caught() -> None:
    found: list[object] = []
    before = signal.getsignal(signal.SIGINT)

    def look() -> None:
        with interrupted(lambda: None):
            found.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert found == [before]
