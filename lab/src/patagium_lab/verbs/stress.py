"""`patagium study stress`: former name of the areas of learners of `patagium study attack`."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated

import typer

from patagium_lab.verbs.attack import Captures, Jobs, Log, Runs, Seed, Updates
from patagium_lab.verbs.options import OutputOption

EXAMPLES = ("patagium study attack --only faults --only damage",)
HIDDEN = True


def stress(
    runs: Runs = 1000,
    seed: Seed = 0,
    jobs: Jobs = 2,
    log: Log = None,
    updates: Updates = 10_000_000,
    captures: Captures = 200,
    output: OutputOption = Path("stress.html"),
    as_json: Annotated[bool, typer.Option("--json", help="The figures as JSON on stdout.")] = False,
) -> None:
    """Former name of `patagium study attack` without its hostile cases."""
    from patagium.cli.words import existing, say_json, show_table
    from patagium_lab.attack import run as study
    from patagium_lab.attack.page import fault_table, page
    from patagium_lab.attack.plan import LEARNERS, AttackPlan
    from patagium_lab.stage_bar import stage_bar
    from patagium_lab.study import Stages

    warnings.warn(
        "patagium study stress is now patagium study attack; its areas are named by --only",
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
