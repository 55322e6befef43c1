"""Verb `patagium import`: a log of another program in SI units, our axes and one time base."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from patagium.cli.options import OUTPUT, FilesArgument, ResultOption, output_file
from patagium.cli.words import existing, progress_bar, say_json, say_next, tell, warn
from patagium.errors import PatagiumError, command

NAME = "import"
EXAMPLES = (
    "patagium import flight.ulg --map px4.yaml -o flight.nc",
    "patagium import recording_0.bag recording_1.bag --map rig.yaml",
    "patagium import flapping.csv --map columns.yaml -o packets.csv",
)


def import_log(
    files: FilesArgument,
    mapping: Annotated[
        Path, typer.Option("--map", "--mapping", help="Meaning of its columns or fields (YAML).")
    ],
    out: Annotated[
        Path | None, output_file("The log to write: .nc, or .csv for `stream`.", *OUTPUT)
    ] = None,
    as_json: ResultOption = False,
) -> None:
    """Bring a log of another program to SI units, our axes and one time base.

    Suspicious stamps, gaps, units and axes are reported before anything is computed from the log.
    The result is written whole or not at all. `docs/logs.md` has a mapping for each kind of file.
    """
    from patagium.cli.inspect import show_findings
    from patagium.sensing.logs.importing.import_log import import_log as bring

    target = out or Path(f"{files[0].name.partition('.')[0]}.nc")
    try:
        with progress_bar(f"Importing {files[0].name}") as progress:
            found = bring(
                files,
                existing(mapping),
                target,
                progress=progress,
                tell=lambda findings: show_findings(findings, err=True),
            )
    except KeyboardInterrupt:
        warn(f"interrupted; {target} is as it was before; repeat the command to import")
        raise typer.Exit(130) from None
    if as_json:
        say_json({**asdict(found), "path": str(found.path)})
        return
    typer.echo(f"{found.samples} samples over {found.duration:.6g} s: {found.time_base}.")
    if found.left_out:
        typer.echo(f"Samples left out because a quantity is missing: {found.left_out}.")
    typer.echo("Interpolated linearly, attitudes by slerp; axes are x forward, y left, z up.")
    for fact in found.facts:
        if "residual_rms" in fact:
            mean, spread, moved = (
                ", ".join(f"{value:.3g}" for value in fact[key])
                for key in ("residual_mean", "residual_std", "acceleration_rms")
            )
            typer.echo(
                f"{fact['specific_force']} in the world, less gravity, less the change of "
                f"{fact['velocity']} over {fact['span']:.3g} s: mean ({mean}), standard deviation "
                f"({spread}) m/s^2; the change itself is ({moved}) m/s^2 rms."
            )
    typer.echo(f"The log is in {found.path}")
    verbs = [command(f"patagium {verb} {{}}", found.path) for verb in _verbs(found.path)]
    change = "OUT to a .nc file" if found.path.suffix.lower() == ".csv" else str(mapping)
    say_next(*(verbs or [f"change {change}, then import again"]))


def _verbs(path: Path) -> list[str]:
    """Commands that can read an imported log; prints what the log lacks for `motion`."""
    from patagium.sensing import sensor_log
    from patagium.sensing.logs.record import LogRecord
    from patagium.sensing.motion.estimate_motion import coupled
    from patagium.sensing.motion.sensor_streams import streams_of

    if path.suffix.lower() == ".csv":
        with path.open(encoding="utf-8") as lines:
            names = next(line for line in lines if not line.startswith("#")).split(",")
        flown = {"q", "v", "a", "u1"} <= {name.partition(".")[0] for name in names}
        return ["stream --robot ROBOT"] * flown
    with LogRecord(path) as record:
        learns = record.is_flight or bool(record.of_role("output"))
        moves, robot, count = bool(record.of_role("channel")), record.robot, record.count
    if moves and robot is not None and not learns and count < 1e6:  # it is read again
        try:
            coupled(robot, streams_of(sensor_log(path), robot, {}))
        except PatagiumError as error:
            tell(f"patagium motion cannot take it yet: {error}")
            moves = False
    return ["identify"] * learns + ["motion" + " --robot ROBOT" * (robot is None)] * moves
