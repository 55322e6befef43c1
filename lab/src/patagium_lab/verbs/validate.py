"""`patagium validate`: the models of the air beside what is known."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = (
    "patagium validate",
    "patagium validate --only wagner --only theodorsen -o page.html --json",
    "patagium validate -o docs/validation.md",
)


def validate(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Page to write (.md or HTML).")
    ] = Path("validation.html"),
    only: Annotated[list[str] | None, typer.Option(help="One case. Repeat it.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The errors as JSON on stdout.")] = False,
) -> None:
    """Compare the models of the air with theory and measurement, on one page.

    Closed forms, classical functions, a measured flapping wing and a measured section that
    pitches through stall; nothing is tuned.
    """
    from patagium.cli.words import json_text, progress_bar, show_table
    from patagium_lab.validation import run as validation
    from patagium_lab.validation.page import write_validation

    with progress_bar("Validating") as progress:
        results = validation.validate(only, progress)
    write_validation(output, results)
    if as_json:
        typer.echo(json_text(validation.error_rows(results)))
    else:
        show_table(validation.error_table(results))
    typer.echo(f"Written to {output}", err=True)
