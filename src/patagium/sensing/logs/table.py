"""Tables of named columns from a log: checked and scaled, with nothing repaired.

A log that would need repair is refused with a sentence: missing numbers, time that does not
advance, absent columns, units that do not fit. Gaps in time are counted and passed on, never
bridged. Neglected: drift of clocks, delays between columns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from patagium.arrays import Array, brief, selected
from patagium.errors import LogError
from patagium.sensing.logs.files.table_files import HEADER
from patagium.sensing.logs.mapping import TableMapping, ValueColumn, conversion


@dataclass(frozen=True)
class LogTable:
    """Samples of a log in the units that a model sees.

    Attributes:
        time: Time from the first sample, (N,) [s].
        x: Inputs, (N, n_x) [`input_units`].
        y: Outputs, (N, n_y) [`output_units`].
        input_names: Names of the inputs.
        output_names: Names of the outputs.
        input_units: Units of the inputs.
        output_units: Units of the outputs.
        input_range: Lowest and highest expected input, (n_x, 2) [`input_units`]; NaN if not stated.
        output_range: Lowest and highest expected output, (n_y, 2) [`output_units`]; NaN if not
            stated.
        gaps: Index of the first sample after each gap, (n_gaps,) [1].
        gap: Length from which a time step is a gap, in median steps.
        source: File from which the samples came.
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
    __repr__ = brief

    def where(self, kept: slice | ArrayLike) -> LogTable:
        """LogTable of some of the samples with their times; left-out samples become gaps.

        Args:
            kept: Slice, increasing indices, or a bool for each sample.

        Raises:
            ParameterError: If it is something else.
        """
        chosen = selected(kept, len(self.time))
        time = self.time[chosen]
        step = float(np.median(np.diff(self.time)))
        gaps = np.flatnonzero(np.diff(time) > self.gap * step) + 1
        return replace(self, time=time, x=self.x[chosen], y=self.y[chosen], gaps=gaps)

    def describe_gaps(self) -> str:
        """Description of the gaps in one sentence."""
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
    """Index of the first sample after each gap, (n_gaps,).

    Args:
        time: Increasing times, (N,) [s].
        factor: Length from which a step is a gap, in median steps.
    """
    steps = np.diff(np.asarray(time, float))
    if not len(steps):
        return np.empty(0, np.int64)
    return np.flatnonzero(steps > factor * np.median(steps)) + 1


def table_from_frame(frame: pd.DataFrame, mapping: TableMapping, source: str = "table") -> LogTable:
    """Checked table of columns in memory.

    Args:
        frame: Named columns.
        mapping: Meaning of the columns.
        source: Name of the source in messages.

    Raises:
        LogError: If a column is missing or not numeric, a number is missing or infinite, time
            does not advance, or a unit does not fit.
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
    return LogTable(
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


def _headers(frame: pd.DataFrame, source: str) -> dict[str, tuple[str, str | None]]:
    found: dict[str, tuple[str, str | None]] = {}
    for header in map(str, frame.columns):
        match = HEADER.match(header)
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
    zero = float(np.asarray(column.offset))  # one number: a plain column is no vector
    return (raw - zero) * factor, unit, ((low - zero) * factor, (high - zero) * factor)


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
            f"after row {row} ({len(bad)} in all); say under time `duplicates: keep-first` or "
            "`restamp: RATE`"
        )
