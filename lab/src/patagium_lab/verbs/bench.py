"""`patagium bench`: compiled functions and learners, against their rivals."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = (
    "patagium bench",
    "patagium bench -o docs/benchmarks.md --json bench.json",
    "patagium bench --quick",
    "patagium bench --only update --only simulation",
    "patagium bench learners -o docs/learners.md --log log16.csv.gz",
    "patagium bench learners --quick --only node --only filterpy",
)


class Subject(StrEnum):
    """What is put to the test."""

    SPEED = "speed"
    LEARNERS = "learners"


def bench(
    subject: Annotated[
        Subject, typer.Argument(help="Times of the compiled functions, or learners.")
    ] = Subject.SPEED,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the figures there too.")
    ] = None,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Leave out what takes minutes: rivals' compilers, long runs."),
    ] = False,
    only: Annotated[
        list[str] | None, typer.Option(help="One group of figures, or one learner. Repeat it.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Page to write (.md or HTML); else benchmarks.md or learners.md."
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(help="The Crazyflie log (log16.csv.gz), for learners; left out without it."),
    ] = None,
) -> None:
    """Time dynamics, air, networks and updates, or race the learners, beside other programs.

    Times: random states, medians, one core. Learners: time of an update, errors and intervals
    on the published flight, the corrected flight and a log, each tuned by the same search. A
    rival that is missing is named, with the reason.
    """
    if subject is Subject.LEARNERS:
        _learners(output or Path("learners.md"), json_file, quick, only, log)
    else:
        _speed(output or Path("benchmarks.md"), json_file, quick, only)


def _speed(output: Path, json_file: Path | None, quick: bool, only: list[str] | None) -> None:
    from patagium.cli.words import json_text, show_table, stage_bar
    from patagium.report import Table
    from patagium.whole_file import write_whole
    from patagium_lab.bench.page import write_benchmark
    from patagium_lab.bench.run import QUICK, run_benchmark

    chosen = only or (QUICK if quick else None)
    with stage_bar("Timing") as progress:
        figures = run_benchmark(chosen, progress)
    heads = ("name", "value", "unit", "against", "against_value", "ratio", "note")
    rows = [[figure[head] for head in heads] for figure in figures]
    show_table(Table([head.replace("_", " ") for head in heads], rows))
    typer.echo(f"Written to {write_benchmark(output, figures)}", err=True)
    if json_file is not None:
        write_whole(json_file, json_text(figures) + "\n")
        typer.echo(f"Written to {json_file}", err=True)


def _learners(
    output: Path, json_file: Path | None, quick: bool, only: list[str] | None, log: Path | None
) -> None:
    from patagium.cli.words import existing, json_text, stage_bar
    from patagium.whole_file import write_whole
    from patagium_lab.learners.data_sets import flight_course, log_course
    from patagium_lab.learners.page import write_learners
    from patagium_lab.learners.race import QUICK, RacePlan
    from patagium_lab.learners.run import run_learners

    plan = QUICK if quick else RacePlan()
    path = None if log is None else existing(log)
    with stage_bar("Racing") as progress:
        progress("flown", 0.0)
        courses = [flight_course(name, plan.after[-1]) for name in ("published", "corrected")]
        courses += [] if path is None else [log_course(path)]
        found = run_learners(courses, plan, only, progress)
    typer.echo(f"Written to {write_learners(output, found)}", err=True)
    if json_file is not None:
        write_whole(json_file, json_text(found) + "\n")
        typer.echo(f"Written to {json_file}", err=True)
