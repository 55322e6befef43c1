"""`patagium bench`: times of the compiled functions against their rivals."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = (
    "patagium bench",
    "patagium bench --json bench.json",
    "patagium bench --quick",
    "patagium bench --only update --only simulation",
)


def bench(
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the list of figures there too.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Leave out rivals that take minutes to compile.")
    ] = False,
    only: Annotated[list[str] | None, typer.Option(help="One group of figures. Repeat it.")] = None,
) -> None:
    """Time dynamics, air, networks and updates, beside other programs doing the same.

    Random states, medians, one core. A rival that is missing is named, with the reason.
    """
    from patagium.cli.words import json_text, show_table, stage_bar
    from patagium.report import Table
    from patagium.report.page import write_whole
    from patagium.studies.benchmark import QUICK, run_benchmark

    chosen = only or (QUICK if quick else None)
    with stage_bar("Timing") as progress:
        figures = run_benchmark(chosen, progress)
    heads = ("name", "value", "unit", "against", "against_value", "ratio", "note")
    rows = [[figure[head] for head in heads] for figure in figures]
    show_table(Table([head.replace("_", " ") for head in heads], rows))
    if json_file is not None:
        write_whole(json_file, json_text(figures) + "\n")
        typer.echo(f"Written to {json_file}", err=True)
