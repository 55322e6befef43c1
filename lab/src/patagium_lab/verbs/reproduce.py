"""`patagium study reproduce`: the paper's experiment, corrected and as published."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from patagium_lab.verbs.options import ResultsPageOption, write_reports

EXAMPLES = (
    "patagium study reproduce --out demo",
    "patagium study reproduce --out quick --quick",
    "patagium study reproduce --out demo --full --page docs/results.md",
)


def reproduce(
    out: Annotated[Path, typer.Option(help="Folder of the report, its numbers and flights.")],
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="Short flights and few runs: the same pages, rougher numbers."
        ),
    ] = False,
    full: Annotated[
        bool,
        typer.Option(
            "--full",
            help="Rivals that compile for half a minute too, eight starts of every strip network, "
            "a grey box, and every learner at every sample that it has time for.",
        ),
    ] = False,
    crazyflie: Annotated[
        Path | None, typer.Option(help="Log of a quadrotor, log16.csv.gz, for a section on it.")
    ] = None,
    page: ResultsPageOption = None,
) -> None:
    """Run the paper's whole experiment and write one HTML report.

    Writes report.html, metrics.json, the flights (*.nc) and figures/. A first page, with one
    flight and what was learned from it, is there after a minute or two.
    """
    from patagium.errors import ParameterError

    if quick and full:
        raise ParameterError("--quick", "nothing else about the length of the run", "--full")
    from patagium.cli.words import existing
    from patagium_lab.reproduction import page as pages
    from patagium_lab.reproduction.plan import ReproductionPlan
    from patagium_lab.reproduction.run import run

    plan = ReproductionPlan.of(quick, full, None if crazyflie is None else existing(crazyflie))
    write_reports("Reproducing the paper", out, plan, run, pages.page, page, pages.RESULTS)
