"""Options that several studies share, and what each does when it ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

if TYPE_CHECKING:
    from patagium_lab.study import Page, Results, Stages

Plan = TypeVar("Plan")
JobsOption = Annotated[int, typer.Option(min=0, help="Number of processes.")]
PageOption = Annotated[
    Path | None, typer.Option(help="Further page, of the same content (.md or .html).")
]
ResultsPageOption = Annotated[
    Path | None, typer.Option(help="Further page, of the results alone (.md or .html).")
]
OutputOption = Annotated[
    Path, typer.Option("--output", "-o", writable=True, help="Page to write (.md or HTML).")
]
JsonFileOption = Annotated[
    Path | None, typer.Option("--json", writable=True, help="File for the figures as JSON.")
]


def write_reports(
    label: str,
    out: Path,
    plan: Plan,
    run: Callable[[Plan, Path, Stages], Results],
    page: Callable[[Results], Page],
    further: Path | None,
    only: Sequence[str] | None = None,
) -> None:
    """Run a study into a folder, with a bar; then write its further page, if there is to be one.

    Args:
        label: Label of the bar.
        out: Folder of the results.
        plan: What the study does.
        run: Function `run` of the study.
        page: Function `page` of the study.
        further: Further page (.md or .html); None for none.
        only: Titles of the sections of that page; None: all.
    """
    from patagium_lab.stage_bar import stage_bar
    from patagium_lab.study import write_study

    with stage_bar(label) as progress:
        report, whole = write_study(out, plan, run, page, progress)
        if further is not None:
            (whole if only is None else whole.only(only)).write(further)
    typer.echo(f"The report is in {report}")
