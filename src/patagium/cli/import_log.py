"""`patagium import`: a log of another program as one of ours, in SI and our axes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from patagium.sensing.logs.importing.run import Imported

NAME = "import"
EXAMPLES = (
    "patagium import flight.ulg --map px4.yaml -o flight.nc",
    "patagium import recording_0.bag recording_1.bag --map rig.yaml",
    "patagium import flapping.csv --map columns.yaml -o packets.csv",
)


def import_log(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="A CSV, Parquet, MAT, ULog or MCAP file, a ROS bag, or the parts of a recording."
        ),
    ],
    mapping: Annotated[
        Path, typer.Option("--map", "--mapping", help="What its columns or fields mean (YAML).")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The log to write: .nc, or .csv for `stream`."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="What came of it, as JSON.")] = False,
) -> None:
    """Bring a log of another program to SI, our axes and one time base.

    What is suspicious (stamps, gaps, units, axes) is told before anything is computed from it.
    The log is written whole or not at all; after Ctrl-C the same command goes on where it was.
    `docs/logs.md` has a mapping for each kind of file.
    """
    from patagium.cli.inspect import show_findings
    from patagium.cli.words import existing, progress_bar, say_json
    from patagium.sensing.logs.importing.run import import_log as bring

    target = out if out is not None else Path(f"{files[0].name.partition('.')[0]}.nc")
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
        typer.echo("patagium: interrupted; the same command goes on from here", err=True)
        raise typer.Exit(130) from None
    if as_json:
        say_json(_facts(found))
        return
    if found.resumed:
        typer.echo(f"Went on from {found.resumed} rows read before.")
    typer.echo(f"{found.samples} samples over {found.duration:.6g} s: {found.time_base}.")
    if found.left_out:
        typer.echo(f"Left out, for lack of some quantity: {found.left_out} samples.")
    typer.echo("Numbers and vectors linearly, attitudes by slerp; x forward, y left, z up.")
    for fact in found.facts:
        if "residual_rms" in fact:
            mean, spread, moved = (
                ", ".join(f"{value:.3g}" for value in fact[key])
                for key in ("residual_mean", "residual_std", "acceleration_rms")
            )
            typer.echo(
                f"{fact['specific_force']} in the world, less gravity, less the change of "
                f"{fact['velocity']} over {fact['span']:.3g} s: mean ({mean}), deviation "
                f"({spread}) m/s^2; the change itself is ({moved}) m/s^2 rms."
            )
    typer.echo(f"The log is in {found.path}")


def _facts(found: Imported) -> dict[str, Any]:
    from dataclasses import asdict

    return {**asdict(found), "path": str(found.path)}
