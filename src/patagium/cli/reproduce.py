"""`patagium reproduce`: the paper's experiment, corrected and as published."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = (
    "patagium reproduce --out out/demo",
    "patagium reproduce --out out/quick --quick",
)


def reproduce(
    out: Annotated[Path, typer.Option(help="Folder of the report, its numbers and flights.")],
    quick: Annotated[
        bool, typer.Option("--quick", help="Short flights: the same pages, rougher numbers.")
    ] = False,
) -> None:
    """Run the paper's whole experiment and write one HTML report.

    Writes report.html, metrics.json, the flights (*.nc) and figures/.
    """
    from patagium.cli.words import stage_bar
    from patagium.studies.reproduction import reproduce as run

    with stage_bar("Reproducing the paper") as progress:
        report = run(out, progress=progress, quick=quick)
    typer.echo(f"The report is in {report}")
