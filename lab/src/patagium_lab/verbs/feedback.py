"""`patagium study feedback`: delays and rates that robots bear, and starts that they recover."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from patagium_lab.verbs.options import JobsOption, PageOption, write_reports

EXAMPLES = (
    "patagium study feedback --out feedback --quick",
    "patagium study feedback --out feedback --starts 10000 --few 3000 --page docs/feedback.md",
)


def feedback(
    out: Annotated[Path, typer.Option(help="Folder of the report and its figures.")],
    starts: Annotated[
        int, typer.Option(min=1, help="Starts of each regulator; a fifth for all but one robot.")
    ] = 1000,
    few: Annotated[
        int, typer.Option(min=1, help="Of these, starts of the predictive controller.")
    ] = 300,
    flights: Annotated[int, typer.Option(min=1, help="Flights of each delay and each rate.")] = 6,
    beats: Annotated[int, typer.Option(min=2, help="Beats of each flight.")] = 40,
    seed: Annotated[int, typer.Option(min=0, help="First seed.")] = 1000,
    jobs: JobsOption = 2,
    quick: Annotated[
        bool, typer.Option("--quick", help="One robot, few starts and flights, in some minutes.")
    ] = False,
    page: PageOption = None,
) -> None:
    """Find the largest delay, the slowest rate and the region of attraction of feedback.

    Writes report.html, metrics.json, jobs.jsonl and figures. Results that are there already are
    kept, so that the same command goes on where it stopped.
    """
    from patagium_lab.feedback import page as pages
    from patagium_lab.feedback.plan import ORNITHOPTER, FeedbackPlan
    from patagium_lab.feedback.run import run

    plan = FeedbackPlan(seed, flights, starts, few, beats, workers=jobs)
    if quick:
        bird = (ORNITHOPTER,)
        plan = replace(plan, flights=1, starts=100, beats=20, margins=bird, regions=bird)
    write_reports("Feedback", out, plan, run, pages.page, page)
