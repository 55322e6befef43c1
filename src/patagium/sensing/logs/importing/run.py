"""`import_log`: a log of another program, looked at, then written on one time base in our units.

What is suspicious is told before anything is computed from it. The result appears whole or not
at all; who was interrupted, or killed, goes on from the rows already read.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import LogFile
from patagium.sensing.logs.files.opening import open_log
from patagium.sensing.logs.importing.consistency import consistency
from patagium.sensing.logs.importing.findings import (
    Finding,
    Sizes,
    stamp_findings,
    unit_findings,
    value_findings,
)
from patagium.sensing.logs.importing.plan import Item, Plan, plan_import
from patagium.sensing.logs.importing.resample import (
    CHUNK,
    TimeBase,
    resampled,
    stamps_in,
    time_base,
)
from patagium.sensing.logs.importing.spool import Progress, Spool, mark_of
from patagium.sensing.logs.importing.survey import SECOND
from patagium.sensing.logs.importing.writer import CsvWriter, NetcdfWriter, Writer
from patagium.sensing.logs.mapping import TableMapping, load_mapping
from patagium.version import __version__
from patagium.whole_file import force_folder

Tell = Callable[[Sequence[Finding]], None]

_MOST_LOST = 0.5
"""A stream that loses more of its rows than this to bad stamps is refused."""


@dataclass(frozen=True)
class Imported:
    """What came of an import.

    Attributes:
        path: The log that was written.
        samples: On its time base.
        duration: From first to last of them [s].
        time_base: In words.
        left_out: Samples of the time base where a quantity had none.
        findings: What is suspicious.
        facts: How well specific forces explain velocities; see `consistency`.
        resumed: Rows that an interrupted import had read before.
        notes: What had to be assumed to read the file.
    """

    path: Path
    samples: int
    duration: float
    time_base: str
    left_out: int
    findings: tuple[Finding, ...]
    facts: tuple[dict[str, Any], ...] = ()
    resumed: int = 0
    notes: tuple[str, ...] = field(default=())


def import_log(
    paths: str | Path | Sequence[str | Path],
    mapping: TableMapping | str | Path,
    out: str | Path,
    *,
    progress: Progress | None = None,
    tell: Tell | None = None,
) -> Imported:
    """A log of another program as one of ours, in SI and our axes, on one time base.

    Args:
        paths: A CSV, Parquet, MAT, ULog or MCAP file, a ROS bag, or the parts of a recording.
        mapping: What its columns or fields mean, or the YAML file that says it.
        out: The log to write: `.nc`, or `.csv` for a stream.
        progress: Called now and then with rows done and rows in all, reading and writing.
        tell: Called with the findings before anything is resampled.

    Raises:
        LogError: If the log cannot be read, or does not hold what the mapping says.
    """
    words = mapping if isinstance(mapping, TableMapping) else load_mapping(mapping)
    source = "mapping" if isinstance(mapping, TableMapping) else str(mapping)
    target = Path(out)
    if target.suffix.lower() not in (".nc", ".csv"):
        raise LogError(f"{target}: expected a name that ends in .nc or .csv")
    log = open_log(paths)
    try:
        _check_target(target, log)
        plan = plan_import(log, words, source)
        target.parent.mkdir(parents=True, exist_ok=True)
        mark = mark_of(_files(log.path), f"{__version__} {words.model_dump_json()}")
        spool = Spool(target.with_name(f".{target.name}.import"), plan, mark)
        resumed = spool.resumed
        try:
            spool.fill(log, _half(progress, 0))
            run = _Run(log, words, source, spool, target, resumed)
            imported = run.go(_half(progress, 1), tell)
        except Exception:
            spool.remove()
            raise
        spool.remove()
        return imported
    finally:
        log.close()


class _Run:
    """An import whose rows are read."""

    def __init__(
        self,
        log: LogFile,
        mapping: TableMapping,
        source: str,
        spool: Spool,
        target: Path,
        resumed: int,
    ) -> None:
        self.log, self.mapping, self.source = log, mapping, source
        self.spool, self.target, self.resumed = spool, target, resumed
        self.plan: Plan = spool.plan

    def go(self, progress: Progress | None, tell: Tell | None) -> Imported:
        self._refuse_what_is_unusable()
        base = time_base(self.spool, self.mapping, self.source)
        found, facts = consistency(self.spool, base, self.mapping.gap)
        findings = (*self._findings(base), *found)
        if tell is not None:
            tell(findings)
        draft = self.spool.folder / "draft.nc"
        samples, span = self._write(draft, base, findings, facts, progress)
        os.replace(draft, self.target)
        force_folder(self.target.parent)
        return Imported(
            self.target,
            samples,
            span,
            base.describe(self.plan),
            base.count - samples,
            tuple(findings),
            tuple(facts),
            self.resumed,
            tuple(self.log.notes),
        )

    def _refuse_what_is_unusable(self) -> None:
        for k, survey in enumerate(self.spool.stamps):
            name = self.plan.names[k]
            if survey.kept < 2:
                raise LogError(
                    f"{self.log.path}: {name}: expected at least two samples with stamps that "
                    f"advance, found {survey.kept} in {survey.rows} row(s)"
                )
            lost = survey.rows - survey.kept
            if lost > _MOST_LOST * survey.rows:
                raise LogError(
                    f"{self.log.path}: {name}: expected time that advances, but {lost} of "
                    f"{survey.rows} rows do not come after those before them (steps back of up to "
                    f"{survey.furthest_back / SECOND:.4g} s); cut the log, or check its stamps"
                )
        for item in self.plan.items:
            counted = self.spool.values[item.stream]
            if not counted.count[list(item.places)].all():
                raise LogError(
                    f"{self.log.path}: {item.column.label}: expected finite numbers, found none"
                )

    def _findings(self, base: TimeBase) -> list[Finding]:
        found = [Finding("note", str(self.log.path), "file", note) for note in self.log.notes]
        for k, survey in enumerate(self.spool.stamps):
            wanted = self.plan.wanted[k]
            by_column = wanted.base.kind == "column"
            found += stamp_findings(self.plan.names[k], survey, self.mapping.gap, column=by_column)
            if base.step > 2.01 * survey.median:
                text = (
                    f"every {survey.median:.4g} s, brought to every {base.step:.4g} s without a "
                    "filter: what is faster folds"
                )
                found.append(Finding("warning", self.plan.names[k], "rate", text))
        for item in self.plan.items:
            found += self._item_findings(item)
        return found

    def _item_findings(self, item: Item) -> list[Finding]:
        values, places = self.spool.values[item.stream], list(item.places)
        name = item.column.label
        found = value_findings(
            name, values.count[places], values.missing[places], values.low[places],
            values.high[places],
        )  # fmt: skip
        if item.is_attitude and item.order != "rpy":
            norm = float(np.sqrt((values.rms[places] ** 2).sum()))
            if abs(norm - 1.0) > 0.01:
                text = f"expected quaternions of norm 1, found {norm:.4g} (rms); scaled to 1"
                found.append(Finding("warning", name, "attitude", text))
        if not item.is_attitude or item.order == "rpy":
            factor, offset = item.si_factor, item.column.offset
            ends = np.array([values.low[places], values.high[places]]) - offset
            sizes = Sizes(
                item.column.unit,
                item.si,
                factor,
                (values.mean[places] - offset) * factor,
                values.rms[places] * abs(factor),
                float(np.abs(ends).max()) * abs(factor),
            )
            found += unit_findings(name, sizes)
        return found + self._stated_unit(item)

    def _stated_unit(self, item: Item) -> list[Finding]:
        from patagium.sensing.logs.mapping import conversion

        topic = self.log.topics[self.plan.wanted[item.stream].topic]
        field_name = self.plan.wanted[item.stream].fields[item.places[0]]
        stated = topic.channels[field_name].unit
        if not stated or (item.is_attitude and item.order != "rpy"):
            return []
        try:
            factor, si = conversion(stated, None, field_name)
        except LogError:
            return []
        if si == item.si and abs(factor / item.si_factor - 1.0) < 1e-9:
            return []
        text = f"the file or its definitions say [{stated}], the mapping [{item.column.unit}]"
        return [Finding("warning", item.column.label, "unit", text)]

    def _write(
        self,
        draft: Path,
        base: TimeBase,
        findings: Sequence[Finding],
        facts: list[dict[str, Any]],
        progress: Progress | None,
    ) -> tuple[int, float]:
        attributes = self._attributes(base, findings, facts)
        writer: Writer = (
            NetcdfWriter(draft, self.plan, base.count, attributes)
            if self.target.suffix.lower() == ".nc"
            else CsvWriter(draft, self.plan)
        )
        samples, first, last = 0, 0.0, 0.0
        try:
            for begin in range(0, base.count, CHUNK):
                end = min(begin + CHUNK, base.count)
                stamps = stamps_in(self.spool, base, begin, end)
                parts = [
                    resampled(self.spool, item, stamps, self.mapping.gap)
                    for item in self.plan.items
                ]
                valid = np.logical_and.reduce([ok for _, ok in parts])
                values = np.column_stack([part for part, _ in parts])[valid]
                time = (stamps[valid] - base.origin) / SECOND
                if len(time):
                    first = float(time[0]) if not samples else first
                    last = float(time[-1])
                    samples += len(time)
                    writer.write(time, values)
                if progress is not None:
                    progress(end, base.count)
        finally:
            writer.close()
        if samples < 2:
            raise LogError(
                f"{self.source}: expected samples where all quantities are known, found {samples} "
                f"of {base.count}; gaps of different streams, or missing numbers, leave no more"
            )
        return samples, last - first

    def _attributes(
        self, base: TimeBase, findings: Sequence[Finding], facts: list[dict[str, Any]]
    ) -> dict[str, Any]:
        return {
            "patagium_version": __version__,
            "source": self.log.path.name,
            "source_format": self.log.format,
            "mapping": self.mapping.model_dump_json(by_alias=True, exclude_defaults=True),
            "findings": json.dumps([one.plain() for one in findings], ensure_ascii=False),
            "consistency": json.dumps(facts),
            "time_base": base.describe(self.plan),
            "time_origin_ns": str(base.origin),
            "resampling": "numbers and vectors linear, attitudes by slerp, angles the short way",
            "axes": "x forward, y left, z up; attitudes w, x, y, z, body to world",
            "gap": self.mapping.gap,
            **_robot_attributes(self.mapping),
        }


def _robot_attributes(mapping: TableMapping) -> dict[str, str]:
    if mapping.robot is None:
        return {}
    from patagium.robot import load_robot

    robot = load_robot(mapping.robot)
    air = mapping.air.model_dump_json()
    return {"robot": robot.source, "robot_name": robot.name, "air": air}


def _check_target(target: Path, log: LogFile) -> None:
    for path in _files(log.path):
        if target.exists() and target.samefile(path):
            raise LogError(f"{target}: expected another name than that of the log itself")


def _files(path: Path) -> Iterator[Path]:
    if path.is_dir():
        yield from sorted(inner for inner in path.iterdir() if inner.is_file())
    else:
        yield path


def _half(progress: Progress | None, which: int) -> Progress | None:
    if progress is None:
        return None
    return lambda done, total: progress(done + which * total, 2 * total)
