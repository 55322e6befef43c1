"""`patagium evaluate`: a learned model against a flight or log it never saw."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from patagium.cli.options import LogArgument, MappingOption, ReportOption, ScoresOption
from patagium.cli.outputs import Outputs
from patagium.cli.words import existing, say_next, tell
from patagium.errors import command

EXAMPLES = (
    "patagium evaluate model.json another-flight.nc --report report.html",
    "patagium evaluate model.json log.csv --mapping columns.yaml --json",
)


def evaluate(
    model: Annotated[Path, typer.Argument(help="Model that patagium identify wrote (.json).")],
    file: LogArgument,
    mapping: MappingOption = None,
    every: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Samples over which the rival holds a measurement; as identify by default.",
        ),
    ] = None,
    report: ReportOption = None,
    as_json: ScoresOption = False,
) -> None:
    """Score a learned model, its weights frozen, where it has not been."""
    from patagium.cli.identify import show_scores
    from patagium.cli.logs import flight_or_table
    from patagium.learning import evaluate as evaluate_model
    from patagium.learning.model_file import load_model

    learned = load_model(existing(model))
    flight, table = flight_or_table(file, mapping)
    result = evaluate_model(flight if table is None else table, learned, every=every)
    outputs, title = Outputs(), f"{model.name} against {file.name}"
    if report is not None and outputs.attempt("report", result.report, report, title):
        tell(f"The report is in {report}")
    outputs.attempt("scores", show_scores, result.scores, as_json=as_json)
    outputs.check()
    if not as_json:
        seen = command("patagium view {} --model {}", file, model)
        say_next(seen if table is None else "the same with --report report.html, a page")
