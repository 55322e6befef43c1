"""Gaits from CSV tables: reading with units, refusing what cannot be a period.

A table holds one period: a time column and a column a joint (or pair of joints).
Neglected: smoothing; the spline goes through every row, noise included.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from patagium.errors import LogError
from patagium.robot import Robot
from patagium.robot.units import UnitMismatch, in_si

Array: TypeAlias = NDArray[np.float64]

FEWEST_ROWS = 4
"""Rows a periodic cubic needs, the repeated first one included."""

CLOSURE = 1e-9
"""How far the last row may be from the first and still repeat it [rad, m]."""

_HEADER = re.compile(r"\s*(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*")


@dataclass(frozen=True)
class GaitTable:
    """One period of motion, SI.

    Attributes:
        time: Strictly rising, both ends of the period included, (M,) [s].
        positions: Joint (or pair) name to positions, the last as the first, (M,) [rad, m].
    """

    time: Array
    positions: dict[str, Array]


def read_gait_table(
    robot: Robot,
    path: Path,
    columns: Mapping[str, str],
    units: Mapping[str, str],
    period: float | None,
) -> GaitTable:
    """One period of a gait from a CSV file.

    Args:
        robot: The machine, for the kind of each joint.
        path: The file.
        columns: Joint or "time" to the name of its column, where they differ.
        units: Joint or "time" to its unit, where the header has none.
        period: Time after which it repeats [s]; None if the last row repeats the first.

    Raises:
        LogError: If it cannot be used as it stands.
    """
    header, rows = read_columns(path)
    renamed = {column: name for name, column in columns.items()}
    table: dict[str, Array] = {}
    for k, (written, unit) in enumerate(header):
        name = renamed.pop(written, written)
        if name in table:
            raise LogError(f"{path.name}: column {name!r} is there twice")
        si = "s" if name == "time" else _joint_unit(robot, name)
        table[name] = rows[:, k] * unit_factor(path, name, units.get(name, unit), si)
    for missing in renamed:
        raise LogError(f"{path.name}: column {missing!r} is missing; found {', '.join(table)}")
    for name in units:
        if name not in table:
            raise LogError(f"{path.name}: unit given for {name!r}, found {', '.join(table)}")
    if "time" not in table or len(table) < 2:
        raise LogError(f"{path.name}: needs time and a joint, found {', '.join(table)}")
    time = table.pop("time")
    return _closed(path, GaitTable(time, table), period)


def read_columns(path: Path) -> tuple[list[tuple[str, str]], Array]:
    """Name and unit of each column of a CSV file, and its rows, (M, columns).

    Args:
        path: The file.

    Raises:
        LogError: If it is no table of finite numbers under a header.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = [line for line in csv.reader(file) if line]
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path.name}: cannot be read: {error}") from None
    if not lines:
        raise LogError(f"{path.name}: empty")
    header = []
    for cell in lines[0]:
        match = _HEADER.fullmatch(cell)
        if match is None or not match["name"]:
            raise LogError(f"{path.name}: header {cell!r}, expected such as 'plunge [rad]'")
        header.append((match["name"], match["unit"] or ""))
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        if len(line) != len(header):
            raise LogError(f"{path.name}: row {number}: {len(line)} cells, expected {len(header)}")
        rows.append([_number(path, number, cell) for cell in line])
    if not rows:
        raise LogError(f"{path.name}: no rows below the header")
    return header, np.array(rows)


def _number(path: Path, row: int, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise LogError(f"{path.name}: row {row}: expected a finite number, found {cell!r}")
    return value


def _joint_unit(robot: Robot, name: str) -> str:
    for dof, unit in zip(robot.dof_names, robot.dof_units, strict=True):
        if dof in (name, f"left_{name}", f"right_{name}"):
            return unit
    raise LogError(f"column {name!r}: no joint of {robot.name!r} ({', '.join(robot.dof_names)})")


def unit_factor(path: Path, name: str, unit: str, si: str) -> float:
    """Factor that converts a column to SI.

    Args:
        path: The file, for the message.
        name: The column.
        unit: Its unit as written.
        si: The SI unit wanted.

    Raises:
        LogError: If there is no unit, or one of another dimension.
    """
    if not unit:
        raise LogError(f"{path.name}: column {name!r} has no unit; write it as '{name} [{si}]'")
    try:
        return in_si(f"1 {unit}", si, name)
    except UnitMismatch as error:
        raise LogError(f"{path.name}: column {name!r}: {error}") from None


def _closed(path: Path, table: GaitTable, period: float | None) -> GaitTable:
    time, positions = table.time, table.positions
    steps = np.diff(time)
    if not np.all(steps > 0):
        row = int(np.flatnonzero(~(steps > 0))[0]) + 3
        raise LogError(f"{path.name}: row {row}: time does not rise")
    if period is not None and period > time[-1] - time[0] + CLOSURE:
        time = np.append(time, time[0] + period)
        positions = {name: np.append(x, x[0]) for name, x in positions.items()}
    elif period is not None and abs(period - (time[-1] - time[0])) > CLOSURE:
        span = time[-1] - time[0]
        raise LogError(f"{path.name}: {span:g} s of rows, more than the period of {period:g} s")
    for name, x in positions.items():
        if abs(x[-1] - x[0]) > CLOSURE:
            raise LogError(
                f"{path.name}: {name}: last row {x[-1]:g}, first {x[0]:g}: not one whole period; "
                "repeat the first row at its end, or give the period"
            )
    if len(time) < FEWEST_ROWS:
        raise LogError(f"{path.name}: {len(time)} rows, expected at least {FEWEST_ROWS}")
    return GaitTable(time, {name: np.append(x[:-1], x[0]) for name, x in positions.items()})
