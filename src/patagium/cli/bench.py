"""`patagium bench`: times of the compiled functions against their rivals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = (
    "patagium bench",
    "patagium bench --json bench.json",
)


def bench(
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the list of results there too.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer repetitions, and no rival that compiles long.")
    ] = False,
) -> None:
    """Time dynamics, air, networks and updates, beside other programs doing the same.

    Random states, medians, one core. Rivals that are not installed are left out and named.
    """
    from patagium.cli.words import show_table, stage_bar
    from patagium.report import Table
    from patagium.report.page import write_whole
    from patagium.studies.bench import bench as run

    with stage_bar("Timing") as progress:
        results = run(progress=progress, quick=quick)
    heads = ("name", "value", "unit", "against", "ratio")
    show_table(Table(heads, [[result[head] for head in heads] for result in results]))
    if json_file is not None:
        write_whole(json_file, json.dumps(results, indent=2) + "\n")
        typer.echo(f"Written to {json_file}", err=True)
