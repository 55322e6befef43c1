"""Mounts of `patagium simulate`: the path and the arm that follows it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import typer

from patagium.cli.words import Numbers, Vector, existing, named_quantities, parts_of, quantity
from patagium.errors import ParameterError

if TYPE_CHECKING:
    from patagium.simulation.mounts import Mount

MountKind: TypeAlias = Literal["free", "fixed", "carried", "arm"]
"""Mounts that hold the robot."""


def sizes(text: str) -> Numbers:
    """Lengths such as "0.9,0.3 m"; a last unit holds for all."""
    found = Numbers(map(quantity("m", "a length"), parts_of(text)))
    if len(found) > 3:
        raise typer.BadParameter(f"expected one to three lengths such as 0.9,0.3 m, found {text!r}")
    return found


@dataclass(frozen=True)
class PathWords:
    """Words of the command line for a path; None where an option is not given.

    Attributes:
        kind: line, circle, figure-of-eight, sinusoid, or a CSV file.
        center: Center, or start of a line [m].
        size: Radius; length and width of an eight; end minus start of a line [m].
        speed: Greatest speed [m/s].
        frequency: Frequency [Hz].
        along: Direction of an eight's length; a circle's normal.
        across: Direction of an eight's width.
        attitude: Roll, pitch, yaw [rad].
        amplitude: Amplitudes of a sinusoid, NAME=VALUE.
    """

    kind: str | None
    center: Vector | None
    size: Numbers | None
    speed: float | None
    frequency: float | None
    along: Vector | None
    across: Vector | None
    attitude: Vector | None
    amplitude: Sequence[str]


def mount_from(
    kind: MountKind | None,
    words: PathWords,
    *,
    arm: str | None,
    at: str | None,
    turn: Vector | None,
    shift: Vector | None,
) -> Mount | None:
    """Mount of the command line; None: the mount that the robot implies.

    Args:
        kind: Kind of the mount.
        words: Path.
        arm: Preset or file of the arm; by default "ur5e".
        at: Body of the arm that holds the robot; by default "tool".
        turn: Roll, pitch, yaw of the robot on that body [rad].
        shift: Position of the robot on that body [m].

    Raises:
        ParameterError: If the words contradict each other.
        PathError: If the arm cannot follow.
    """
    from patagium.robot import load_robot
    from patagium.simulation import mounts

    given = {"--arm": arm, "--arm-at": at, "--arm-turn": turn, "--arm-shift": shift}
    for name in (name for name, value in given.items() if value is not None and kind != "arm"):
        raise ParameterError(name, "--mount arm with it", kind)
    if kind not in ("carried", "arm"):
        if words.kind is not None:
            raise ParameterError("--path", "--mount arm or carried with it", kind)
        return None if kind is None else getattr(mounts, kind)()
    path = _path(words)
    if kind == "carried":
        return mounts.carried(path)
    machine, place = load_robot(arm or "ur5e"), {"position": shift, "orientation": turn}
    held_at = {name: value or _ZERO for name, value in place.items()}
    return mounts.on_arm(machine, path, at=at or "tool", **held_at)


def _path(words: PathWords) -> Any:
    from patagium.simulation import paths

    if words.kind is None:
        expected = f"one of {', '.join(_MAKERS)}, or a CSV file"
        raise ParameterError("--path", expected, None)
    make, used = _MAKERS.get(words.kind, (None, ()))
    for name, value in vars(words).items():
        if name != "kind" and value not in (None, ()) and name not in used:
            raise ParameterError(f"--path-{name}", f"nothing of the kind with {words.kind}", "one")
    return paths.from_csv(existing(Path(words.kind))) if make is None else make(words)


_ZERO = (0.0, 0.0, 0.0)


def _sized(words: PathWords, count: int, what: str) -> Numbers:
    if words.size is None or len(words.size) != count:
        raise ParameterError("--path-size", what, words.size)
    return words.size


def _line(words: PathWords) -> Any:
    """Line from its start; the greatest speed of a motion of least jerk is 15/8 of the mean."""
    from patagium.simulation import paths

    way = _sized(words, 3, "how far a line goes, such as '0.3,0,0.1 m'")
    if words.speed is None:
        raise ParameterError("--path-speed", "the greatest speed of a line, in m/s", None)
    start = words.center or Vector(*_ZERO)
    end = [a + b for a, b in zip(start, way, strict=True)]
    length = math.hypot(*way)
    if not (length > 0 and words.speed > 0):
        raise ParameterError("--path-size, --path-speed", "a way and a speed above 0", length)
    duration = 15 / 8 * length / words.speed
    return paths.line(start, end, duration=duration, attitude=words.attitude or _ZERO)


def _round(words: PathWords) -> Any:
    """Circle, or figure of eight."""
    from patagium.simulation import paths

    center, attitude = words.center or _ZERO, words.attitude or _ZERO
    pace: Any = {"speed": words.speed, "frequency": words.frequency, "attitude": attitude}
    if words.kind == "circle":
        (radius,) = _sized(words, 1, "a circle's radius, such as '20 cm'")
        return paths.circle(center, radius, normal=words.along or (0.0, 0.0, 1.0), **pace)
    length, width = _sized(words, 2, "length and width, such as '0.9,0.3 m'")
    along, across = words.along or (1.0, 0.0, 0.0), words.across or (0.0, 1.0, 0.0)
    return paths.figure_of_eight(center, length, width, along=along, across=across, **pace)


def _sinusoid(words: PathWords) -> Any:
    from patagium.simulation import paths

    if words.frequency is None:
        raise ParameterError("--path-frequency", "the cycles a second of a sinusoid, in Hz", None)
    slides = [word for word in words.amplitude if word.partition("=")[0] in ("x", "y", "z")]
    turns = [word for word in words.amplitude if word not in slides]
    size = named_quantities("--path-amplitude", slides, "m", "a length")
    size |= named_quantities("--path-amplitude", turns, "rad", "an angle")
    center, attitude = words.center or _ZERO, words.attitude or _ZERO
    rate, still = words.frequency, None
    return paths.sinusoid(center, frequency=rate, phase=still, attitude=attitude, **size)


_MAKERS: dict[str, tuple[Callable[[PathWords], Any], set[str]]] = {
    "line": (_line, {"center", "size", "speed", "attitude"}),
    "circle": (_round, {"center", "size", "speed", "frequency", "along", "attitude"}),
    "figure-of-eight": (_round, {*"center size speed frequency along across attitude".split()}),
    "sinusoid": (_sinusoid, {"center", "frequency", "attitude", "amplitude"}),
}
"""Function that makes each kind of path, and the options that it takes."""
