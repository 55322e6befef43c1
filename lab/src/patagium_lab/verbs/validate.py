"""`patagium study validate`: models of the air against theory and measurement."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from patagium_lab.verbs.options import OutputOption

EXAMPLES = (
    "patagium study validate",
    "patagium study validate --only wagner --only theodorsen -o page.html --json",
    "patagium study validate -o docs/validation.md",
)


def validate(
    output: OutputOption = Path("validation.html"),
    only: Annotated[
        list[str] | None, typer.Option(help="Name of a case; the option may be repeated.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The errors as JSON on stdout.")] = False,
) -> None:
    """Compare the models of the air with theory and measurement, on one page.

    Closed forms, classical functions, a measured flapping wing and a measured section that
    pitches through stall; nothing is tuned.
    """
    from patagium.cli.words import json_text, show_table
    from patagium_lab.stage_bar import stage_bar
    from patagium_lab.study import Stages
    from patagium_lab.validation import run as validation
    from patagium_lab.validation.page import page
    from patagium_lab.validation.plan import CASES, ValidationPlan

    plan = ValidationPlan(tuple(only or CASES))
    with stage_bar("Validating") as progress:
        results = validation.run(plan, Stages(progress))
    page(results).write(output)
    if as_json:
        typer.echo(json_text(validation.error_rows(results)))
    else:
        show_table(validation.error_table(results))
    typer.echo(f"Written to {output}", err=True)
