"""`patagium trim`: the periodic flight of a robot, and the gait that keeps it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from patagium.cli import options
from patagium.cli.estimates import (
    AirOption,
    left_open,
    orbit_air,
    refuse_missing,
    tell_unseen,
)
from patagium.cli.options import option_in
from patagium.cli.outputs import Outputs
from patagium.cli.words import (
    for_person,
    heading,
    named_quantities,
    only_given,
    parts_of,
    progress_bar,
    say_json,
    show_table,
    tell,
)
from patagium.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

    from patagium.control import Branch

EXAMPLES = (
    "patagium trim aerobat",
    'patagium trim ornithopter --speed "7 m/s" -o trimmed.nc',
    "patagium trim aerobat --aero model.json",
    "patagium trim aerobat --along speed=2.5:6 --figure branch.svg",
    "patagium trim dragonfly --speed 0 --free frequency --free fore_feather_offset "
    "--free hind_feather_offset --json",
)
PANELS = {"Air and flight": "aero polar inflow density beats", "Branch of orbits": "along figure"}


def trim(
    robot: options.RobotArgument,
    speed: options.SpeedOption = None,
    climb: Annotated[
        float | None,
        option_in("m/s", "Mean speed upward, in m/s; 0 by default, free in a glide."),
    ] = None,
    turn_rate: Annotated[
        float,
        option_in("rad/s", "Mean rate of the heading, positive to the left, in rad/s."),
    ] = 0.0,
    free: Annotated[
        list[str] | None,
        typer.Option(
            help="Gait parameter that may change, such as frequency or elevation_offset; by "
            "default the actuators of the robot's file, else all. Repeat it."
        ),
    ] = None,
    aero: AirOption = "quasi-steady",
    polar: options.PolarOption = None,
    inflow: options.InflowOption = False,
    density: options.DensityOption = None,
    beats: Annotated[
        float, typer.Option(min=1e-3, max=1e4, help="Wingbeats of the flight that -o writes.")
    ] = 10.0,
    along: Annotated[
        str | None,
        typer.Option(
            help="Branch of orbits along speed, climb or a gait parameter, from one value to "
            "another, in SI units or with a unit: speed=2:6."
        ),
    ] = None,
    figure: Annotated[
        Path | None, options.output_file("File for a picture of the branch (.svg, .png, .pdf).")
    ] = None,
    output: options.OrbitOutput = None,
    as_json: options.JsonOption = False,
) -> None:
    """Periodic flight of a robot: gait, attitude, stability; or what it lacks."""
    from patagium import control
    from patagium.report.page import Table
    from patagium.robot import load_robot
    from patagium.simulation import gaits, save_flight

    if along is None and figure is not None:
        raise ParameterError("--figure", "a branch to draw, such as --along speed=2:6", None)
    machine = load_robot(robot)
    gait = gaits.cruise(machine)
    chosen = tuple(free) if free else control.free_parameters(machine, gait, turn_rate)
    if not as_json:
        kind = "Wingbeat" if gait.period else "Glide"
        air = ", ".join([f"{aero} air", *(f"polar {k}" for k in polar or ()), *["inflow"] * inflow])
        tell(f"{kind} of the file's cruise, {air}; free: {', '.join(chosen)}")
    hovers = speed == 0 and gait.period is not None
    model, added, learned = orbit_air(aero, machine, polar, inflow, density, hovers=hovers)
    asked = 0.0 if climb is None and gait.period else climb  # a glide's is free
    wanted = partial(control.trim, machine, gait=gait, free=chosen, turn_rate=turn_rate)
    search = partial(wanted, speed=speed, climb=asked)
    with progress_bar("Beats of the search, of 250 at most") as progress:
        orbit = search(model, added_mass=added, progress=progress)
    if not isinstance(orbit, control.Orbit):
        refuse_missing(orbit, as_json)
    tell_unseen(learned, orbit)
    unknown = left_open(learned, orbit, search)
    if along is not None:
        units = dict(zip(orbit.family.names, orbit.family.units, strict=True))
        name, limits = _range(along, {**units, "speed": "m/s", "climb": "m/s"})
        hold = tuple(only_given({"climb": asked, "speed": speed}))
        with progress_bar("Orbits of the branch, 400 at most") as progress:
            branch = control.continue_orbit(orbit, name, limits, hold=hold, progress=progress)
        _branch(branch, figure, as_json)
        return
    outputs, facts, found = Outputs(), orbit.summary(), orbit
    if output is not None:
        outputs.attempt(str(output), lambda: save_flight(found.flight(beats), output))
    modes = control.floquet(found).summary()
    if as_json:
        facts["modes"] = modes
        facts |= {"left_open": unknown} if unknown else {}
    outputs.answer("orbit", facts, as_json, f"Periodic flight of {machine.name}")
    if not as_json:
        heads = [heading(name) for name in modes[0]]
        rows = [["–" if cell is None else cell for cell in mode.values()] for mode in modes]
        outputs.attempt("modes", show_table, Table(heads, rows, "Modes"))
    outputs.check()
    if not as_json:
        told = f"patagium view {output}" if output else "the same with -o trimmed.nc, a flight"
        tell(f"Next: {told}")


def _range(words: str, units: Mapping[str, str]) -> tuple[str, tuple[float, float]]:
    """Name of a parameter and its limits [unit by name], from words such as "speed=2:6 m/s"."""
    name, _, rest = words.partition("=")
    ends, unit = parts_of(rest, ":"), units.get(name, "").removesuffix("1")
    if len(ends) != 2:
        raise ParameterError("--along", "a name and two values: speed=2:6", words)
    told = [named_quantities("--along", [f"{name}={one}"], unit, "a value") for one in ends]
    low, high = sorted(one[name] for one in told)
    return name, (low, high)


def _branch(found: Branch, figure: Path | None, as_json: bool) -> None:
    """Table and picture of a branch."""
    from patagium.report.page import Table
    from patagium.report.style import styled

    outputs, rows = Outputs(), found.summary()
    outputs.draw(figure, lambda _: styled(_picture)(found))
    if as_json:
        points = [
            {"kind": one.kind, "value": one.value, "multiplier": abs(one.multiplier)}
            for one in found.bifurcations
        ]
        say_json({"orbits": rows, "bifurcations": points, "ends": [*found.ends]})
    else:
        told = [for_person(row) for row in rows]
        show_table(Table([*told[0]], [[*row.values()] for row in told], repr(found)))
    outputs.check()


def _picture(found: Branch) -> Figure:
    """Figure of the free parameters and of the largest multipliers along a branch."""
    import numpy as np

    from patagium.report.style import color, dash, panels

    family = found.orbits[0].family
    units = dict(zip(family.names, family.units, strict=True))
    changing = [name for name in found.free if name != found.along]
    figure, axes = panels(len(changing) + 1, 1, row_height=1.8)
    for panel, name in zip(axes[:, 0], changing, strict=False):
        panel.plot(found.values, [one.parameters[name] for one in found.orbits], ".-")
        for one in found.bifurcations:
            panel.plot(one.value, one.orbit.parameters[name], "s", color=color(0))
        panel.set_ylabel(f"{name} [{units[name]}]".replace("_", "\n"))
    last, sizes = axes[-1, 0], np.abs(found.multipliers)
    last.plot(found.values, sizes[:, 1:4], color=color(2), linestyle=dash(1))
    last.plot(found.values, sizes[:, 0], ".-")
    last.axhline(1.0, color="0.5", linewidth=0.8)
    for k, one in enumerate(found.bifurcations):
        size = abs(one.multiplier)
        last.plot(one.value, size, "s", color=color(0))
        last.annotate(
            one.kind, (one.value, size), textcoords="offset points", xytext=(6, 5 - 18 * k)
        )
    last.set_xlabel(f"{found.along} [{found.unit}]")
    last.set_ylabel("largest\nmultipliers [1]")
    return figure
