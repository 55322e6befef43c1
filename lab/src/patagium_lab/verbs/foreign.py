"""`patagium study foreign`: every learner in air that other programs made."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from patagium_lab.verbs.options import JobsOption, PageOption, write_reports

EXAMPLES = (
    "patagium study foreign --out foreign --quick",
    "patagium study foreign --out foreign --search 64 --log log16.csv.gz --page docs/foreign.md",
)


def foreign(
    out: Annotated[Path, typer.Option(help="Folder of the report, its flights and trials.")],
    learned: Annotated[
        int, typer.Option(min=1, help="Flights that are learned, a robot and side of the split.")
    ] = 2,
    unseen: Annotated[
        int, typer.Option(min=1, help="Unseen flights on which each learned model is scored.")
    ] = 2,
    near: Annotated[
        int,
        typer.Option(min=0, help="Directions in which wingbeats near a learned one are flown."),
    ] = 2,
    search: Annotated[
        int, typer.Option(min=0, help="Trials of a search for settings on each flight; 0: none.")
    ] = 0,
    every: Annotated[int, typer.Option(min=1, help="Use one sample in so many.")] = 10,
    flights: Annotated[
        Path | None, typer.Option(help="Folder of the flights; flights of the study by default.")
    ] = None,
    log: Annotated[
        Path | None, typer.Option(help="Crazyflie log (log16.csv.gz) to learn too.")
    ] = None,
    jobs: JobsOption = 2,
    quick: Annotated[
        bool, typer.Option("--quick", help="Two robots and four learners, in about a minute.")
    ] = False,
    page: PageOption = None,
) -> None:
    """Learn air that other programs made: MuJoCo's fluid, PteraSoftware's vortex lattice.

    Writes report.html, metrics.json, flights/ and trials/. What is there already is kept, so that
    the same command goes on where it stopped. Without PteraSoftware a few of its wings, which the
    laboratory carries, are flown.
    """
    from patagium.cli.words import existing
    from patagium_lab.foreign import page as pages
    from patagium_lab.foreign.plan import QUICK, ForeignPlan
    from patagium_lab.foreign.run import run

    found = None if log is None else existing(log)
    full = ForeignPlan(learned=learned, unseen=unseen, near=near, log=found)
    plan = QUICK if quick else full
    plan = replace(plan, search=search, every=every, flights=flights, workers=jobs)
    write_reports("Foreign air", out, plan, run, pages.page, page)
