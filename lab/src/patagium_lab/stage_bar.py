"""Bar that shows how far a study is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import typer

from patagium_lab.study import Progress as Tell


@contextmanager
def stage_bar(label: str) -> Iterator[Tell]:
    """Bar on stderr for work in stages; called with the name of a stage and the share done.

    Where stderr is no terminal, each stage is one line.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    quiet, last = not console.is_terminal, ""
    bars = (BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    columns = (TextColumn("{task.description}"), *bars)
    with Progress(*columns, console=console, transient=True, disable=quiet) as bar:
        task = bar.add_task(label, total=1.0)

        def tell(stage: str, fraction: float) -> None:
            nonlocal last
            bar.update(task, description=f"{label}: {stage}", completed=fraction)
            if stage != last and quiet:
                typer.echo(f"{label}: {stage} ({fraction:.0%})", err=True)
            last = stage

        yield tell
