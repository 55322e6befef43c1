"""Logs on one time base as files: netCDF4 for all that follows, CSV for `patagium stream`.

A netCDF4 log has one variable a number, `angular rate.x`, with its unit, its range to expect and
its role; its attributes carry the mapping, the findings, and how it was resampled. Neglected:
compression.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from patagium.sensing.logs.files.channels import Array
from patagium.sensing.logs.importing.plan import Plan, variable_name
from patagium.sensing.logs.record import FORMAT

CHUNK = 1 << 15


class Writer(Protocol):
    """What rows of a log are written to."""

    def write(self, time: Array, values: Array) -> None:
        """More rows: time (k,) [s] and all labels (k, n)."""
        ...

    def close(self) -> None:
        """The file is whole."""
        ...


class NetcdfWriter:
    """A netCDF4 log that is being written.

    Args:
        path: The draft.
        plan: Its quantities.
        rows: How many there will be, at most.
        attributes: Of the file.
    """

    def __init__(self, path: Path, plan: Plan, rows: int, attributes: dict[str, Any]) -> None:
        from netCDF4 import Dataset

        self._chunk = min(CHUNK, max(1, rows))
        self._file = Dataset(path, "w", format="NETCDF4")
        self._file.setncatts({**attributes, "format": FORMAT})
        self._file.createDimension("time", None)
        self._time = self._variable("time", "s", {})
        self._columns = []
        for item in plan.items:
            words = item.column
            for label, bounds in zip(words.labels, item.bounds(), strict=False):
                facts: dict[str, Any] = {"role": item.role, "quantity": words.label}
                if np.isfinite(bounds).all():
                    facts["expected_range"] = list(bounds)
                if words.frame is not None:
                    facts["frame_in_log"] = words.frame
                if item.is_attitude:
                    facts["body_in_log"] = words.body
                self._columns.append(self._variable(label, item.unit, facts))
        self._rows = 0

    def write(self, time: Array, values: Array) -> None:
        """More rows: time (k,) [s] and all labels (k, n)."""
        rows = slice(self._rows, self._rows + len(time))
        self._time[rows] = time
        for column, variable in zip(values.T, self._columns, strict=True):
            variable[rows] = column
        self._rows = rows.stop

    def close(self) -> None:
        """The file is whole."""
        self._file.close()

    def _variable(self, name: str, unit: str, facts: dict[str, Any]) -> Any:
        variable = self._file.createVariable(
            variable_name(name), "f8", ("time",), chunksizes=(self._chunk,)
        )
        variable.set_var_chunk_cache(8 * self._chunk, 3, 0.75)  # one chunk; the default is many
        variable.setncatts({"units": unit, "long_name": name, **facts})
        return variable


class CsvWriter:
    """A CSV text that is being written: time and all labels.

    Args:
        path: The draft.
        plan: Its quantities.
    """

    def __init__(self, path: Path, plan: Plan) -> None:
        self._file = path.open("w", encoding="utf-8", newline="")
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._rows.writerow(["time", *(k for item in plan.items for k in item.column.labels)])

    def write(self, time: Array, values: Array) -> None:
        """More rows: time (k,) [s] and all labels (k, n)."""
        self._rows.writerows(np.column_stack([time, values]).tolist())

    def close(self) -> None:
        """The file is whole."""
        self._file.close()
