"""Arguments and options that several verbs have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from patagium.cli.words import Vector, quantity, vector
from patagium.limits import TURN

OUTPUT = ("--output", "--out", "-o")
"""Words of the option for the file that a verb writes."""


def output_file(text: str, *words: str, callback: Any = None) -> Any:
    """Option for a file that a verb writes, with its help; `check_files` knows it by its kind."""
    return typer.Option(*words, writable=True, callback=callback, help=text)


def option_in(unit: str, text: str, noun: str = "", most: float = TURN) -> Any:
    """Option of a quantity in a unit, with its help; noun and most are those of `quantity`."""
    return typer.Option(parser=quantity(unit, noun, most), help=text)


def vector_in(unit: str, text: str) -> Any:
    """Option of a vector in a unit, with its help."""
    return typer.Option(parser=vector(unit), help=text)


FlightArgument = Annotated[Path, typer.Argument(help="Flight that patagium simulate wrote (.nc).")]
JsonOption = Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")]
ResultOption = Annotated[bool, typer.Option("--json", help="Result as JSON on stdout.")]
ScoresOption = Annotated[bool, typer.Option("--json", help="All scores as JSON on stdout.")]
RobotArgument = Annotated[str, typer.Argument(help="Preset (see patagium robots) or robot file.")]
RobotOption = Annotated[
    str | None, typer.Option(help="Robot, a preset or a file; that of the log by default.")
]
ReportOption = Annotated[Path | None, output_file("File for an HTML page.")]
LogArgument = Annotated[Path, typer.Argument(help="Flight or imported log (.nc), or another log.")]


def netcdf(path: Path | None) -> Path | None:
    """Name of a flight's file, which ends in .nc; one with another ending is refused."""
    if path is None:
        return None
    if path.suffix not in ("", ".nc"):
        raise typer.BadParameter(f"expected a name that ends in .nc (netCDF), found {str(path)!r}")
    kept = path.suffix or str(path) == "-" or (path.exists() and not path.is_file())
    return path if kept else path.with_name(f"{path.name}.nc")


FlightOutput = Annotated[Path, output_file("File for the flight (.nc).", *OUTPUT, callback=netcdf)]
OrbitOutput = Annotated[
    Path | None, output_file("File for a flight on the orbit (.nc).", *OUTPUT, callback=netcdf)
]
_FILES = "A CSV, Parquet, MAT, HDF5, ULog, ArduPilot or MCAP file, a ROS bag, or parts of one."
FilesArgument = Annotated[list[Path], typer.Argument(help=_FILES)]
MappingOption = Annotated[
    Path | None,
    typer.Option("--mapping", "--map", help="Meaning of the columns or fields of a log (YAML)."),
]
SpeedOption = Annotated[
    float | None,
    option_in("m/s", "Mean speed forward, in m/s; free by default, 0 hovers."),
]
DurationOption = Annotated[float | None, option_in("s", "Duration of the flight, in s.")]
DensityOption = Annotated[
    float | None,
    option_in("kg/m^3", "Density of the air, in kg/m^3; 1.225, or that of a learned model."),
]
WindOption = Annotated[
    Vector | None, vector_in("m/s", "Steady wind in world axes, in m/s: -3,0,0.")
]
PolarOption = Annotated[
    list[str] | None,
    typer.Option(
        help="A file of XFOIL, AeroSandbox, NeuralFoil or AeroDyn; of quasi-steady air also "
        "dickinson, the default, or reynolds (insects of any size). For one wing: WING=FILE; may "
        "be repeated.",
    ),
]
InflowOption = Annotated[
    bool, typer.Option("--inflow", help="Wings meet the air that they have thrown down.")
]
PredictedOption = Annotated[
    Path | None, typer.Option(help="Predicted forces too, by what identify --model wrote.")
]
DrawingOption = Annotated[
    Path | None, output_file("File for a drawing of the flight (.png, .svg).")
]
