"""Verb `patagium inspect`: content of a log of another program, with findings."""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import asdict, astuple
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from patagium.cli.options import OUTPUT, FilesArgument, ResultOption, output_file
from patagium.cli.words import progress_bar, say_json, say_next, show_table
from patagium.errors import LogError, ParameterError, command

if TYPE_CHECKING:
    from collections.abc import Sequence

    from patagium.report import Table
    from patagium.sensing.logs.importing.findings import Finding
    from patagium.sensing.logs.importing.inspection import Inspection

EXAMPLES = (
    "patagium inspect rig.csv -o map.yaml",
    "patagium inspect recording.bag --topic /imu --json",
    "patagium inspect ros2_bag_folder",
)


def inspect(
    files: FilesArgument,
    topic: Annotated[
        list[str] | None, typer.Option(help="Topic whose numbers are shown; may be repeated.")
    ] = None,
    skip_rows: Annotated[
        int | None,
        typer.Option(min=0, help="Lines before the line of names of a CSV file; found by default."),
    ] = None,
    output: Annotated[
        Path | None, output_file("New file for a mapping to begin from (.yaml).", *OUTPUT)
    ] = None,
    as_json: ResultOption = False,
) -> None:
    """Show the topics, rates, gaps and ranges of a log, and suspicious facts.

    Topics and fields are named as a mapping for `patagium import` names them. What is not read
    is listed with the reason.
    """
    from patagium.sensing.logs.importing.inspection import inspect_log
    from patagium.whole_file import write_whole

    if output is not None and output.exists():
        raise ParameterError("--output", "a file that is not there yet", str(output))
    with progress_bar(f"Reading {files[0].name}") as progress:
        found = inspect_log(files, skip_rows=skip_rows, progress=progress)
    names = [one.name for one in found.topics]
    unknown = [name for name in topic or () if name not in names]
    if unknown:
        raise LogError(f"{found.path}: holds no topic {unknown[0]!r}, but {', '.join(names)}")
    if names == [""] and found.topics[0].problem:  # a table of which nothing can be shown
        raise LogError(f"{found.path}: {found.topics[0].problem}")
    tables = all(one.kind == "table" for one in found.topics)
    shown = topic or (names if tables or len(names) == 1 else ())
    if output is not None:  # before stdout, which may fail
        if not shown:
            raise ParameterError("--topic", f"topics of the mapping, such as {names[0]}", None)
        write_whole(output, _mapping(found, shown))
    if as_json:
        say_json(asdict(found))
        return
    for table in _tables(found, shown):
        show_table(table)
    show_findings(found.findings)
    for note in found.notes:
        typer.echo(f"Note: {note}")
    if not shown:
        typer.echo("Numbers of a topic, and a mapping to begin from: --topic NAME; all: --json")
    elif output is None:
        typer.echo("A map.yaml to begin from (-o map.yaml writes it):")
        typer.echo(_mapping(found, shown), nl=False)
    mapping = output or "map.yaml"
    bring = command("patagium import" + " {}" * len(files) + " --mapping {}", *files, mapping)
    rate = "write the rate of the rows in place of ??? and " * (found.topics[0].stamps == "rows")
    say_next(f"{rate}say in {mapping} what the fields mean (docs/logs.md), then {bring}")


