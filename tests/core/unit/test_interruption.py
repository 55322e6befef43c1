"""Ctrl-C: one answer each, then the program ends; handlers are as they were."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading

import pytest

from patagium.cli import main
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


def spoken(program: str) -> str:
    """What a program in a process of its own prints; nothing may come on stderr.

    A shell that starts the tests in the background has Ctrl-C ignored, which is inherited.
    """
    begin = (
        "import os, signal, time\n"
        "from patagium.cli.interruption import repeated_interrupt, stop_repeating\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", begin + program],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert not ran.stderr, "Python's own words on what it ignored"
    return ran.stdout


LOST = {
    "destructor": """
class Held:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
def work():
    Held()
""",
    "CasADi": """
import casadi as ca, numpy as np
class Number:
    @property
    def shape(self):  # which CasADi asks for, and whose errors it drops
        signal.raise_signal(signal.SIGINT)
    def __float__(self):
        return 1.0
def work():
    try:
        ca.SX.sym("x") + Number()
    except (NotImplementedError, TypeError):
        pass
""",
}


@pytest.mark.parametrize("where", LOST)
def test_ctrl_c_that_is_dropped_is_heard_again(where: str) -> None:
    program = """
with repeated_interrupt():
    try:
        work()
        print("dropped")
        time.sleep(60)  # s; the test waits no longer
    except KeyboardInterrupt:
        print("heard")
time.sleep(0.3)  # s; nothing is asked any more
"""
    assert spoken(LOST[where] + program) == "dropped\nheard\n"


def test_what_tidies_up_after_ctrl_c_is_left_in_peace() -> None:
    program = """
with repeated_interrupt():
    try:
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            try:
                raise OSError
            except OSError:
                time.sleep(0.4)  # s; asked again meanwhile, and not heard
            print("tidy")
    except KeyboardInterrupt:
        stop_repeating()
        time.sleep(0.4)  # s; told to be heard, it is asked no more
        print("ended")
"""
    assert spoken(program) == "tidy\nended\n"


def test_a_second_press_ends_what_tidies_up() -> None:
    program = """
with repeated_interrupt():
    try:
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            signal.raise_signal(signal.SIGINT)
            print("tidy")
    except KeyboardInterrupt:
        print("ended")
"""
    assert spoken(program) == "ended\n"


def test_an_ignored_ctrl_c_stays_so() -> None:
    program = """
signal.signal(signal.SIGINT, signal.SIG_IGN)
with repeated_interrupt():
    signal.raise_signal(signal.SIGINT)
print("went on", signal.getsignal(signal.SIGINT) is signal.SIG_IGN)
"""
    assert spoken(program) == "went on True\n"


EARLY = """
import signal, sys

class Early:
    def find_spec(self, name, path=None, target=None):
        if name == "{module}":
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Early())
sys.argv = ["patagium", "fly", "ornithopter", "--duration", "0.01"]
from patagium.__main__ import main
main()
"""


@pytest.mark.parametrize("module", ["typer", "patagium.cli.view", "patagium.control"])
def test_ctrl_c_while_modules_are_imported_ends_without_a_word(module: str) -> None:
    words = [sys.executable, "-c", EARLY.format(module=module)]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stderr) == (130, "")


def test_ctrl_c_before_a_verb_is_at_work_ends_with_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def pressed(*words: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(main, "program", lambda: pressed)
    with pytest.raises(SystemExit) as left:
        main.run(["robots"])
    assert left.value.code == 130
