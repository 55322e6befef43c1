"""`patagium study bench`: compiled functions and learners compared with their rivals."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from patagium_lab.verbs.options import JsonFileOption

EXAMPLES = (
    "patagium study bench",
    "patagium study bench -o docs/benchmarks.md --json bench.json",
    "patagium study bench --quick",
    "patagium study bench --only update --only simulation",
    "patagium study bench learners -o docs/learners.md --log log16.csv.gz",
    "patagium study bench learners --quick --only node --only filterpy",
)


class Topic(StrEnum):
    """Topics of the bench."""

    SPEED = "speed"
    LEARNERS = "learners"


def bench(
    topic: Annotated[
        Topic, typer.Argument(help="Times of the compiled functions (speed), or learners.")
    ] = Topic.SPEED,
    json_file: JsonFileOption = None,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="Short form, without rivals that compile for minutes and long runs."
        ),
    ] = False,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Group of figures, or learner; the option may be repeated."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            writable=True,
            help="Page to write (.md or HTML); benchmarks.md or learners.md by default.",
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(help="Crazyflie log (log16.csv.gz), a further data set for learners."),
    ] = None,
) -> None:
    """Time dynamics, air, networks and updates, or compare learners, against other programs.

    Times: random states, medians, one core. Learners: time of an update, errors and intervals
    on the published flight, the corrected flight and a log, each tuned by the same search. A
    rival that is missing is named, with the reason.
    """
    if topic is Topic.LEARNERS:
        _learners(output or Path("learners.md"), json_file, quick, only, log)
    else:
        _speed(output or Path("benchmarks.md"), json_file, quick, only)


def _speed(output: Path, json_file: Path | None, quick: bool, only: list[str] | None) -> None:
    from patagium.cli.words import json_text, show_table
    from patagium.whole_file import write_whole
    from patagium_lab.bench.page import page
    from patagium_lab.bench.plan import GROUPS, QUICK, BenchPlan
    from patagium_lab.bench.run import run
    from patagium_lab.stage_bar import stage_bar
    from patagium_lab.study import Stages, table_of

    chosen = tuple(group for group in GROUPS if group in only) if only else GROUPS
    unknown = tuple(name for name in only or () if name not in GROUPS)
    plan = BenchPlan(unknown or (QUICK if quick and not only else chosen))
    with stage_bar("Timing") as progress:
        rows = run(plan, Stages(progress))
    heads = ("name", "value", "unit", "against", "against_value", "ratio", "note")
    show_table(table_of({head.replace("_", " "): head for head in heads}, rows))
    typer.echo(f"Written to {page(rows).write(output)}", err=True)
    if json_file is not None:
        write_whole(json_file, json_text(rows) + "\n")
        typer.echo(f"Written to {json_file}", err=True)


def _learners(
    output: Path, json_file: Path | None, quick: bool, only: list[str] | None, log: Path | None
) -> None:
    from patagium.cli.words import existing, json_text
    from patagium.whole_file import write_whole
    from patagium_lab.learners import run as study
    from patagium_lab.learners.page import page
    from patagium_lab.learners.plan import LearnersPlan
    from patagium_lab.stage_bar import stage_bar
    from patagium_lab.study import Stages

    plan = LearnersPlan(only=tuple(only or ()), log=None if log is None else existing(log))
    with stage_bar("Comparing") as progress:
        results = study.run(plan.quick() if quick else plan, Stages(progress))
    typer.echo(f"Written to {page(results).write(output)}", err=True)
    if json_file is not None:
        write_whole(json_file, json_text(results) + "\n")
        typer.echo(f"Written to {json_file}", err=True)
