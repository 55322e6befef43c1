"""The kinds of gait, and the CSV tables that a gait may come from.

`patagium.simulation.gaits` builds gaits for a robot and checks them. All are
periodic, with exact derivatives (of the spline, in a table's case). A table holds one
period: a time column and a column a joint (or pair of joints). Neglected: smoothing; the
spline goes through every row, noise included.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from io import StringIO
from operator import add
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.named_descriptions import field_values
from patagium.arrays import Array, Bools, brief, equal, real_array
from patagium.errors import LogError, ParameterError, ShapeError
from patagium.limits import LARGEST, TABLE_FILE, TURN
from patagium.reading import text_of
from patagium.robot import Robot
from patagium.robot.linkage import Linkage
from patagium.robot.units import UnitMismatch, in_si, meant, spoken


@dataclass(frozen=True)
class PrescribedMotion:
    """Motion of prescribed coordinates, (N, n) each: actuated joints, or a path's coordinates.

    Attributes:
        position: Joint positions [rad, m].
        velocity: Joint velocities [rad/s, m/s].
        acceleration: Joint accelerations [rad/s^2, m/s^2].
    """

    position: Array
    velocity: Array
    acceleration: Array
    __repr__, __eq__ = brief, equal

    def __iter__(self) -> Iterator[Array]:
        return iter((self.position, self.velocity, self.acceleration))

    def __add__(self, other: PrescribedMotion) -> PrescribedMotion:
        return PrescribedMotion(*map(add, self, other))


@runtime_checkable
class Gait(Protocol):
    """Protocol of a gait."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints it moves: all actuated ones of a robot, in order."""

    @property
    def period(self) -> float | None:
        """Time after which it repeats [s]; None if it does not move."""

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s]."""

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values; it travels with every flight."""


def leads(phase: Mapping[str, float] | None) -> Mapping[str, float]:
    """Phases by name [rad], none beyond a turn.

    Raises:
        ParameterError: If one is.
    """
    for name, one in (phase or {}).items():
        if abs(one) > TURN:
            expected = f"a lead of {name} within {spoken('rad', -TURN, TURN)}"
            raise ParameterError("phase", expected, spoken("rad", one) + meant(one))
    return phase or {}


def asked_times(time: ArrayLike) -> Array:
    """Times at which a motion is asked for, (N,) [s]; N is 1 for a number.

    Raises:
        ShapeError: If there are more dimensions.
    """
    times = np.atleast_1d(real_array("time", time))
    if times.ndim > 1:
        raise ShapeError("time", "(N,)", times.shape)
    return times


@dataclass(frozen=True)
class FourierGait:
    """Fourier series of every joint, exact derivatives.

    Attributes:
        joints: Names of the actuated joints.
        frequency: Beats a second [Hz]; 0 if nothing moves.
        mean: Mean positions, (n_a,) [rad, m].
        cosine: Cosine coefficients, (order, n_a).
        sine: Sine coefficients, (order, n_a).
    """

    joints: tuple[str, ...]
    frequency: float
    mean: Array
    cosine: Array
    sine: Array
    __repr__, __eq__ = brief, equal

    @property
    def period(self) -> float | None:
        """Time after which it repeats [s]; None if nothing moves."""
        return 1.0 / self.frequency if self.frequency else None

    @property
    def moving(self) -> list[str]:
        """Names of the joints that do not stand still."""
        swinging = np.r_[self.cosine, self.sine].any(axis=0)
        return [joint for joint, moves in zip(self.joints, swinging, strict=True) if moves]

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s]."""
        rate = 2.0 * np.pi * self.frequency * np.arange(1, len(self.sine) + 1)
        angle = asked_times(time)[:, None] * rate
        c, s = np.cos(angle), np.sin(angle)
        return PrescribedMotion(
            self.mean + c @ self.cosine + s @ self.sine,
            (c * rate) @ self.sine - (s * rate) @ self.cosine,
            -(c * rate**2) @ self.cosine - (s * rate**2) @ self.sine,
        )

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        return {"kind": "fourier", **field_values(self)}


@dataclass(frozen=True)
class LinkageGait:
    """Crank linkage driving plunge and elbow.

    Attributes:
        joints: Names of the actuated joints.
        frequency: Turns of the crank a second [Hz].
        linkage: The bars.
        offset: Added to every joint, (n_a,) [rad].
        plunge: Which joints follow the humerus, (n_a,) bool.
        elbow: Which joints follow the radius relative to the humerus, (n_a,) bool.
    """

    joints: tuple[str, ...]
    frequency: float
    linkage: Linkage
    offset: Array
    plunge: Bools
    elbow: Bools
    __repr__, __eq__ = brief, equal

    @property
    def period(self) -> float | None:
        """Time of one turn of the crank [s]."""
        return 1.0 / self.frequency

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s]."""
        rate = 2.0 * np.pi * self.frequency
        wing = self.linkage.solve(rate * asked_times(time))
        return PrescribedMotion(
            self.offset + self._spread(wing.humerus, wing.radius),
            rate * self._spread(wing.humerus_rate, wing.radius_rate),
            rate**2 * self._spread(wing.humerus_acceleration, wing.radius_acceleration),
        )

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        values = field_values(self)
        del values["plunge"], values["elbow"]
        return {"kind": "linkage", **values}

    def _spread(self, humerus: Array, radius: Array) -> Array:
        """Humerus to the plunge joints, radius relative to it to the elbows, (N, n_a)."""
        return np.outer(humerus, self.plunge) + np.outer(radius - humerus, self.elbow)


