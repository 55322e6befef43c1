"""Walks through the program, traced: a setting from the command line to C, a sample to weights."""

from __future__ import annotations

import ctypes
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from inspect import CO_VARARGS, CO_VARKEYWORDS
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from patagium.cli.main import run

SPREAD = 1.6180339
WORDS = (
    "--robot yeo-wing --network strip --hidden 2 --prior-std 0.3 --measurement-std 3e-4 "
    f"--idle 0.3 --json --spread {SPREAD}"
).split()


def stream_words(folder: Path, lines: int) -> list[str]:
    """Command that learns from a log with a number of samples, a line each."""
    import patagium as pt
    from patagium.sensing.force.air_force import packet_columns

    robot = pt.load_robot("yeo-wing")
    names = [column.name for column in packet_columns(robot)]
    rows = np.random.default_rng(0).normal(0.0, 0.1, (lines, len(names)))
    rows[:, 0] = 0.01 * np.arange(lines)
    log = folder / f"log{lines}.csv"
    log.write_text(
        "\n".join([",".join(names), *(",".join(map(repr, r)) for r in rows.tolist()), ""])
    )
    return ["stream", str(log), *WORDS]


Noted = Callable[[FrameType, str, str, Any], None]


def traced(words: list[str], noted: Noted) -> None:
    """Run a command and note every call of a function of patagium, and its end, in all threads.

    Args:
        words: Words of the command line.
        noted: Takes the frame, the name of its module, "call" or "return", what it returns.
    """

    def profile(frame: FrameType, event: str, argument: Any) -> None:
        module = frame.f_globals.get("__name__", "")
        if event in ("call", "return") and module.startswith("patagium."):
            noted(frame, module, event, argument)

    threading.setprofile(profile)
    sys.setprofile(profile)
    try:
        with suppress(SystemExit):
            run(words)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)


def holds(value: Any, number: float, depth: int = 3) -> bool:
    """Whether a value is a number or a record, mapping or sequence that holds it."""
    if isinstance(value, float):
        return value == number
    if depth == 0:
        return False
    if is_dataclass(value) and not isinstance(value, type):
        return any(holds(getattr(value, f.name, None), number, depth - 1) for f in fields(value))
    if isinstance(value, Mapping):
        return any(holds(one, number, depth - 1) for one in value.values())
    if isinstance(value, list | tuple):
        return any(holds(one, number, depth - 1) for one in value)
    return False


def is_given(frame: FrameType, number: float) -> bool:
    """Whether an argument of a function is a number or holds it."""
    code = frame.f_code
    count = code.co_argcount + code.co_kwonlyargcount
    count += bool(code.co_flags & CO_VARARGS) + bool(code.co_flags & CO_VARKEYWORDS)
    return any(holds(frame.f_locals.get(name), number) for name in code.co_varnames[:count])


def fills_a_struct(frame: FrameType) -> bool:
    """Whether a function holds a structure or pointer of C, or makes an object that does."""
    values = [*frame.f_locals.values()]
    if frame.f_code.co_name == "__init__":
        values += [*getattr(frame.f_locals.get("self"), "__dict__", {}).values()]
    return any(isinstance(value, ctypes.Structure) for value in values)


def spread_walk(folder: Path) -> list[str]:
    """Modules through which the spread goes from the command line to C, in order.

    A function is on the walk if it is given the spread, or a record with it, and hands it on:
    to another function on the walk, to its caller in what it returns or makes, or to C. The check
    of arguments hands on what it was given, whatever that is, and does not count.
    """
    open_frames: list[dict[str, Any]] = []
    order: list[dict[str, Any]] = []

    def note(frame: FrameType, module: str, event: str, answer: Any) -> None:
        if threading.current_thread() is not threading.main_thread():
            return
        if event == "call":
            step = {"frame": frame, "module": module, "given": is_given(frame, SPREAD)}
            open_frames.append(step)
            order.append(step)
            return
        step = open_frames.pop()
        made = frame.f_locals.get("self") if frame.f_code.co_name == "__init__" else answer
        onward = fills_a_struct(frame) or step.get("onward", False) or holds(made, SPREAD)
        step["on the walk"] = step["given"] and onward
        step["frame"] = None
        if open_frames and step["on the walk"]:
            open_frames[-1]["onward"] = True

    traced(stream_words(folder, 1), note)
    walked = (step["module"] for step in order if step.get("on the walk"))
    return [name for name in dict.fromkeys(walked) if name != "patagium.arguments"]


def functions_called(words: list[str]) -> dict[tuple[str, str], None]:
    """Modules and names of functions that a command calls, in order of their first call."""
    found: dict[tuple[str, str], None] = {}

    def note(frame: FrameType, module: str, event: str, _: Any) -> None:
        if event == "call":
            found.setdefault((module, frame.f_code.co_qualname), None)

    traced(words, note)
    return found


def sample_walk(folder: Path) -> list[str]:
    """Modules with a function that runs because there is a sample, in order."""
    without = functions_called(stream_words(folder, 0))
    found = [call for call in functions_called(stream_words(folder, 1)) if call not in without]
    return [*dict.fromkeys(module for module, _ in found)]
