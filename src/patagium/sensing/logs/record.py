"""Imported logs on disk, read whole as a table or a flight, or block by block.

Logs are not compressed: 10^7 samples of ten numbers take 0.9 GB on the disk.
"""

from __future__ import annotations

import json
import warnings
from contextlib import AbstractContextManager, ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from patagium.aerodynamics import Air
from patagium.arguments import checked
from patagium.arrays import Array, Indices, find_gaps
from patagium.errors import FlightError, LogError, command
from patagium.netcdf_file import kind_of, loaded_dataset, netcdf_content, open_netcdf
from patagium.reading import parsed_json
from patagium.robot import Robot, load_robot_text
from patagium.robot.files import robot_attributes
from patagium.sensing.force.air_force import OPTIONAL_PARTS, PARTS, flight_labels
from patagium.sensing.logs.table import LogTable
from patagium.simulation.flight import air_of, quantities, robot_of

FORMAT = "patagium log 1"
AIR_LINE = b"# air "
"""Beginning of the first line of a text of packets in other air than that at rest at sea level."""
WIND = ("wind.x", "wind.y", "wind.z")
"""Names of the velocity of the air in a log that recorded it, world axes [m/s]."""
LOADED = ("a record", "a motion")
"""Kinds of files that are read as they are; see `kind_of`."""
_COMPONENTS = (".w", ".x", ".y", ".z")
_CACHE = 1 << 19
"""Cache of a variable [B]; the default of netCDF4 is many times that."""


def stated_air(line: bytes) -> Air | None:
    """Air that the first line of a text of packets states; None where it states none.

    Raises:
        FlightError: If it cannot be read.
    """
    if not line.startswith(AIR_LINE):
        return None
    return air_of(xr.Dataset(attrs={"air": line.removeprefix(AIR_LINE).decode("utf-8", "replace")}))


def is_log(path: str | Path) -> bool:
    """Whether a file is an imported log."""
    return Path(path).suffix.lower() == ".nc" and kind_of(path).startswith("an imported log")