def _mapping(found: Inspection, topics: Sequence[str]) -> str:
    """Mapping to begin from: forces and moments of the topics, or the last field, are outputs.

    Numbers without stamps, beside others that have them, are none of it.
    """
    from patagium.sensing.logs.mapping import si_of

    chosen = [one for one in found.topics if one.name in topics]
    chosen = [one for one in chosen if one.stamps != "rows"] or chosen[:1]
    rates = [one.rate for one in chosen if one.rate > 0]
    time = f"{{rate: {max(rates, default=100.0):.4g} Hz}}"
    if not chosen[0].name:
        time = f"{{column: {json.dumps(chosen[0].stamps)}}}"
    if chosen[0].stamps == "rows":
        time = '{restamp: "??? Hz"}  # rate of the rows: no column of the table is read as time'
        time += "; else {column: NAME, unit: s}"
    inputs, outputs = list[str](), list[str]()
    count = Counter(field.name for one in chosen for field in one.channels)
    for one in chosen:
        place = "column"
        if one.name:
            place = f"topic: {json.dumps(one.name)}, field"
        if one.kind == "table" and one.name:  # some columns of a table, by their stamps
            other = one.stamps != chosen[0].stamps
            place = f"stamp: {json.dumps(one.stamps)}, " * other + "column"
        for field in one.channels:
            if re.fullmatch(r"(\.\d+)?", field.name) or not field.low <= field.high:
                continue  # a column without a name or a number
            name = json.dumps(_UNIT.sub("", field.name) if one.kind == "table" else field.name)
            si = si_of(field.unit)[1]  # nothing of a unit that we do not know
            unit = (field.unit if si else "") or ("s" if field.name == one.stamps else "1")
            unit = json.dumps(unit, ensure_ascii=False)
            text = f"{{{place}: {name}, unit: {unit}}}"
            if count[field.name] > 1:
                own = f"{one.name.strip('/').replace('/', ' ')} {field.name}"
                text = f"{text[:-1]}, name: {json.dumps(own)}}}"
            if field.name == one.stamps:
                text = f"{{column: {name}, unit: {unit}}}"
                shared = f"{text[:-1]}, {time[1:]}" if "column" not in time else time
                time = shared if one.name else text
            elif si in ("N", "N m") or _FORCES.search(field.name):
                outputs.append(f"  - {text}")
            else:
                inputs.append(f"  - {text}")
    if not inputs:
        inputs, outputs = outputs, inputs
    if inputs and not outputs:
        outputs = [inputs.pop()]
    time += "".join(f"  # {one.text}" for one in found.findings if one.kind == "unit of time")
    roles = ["inputs:", *inputs, "outputs:", *outputs] if inputs else ["channels:", *outputs]
    return "\n".join([f"time: {time}", *roles, ""])


_UNIT = re.compile(r"\s*\[(?!\d+\])[^\]]*\]$")
"""Unit in the head of a column, which is no index."""
_FORCES = re.compile(r"(?i)(^|[._/])([fmt][xyz]|force|lift|drag|thrust|moment|torque)(?![a-z])")
"""Names of forces and moments."""


def show_findings(findings: Sequence[Finding], *, err: bool = False) -> None:
    """Print findings as a table."""
    from patagium.report import Table

    if not findings:
        typer.echo("Nothing suspicious.", err=err)
        return
    rows = [[one.level, one.where, one.kind, one.text] for one in findings]
    show_table(Table(["", "where", "what", "found"], rows, "Findings"), err=err)


def _tables(found: Inspection, shown: Sequence[str]) -> list[Table]:
    """Tables of the topics, of the fields of those to show, and of what is not read."""
    from patagium.report import Table

    columns = ["topic", "type", "rows", "stamps", "begin [s]", "duration [s]", "rate [Hz]",
               "gaps", "longest step [s]", "duplicate", "backward", "numbers"]  # fmt: skip
    rows: list[list[str | float | bool | None]] = [
        [one.name or "table", one.kind, one.rows, one.problem or one.stamps, one.begin,
         one.duration, one.rate, one.gaps, one.longest, one.duplicates, one.backwards,
         len(one.channels)] for one in found.topics
    ]  # fmt: skip
    tables = [Table(columns, rows, f"{found.path}: {found.format}")]
    columns = ["field", "type", "unit", "lowest", "highest", "mean", "rms", "missing"]
    for one in found.topics:
        if one.name in shown:
            rows = [[*astuple(field)] for field in one.channels]
            tables.append(Table(columns, rows, one.name or "table"))
    parts = [(one.name or "table", *part) for one in found.topics for part in one.unplaced.items()]
    lost = [Table(["topic", "field", "reason"], [[*part] for part in parts], "Not read")]
    return tables + lost * bool(parts)
