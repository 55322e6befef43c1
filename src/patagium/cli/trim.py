"""`patagium trim`: the periodic flight of a robot, and the gait that keeps it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from patagium.cli.estimates import GreyModel, air_class
from patagium.cli.outputs import Outputs
from patagium.cli.words import quantity

EXAMPLES = (
    "patagium trim aerobat",
    'patagium trim ornithopter --speed "7 m/s" -o trimmed.nc',
    "patagium trim dragonfly --speed 0 --free frequency --free fore_feather_offset --json",
)
PANELS = {"Air and flight": "aero density beats"}
_SPEED = {"parser": quantity("m/s", "a speed")}


def trim(
    robot: Annotated[str, typer.Argument(help="Preset (see patagium robots) or robot file.")],
    speed: Annotated[
        float | None,
        typer.Option(**_SPEED, help="Mean speed forward, in m/s; free by default, 0 hovers."),
    ] = None,
    climb: Annotated[
        float | None,
        typer.Option(**_SPEED, help="Mean speed upward, in m/s; 0 by default, free in a glide."),
    ] = None,
    turn_rate: Annotated[
        float,
        typer.Option(
            parser=quantity("rad/s", "a rate of turning"),
            help="Mean rate of the heading, positive to the left, in rad/s.",
        ),
    ] = 0.0,
    free: Annotated[
        list[str] | None,
        typer.Option(
            help="Gait parameter that may change, such as frequency or elevation_offset; by "
            "default the actuators of the robot's file, else all. Repeat it."
        ),
    ] = None,
    aero: Annotated[GreyModel, typer.Option(help="Model of the air.")] = GreyModel.QUASI_STEADY,
    density: Annotated[
        float,
        typer.Option(parser=quantity("kg/m^3", "a density"), help="Density of the air, in kg/m^3."),
    ] = 1.225,
    beats: Annotated[
        float, typer.Option(min=1e-3, help="Wingbeats of the flight that -o writes.")
    ] = 10.0,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File for a flight on the orbit (.nc).")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Periodic flight of a robot: gait, attitude, stability; or what it lacks."""
    from patagium import control
    from patagium.aerodynamics import Air
    from patagium.cli.words import answer, show_table
    from patagium.errors import PatagiumError
    from patagium.report.page import Table
    from patagium.robot import load_robot
    from patagium.simulation import gaits, save_flight

    machine = load_robot(robot)
    gait = gaits.cruise(machine)
    chosen = tuple(free) if free else control.free_parameters(machine, gait)
    level = 0.0 if gait.period else None
    if not as_json:
        kind = "Wingbeat" if gait.period else "Glide"
        typer.echo(
            f"{kind} of the file's cruise, {aero.value} air; free: {', '.join(chosen)}", err=True
        )
    model = air_class(aero)(machine, Air(density=density))
    orbit = control.trim(
        machine,
        model,
        gait,
        free=chosen,
        speed=speed,
        climb=level if climb is None else climb,
        turn_rate=turn_rate,
    )
    if not isinstance(orbit, control.Orbit):
        if as_json:
            answer(orbit.summary(), as_json=True)
        raise PatagiumError(repr(orbit))
    outputs, facts, found = Outputs(), orbit.summary(), orbit
    if output is not None:
        outputs.attempt(str(output), lambda: save_flight(found.flight(beats), output))
    title = f"Periodic flight of {machine.name}"
    modes = control.floquet(found).summary()
    if as_json:
        facts["modes"] = modes
    outputs.attempt("orbit on stdout", lambda: answer(facts, as_json=as_json, title=title))
    if not as_json:
        heads = [name.replace("_", " ") for name in modes[0]]
        rows = [["–" if cell is None else cell for cell in mode.values()] for mode in modes]
        outputs.attempt("modes on stdout", lambda: show_table(Table(heads, rows, "Modes")))
    outputs.check()
    words = f"view {output}" if output else f"trim {robot} -o trimmed.nc"
    if not as_json:
        typer.echo(f"Next: patagium {words}", err=True)
