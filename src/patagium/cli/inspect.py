"""Verb `patagium inspect`: content of a log of another program, with findings."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Annotated

import typer

from patagium.cli.words import FilesArgument

if TYPE_CHECKING:
    from collections.abc import Sequence

    from patagium.sensing.logs.importing.findings import Finding
    from patagium.sensing.logs.importing.inspection import Inspection

EXAMPLES = (
    "patagium inspect flight.ulg",
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
    as_json: Annotated[bool, typer.Option("--json", help="Result as JSON on stdout.")] = False,
) -> None:
    """Show the topics, rates, gaps and ranges of a log, and suspicious facts.

    Topics and fields are named as a mapping for `patagium import` names them. What is not read
    is listed with the reason.
    """
    from patagium.cli.words import progress_bar, say_json, say_next
    from patagium.errors import LogError
    from patagium.sensing.logs.importing.inspection import inspect_log

    with progress_bar(f"Reading {files[0].name}") as progress:
        found = inspect_log(files, skip_rows=skip_rows, progress=progress)
    if as_json:
        say_json(found.plain())
        return
    names = [one.name for one in found.topics]
    unknown = [name for name in topic or () if name not in names]
    if unknown:
        raise LogError(f"{found.path}: holds no topic {unknown[0]!r}, but {', '.join(names)}")
    _show_topics(found)
    _show_channels(found, topic or (names if len(names) == 1 else ()))
    _show_unplaced(found)
    show_findings(found.findings)
    for note in found.notes:
        typer.echo(f"Note: {note}")
    if len(names) > 1 and not topic:
        typer.echo("Numbers of a topic: --topic NAME; of all: --json")
    brought = f"patagium import {' '.join(map(str, files))} --mapping map.yaml"
    for line in _begun(found):
        typer.echo(line)
    say_next(f"say in map.yaml what the fields mean, as above or in docs/logs.md, then {brought}")


def _begun(found: Inspection) -> list[str]:
    """Lines of a mapping to begin from: of the first topic with numbers, the last is the output."""
    first = next((one for one in found.topics if len(one.channels) > 1), None)
    if first is None:
        return []
    place = f'topic: "{first.name}", field' if first.name else "column"
    entries = {
        one.name: f"{{{place}: {json.dumps(_UNIT.sub('', one.name))}, unit: {one.unit or _NONE}}}"
        for one in first.channels
    }
    time = "{rate: 100 Hz}" if first.name else entries.pop(first.stamps, "{rate: 100 Hz}")
    *inputs, output = entries.values()
    shown = [f"  - {one}" for one in inputs[:_SHOWN]]
    begin = ["A map.yaml to begin from:", f"time: {time}", "inputs:", *shown]
    return [*begin, "outputs:", f"  - {output}"]


_SHOWN = 4
"""Inputs of a mapping to begin from."""
_UNIT = re.compile(r"\s*\[[^\]]*\]$")
"""Unit in the head of a column."""
_NONE = '"1"'
"""Unit of a plain number, in a mapping."""


def show_findings(findings: Sequence[Finding], *, err: bool = False) -> None:
    """Print findings as a table.

    Args:
        findings: The findings.
        err: Whether to print to stderr.
    """
    from patagium.cli.words import show_table
    from patagium.report import Table

    if not findings:
        typer.echo("Nothing suspicious.", err=err)
        return
    rows = [[one.level, one.where, one.kind, one.text] for one in findings]
    show_table(Table(["", "where", "what", "found"], rows, "Findings"), err=err)


def _show_topics(found: Inspection) -> None:
    from patagium.cli.words import show_table
    from patagium.report import Table

    columns = ["topic", "type", "rows", "stamps", "begin [s]", "duration [s]", "rate [Hz]",
               "gaps", "longest step [s]", "duplicate", "backward", "numbers"]  # fmt: skip
    rows: list[list[str | float | bool | None]] = [
        [
            one.name or "table",
            one.kind,
            one.rows,
            one.problem or one.stamps,
            one.begin,
            one.duration,
            one.rate,
            one.gaps,
            one.longest,
            one.duplicates,
            one.backwards,
            len(one.channels),
        ]
        for one in found.topics
    ]
    show_table(Table(columns, rows, f"{found.path}: {found.format}"))


def _show_channels(found: Inspection, names: Sequence[str]) -> None:
    from patagium.cli.words import show_table
    from patagium.report import Table

    columns = ["field", "type", "unit", "lowest", "highest", "mean", "rms", "missing"]
    for one in found.topics:
        if one.name not in names:
            continue
        rows: list[list[str | float | bool | None]] = [
            [c.name, c.dtype, c.unit, c.low, c.high, c.mean, c.rms, c.missing] for c in one.channels
        ]
        show_table(Table(columns, rows, one.name or "table"))


def _show_unplaced(found: Inspection) -> None:
    from patagium.cli.words import show_table
    from patagium.report import Table

    rows: list[list[str | float | bool | None]] = [
        [one.name or "table", path, reason]
        for one in found.topics
        for path, reason in one.unplaced.items()
    ]
    if rows:
        show_table(Table(["topic", "field", "reason"], rows, "Not read"))
