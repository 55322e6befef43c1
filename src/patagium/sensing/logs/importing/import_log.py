"""Import of a log of another program: findings first, then a file on one time base in our units.

A netCDF4 file has one variable for each number, such as `angular rate.x`, with its unit, its
expected range and its role. Its attributes hold the mapping, the findings and the resampling. The
file appears whole or not at all. An import that is interrupted leaves nothing behind and
starts from the beginning when it is called again.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from patagium.arguments import Progress, checked
from patagium.arrays import Array, brief, count_noise
from patagium.errors import LogError, ParameterError
from patagium.netcdf_file import NetcdfDraft
from patagium.robot import Robot, load_robot, preset_names
from patagium.robot.files import robot_attributes
from patagium.sensing.logs.files.opening import open_log, parts_of
from patagium.sensing.logs.importing.consistency import consistency
from patagium.sensing.logs.importing.findings import SECOND, Finding, time_doubt
from patagium.sensing.logs.importing.log_findings import log_findings, zero_forces
from patagium.sensing.logs.importing.plan import Plan, plan_import, variable_name
from patagium.sensing.logs.importing.resample import (
    CHUNK,
    Spool,
    TimeBase,
    after_gaps,
    resampled,
    stamps_in,
    time_base,
)
from patagium.sensing.logs.mapping import AirWords, TableMapping, load_mapping
from patagium.sensing.logs.record import AIR_LINE, FORMAT, LogRecord, is_log
from patagium.sensing.logs.table import LogTable
from patagium.version import __version__
from patagium.whole_file import Draft

_CHUNK = 1 << 15
"""Samples of a chunk of a netCDF4 variable."""
_LOOK = 1 << 17
"""First samples of a stream whose counts are looked for."""


class NetcdfWriter:
    """Writer of a netCDF4 log.

    Args:
        file: The open file.
        rows: Largest number of samples to come.
        attributes: Attributes of the file.
        spool: Streams of the log.
    """

    def __init__(self, file: Any, rows: int, attributes: dict[str, Any], spool: Spool) -> None:
        self._chunk = min(_CHUNK, max(1, rows))
        self._file = file
        self._file.setncatts({**attributes, "format": FORMAT})
        self._file.createDimension("time", None)
        self._time = self._variable("time", "s", {})
        self._columns = []
        for item in spool.plan.items:
            words, stamps = item.column, spool.surveys[item.stream].stamps
            first = spool.values_of(item, 0, min(stamps.kept, _LOOK))
            coarse = [0.0] * 4 if item.is_attitude else map(count_noise, item.converted(first).T)
            for label, bounds, rounding in zip(words.labels, item.bounds(), coarse, strict=False):
                facts: dict[str, Any] = {"role": item.role, "quantity": words.label}
                facts |= {"step_in_log": stamps.median, "rounding_in_log": rounding}
                if np.isfinite(bounds).all():
                    facts["expected_range"] = bounds
                axes = {"frame_in_log": words.frame, "body_in_log": words.body}
                facts |= {name: one for name, one in axes.items() if one is not None}
                self._columns.append(self._variable(label, item.unit, facts))
        for name, unit in spool.plan.zero.items():
            self._columns.append(self._variable(name, unit, {"role": "channel", "quantity": name}))
        self._rows = 0

    def write(self, time: Array, values: Array) -> None:
        """Append samples: time (k,) [s] and values of all labels (k, n) in their units."""
        rows = slice(self._rows, self._rows + len(time))
        self._time[rows] = time
        for column, variable in zip(values.T, self._columns, strict=True):
            variable[rows] = column
        self._rows = rows.stop

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
        plan: Quantities of the log; a first line states air that is not at rest at sea level.

    Raises:
        OSError: If the file cannot be written.
    """

    def __init__(self, path: Path, plan: Plan) -> None:
        self._path, air = path, plan.mapping.air
        stated = f"{AIR_LINE.decode()}{air.model_dump_json()}\n"
        path.write_bytes(b"" if air == AirWords() else stated.encode())
        labels = [label for item in plan.items for label in item.column.labels]
        self._append(pd.DataFrame(columns=["time", *labels, *plan.zero]), header=True)

    def write(self, time: Array, values: Array) -> None:
        """Append samples: time (k,) [s] and values of all labels (k, n) in their units."""
        self._append(pd.DataFrame(np.column_stack([time, values])), header=False)

    def _append(self, rows: pd.DataFrame, *, header: bool) -> None:
        rows.to_csv(self._path, mode="a", header=header, index=False, lineterminator="\n")


Writer: TypeAlias = NetcdfWriter | CsvWriter


Tell = Callable[[Sequence[Finding]], None]

_MOST_LOST = 0.5
"""Share of the rows of a stream that may have bad stamps."""


