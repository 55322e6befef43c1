"""`patagium optimize`: the gait of least power, least energy a meter, or greatest speed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from patagium.cli import options
from patagium.cli.estimates import AirOption, orbit_air, refuse_missing, tell_unseen
from patagium.cli.options import option_in
from patagium.cli.outputs import Outputs
from patagium.cli.words import Numbers, numbers, progress_bar, say_json, show_table, tell
from patagium.errors import ParameterError, PatagiumError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from patagium.control import OptimalGait

EXAMPLES = (
    'patagium optimize ornithopter --speed "4 m/s" -o best.nc --gait best.csv',
    "patagium optimize aerobat --goal range --harmonics 2",
    "patagium optimize ornithopter --front 3,4,5,6 --figure front.svg",
)
MOST_SPEEDS = 100
"""Speeds of a front, each of which takes some optimizations."""
PANELS = {"Air and flight": "climb aero polar inflow density", "Files": "output beats gait figure"}


def optimize(
    robot: options.RobotArgument,
    speed: options.SpeedOption = None,
    climb: Annotated[float, option_in("m/s", "Mean speed upward, in m/s.")] = 0.0,
    goal: Annotated[
        Literal["power", "range", "speed"],
        typer.Option(help="Least mean power, least energy a meter, or greatest speed."),
    ] = "power",
    harmonics: Annotated[
        int, typer.Option(min=1, help="Order of the Fourier series of the joints.")
    ] = 3,
    free: Annotated[
        list[str] | None,
        typer.Option(
            help="Gait parameter that may change, such as frequency or plunge_sine_2; by default "
            "those of the actuators, else of all joints with limits. Repeat it."
        ),
    ] = None,
    front: Annotated[
        Numbers | None,
        typer.Option(parser=numbers, help="Speeds of a front of speed and power, in m/s."),
    ] = None,
    aero: AirOption = "quasi-steady",
    polar: options.PolarOption = None,
    inflow: options.InflowOption = False,
    density: options.DensityOption = None,
    output: options.OrbitOutput = None,
    beats: Annotated[
        float, typer.Option(min=1e-3, max=1e4, help="Wingbeats of that flight.")
    ] = 10.0,
    gait: Annotated[
        Path | None, options.output_file("File for the gait (.csv), as simulate --gait takes it.")
    ] = None,
    figure: Annotated[
        Path | None, options.output_file("File for a picture of the front (.svg, .png, .pdf).")
    ] = None,
    as_json: options.JsonOption = False,
) -> None:
    """Optimal gait of a periodic flight within the limits of joints and actuators.

    Power is mechanical, and what a joint takes back counts as recovered. With --front, gaits of
    least power at several speeds, compared with the best sinusoids.
    """
    from patagium import control
    from patagium.robot import load_robot
    from patagium.simulation import gaits, save_flight

    if front is None and figure is not None:
        raise ParameterError("--figure", "--front with the speeds of the picture", None)
    machine = load_robot(robot)
    model, added, learned = orbit_air(aero, machine, polar, inflow, density, hovers=speed == 0)
    asked: dict[str, Any] = {"climb": climb, "harmonics": harmonics, "added_mass": added}
    if front is not None:
        if speed is not None or output is not None or gait is not None or goal != "power":
            raise ParameterError("--front", "no --speed, --goal, --output or --gait with it", front)
        if len(front) > MOST_SPEEDS:
            raise ParameterError("--front", f"at most {MOST_SPEEDS} speeds", len(front))
        _front(control.power_front(machine, front, model, **asked), figure, as_json)
        return
    asked |= {"speed": speed, "goal": goal} | ({"free": free} if free else {})
    if not as_json:
        tell("Searching a trimmed flight, then its best gait; many joints take minutes.")
    with progress_bar("Iterations, of 200 at most") as progress:
        found = control.optimize(machine, model, progress=progress, **asked)
    if not isinstance(found, control.OptimalGait):
        refuse_missing(found, as_json)
    tell_unseen(learned, found.orbit)
    outputs, best = Outputs(), found.orbit
    if output is not None:
        outputs.attempt(str(output), lambda: save_flight(best.flight(beats), output))
    if gait is not None:
        outputs.attempt(str(gait), gaits.to_csv, machine, best.gait, gait)
    outputs.answer("gait", found.summary(), as_json, f"Optimal gait of {machine.name}")
    outputs.check()
    if not as_json:
        again = "the same with -o best.nc --gait best.csv, a flight and its gait"
        tell(f"Next: {f'patagium view {output}' if output else again}")


def _front(found: list[tuple[float, Any]], figure: Path | None, as_json: bool) -> None:
    """Table and picture of a front."""
    from patagium.report.page import Table
    from patagium.report.style import styled

    gaits = [(speed, gait) for speed, gait in found if gait.found]
    heads = ("speed [m/s]", "power [W]", "best sinusoid [W]", "saved [%]", "frequency [Hz]")
    rows = [
        (speed, one.power, sine := one.sinusoid.power if one.sinusoid else float("nan"),
         100 * (1 - one.power / sine), one.orbit.gait.frequency)
        for speed, one in gaits
    ]  # fmt: skip
    outputs = Outputs()
    outputs.draw(figure if gaits else None, lambda _: styled(_picture)(gaits))
    if as_json:
        say_json([dict(zip(heads, row, strict=True)) for row in rows])
    else:
        show_table(Table(heads, rows, "Least mean power over speed"))
    for speed, one in found:
        if not one.found:
            tell(f"{speed:g} m/s: {one!r}")
    if not gaits:
        raise PatagiumError("no gait was found at any of these speeds")
    outputs.check()


def _picture(gaits: list[tuple[float, OptimalGait]]) -> Figure:
    """Figure of the least power over speed, and that of the best sinusoids."""
    from patagium.report.style import color, dash, legend_above, panels

    figure, axes = panels(1, 1, row_height=3.0)
    panel = axes[0, 0]
    speeds = [speed for speed, _ in gaits]
    kinds = {
        f"{gaits[0][1].harmonics} harmonics": [one.power for _, one in gaits],
        "best sinusoid": [one.sinusoid and one.sinusoid.power for _, one in gaits],
    }
    for k, (name, powers) in enumerate(kinds.items()):
        panel.plot(speeds, powers, "o", label=name, color=color(k), linestyle=dash(k))
    panel.set_xlabel("speed [m/s]")
    panel.set_ylabel("mean mechanical power [W]")
    panel.set_ylim(bottom=0.0)
    legend_above(figure, panel)
    return figure
