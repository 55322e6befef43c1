"""`patagium view`: a flight as a page in three dimensions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from patagium.cli.options import OUTPUT, PredictedOption, option_in, output_file
from patagium.cli.words import (
    FLIGHT,
    existing,
    flight_file,
    model_for,
    progress_bar,
    say_next,
    tell,
)
from patagium.errors import LogError, ParameterError, command

if TYPE_CHECKING:
    import xarray as xr

    from patagium.viewer.predicted_forces import Predicted

EXAMPLES = (
    "patagium view flight.nc",
    "patagium view flight.nc --model model.json -o flight.html",
    "patagium view before.nc after.nc -o both.html",
    'patagium view flight.nc --predictions predictions.nc --start "1 s" --end "1.5 s"',
    'patagium view flight.nc --still flight.png --at "0.3 s"',
    'patagium view flight.nc --film flight.gif --start "1.8 s" --end "2 s"',
)
PANELS = {"A picture or a film instead of a page": "still at film"}


def view(
    flights: Annotated[
        list[Path],
        typer.Argument(help="Flight, motion or log (.nc), or two: the second is drawn as a ghost."),
    ] = [FLIGHT],  # noqa: B006
    out: Annotated[
        Path | None,
        output_file("File for the page; in the folder of the flight by default.", *OUTPUT),
    ] = None,
    model: PredictedOption = None,
    predictions: Annotated[
        Path | None,
        typer.Option(help="Predicted forces too, as identify --predictions wrote them."),
    ] = None,
    title: Annotated[str | None, typer.Option(help="Heading of the page.")] = None,
    start: Annotated[float | None, option_in("s", "Show the flight from here, in s.")] = None,
    end: Annotated[float | None, option_in("s", "Show the flight up to here, in s.")] = None,
    still: Annotated[
        Path | None, output_file("File for a picture of one moment instead (.png, .svg, .pdf).")
    ] = None,
    film: Annotated[
        Path | None,
        output_file("File for a film of --start to --end instead (.gif; .mp4: [film])."),
    ] = None,
    at: Annotated[
        float | None,
        option_in("s", "That moment, in s; else of the largest force of a middle beat."),
    ] = None,
) -> None:
    """Show a flight in three dimensions: one HTML file, opened by any browser, offline.

    With --still a picture of one moment instead, with --film a film of --start to --end.

    Bodies, folding wings, forces on strips, path; plays from 1/200 of real time, steps, repeats a
    wingbeat; plots of generalized forces with a cursor at the time shown.
    """
    from patagium.learning.result import load_identification
    from patagium.report.figures import save_figure
    from patagium.report.page import page_path
    from patagium.viewer import replay
    from patagium.viewer import still as draw_still
    from patagium.viewer.film import film as write_film

    if model is not None and predictions is not None:
        raise ParameterError("--predictions", "either a model or predictions", "both")
    flight, *others = flights
    if len(others) > 1:
        raise ParameterError("flights", "one or two", len(flights))
    if len({out, still, film} - {None}) > 1:
        raise ParameterError("--out, --still, --film", "one of them", "several")
    page = page_path(flight.with_suffix(".html") if out is None else out, name="--out")
    if at is not None and still is None:
        raise ParameterError("--at", "--still, the picture it is for, as well", "none")
    unused: dict[str, Any] = {"--title": title, "second flight": " ".join(map(str, others)) or None}
    unused |= {} if still is None else {"--start": start, "--end": end}
    for name, value in unused.items():
        if value is not None and (still or film):
            raise ParameterError(name, f"none with {'--still' if still else '--film'}", value)
    with progress_bar(f"Reading {flight.name}"):
        shown = _flight(flight)
    predicted: Predicted | None = None if model is None else model_for(model, shown)
    if predictions is not None:
        predicted = load_identification(existing(predictions))
    if still is not None:
        with progress_bar("Drawing"):
            save_figure(draw_still(shown, at, predicted=predicted), still)
        tell(f"The picture is in {still}")
    elif film is not None:
        with progress_bar("Filming") as progress:
            write_film(shown, film, predicted=predicted, start=start, end=end, progress=progress)
        tell(f"The film is in {film}")
    else:
        with progress_bar(f"Drawing {flight.name}"):
            beside = {other.stem: _flight(other) for other in others}
            options: dict[str, Any] = {"title": title, "start": start, "end": end, "beside": beside}
            replay(shown, page, predicted=predicted, **options)
        tell(f"The page is in {page}")
        cycles = () if "air" in shown.attrs else (command("patagium cycles {}", flight),)  # of logs
        say_next(f"open {page} in a browser", *cycles)


def _flight(file: Path) -> xr.Dataset:
    """Flight to show: a simulated one, an imported one, a record of a stream, or a motion."""
    from patagium.cli.logs import loaded, record_of
    from patagium.sensing.sensors.sense import is_sensor_log

    record = record_of(flight_file(file), None)
    if record is not None:
        with record:
            if record.is_flight:
                return record.flight()
    elif not is_sensor_log(file):
        return loaded(file)
    motion = command("patagium motion {} --robot ROBOT", file)
    raise LogError(file, f"a motion, which `{motion}` finds", "sensors alone")
