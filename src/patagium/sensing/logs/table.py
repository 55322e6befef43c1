"""A log as a table of named columns: read, checked, scaled, and nothing repaired.

What would have to be guessed is refused with a sentence: missing numbers, time that
does not advance, columns that are not there, units that do not fit. Gaps in time are
counted and handed on, never bridged. Neglected: clocks that drift, delays between columns.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from patagium.errors import LogError
from patagium.sensing.logs.mapping import TableMapping, ValueColumn, conversion, load_mapping

Array = NDArray[np.float64]

_HEADER = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*$")


@dataclass(frozen=True)
class Table:
    """The samples of a log, in the units the model sees.

    Attributes:
        time: From the first sample, (N,) [s].
        x: Inputs, (N, n_x).
        y: Outputs, (N, n_y).
        input_names: Names of the inputs.
        output_names: Names of the outputs.
        input_units: Units of the inputs.
        output_units: Units of the outputs.
        input_range: Lowest and highest value to expect, (n_x, 2); nan where not stated.
        output_range: The same for the outputs, (n_y, 2).
        gaps: Index of the first sample after each gap, (n_gaps,).
        gap: A time step longer than this many medians is a gap.
        source: File it came from.
    """

    time: Array
    x: Array
    y: Array
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    input_range: Array
    output_range: Array
    gaps: NDArray[np.int64]
    gap: float
    source: str

    def where(self, kept: slice | ArrayLike) -> Table:
        """Some of the samples, time as it was; what is left out becomes a gap.

        Args:
            kept: A slice, indices in order, or a bool for each sample.
        """
        chosen = kept if isinstance(kept, slice) else np.asarray(kept)
        time = self.time[chosen]
        step = float(np.median(np.diff(self.time)))
        gaps = np.flatnonzero(np.diff(time) > self.gap * step) + 1
        return replace(self, time=time, x=self.x[chosen], y=self.y[chosen], gaps=gaps)

    def describe_gaps(self) -> str:
        """The gaps in one sentence."""
        step = float(np.median(np.diff(self.time)))
        if not len(self.gaps):
            return f"no gap longer than {self.gap:g} times the median step of {step:.4g} s"
        lengths = self.time[self.gaps] - self.time[self.gaps - 1]
        return (
            f"{len(self.gaps)} gap(s) longer than {self.gap:g} times the median step of "
            f"{step:.4g} s, the longest {lengths.max():.4g} s at t = "
            f"{self.time[self.gaps[lengths.argmax()] - 1]:.6g} s"
        )


def find_gaps(time: ArrayLike, factor: float) -> NDArray[np.int64]:
    """First sample after each gap: where the time step exceeds `factor` medians.

    Args:
        time: Increasing, (N,) [s].
        factor: Number of median steps.
    """
    steps = np.diff(np.asarray(time, float))
    if not len(steps):
        return np.empty(0, np.int64)
    return np.flatnonzero(steps > factor * np.median(steps)) + 1


def read_table(
    path: str | Path,
    mapping: TableMapping | str | Path,
    tell: Callable[[Any], None] | None = None,
) -> Table:
    """A CSV or Parquet file as a checked table; other logs as `import_log` brings them.

    A header may carry its unit as `name [unit]`; it must then agree with the mapping. Where
    the mapping asks for more than columns as they stand (topics, axes, a time base), the log
    is imported on the way, in a temporary folder.

    Args:
        path: A `.csv` (also `.csv.gz`) or `.parquet` file with named columns, or another log.
        mapping: What the columns mean, or the YAML file that says it.
        tell: Called with the findings of an import.

    Raises:
        LogError: If the file cannot be read, a column is missing or not numeric, a number
            is missing or infinite, time does not advance, or a unit does not fit.
    """
    file = Path(path)
    words = mapping if isinstance(mapping, TableMapping) else load_mapping(mapping)
    if words.is_plain and file.name.lower().endswith((".csv", ".csv.gz", ".parquet")):
        return table_from_frame(_read(file), words, str(file))
    from patagium.sensing.logs.importing.run import import_log
    from patagium.sensing.logs.record import LogRecord

    with tempfile.TemporaryDirectory() as folder:
        found = import_log(file, mapping, Path(folder) / "log.nc", tell=tell)
        with LogRecord(found.path) as record:
            return replace(record.table(), source=str(file))


def table_from_frame(frame: pd.DataFrame, mapping: TableMapping, source: str = "table") -> Table:
    """Columns already in memory as a checked table; see `read_table`.

    Args:
        frame: Named columns.
        mapping: What they mean.
        source: Named in messages.
    """
    columns = (*mapping.inputs, *mapping.outputs)
    found = _headers(frame, source)
    wanted = [mapping.time.column, *(str(column.column) for column in columns)]
    missing = [name for name in dict.fromkeys(wanted) if name not in found]
    if missing:
        raise LogError(
            f"{source}: expected column(s) {', '.join(missing)}, "
            f"but the file holds {', '.join(map(str, frame.columns))}"
        )
    time = _column(frame, found, mapping.time.column, mapping.time.unit, source)
    time = time * conversion(mapping.time.unit, "s", f"{source}: {mapping.time.column}")[0]
    _advancing(time, mapping.time.column, source)
    count = len(mapping.inputs)
    scaled = [_scaled(frame, found, column, source) for column in columns]
    values = np.column_stack([value for value, _, _ in scaled])
    units = tuple(unit for _, unit, _ in scaled)
    ranges = np.array([bounds for _, _, bounds in scaled])
    labels = tuple(column.label for column in columns)
    time = time - time[0]
    return Table(
        time=time,
        x=np.ascontiguousarray(values[:, :count]),
        y=np.ascontiguousarray(values[:, count:]),
        input_names=labels[:count],
        output_names=labels[count:],
        input_units=units[:count],
        output_units=units[count:],
        input_range=ranges[:count],
        output_range=ranges[count:],
        gaps=find_gaps(time, mapping.gap),
        gap=mapping.gap,
        source=source,
    )


def _read(file: Path) -> pd.DataFrame:
    try:
        if file.suffix == ".parquet":
            return pd.read_parquet(file)
        return pd.read_csv(file, encoding="utf-8-sig")
    except FileNotFoundError as problem:
        raise LogError(f"{file}: no such file") from problem
    except (OSError, ValueError, ImportError) as problem:
        raise LogError(f"{file}: expected a CSV or Parquet table, found: {problem}") from problem


def _headers(frame: pd.DataFrame, source: str) -> dict[str, tuple[str, str | None]]:
    found: dict[str, tuple[str, str | None]] = {}
    for header in map(str, frame.columns):
        match = _HEADER.match(header)
        if match:
            found.setdefault(match["name"], (header, match["unit"]))
        found[header.strip()] = (header, None)
    if not len(frame):
        raise LogError(f"{source}: expected samples, found an empty table")
    return found


def _column(
    frame: pd.DataFrame,
    found: dict[str, tuple[str, str | None]],
    name: str,
    unit: str,
    source: str,
) -> Array:
    header, stated = found[name]
    where = f"{source}: column {name}"
    if stated is not None:
        factor, _ = conversion(stated, unit, where)
        if abs(factor - 1.0) > 1e-12:  # rounding of pint's factors
            raise LogError(f"{where}: the mapping says {unit!r}, the header says {stated!r}")
    series: Any = frame[header]
    if not pd.api.types.is_numeric_dtype(series) or pd.api.types.is_complex_dtype(series):
        raise LogError(f"{where}: expected numbers, found {series.iloc[0]!r} ({series.dtype})")
    values = series.to_numpy(dtype=float, na_value=np.nan)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise LogError(
            f"{where}: expected finite numbers, found {values[bad[0]]} in row {bad[0] + 1} of "
            f"{len(values)} ({len(bad)} in all); mend or cut the log first"
        )
    return np.asarray(values, float)


def _scaled(
    frame: pd.DataFrame,
    found: dict[str, tuple[str, str | None]],
    column: ValueColumn,
    source: str,
) -> tuple[Array, str, tuple[float, float]]:
    raw = _column(frame, found, str(column.column), column.unit, source)
    factor, unit = conversion(column.unit, column.as_unit, f"{source}: {column.column}")
    low, high = column.range if column.range is not None else (np.nan, np.nan)
    bounds = ((low - column.offset) * factor, (high - column.offset) * factor)
    return (raw - column.offset) * factor, unit, bounds


def _advancing(time: Array, name: str, source: str) -> None:
    if len(time) < 2:
        raise LogError(f"{source}: expected at least two samples, found {len(time)}")
    steps = np.diff(time)
    bad = np.flatnonzero(steps <= 0)
    if len(bad):
        row, step = int(bad[0]) + 1, float(steps[bad[0]])
        what = "the same stamp twice" if step == 0 else f"a step back of {-step:.6g} s"
        raise LogError(
            f"{source}: column {name}: expected time that advances, found {what} "
            f"after row {row} ({len(bad)} in all)"
        )
