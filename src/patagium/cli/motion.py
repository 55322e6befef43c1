"""`patagium motion`: from the log of a laboratory to motion and forces with their uncertainty."""

from __future__ import annotations

import json
import tempfile
from dataclasses import asdict, replace
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from patagium.cli.options import OUTPUT, MappingOption, ResultOption, RobotOption, output_file
from patagium.cli.outputs import Outputs
from patagium.cli.words import existing, say_json, say_next, show_table
from patagium.errors import LogError, ParameterError, command

if TYPE_CHECKING:
    import xarray as xr

    from patagium.robot import Robot
    from patagium.sensing import ForceSamples, SensorLog

EXAMPLES = (
    "patagium motion log.nc --robot aerobat --plot motion.png",
    "patagium motion flight.bag --mapping rig.yaml --robot aerobat -o motion.nc",
    "patagium motion flight.nc --robot aerobat --body imu2=left_plate --json",
)


def motion(
    log: Annotated[
        Path, typer.Argument(help="Imported log or sensor log (.nc), or another log to import.")
    ],
    robot: RobotOption = None,
    mapping: MappingOption = None,
    body: Annotated[
        list[str] | None, typer.Option(help="Body of a quantity, QUANTITY=BODY; may be repeated.")
    ] = None,
    out: Annotated[Path | None, output_file("File for motion and forces (.nc).", *OUTPUT)] = None,
    plot: Annotated[
        Path | None, output_file("Figure of attitude and forces (.png, .svg or .pdf).")
    ] = None,
    as_json: ResultOption = False,
) -> None:
    """Estimate motion and forces from a log, each with its standard deviation.

    Noise, clocks and swapped markers are found from the log. Stretches in which the sensors do not
    tell the motion are named, and have no forces.
    """
    from patagium.sensing.force.flown_force import motion_and_force, write_motion
    from patagium.sensing.motion.clock_shifts import found_shifts
    from patagium.viewer.flight_figures import motion_figure

    measured = _measured(log, robot, mapping, body or [])
    shifts, note = found_shifts(measured)
    found, forces = motion_and_force(measured, shifts=shifts)
    target = out or Path(f"{log.name.partition('.')[0]}-motion.nc")
    outputs = Outputs()
    kept = outputs.attempt("motion", write_motion, found, forces, target)
    outputs.draw(plot, lambda _: motion_figure(found, forces))
    facts = json.loads(found.attrs["findings"]) | ({"file": str(target)} if kept else {})
    summary = _summary(found, forces) | {"clock_shifts": shifts, **facts}
    told: Any = (say_json, summary) if as_json else (_say, measured, forces, summary, note)
    outputs.attempt("summary", *told)
    outputs.check()
    if not as_json:
        where = f", the figure in {plot}" if plot else ""
        typer.echo(f"Motion and forces are in {target}{where}")
        if forces.measured and measured.robot.strips:
            say_next(command("patagium identify {}", target))


def _measured(log: Path, robot: str | None, mapping: Path | None, words: list[str]) -> SensorLog:
    """Sensor log in a file of any kind."""
    from patagium.cli.logs import record_of, tell_warnings
    from patagium.netcdf_file import kind_of
    from patagium.robot import load_robot
    from patagium.sensing import load_sensor_log, sensor_log
    from patagium.sensing.logs.importing.import_log import import_log as bring

    bodies = dict(word.partition("=")[::2] for word in words)
    machine: Robot | None = None if robot is None else load_robot(robot)
    if (record := record_of(log, mapping)) is not None:
        record.close()
        return sensor_log(log, machine, bodies=bodies)
    if log.suffix.lower() == ".nc" and mapping is None:
        if kind_of(log).startswith("a flight"):
            known = "a simulated flight, whose motion is known: patagium identify {}"
            raise LogError(log, "a log of sensors", command(known, log))
        kept = load_sensor_log(existing(log))
        return kept if machine is None else replace(kept, robot=machine)
    if mapping is None:
        raise ParameterError("--mapping", "a YAML file that says what the columns mean", None)
    with tempfile.TemporaryDirectory(prefix="patagium-") as folder:
        found = bring([log], existing(mapping), Path(folder) / "log.nc")
        tell_warnings(log, [asdict(one) for one in found.findings])
        return sensor_log(found.path, machine, bodies=bodies)


def _summary(found: xr.Dataset, forces: ForceSamples) -> dict[str, Any]:
    """Figures of the motion and the forces."""
    import numpy as np

    known, time = found["known"].values, found["time"].values
    result: dict[str, Any] = {
        "samples": len(time),
        "duration": float(time[-1] - time[0]),
        "known": float(known.mean()),
    }
    if "attitude_std" in found and known.any():
        result["attitude_std"] = float(np.median(found["attitude_std"].values[known]))
    result["forces"], robot = {}, forces.robot
    for name in forces.measured:
        force, std = forces.force[:, k := robot.index(name)], forces.std[:, k]
        if not np.isfinite(force).any():
            continue
        result["forces"][name] = {
            "unit": robot.force_units[k],
            "mean": float(np.nanmean(force)),
            "rms": float(np.sqrt(np.nanmean(force**2))),
            "std": float(np.nanmedian(std)),
        }
    return result


def _say(measured: SensorLog, forces: ForceSamples, summary: dict[str, Any], note: str) -> None:
    """Print what was found, in words with units."""
    from patagium.report import Table
    from patagium.sensing.sensors import LoadCell

    for name, reading in measured.readings.items():
        made = ", ".join(reading.attrs.get("quantities", ()))
        typer.echo(f"{name}: {len(reading['time'])} samples" + (f" of {made}." if made else "."))
    typer.echo(note)
    for word in summary["notes"]:
        typer.echo(f"{word}.")
    for one in summary["noise"]:
        correlation, jitter, doubted = (one[key] for key in ("correlation", "jitter", "doubted"))
        noise = f"Noise of {one['sensor']}, {one['part']}: {one['std']:.3g} {one['unit']}"
        noise += f", correlated {correlation:.1f} from sample to sample" * (correlation > 0)
        noise += f", stamps uncertain by {1e3 * jitter:.2g} ms" * (jitter > 1e-5)
        typer.echo(noise + f", {doubted:.1%} of the samples doubted" * (doubted > 0) + ".")
    told = f"The motion is known in {summary['known']:.1%} of {summary['duration']:.6g} s"
    if "attitude_std" in summary:
        told += f", its attitude to {degrees(summary['attitude_std']):.2g} deg (median)"
    typer.echo(f"{told}.")
    if summary["stretches"]:
        rows: list[list[Any]] = [[*one.values()] for one in summary["stretches"]]
        columns = ["from [s]", "to [s]", "reason", "samples left out"]
        show_table(Table(columns, rows, "Left out or not known"))
    rows = [[name, *one.values()] for name, one in summary["forces"].items()]
    if rows:
        columns = ["coordinate", "unit", "mean", "rms", "standard deviation (median)"]
        show_table(Table(columns, rows, "Force of the air, gravity and inertia taken off"))
    silent = [name for name in forces.robot.dof_names if name not in forces.measured]
    if silent:
        typer.echo(f"No force is known of {', '.join(silent)}: nothing measures what drives them.")
    cells = [one for one in measured.sensors.values() if isinstance(one, LoadCell)]
    if cells and not forces.robot.floating_dofs:
        typer.echo(
            "The load cell is not used: its force is that on a body with `floating` in the robot "
            "file, whose pose the log has, if only constant columns of position and attitude."
        )