@dataclass(frozen=True)
class Imported:
    """Result of an import.

    Attributes:
        path: The file that was written.
        samples: Number of its samples.
        duration: Time from the first to the last sample [s].
        time_base: Its time base in words.
        left_out: Samples of the time base that lack an input, a channel or all outputs.
        findings: Suspicious facts about the log.
        facts: Residuals of specific forces against velocities; see `consistency`.
        notes: Assumptions made to read the log.
    """

    path: Path
    samples: int
    duration: float
    time_base: str
    left_out: int
    findings: tuple[Finding, ...]
    facts: tuple[dict[str, Any], ...] = ()
    notes: tuple[str, ...] = ()
    __repr__ = brief


@checked
def import_log(
    paths: str | Path | Sequence[str | Path],
    mapping: TableMapping | str | Path,
    out: str | Path,
    *,
    progress: Progress | None = None,
    tell: Tell | None = None,
) -> Imported:
    """Import of a log of another program, in SI units and our axes, on one time base.

    Args:
        paths: A CSV, Parquet, MAT, HDF5, ULog, ArduPilot or MCAP file, a ROS bag, or parts of one.
        mapping: Meaning of its columns or fields, or the YAML file that states it.
        out: The log to write: `.nc`, or `.csv` for a stream.
        progress: Called now and then with the rows done and the rows in all.
        tell: Called with the findings before anything is resampled.

    Raises:
        LogError: If the log cannot be read or lacks what the mapping names.
        OutputError: If the result cannot be written.
    """
    words = mapping if isinstance(mapping, TableMapping) else load_mapping(mapping)
    source = "mapping" if isinstance(mapping, TableMapping) else str(mapping)
    target = Path(out)
    if target.suffix.lower() not in (".nc", ".csv"):
        raise LogError(f"{target}: expected a name that ends in .nc or .csv")
    parts = parts_of(paths)
    with closing(open_log(parts, skip_rows=words.skip_rows)) as log:
        read = (path for part in parts for path in (part, *part.glob("*")))
        if target.exists() and any(target.samefile(path) for path in read):
            raise LogError(f"{target}: expected another name than that of the log itself")
        plan = plan_import(log, words, source, _robot(words, source))
        plan = replace(plan, zero=zero_forces(plan))
        place = Draft(target)  # refused before anything is read
        place.discard()  # and nothing is left if the program is killed while it reads
        kind = NetcdfDraft if target.suffix.lower() == ".nc" else Draft
        with (
            place.writing(),
            Spool(plan, place.path.parent, _half(progress, 0)) as spool,
            kind(target).whole() as draft,
        ):
            return _written(spool, draft, _half(progress, 1), tell)


def _written(spool: Spool, draft: Draft, progress: Progress | None, tell: Tell | None) -> Imported:
    """Import of a log whose rows are read."""
    _refuse_unusable(spool)
    plan, base = spool.plan, time_base(spool)
    log, mapping, robot = plan.log, plan.mapping, plan.robot
    relations, facts = consistency(spool, base)
    findings = (*log_findings(spool, base), *relations)
    if tell is not None:
        tell(findings)
    attributes = {
        "patagium_version": __version__,
        "source": log.path.name,
        "source_format": log.format,
        "mapping": mapping.model_copy(
            update={"robot": mapping.robot and Path(mapping.robot).name}  # no folders
        ).model_dump_json(by_alias=True, exclude_defaults=True),
        "findings": json.dumps([asdict(one) for one in findings], ensure_ascii=False),
        "consistency": json.dumps(facts),
        "time_base": base.describe(plan),
        "time_origin_ns": str(base.origin),
        "resampling": "numbers and vectors linear, attitudes by slerp, angles the short way",
        "axes": "x forward, y left, z up; attitudes w, x, y, z, body to world",
        "gap": mapping.gap,
        "air": mapping.air.model_dump_json(),
    }
    if robot is not None:
        attributes |= robot_attributes(robot)
    writer: Writer = (
        NetcdfWriter(draft.file, base.count, attributes, spool)
        if isinstance(draft, NetcdfDraft)
        else CsvWriter(draft.path, plan)
    )
    samples, duration = _write(writer, spool, base, progress)
    if samples < 2:
        raise LogError(
            f"{plan.source}: expected samples with all inputs and an output, found {samples} "
            f"of {base.count}; gaps of different streams, or missing numbers, leave no more"
        )
    return Imported(
        path=draft.target,
        samples=samples,
        duration=duration,
        time_base=base.describe(plan),
        left_out=base.count - samples,
        findings=findings,
        facts=tuple(facts),
        notes=tuple(log.notes),
    )