class LogRecord(AbstractContextManager["LogRecord"]):
    """Open imported log: one time base, SI units, our axes.

    Args:
        path: The netCDF file.

    Attributes:
        path: The file.
        count: Number of samples.
        labels: Names of its numbers.
        units: Units of its numbers, by name.
        gap: Length from which a step is a gap, in median steps.
        findings: Findings of the import; see `Finding`.
        mapping: Mapping of the import as JSON text; empty of a log that had none.

    Raises:
        LogError: If the file is no imported log.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        with self._content(), ExitStack() as opened:
            self._file = opened.enter_context(closing(open_netcdf(self.path)))
            self._read_header()
            opened.pop_all()

    def _content(self) -> AbstractContextManager[None]:
        return netcdf_content(self.path, LogError, "a whole log that `patagium import` wrote")

    def _read_header(self) -> None:
        """Read all but the numbers."""
        if getattr(self._file, "format", "") != FORMAT:
            other = kind_of(self.path) or "another file"
            raise LogError(self.path, "a log that `patagium import` wrote", other)
        self._file.set_auto_mask(False)
        self._columns = {
            str(variable.long_name): variable
            for name, variable in self._file.variables.items()
            if name != "time"
        }
        self.count = len(self._file.dimensions["time"])
        self.gap = float(self._file.gap)
        self.findings: list[dict[str, Any]] = parsed_json(self._file.findings, "findings")
        self.mapping = str(getattr(self._file, "mapping", ""))
        for variable in self._file.variables.values():
            if variable.dtype != np.float64 or variable.dimensions != ("time",):
                raise LogError(f"{self.path}: {variable.name}: expected float64 over time")
            variable.set_var_chunk_cache(_CACHE, 3, 0.75)
        self._time = self._file["time"]
        self.labels = tuple(self._columns)
        self.units = {name: str(column.units) for name, column in self._columns.items()}

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def of_role(self, role: str) -> tuple[str, ...]:
        """Names of the numbers of a role, which is "input", "output" or "channel"."""
        return tuple(name for name, column in self._columns.items() if column.role == role)

    def ranges(self, names: tuple[str, ...]) -> Array:
        """Lowest and highest expected value, (n, 2) in the units of the log; NaN if not stated."""
        nothing = (np.nan, np.nan)
        rows = [getattr(self._columns[name], "expected_range", nothing) for name in names]
        return np.array(rows, float).reshape(-1, 2)

    def time(self, begin: int = 0, end: int | None = None) -> Array:
        """Times of the samples from `begin` to `end`, (k,) [s]."""
        with self._content():
            return np.asarray(self._time[begin:end], float)

    def values(self, names: tuple[str, ...], begin: int = 0, end: int | None = None) -> Array:
        """Numbers of the samples from `begin` to `end`, (k, n), in the units of the log.

        Raises:
            LogError: If the log has no number of such a name.
        """
        missing = [name for name in names if name not in self._columns]
        if missing:
            raise LogError(
                f"{self.path}: expected {', '.join(missing[:6])}, but it holds "
                f"{', '.join(self.labels[:12])}"
            )
        rows = len(range(self.count)[begin:end])
        with self._content():
            columns = [np.asarray(self._columns[name][begin:end], float) for name in names]
        return np.column_stack(columns) if columns else np.empty((rows, 0))

    def table(self, begin: int = 0, end: int | None = None) -> LogTable:
        """Inputs and outputs of the samples from `begin` to `end`.

        Raises:
            LogError: If the mapping of the log named channels only.
        """
        inputs, outputs = self.of_role("input"), self.of_role("output")
        if not inputs or not outputs:
            raise LogError(
                f"{self.path}: expected inputs and outputs, but its mapping named channels only: "
                f"{', '.join(self.labels[:12])}; from sensors of a robot "
                + command("`patagium motion {}", self.path)
                + " --robot ROBOT" * (self.robot is None)
                + "` finds the motion and the forces, to learn from"
            )
        time = self.time(begin, end)
        return LogTable(
            time=time - time[0] if begin == 0 else time,
            x=self.values(inputs, begin, end),
            y=self.values(outputs, begin, end),
            input_names=inputs,
            output_names=outputs,
            input_units=tuple(self.units[name] for name in inputs),
            output_units=tuple(self.units[name] for name in outputs),
            input_range=self.ranges(inputs),
            output_range=self.ranges(outputs),
            gaps=find_gaps(time, self.gap),
            gap=self.gap,
            source=str(self.path),
        )

    @property
    def robot(self) -> Robot | None:
        """Robot that the mapping named; None if it named none."""
        if "robot" not in self._file.ncattrs():
            return None
        return load_robot_text(str(self._file.robot), str(self._file.robot_name))

    @property
    def air(self) -> Air:
        """Air that the mapping states, else at rest at sea level."""
        return air_of(xr.Dataset(attrs=self._origin()))

    @property
    def is_flight(self) -> bool:
        """Whether the log holds q, v, a and u1 of every coordinate of its robot."""
        robot = self.robot
        return robot is not None and not self._missing(robot)

    def flight(self) -> xr.Dataset:
        """Flight of the q, v, a and u1 in the log, and of the known forces it holds.

        Raises:
            FlightError: If the log lacks a robot, or one of these quantities.
        """
        robot = self.robot
        if robot is None:
            raise FlightError(self.path, "a mapping with `robot`", "none")
        missing = self._missing(robot)
        if missing:
            expected = f"q, v, a and u1 of each coordinate of {robot.name}"
            raise FlightError(self.path, expected, f"no {', '.join(missing[:6])}")
        record = {
            part: (("time", *quantities(robot)[part].dims), self.values(labels))
            for part, labels in self._parts(robot).items()
        }
        coordinates = {"time": ("time", self.time(), {"units": "s"}), "dof": list(robot.dof_names)}
        return xr.Dataset(record | self._wind(), coordinates, self._origin())

    def dataset(self) -> xr.Dataset:
        """All quantities in memory; those of a flight as q, v, a, u1 of its coordinates."""
        wind = self._wind()
        base, used = xr.Dataset(wind, attrs=self._origin()), set(WIND if wind else ())
        if self.is_flight:
            base = self.flight()
            used |= {label for labels in self._parts(robot_of(base)).values() for label in labels}
        parts: dict[str, list[str]] = {}
        single = {one.rpartition(".")[0] for one in self.labels if one[-2:] not in _COMPONENTS}
        for name in (label for label in self.labels if label not in used):
            head = name[:-2] if name[-2:] in _COMPONENTS else ""
            apart = not head or head in base or (head in PARTS and head in single)
            parts.setdefault(name if apart else head, []).append(name)
        variables: dict[str, Any] = {}
        for whole, names in parts.items():
            dim, values = {3: "axis", 4: "quaternion"}.get(len(names)), self.values(tuple(names))
            facts: dict[str, Any] = {"units": self.units[names[0]]}
            for fact in ("step_in_log", "rounding_in_log"):
                facts[fact] = max(getattr(self._columns[one], fact, 0.0) for one in names)
            if dim is not None:
                variables[whole] = (("time", dim), values, facts)
                continue
            variables |= {one: ("time", values[:, k], facts) for k, one in enumerate(names)}
        coordinates = {
            "time": ("time", self.time(), {"units": "s"}),
            "axis": list("xyz"),
            "quaternion": list("wxyz"),
        }
        attributes = {**base.attrs, "findings": json.dumps(self.findings)}
        return base.assign(variables).assign_coords(coordinates).assign_attrs(attributes)

    def _origin(self) -> dict[str, str]:
        """Air and robot of the log as attributes of a flight, as far as it has them."""
        robot = self.robot
        stated = {"air": str(self._file.air)} if "air" in self._file.ncattrs() else {}
        if robot is None:
            return stated
        return {**stated, **robot_attributes(robot), "gait": "{}"}

    def _parts(self, robot: Robot) -> dict[str, tuple[str, ...]]:
        """Names of the numbers of each part of a flight that the log holds whole."""
        names = {"q": robot.coordinate_names}
        parts = {
            part: tuple(f"{part}.{name}" for name in names.get(part, robot.dof_names))
            for part in (*PARTS, *OPTIONAL_PARTS)
        }
        return {part: labels for part, labels in parts.items() if set(labels) <= set(self.labels)}

    def _wind(self) -> dict[str, Any]:
        """Wind over (time, axis); components that the log lacks are those of the stated wind."""
        known = tuple(name for name in WIND if name in self._columns)
        if not known or (len(known) < 3 and self.robot is None):  # else columns as any other
            return {}
        wind = np.tile(self.air.wind, (self.count, 1))
        wind[:, [WIND.index(name) for name in known]] = self.values(known)
        return {"wind": (("time", "axis"), wind, {"units": self.units[known[0]]})}

    def _missing(self, robot: Robot) -> list[str]:
        return [name for name in flight_labels(robot) if name not in self._columns]


@checked
def load_log(path: str | Path) -> xr.Dataset:
    """Imported log, record of a stream, or motion: a variable for each quantity, and its unit.

    Vectors are (time, axis), attitudes (time, quaternion) with w, x, y, z, body to world. A log
    with q, v, a and u1 of every coordinate of its robot has them as the variables of a flight,
    (time, dof), and `identify` learns from it as from a simulated flight. A record of `patagium
    stream` is such a log, in still air, without the samples that nothing can learn from: a warning
    says how many. Of a file of `patagium motion` the measured `force` is learned.

    Args:
        path: The netCDF file.

    Raises:
        LogError: If the file is no imported log. A simulated flight is read by `load_flight`.
    """
    if (kind := kind_of(path)).startswith(LOADED):
        log = loaded_dataset(path, LogError, "a whole record")
        if kind.startswith(LOADED[0]):
            with netcdf_content(path, LogError, "a whole record"):
                kept, count = _usable(log), log.sizes["time"]
                log = log.isel(time=kept)
            if left := count - len(kept):
                why = "their motion is no number, or their stamps do not rise"
                warnings.warn(
                    f"{path}: {left} of {count} samples are left out: {why}", stacklevel=3
                )
        return log.assign_attrs({"air": "{}", "gait": "{}"} | log.attrs)
    with LogRecord(path) as record, netcdf_content(path, LogError, "a whole log"):
        return record.dataset()


def _usable(stream: xr.Dataset) -> Indices:
    """Index of each sample of a stream with finite motion and rising times.

    After a clock that was set, either what is later than all before it is kept or what is earlier
    than all after it, whichever is more.
    """
    good = np.isfinite(stream["time"].values)
    for name in {*PARTS, *OPTIONAL_PARTS} & {*stream}:
        values = stream[name].values
        good &= (np.isfinite(values) if name in PARTS[:3] else ~np.isinf(values)).all(axis=1)
    rows = np.flatnonzero(good)
    time = np.concatenate([[-np.inf], stream["time"].values[rows], [np.inf]])
    later = time[1:-1] > np.maximum.accumulate(time)[:-2]
    earlier = time[1:-1] < np.minimum.accumulate(time[::-1])[::-1][2:]
    return np.asarray(rows[max(later, earlier, key=np.count_nonzero)])
