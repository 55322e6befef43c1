"""Robot files: YAML or URDF in, a validated robot out, every fault with its place.

A preset is a robot file that comes with the package. A file may also say that one
robot is mounted on another. Aliases (`&a`, `*a`) and duplicate keys are refused: a
robot is written once, in the open.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import ValidationError

from patagium.arguments import checked
from patagium.errors import (
    ParameterError,
    RobotFileError,
    RobotFileWarning,
    Unreadable,
    shown,
    similar,
)
from patagium.limits import ROBOT_FILE
from patagium.reading import faults, lines_of, parsed_yaml, text_of
from patagium.robot.assembly import AssemblyError, assemble, with_file_parameters
from patagium.robot.model import PAGES, Robot
from patagium.robot.review import robot_warnings
from patagium.robot.schema import CompositionFile, RobotFile
from patagium.robot.urdf import read_urdf
from patagium.whole_file import write_whole

_FOLDER = resources.files("patagium.robot")


@checked
def load_robot(name_or_path: str | Path) -> Robot:
    """Robot from a preset's name, a robot file or a URDF.

    A URDF's root stands on the world; `load_urdf` gives it a floating base. What a robot
    cannot represent of it is told in a `RobotFileWarning`.

    Args:
        name_or_path: A preset, such as "aerobat", or the path of a YAML or URDF file.

    Returns:
        The robot; its `source` is the text of the file, of a URDF the same as YAML.

    Raises:
        RobotFileError: If there is no such file, or it describes no robot.
    """
    name = str(name_or_path)
    if name in preset_names():
        return load_robot_text(preset_text(name), name)
    path = Path(name_or_path)
    if path.suffix.lower() == ".urdf":
        return _reviewed(load_urdf(path), name)
    other = path.suffix.lower() in (".nc", ".json", ".csv", ".parquet")
    if path.suffix not in (".yaml", ".yml") and (other or not os.path.exists(path)):
        known = ", ".join(preset_names())
        expected = f"a preset ({known}) or the path of a robot file (.yaml, .urdf)"
        kind = "a flight or log: " if path.suffix.lower() == ".nc" else ""
        found = kind + shown(name) + similar(name, preset_names())
        raise RobotFileError(name, [("", expected, found)])
    return _reviewed(load_robot_text(_read(text_of, path, ROBOT_FILE), name), name)


def _reviewed(robot: Robot, name: str) -> Robot:
    for sentence in robot_warnings(robot):
        warnings.warn(f"{name}: {sentence}", RobotFileWarning, stacklevel=3)
    return robot


@checked
def load_urdf(path: str | Path, *, base: Literal["fixed", "floating"] = "fixed") -> Robot:
    """Robot from a URDF, its root on the world or floating.

    Args:
        path: The file.
        base: What a root link does that no joint of kind floating frees.

    Returns:
        The robot; its `source` is a robot file that says the same, with all that was
        left out or renamed at its head.

    Raises:
        RobotFileError: If it cannot be read, or holds what a robot cannot have.
    """
    path = Path(path)
    return load_urdf_text(_read(text_of, path, ROBOT_FILE), str(path), base=base)


def load_urdf_text(
    text: str, name: str = "URDF text", *, base: Literal["fixed", "floating"] = "fixed"
) -> Robot:
    """Robot from the text of a URDF; see `load_urdf`.

    Args:
        text: XML.
        name: What to call it in errors and warnings.
        base: What a root link does that no joint of kind floating frees.

    Raises:
        RobotFileError: If it holds what a robot cannot have.
    """
    if base not in ("fixed", "floating"):
        raise ParameterError("base", "fixed or floating", base)
    written, left_out = read_urdf(text, name, base == "floating")
    robot = _robot(deepcopy(_content(written, name)), written, name, numbered=False)
    for where, what in left_out:
        warnings.warn(f"{name}: {where}: {what}", RobotFileWarning, stacklevel=2)
    return robot


def load_robot_text(text: str, name: str = "robot text") -> Robot:
    """Robot from the text of a robot file, such as a flight carries.

    Raises:
        RobotFileError: If it describes no robot.
    """
    return _robot(deepcopy(_content(text, name)), text, name)


def robot_attributes(robot: Robot) -> dict[str, str]:
    """Text and name of a robot, as records carry them.

    Raises:
        ParameterError: If its source describes another robot.
    """
    if robot.source and robot_of_text(robot.source, robot.name) != robot:
        expected = "the robot that its source describes; change it by `with_parameters`"
        raise ParameterError("robot", expected, f"another {robot.name}")
    return {"robot": robot.source, "robot_name": robot.name}


robot_of_text = lru_cache(maxsize=8)(load_robot_text)
"""`load_robot_text`, which remembers the last few."""


def _robot(described: Any, text: str, name: str, numbered: bool = True) -> Robot:
    mounted = isinstance(described, dict) and "mounted_on" in described
    model = CompositionFile if mounted else RobotFile
    try:
        file = model.model_validate(described)
        if isinstance(file, CompositionFile):
            return _composed(file, text)
        return assemble(file, text)
    except ValidationError as error:
        problems = faults(error.errors(), model)
    except AssemblyError as error:
        problems = error.problems
    lines = lines_of(text, [where for where, *_ in problems]) if numbered else {}
    raise RobotFileError(name, problems, lines)


def _composed(file: CompositionFile, text: str) -> Robot:
    """A robot mounted on another, each a preset or written out in place."""
    robot, arm = (_part(getattr(file, key), key) for key in ("robot", "mounted_on"))
    try:
        composed = robot.mounted_on(
            arm, file.at, position=file.position, orientation=file.orientation, prefix=file.prefix
        )
    except ParameterError as error:
        where = "at" if error.name == "body" else error.name
        raise AssemblyError((where, error.expected, repr(error.found))) from None
    return replace(with_file_parameters(composed, file.parameters), source=text)


def _part(described: Any, key: str) -> Robot:
    if isinstance(described, str):
        if described not in preset_names():
            expected = f"a preset ({', '.join(preset_names())}) or a robot written out"
            found = repr(described) + similar(described, preset_names())
            raise AssemblyError((key, expected, found))
        return load_robot(described)
    try:
        return _robot(described, yaml.safe_dump(described, sort_keys=False), key)
    except RobotFileError as error:
        below = [(f"{key}.{k}".rstrip("."), *found) for k, *found in error.problems]
        raise AssemblyError(*below) from None  # type: ignore[arg-type]


def preset_names() -> tuple[str, ...]:
    """Names of the robots that come with the package, sorted."""
    files = (entry.name for entry in (_FOLDER / "presets").iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in files if name.endswith(".yaml")))


def preset_text(name: str) -> str:
    """Text of a preset's robot file."""
    return (_FOLDER / "presets" / f"{name}.yaml").read_text("utf-8")


