"""Writers of imported logs: netCDF4 for all further work, CSV for `patagium stream`.

A netCDF4 log has one variable for each number, such as `angular rate.x`, with its unit, its
expected range and its role. Its attributes hold the mapping, the findings and the resampling.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from patagium.sensing.logs.files.channels import Array
from patagium.sensing.logs.importing.plan import Plan, variable_name
from patagium.sensing.logs.record import FORMAT

CHUNK = 1 << 15
"""Samples of a chunk of a netCDF4 variable."""


class NetcdfWriter:
    """Writer of a netCDF4 log.

    Args:
        path: The file.
        plan: Quantities of the log.
        rows: Largest number of samples to come.
        attributes: Attributes of the file.

    Raises:
        OSError: If the file cannot be written.
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
        """Append samples: time (k,) [s] and values of all labels (k, n) in their units."""
        rows = slice(self._rows, self._rows + len(time))
        self._time[rows] = time
        for column, variable in zip(values.T, self._columns, strict=True):
            variable[rows] = column
        self._rows = rows.stop

    def close(self) -> None:
        """Complete the file."""
        self._file.close()

    def _variable(self, name: str, unit: str, facts: dict[str, Any]) -> Any:
        variable = self._file.createVariable(
            variable_name(name), "f8", ("time",), chunksizes=(self._chunk,)
        )
        variable.set_var_chunk_cache(8 * self._chunk, 3, 0.75)  # one chunk; the default is many
        variable.setncatts({"units": unit, "long_name": name, **facts})
        return variable


class CsvWriter:
    """Writer of a CSV text with the time and all labels.

    Args:
        path: The file.
        plan: Quantities of the log.

    Raises:
        OSError: If the file cannot be written.
    """

    def __init__(self, path: Path, plan: Plan) -> None:
        self._file = path.open("w", encoding="utf-8", newline="")
        labels = [label for item in plan.items for label in item.column.labels]
        self._append(pd.DataFrame(columns=["time", *labels]), header=True)

    def write(self, time: Array, values: Array) -> None:
        """Append samples: time (k,) [s] and values of all labels (k, n) in their units."""
        self._append(pd.DataFrame(np.column_stack([time, values])), header=False)

    def close(self) -> None:
        """Complete the file."""
        self._file.close()

    def _append(self, rows: pd.DataFrame, *, header: bool) -> None:
        rows.to_csv(self._file, header=header, index=False, lineterminator="\n")


Writer: TypeAlias = NetcdfWriter | CsvWriter
