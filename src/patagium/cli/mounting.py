"""Mounts of `patagium simulate`: the path and the arm that follows it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import typer

from patagium.cli.words import (
    Numbers,
    Vector,
    existing,
    named_quantities,
    only_given,
    parts_of,
    quantity,
)
from patagium.errors import ParameterError

if TYPE_CHECKING:
    from patagium.simulation.mounts import Mount

MountKind: TypeAlias = Literal["free", "fixed", "carried", "arm"]
"""Mounts that hold the robot."""


def lengths(text: str) -> Numbers:
    """Lengths such as "0.9,0.3 m"; a last unit holds for all."""
    found = Numbers(map(quantity("m"), parts_of(text)))
    if len(found) > 3:
        raise typer.BadParameter(f"expected one to three lengths such as 0.9,0.3 m, found {text!r}")
    return found


def mount_from(
    kind: MountKind | None,
    path: str | None,
    words: Mapping[str, Any],
    *,
    arm: str | None,
    at: str | None,
    turn: Vector | None,
    shift: Vector | None,
) -> Mount | None:
    """Mount of the command line; None: the mount that the robot implies.

    Args:
        kind: Kind of the mount.
        path: line, circle, figure-of-eight, sinusoid, or a CSV file; None: not given.
        words: Values of the options --path-... by name [SI]; None where one is not given.
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
    for name in only_given(given) if kind != "arm" else ():
        raise ParameterError(name, "--mount arm with it", kind)
    if kind not in ("carried", "arm"):
        if path is not None:
            raise ParameterError("--path", "--mount arm or carried with it", kind)
        return None if kind is None else getattr(mounts, kind)()
    way = _path(path, only_given(words))
    if kind == "carried":
        return mounts.carried(way)
    machine, place = load_robot(arm or "ur5e"), {"position": shift, "orientation": turn}
    held_at = {name: value or _ZERO for name, value in place.items()}
    return mounts.on_arm(machine, way, at=at or "tool", **held_at)


def _path(kind: str | None, words: Mapping[str, Any]) -> Any:
    from patagium.simulation import paths

    if kind is None:
        raise ParameterError("--path", f"one of {', '.join(_MAKERS)}, or a CSV file", None)
    make, used = _MAKERS.get(kind, (None, ""))
    for name in words:
        if name not in used.split():
            raise ParameterError(f"--path-{name}", f"nothing of the kind with {kind}", "one")
    return paths.from_csv(existing(Path(kind))) if make is None else make(paths, **words)


_ZERO = (0.0, 0.0, 0.0)


def _sized(size: Numbers | None, count: int, what: str) -> Numbers:
    if size is None or len(size) != count:
        raise ParameterError("--path-size", what, size)
    return size


def _line(
    paths: Any, center: Any = _ZERO, size: Any = None, speed: float | None = None, **attitude: Any
) -> Any:
    """Line from its start; the greatest speed of a motion of least jerk is 15/8 of the mean."""
    way = _sized(size, 3, "how far a line goes, such as '0.3,0,0.1 m'")
    if speed is None:
        raise ParameterError("--path-speed", "the greatest speed of a line, in m/s", None)
    end = [a + b for a, b in zip(center, way, strict=True)]
    length = math.hypot(*way)
    if not (length > 0 and speed > 0):
        raise ParameterError("--path-size, --path-speed", "a way and a speed above 0", length)
    return paths.line(center, end, duration=15 / 8 * length / speed, **attitude)


def _circle(
    paths: Any, center: Any = _ZERO, size: Any = None, along: Any = (0.0, 0.0, 1.0), **pace: Any
) -> Any:
    (radius,) = _sized(size, 1, "a circle's radius, such as '20 cm'")
    return paths.circle(center, radius, normal=along, **pace)


def _figure_of_eight(paths: Any, center: Any = _ZERO, size: Any = None, **others: Any) -> Any:
    length, width = _sized(size, 2, "length and width, such as '0.9,0.3 m'")
    return paths.figure_of_eight(center, length, width, **others)


def _sinusoid(
    paths: Any, center: Any = _ZERO, frequency: Any = None, amplitude: Any = (), **turn: Any
) -> Any:
    if frequency is None:
        raise ParameterError("--path-frequency", "the cycles a second of a sinusoid, in Hz", None)
    size: dict[str, Any] = named_quantities(
        "--path-amplitude", amplitude, lambda name: "m" if name in ("x", "y", "z") else "rad"
    )
    return paths.sinusoid(center, frequency=frequency, **turn, **size)


_MAKERS: dict[str, tuple[Callable[..., Any], str]] = {
    "line": (_line, "center size speed attitude"),
    "circle": (_circle, "center size speed frequency along attitude"),
    "figure-of-eight": (_figure_of_eight, "center size speed frequency along across attitude"),
    "sinusoid": (_sinusoid, "center frequency attitude amplitude"),
}
"""Function that makes each kind of path, and the options that it takes."""
