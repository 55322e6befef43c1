"""`patagium figures`: the figures of a flight, for a page, for print or for slides."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from patagium.cli.options import OUTPUT, FlightArgument, JsonOption, PredictedOption
from patagium.cli.outputs import Outputs
from patagium.cli.words import FLIGHT, existing, flight_file, progress_bar, say_next
from patagium.errors import command

EXAMPLES = (
    "patagium figures flight.nc --for paper",
    "patagium figures flight.nc --for slides --format svg --model model.json -o figures",
)


def figures(
    flight: FlightArgument = FLIGHT,
    look: Annotated[
        Literal["page", "paper", "slides"],
        typer.Option("--for", help="Medium, which decides the sizes of letters and lines."),
    ] = "paper",
    form: Annotated[
        Literal["pdf", "svg", "png"], typer.Option("--format", help="Format of the files.")
    ] = "pdf",
    model: PredictedOption = None,
    place: Annotated[
        Path | None,
        typer.Option(*OUTPUT, help="Folder for the figures; named as the flight by default."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Draw a flight: the robot, the flight at a glance, its strips, a wingbeat, the forces.

    One style, colors told apart by every eye and alike in every figure, units on every axis.
    """
    from patagium.learning.model_file import load_model
    from patagium.report.figures import save_figure
    from patagium.simulation import load_flight
    from patagium.viewer.flight_figures import flight_figures
    from patagium.whole_file import make_folder

    learned = None if model is None else load_model(existing(model))
    outputs, files = Outputs(), {}
    with progress_bar(f"Drawing {flight.name}") as progress:
        drawn = flight_figures(load_flight(flight_file(flight)), look, learned)
        folder = make_folder(flight.with_suffix("") if place is None else place)
        for done, (name, figure) in enumerate(drawn.items(), 1):
            file = folder / f"{name}.{form}"
            if outputs.attempt(file.name, save_figure, figure, file):
                files[name] = str(file)
            progress(done, len(drawn))
    outputs.answer("names", files, as_json, f"Figures for {look}")
    outputs.check()
    if not as_json:
        say_next(command("patagium view {}", flight), "patagium robots --new my_robot")