def write_template(name: str) -> Path:
    """Commented robot file of a new robot, which flies as it is.

    Args:
        name: Name of the robot, or of its file (.yaml).

    Returns:
        The file, named as the robot.

    Raises:
        ParameterError: If there is such a file or preset, or it cannot be a robot's name.
        OutputError: If it cannot be written.
    """
    path = Path(name if name.endswith((".yaml", ".yml")) else f"{name}.yaml")
    if path.exists():
        raise ParameterError("--new", "a file that is not there yet", str(path))
    if path.stem in preset_names():
        raise ParameterError("--new", "a name that no preset has", path.stem)
    text = (_FOLDER / "template.yaml").read_text("utf-8").replace("my_robot", path.stem)
    try:
        load_robot_text(text)
    except RobotFileError:
        expected = "a name of at most 40 letters, digits, _ and - that begins with a letter"
        raise ParameterError("--new", expected, path.stem) from None
    return write_whole(path, text)


def _read(reader: Callable[..., Any], *words: Any, **more: Any) -> Any:
    try:
        return reader(*words, **more)
    except Unreadable as error:
        problem = (error.where, error.expected, error.found)
        raise RobotFileError(error.file, [problem]) from None


@lru_cache(maxsize=32)
def _content(text: str, name: str) -> Any:
    """Content of YAML, kept: a flight and all that is learned from it carry the same text."""
    return _read(parsed_yaml, text, name, aliases=False)


def _page(robot: Robot) -> str:
    """Drawing and facts of a robot in HTML."""
    from patagium.report.page import snippet
    from patagium.robot.drawing import draw_robot
    from patagium.robot.planform import describe_robot

    return snippet(repr(robot), describe_robot(robot), draw_robot(robot))


PAGES.append(_page)
