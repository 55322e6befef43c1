"""Changes of a robot, written into the text of its file.

A robot's source travels with every flight, so a calibrated or damaged robot has
to say in it what differs: in the block `parameters`, which is applied last. So does
one whose attitude is given in other coordinates, where its body floats.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from patagium.errors import ParameterError

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # calibration comes here often
_FLOATING = re.compile(r"^([ \t]+)floating:[ \t]*true\b[^\n]*$", re.MULTILINE)
_ATTITUDE = re.compile(r"^[ \t]+attitude:")
_BLOCK = re.compile(r"^parameters:[^\n]*\n(?:(?:[ \t}#][^\n]*)?\n)*", re.MULTILINE)


def amended_source(source: str, values: Mapping[str, float]) -> str:
    """Text of the robot file with some parameters changed.

    Args:
        source: Text of a valid robot file.
        values: New values by parameter name [SI].

    Returns:
        The same text with one block `parameters` at its end.
    """
    described = _parsed(source)
    known = described.pop("parameters", None) or {}
    kept = _BLOCK.sub("", source + "\n").rstrip("\n") + "\n"
    if _parsed(kept) != described:  # the block was written in an unusual way
        kept = yaml.safe_dump(described, sort_keys=False)
    changed = {**known, **{name: float(value) for name, value in values.items()}}
    block = "".join(f"  {json.dumps(k)}: {json.dumps(v)}\n" for k, v in changed.items())
    return f"{kept}parameters:\n{block}" if changed else kept


def source_with_attitude(source: str, attitude: str) -> str:
    """Text of the robot file with its floating body's attitude in other coordinates.

    Raises:
        ParameterError: If what floats is another file, which only its name stands for.
    """
    described = carrier = _parsed(source)
    while "mounted_on" in carrier:
        carrier = carrier["mounted_on"]
        if isinstance(carrier, str):
            raise ParameterError("attitude", "that of what carries the robot, set there", carrier)
    floating = next(body for body in carrier["bodies"].values() if body.get("floating"))
    if floating.get("attitude", "euler") == attitude:
        return source
    floating["attitude"] = attitude
    lines = [line for line in source.splitlines() if not _ATTITUDE.match(line)]
    kept = _FLOATING.sub(rf"\g<0>\n\1attitude: {attitude}", "\n".join(lines) + "\n")
    if _parsed(kept) != described:  # the body was written in an unusual way
        kept = yaml.safe_dump(described, sort_keys=False)
    return kept


def composed_source(
    robot: str,
    arm: str,
    at: str,
    pose: tuple[Sequence[float], Sequence[float]],
    prefix: str,
) -> str:
    """Text of a robot file that mounts one robot on another; empty where either has no text.

    Args:
        robot: Text of the file of the robot that is carried.
        arm: Text of the file of the robot that carries it.
        at: Body of the arm that holds the robot.
        pose: Position (3,) [m] and roll, pitch, yaw (3,) [rad] of the robot on that body.
        prefix: Text before the names of the arm's parts.
    """
    if not (robot and arm):
        return ""
    position, orientation = ([float(k) for k in part] for part in pose)
    described = {
        "robot": yaml.safe_load(robot),
        "mounted_on": yaml.safe_load(arm),
        "at": at,
        "position": position,
        "orientation": [f"{angle!r} rad" for angle in orientation],
        "prefix": prefix,
    }
    return yaml.safe_dump(described, sort_keys=False)


def _parsed(text: str) -> Any:
    return yaml.load(text, Loader=_LOADER)