@dataclass(frozen=True)
class TableGait:
    """Periodic cubic spline through a table of positions.

    Attributes:
        joints: Names of the actuated joints.
        source: Name of the file.
        time: Times of one period from 0, both ends included, (M,) [s].
        position: Joint positions, the last row as the first, (M, n_a) [rad, m].
    """

    joints: tuple[str, ...]
    source: str
    time: Array
    position: Array
    __repr__, __eq__ = brief, equal

    @property
    def period(self) -> float | None:
        """Time after which it repeats [s]."""
        return float(self.time[-1])

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s]."""
        from scipy.interpolate import CubicSpline  # slow to import, rarely needed

        spline = CubicSpline(self.time, self.position, bc_type="periodic")
        phase = np.mod(asked_times(time), self.time[-1])
        return PrescribedMotion(spline(phase), spline(phase, 1), spline(phase, 2))

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        return {"kind": "table", **field_values(self)}


@dataclass(frozen=True)
class SuperposedGait:
    """Sum of gaits of one robot.

    Attributes:
        parts: The gaits.
    """

    parts: tuple[Gait, ...]
    __repr__ = brief

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the actuated joints."""
        return self.parts[0].joints

    @property
    def period(self) -> float | None:
        """Time after which all parts repeat: the longest of theirs [s]; None if none moves."""
        return max(filter(None, (part.period for part in self.parts)), default=None)

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s]."""
        return reduce(add, [part.motion(time) for part in self.parts])

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        return {"kind": "superposed", "parts": [part.describe() for part in self.parts]}


WHOLE = 1e-9
"""Largest distance of a ratio of periods from a whole number."""


def superposition(parts: Sequence[Gait], check: Callable[[Gait], None]) -> SuperposedGait:
    """Sum of gaits, or of paths, whose longest period is a whole number of each of the others.

    Args:
        parts: The gaits.
        check: Function that refuses a part that may not be in the sum.

    Raises:
        ParameterError: If there is no part, or the sum would not repeat.
    """
    if not parts:
        raise ParameterError("parts", "at least one", parts)
    for part in parts:
        check(part)
    whole = SuperposedGait(tuple(parts))
    for period in filter(None, (part.period for part in parts)):
        ratio = (whole.period or 0.0) / period
        if abs(ratio - round(ratio)) > WHOLE:
            expected = f"a period that {whole.period:g} s is a multiple of"
            raise ParameterError("parts", expected, period)
    return whole


FEWEST_ROWS = 4
"""Rows a periodic cubic needs, the repeated first one included."""

CLOSURE = 1e-9
"""Largest distance of the last row from the first that it repeats [rad, m]."""

_WIDEST = 2.0
"""Longest time behind the last row of an open table, over the longest between two rows [1]."""

_HEADER = re.compile(r"(?P<name>[^\[\]]*)(?:\[(?P<unit>[^\[\]]*)\])?")


def read_gait_table(
    robot: Robot, path: Path, period: float | None
) -> tuple[Array, dict[str, Array]]:
    """One period of a gait from a CSV file.

    Args:
        robot: The machine, for the kind of each joint.
        path: The file.
        period: Time after which it repeats [s]; None if the last row repeats the first.

    Returns:
        Strictly rising time from the first row, both ends of the period included, (M,) [s];
        positions by joint (or pair), the last as the first, (M,) [rad, m].

    Raises:
        LogError: If it cannot be used as it stands.
    """
    time, positions = read_columns(path, partial(_joint_unit, robot))
    with np.errstate(over="ignore"):
        steps, time = np.diff(time), time - time[0]
    if not np.all(steps > 0):
        row = int(np.flatnonzero(~(steps > 0))[0]) + 3
        raise LogError(f"{path.name}: row {row}: time does not rise")
    span = time[-1]
    if period is not None and period > span + CLOSURE:
        if period - span > _WIDEST * steps.max(initial=0.0):
            expected = f"a last row nearer to the end of the period of {period:g} s"
            raise LogError(path.name, expected, f"it at {span:g} s")
        time = np.append(time, period)
        positions = {name: np.append(x, x[0]) for name, x in positions.items()}
    elif period is not None and abs(period - span) > CLOSURE:
        raise LogError(f"{path.name}: {span:g} s of rows, more than the period of {period:g} s")
    for name, x in positions.items():
        if abs(x[-1] - x[0]) > CLOSURE:
            raise LogError(
                f"{path.name}: {name}: last row {x[-1]:g}, first {x[0]:g}: not one whole period; "
                "repeat the first row at its end, or give its period (--frequency)"
            )
    if len(time) < FEWEST_ROWS:
        raise LogError(f"{path.name}: {len(time)} rows, expected at least {FEWEST_ROWS}")
    with np.errstate(all="ignore"):
        fastest = max(np.abs(x).max() for x in positions.values()) / np.diff(time).min() ** 2
        extreme = max(fastest, time[-1])
    if not extreme < LARGEST:
        raise LogError(path.name, f"numbers below {LARGEST:g}", f"{extreme:g}")
    return time, {name: np.append(x[:-1], x[0]) for name, x in positions.items()}


def read_columns(path: Path, unit_of: Callable[[str], str]) -> tuple[Array, dict[str, Array]]:
    """Time, (M,) [s], and the other columns of a CSV file by name, (M,) each [SI].

    Args:
        path: The file.
        unit_of: SI unit of a column other than time; raises LogError for one that may not be there.

    Raises:
        LogError: If it is no table of finite numbers under a header with time and another column.
    """
    try:
        text = text_of(path, TABLE_FILE)
        lines = [line for line in csv.reader(StringIO(text, newline="")) if line]
    except csv.Error as error:
        raise LogError(f"{path.name}: cannot be read: {error}") from None
    if not lines:
        raise LogError(f"{path.name}: empty")
    header = []
    for cell in lines[0]:
        match = _HEADER.fullmatch(cell.strip())
        if match is None or not match["name"].strip():
            raise LogError(f"{path.name}: header {cell[:60]!r}, expected such as 'plunge [rad]'")
        header.append((match["name"].strip(), match["unit"] or ""))
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        if len(line) != len(header):
            raise LogError(f"{path.name}: row {number}: {len(line)} cells, expected {len(header)}")
        rows.append([_number(path, number, cell) for cell in line])
    if not rows:
        raise LogError(f"{path.name}: no rows below the header")
    table: dict[str, Array] = {}
    for (name, unit), column in zip(header, np.array(rows).T, strict=True):
        if name in table:
            raise LogError(path.name, f"column {name!r} once", "it twice")
        si = "s" if name == "time" else unit_of(name)
        if not unit:
            expected = f"expected its unit, as in '{name} [{si}]', found none"
            raise LogError(f"{path.name}: column {name!r}: {expected}")
        try:
            table[name] = column * in_si(f"1 {unit}", si, name)
        except UnitMismatch as error:
            raise LogError(f"{path.name}: column {name!r}: {error}") from None
    if "time" not in table or len(table) < 2:
        found = ", ".join(table)
        raise LogError(path.name, "columns of time and what moves", found)
    return table.pop("time"), table


def _number(path: Path, row: int, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise LogError(f"{path.name}: row {row}", "a finite number", f"{cell!r}")
    return value


def _joint_unit(robot: Robot, name: str) -> str:
    joints = robot.joints_named(name)
    if not joints:
        known = ", ".join(robot.actuated_names)
        raise LogError(f"column {name!r}: no actuated joint of {robot.name!r} ({known})")
    return robot.dof_units[robot.index(joints[0])]
