"""`patagium study attack`: hostile files, packets, programs, samples, and one page of what came."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from patagium_lab.verbs.options import OutputOption

EXAMPLES = (
    "patagium study attack --results attack.json -o docs/robustness.md",
    "patagium study attack --only files --only packets --cases 2000 --seed 3 -o page.html",
)
Runs = Annotated[int, typer.Option(help="Number of runs of the fault campaign.")]
Seed = Annotated[int, typer.Option(help="Seed of cases, faults and learners.")]
Jobs = Annotated[int, typer.Option(help="Number of processes.")]
Log = Annotated[Path | None, typer.Option(help="Crazyflie log (log16.csv.gz) to calibrate on too.")]
Updates = Annotated[
    int, typer.Option(help="Updates in float32 and in float64; the glide has a tenth.")
]
Captures = Annotated[int, typer.Option(help="Number of made-up logs of motion capture.")]


def attack(
    cases: Annotated[
        int, typer.Option(help="Number of hostile cases in all areas together.")
    ] = 100_000,
    runs: Runs = 1000,
    seed: Seed = 0,
    only: Annotated[
        list[str] | None,
        typer.Option(
            help="Area: files, packets, loops, calls, options, signals, writes, cache, poison, "
            "faults, damage, calibration, endurance or captures; the option may be repeated."
        ),
    ] = None,
    jobs: Jobs = 2,
    log: Log = None,
    updates: Updates = 10_000_000,
    captures: Captures = 200,
    poisoned: Annotated[
        int, typer.Option(help="Samples with bursts of poison through each learner.")
    ] = 100_000,
    output: OutputOption = Path("robustness.html"),
    results: Annotated[
        Path | None,
        typer.Option(
            writable=True,
            help="File of the results (.json), written; with --only, those of other areas in it "
            "are kept and are on the page too.",
        ),
    ] = None,
) -> None:
    """Attack the whole program with cases drawn from a seed, and write one page of what came.

    Hostile files of every format, packets, options, signals, failing disks and damaged caches;
    learners through faults, damage and long runs. About an hour on two cores. The exit code is 1
    where a hostile case ended as none may.
    """
    from patagium.cli.words import existing, show_table
    from patagium.whole_file import write_whole
    from patagium_lab.attack import run as study
    from patagium_lab.attack.page import area_table, fault_table, page
    from patagium_lab.attack.plan import AREAS, AttackPlan
    from patagium_lab.stage_bar import stage_bar
    from patagium_lab.study import Stages

    plan = AttackPlan(
        cases, runs, seed, tuple(only or AREAS), None if log is None else existing(log),
        max(1, updates // 10), updates, jobs, captures, poisoned,
    )  # fmt: skip
    former = json.loads(results.read_text())["areas"] if results and results.exists() else {}
    with stage_bar("Attacking") as progress:
        found = study.run(plan, former, Stages(progress))
    if results is not None:
        write_whole(results, json.dumps(found.metrics(), indent=1, default=float) + "\n")
    page(found).write(output)
    if found.tallies():
        show_table(area_table(found))
    if "faults" in found.areas:
        show_table(fault_table(found))
    typer.echo(f"Written to {output}", err=True)
    if any(row["counts"] for row in found.tallies()):
        raise typer.Exit(1)