def _refuse_unusable(spool: Spool) -> None:
    """Refuse streams without enough good stamps and quantities without numbers."""
    plan = spool.plan
    log, mapping = plan.log, plan.mapping
    for name, wanted, survey in zip(plan.names, plan.wanted, spool.surveys, strict=True):
        stamps, doubt = survey.stamps, time_doubt(survey.stamps)
        if stamps.kept < 2:
            beyond = f"; none is a time below 146 years: {doubt} Then state its unit "
            beyond += f"(`{{column: {wanted.base.column}, unit: ...}}`)"
            expected = "at least two samples with stamps that advance"
            found = f"{stamps.kept} in {stamps.rows} row(s){beyond * bool(stamps.far and doubt)}"
            raise LogError(f"{log.path}: {name}", expected, found)
        chosen = mapping.time.duplicates is not None
        lost = stamps.rows - stamps.kept - (stamps.duplicates if chosen else 0)
        if lost > _MOST_LOST * stamps.rows:
            back = stamps.rows - stamps.kept - stamps.duplicates > stamps.duplicates
            remedy = (
                f"say under time `restamp: {1 / stamps.median:.4g} Hz` if the rows were sampled "
                "evenly and their clock wraps or was set back, or cut the log"
                if back
                else "say under time `duplicates: keep-first` (or keep-last) if they repeat a "
                f"sample, or `restamp: {stamps.rate:.4g} Hz` if they were sampled evenly"
            )
            raise LogError(
                f"{log.path}: {name}: expected time that advances, but {lost} of {stamps.rows} "
                f"rows do not come after those before them ({stamps.duplicates} repeat a stamp, "
                f"steps back are up to {stamps.furthest_back / SECOND:.4g} s); "
                f"{doubt}{' If not, ' * bool(doubt)}{remedy}"
            )
    for item in plan.items:
        asked = item.needed or item.role == "output"
        if asked and not spool.surveys[item.stream].values.count[item.places].all():
            found = "none; leave it out of the mapping if it was not measured"
            raise LogError(f"{log.path}: {item.label}", "finite numbers", found)


def _write(
    writer: Writer, spool: Spool, base: TimeBase, progress: Progress | None
) -> tuple[int, float]:
    """Number of samples written, with what is needed and an output, and their duration [s]."""
    samples, ends, end = 0, list[float](), 0
    needed = np.array([item.needed for item in spool.plan.items])
    learned = ~needed & [item.role == "output" for item in spool.plan.items]
    while (begin := after_gaps(spool, base, end)) < base.count:
        end = min(begin + CHUNK, base.count)
        stamps = stamps_in(spool, base, begin, end)
        parts = [resampled(spool, item, stamps) for item in spool.plan.items]
        known = np.array([ok for _, ok in parts])
        valid = known[needed].all(axis=0) & (known[learned].any(axis=0) | ~learned.any())
        zeros = np.zeros((len(stamps), len(spool.plan.zero)))
        shown = (np.where(ok[:, None], part, np.nan) for part, ok in parts)
        values = np.column_stack([*shown, zeros])[valid]
        time = (stamps[valid] - base.origin) / SECOND
        if len(time):
            ends += [float(time[0]), float(time[-1])]
            samples += len(time)
            writer.write(time, values)
        if progress is not None:
            progress(end, base.count)
    return samples, ends[-1] - ends[0] if ends else 0.0


def _robot(mapping: TableMapping, source: str) -> Robot | None:
    """Robot that a mapping names."""
    if mapping.robot is None:
        return None
    if mapping.robot not in preset_names() and not Path(mapping.robot).exists():
        raise LogError(
            f"{source}: robot: expected a preset ({', '.join(preset_names())}) or a robot file, by "
            f"its path from the mapping file or the working folder, found {mapping.robot!r}"
        )
    return load_robot(mapping.robot)


def _half(progress: Progress | None, which: int) -> Progress | None:
    if progress is None:
        return None
    return lambda done, total: progress(done + which * total, 2 * total)


@checked
def read_table(
    path: str | Path, mapping: TableMapping | str | Path | None = None, tell: Tell | None = None
) -> LogTable:
    """Table of inputs and outputs in a log, by `import_log` in a temporary folder.

    Args:
        path: A CSV (also `.csv.gz`) or Parquet file, or another log.
        mapping: Meaning of its columns or fields, or its YAML file; None of an imported log.
        tell: Called with the findings of the import.

    Raises:
        LogError: If the log cannot be read or lacks what the mapping names.
        ParameterError: If a mapping is missing.
    """
    with opened_log(path, mapping, tell) as record:
        return record.table()


def opened_log(
    path: str | Path, mapping: TableMapping | str | Path | None = None, tell: Tell | None = None
) -> LogRecord:
    """Open imported log; another one is imported in a temporary folder. See `read_table`.

    The imported file is removed at once; open, it stays readable until it is closed.

    Raises:
        ParameterError: If a mapping is missing.
    """
    if mapping is None and Path(path).exists() and not is_log(path):
        raise ParameterError("mapping", "one, or its file, for such a log", None)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "log.nc"
        file = path if mapping is None else import_log(path, mapping, out, tell=tell).path
        record = LogRecord(file)
    record.path = Path(path)  # what its errors name
    return record
