"""`patagium export`: a flight or its forces for Foxglove, PlotJuggler and Rerun."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from patagium.cli.options import OUTPUT, PredictedOption, output_file
from patagium.cli.words import existing, model_for, tell
from patagium.errors import LogError

EXAMPLES = (
    "patagium export flight.nc -o flight.mcap",
    "patagium export flight.nc -o flight.mcap --model model.json",
    "patagium export stream.nc -o stream.rrd",
)


def export(
    file: Annotated[
        Path, typer.Argument(help="Flight, recorded stream, motion or predictions (.nc).")
    ],
    out: Annotated[Path, output_file("File to write (.mcap or .rrd).", *OUTPUT)],
    model: PredictedOption = None,
) -> None:
    """Write a flight, its forces and predictions for Foxglove and PlotJuggler, or for Rerun.

    Each quantity over time is a topic with the names of its numbers and its unit; the bodies of
    the robot are frames in the world.
    """
    from patagium.learning import evaluate
    from patagium.netcdf_file import loaded_dataset
    from patagium.viewer.export import export as write

    record = loaded_dataset(existing(file), LogError, "a record over time")
    if model is not None:
        found = evaluate(record, model_for(model, record)).prediction
        names = found["output"].to_numpy().astype(str)
        for name in ("measurement", "prediction"):
            values = found[name].to_numpy()
            record[name] = (("time", "output"), values, {"units": "N or N m"})
        record = record.assign_coords(output=names)
    target = write(record, out)
    tell(f"{len(record['time'])} samples are in {target}")
