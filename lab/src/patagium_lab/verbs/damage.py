"""`patagium study damage`: a wing lost in flight, with a model that relearns and without."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from patagium_lab.verbs.options import JobsOption, PageOption, write_reports

EXAMPLES = (
    "patagium study damage --out damage --quick",
    "patagium study damage --out damage --page docs/damage.md",
)


def damage(
    out: Annotated[Path, typer.Option(help="Folder of the report and its flights.")],
    flights: Annotated[
        int, typer.Option(min=1, help="Flights of each kind: learning or not, sensors or not.")
    ] = 100,
    pairs: Annotated[
        int, typer.Option(min=1, help="Pairs of undamaged flights of 60 s, the longest of all.")
    ] = 100,
    ablations: Annotated[int, typer.Option(min=1, help="Flights of each ablation.")] = 20,
    few: Annotated[
        int, typer.Option(min=1, help="Flights by predictive control, and of each turbulence.")
    ] = 10,
    share: Annotated[
        float, typer.Option(min=0.01, max=0.6, help="Share of the span of one wing that is lost.")
    ] = 1 / 3,
    seed: Annotated[int, typer.Option(min=0, help="First seed.")] = 100,
    jobs: JobsOption = 2,
    quick: Annotated[
        bool, typer.Option("--quick", help="Two flights of each kind, in some minutes.")
    ] = False,
    page: PageOption = None,
) -> None:
    """Cut a wing of a flapping robot in flight, and see which controllers bring it back.

    Writes report.html, metrics.json and flights.jsonl. Flights that are there already are kept, so
    that the same command goes on where it stopped.
    """
    from patagium_lab.damage import page as pages
    from patagium_lab.damage.plan import DamagePlan
    from patagium_lab.damage.run import run

    plan = DamagePlan(share, seed, flights, pairs, ablations, few, workers=jobs)
    if quick:
        plan = replace(plan, flights=2, pairs=2, ablations=2, few=2, undamaged=100)
    write_reports("Lost wing", out, plan, run, pages.page, page)
