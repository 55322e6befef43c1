"""`patagium stress`: learners through faults, damage and long runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = (
    "patagium stress",
    "patagium stress --runs 100 --seed 3 --jobs 1 -o page.html --json",
)


def stress(
    runs: Annotated[int, typer.Option(help="Runs of the fault campaign.")] = 1000,
    seed: Annotated[int, typer.Option(help="Faults and learners are drawn from it.")] = 0,
    jobs: Annotated[int, typer.Option(help="Processes.")] = 2,
    log: Annotated[
        Path | None, typer.Option(help="Crazyflie log (log16.csv.gz) to calibrate on too.")
    ] = None,
    updates: Annotated[
        int, typer.Option(help="Updates in float32 and in float64; the glide takes a tenth.")
    ] = 10_000_000,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Page to write (.md or HTML).")
    ] = Path("stress.html"),
    as_json: Annotated[bool, typer.Option("--json", help="The figures as JSON on stdout.")] = False,
) -> None:
    """Fly learners through faults, damage to a wing and long runs, on one page.

    A run of the campaign is drawn from seed and number; any of them can be flown again.
    """
    from patagium.cli.words import existing, progress_bar, say_json, show_table
    from patagium_lab.stress import run as study
    from patagium_lab.stress.page import fault_table, write_stress

    found = None if log is None else existing(log)
    with progress_bar("Stressing") as progress:
        result = study.stress(
            runs,
            seed,
            workers=jobs,
            log=found,
            glide=max(1, updates // 10),
            updates=updates,
            progress=lambda part: progress(round(1000 * part), 1000),
        )
    write_stress(output, result)
    if as_json:
        say_json(result.rows())
    else:
        show_table(fault_table(result))
    typer.echo(f"Written to {output}", err=True)
