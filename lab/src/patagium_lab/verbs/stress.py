"""`patagium stress`: former name of the areas of learners of `patagium attack`."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = ("patagium attack --only faults --only damage",)


def stress(
    runs: Annotated[int, typer.Option(help="Number of runs of the fault campaign.")] = 1000,
    seed: Annotated[int, typer.Option(help="Seed of the faults and learners.")] = 0,
    jobs: Annotated[int, typer.Option(help="Number of processes.")] = 2,
    log: Annotated[
        Path | None, typer.Option(help="Crazyflie log (log16.csv.gz) to calibrate on too.")
    ] = None,
    updates: Annotated[
        int, typer.Option(help="Updates in float32 and in float64; the glide has a tenth.")
    ] = 10_000_000,
    captures: Annotated[int, typer.Option(help="Number of made-up logs of motion capture.")] = 200,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Page to write (.md or HTML).")
    ] = Path("stress.html"),
    as_json: Annotated[bool, typer.Option("--json", help="The figures as JSON on stdout.")] = False,
) -> None:
    """Former name of `patagium attack` without its hostile cases."""
    from patagium.cli.words import existing, say_json, show_table, stage_bar
    from patagium_lab.attack import run as study
    from patagium_lab.attack.page import fault_table, page
    from patagium_lab.attack.plan import LEARNERS, AttackPlan
    from patagium_lab.study import Stages

    warnings.warn(
        "patagium stress is now patagium attack; its areas are named by --only",
        DeprecationWarning,
        stacklevel=2,
    )
    found = None if log is None else existing(log)
    areas = tuple(area for area in LEARNERS if area != "poison")
    plan = AttackPlan(1, runs, seed, areas, found, max(1, updates // 10), updates, jobs, captures)
    with stage_bar("Stressing") as progress:
        results = study.run(plan, {}, Stages(progress))
    page(results).write(output)
    if as_json:
        figures = results.metrics()
        say_json({**figures.pop("areas"), **figures})
    else:
        show_table(fault_table(results))
    typer.echo(f"Written to {output}", err=True)
