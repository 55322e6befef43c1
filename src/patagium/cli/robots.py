"""`patagium robots`: which robots there are, what they weigh, how they look."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from patagium.cli.check import robot_facts
from patagium.cli.options import JsonOption, output_file
from patagium.cli.outputs import Outputs
from patagium.cli.words import say_json, say_next, show_table, tell
from patagium.errors import ParameterError, command

EXAMPLES = (
    "patagium robots",
    "patagium robots aerobat --draw aerobat.png",
    "patagium robots my-robot.yaml --json",
    "patagium robots --new my_robot",
)
ALONE = {"--new": ["my_robot"]}
"""Value of an option that is the last word."""


def robots(
    robot: Annotated[
        str | None, typer.Argument(help="Preset, robot file or URDF; all presets by default.")
    ] = None,
    draw: Annotated[
        Path | None, output_file("Draw it from above, behind and the left, as .png or .svg.")
    ] = None,
    new: Annotated[
        str | None,
        typer.Option(help="Name of a robot, written as NAME.yaml: a commented file to change."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the robots that come along, describe and draw one, or write the file of a new one."""
    from patagium.report import Table
    from patagium.robot import load_robot, preset_names, write_template
    from patagium.robot.planform import describe_robot

    if new is not None:
        if robot or draw:
            raise ParameterError("--new", "no other option with it", str(robot or draw))
        file = write_template(new)
        typer.echo(f"Written: {file}, a robot of two wings and a tail that flies; change it")
        drawn = command("patagium robots {} --draw {}", file, f"{file.stem}.png")
        say_next(drawn, command("patagium simulate {}", file))
        return
    if robot is not None:
        machine, outputs = load_robot(robot), Outputs()
        if draw is not None:
            from patagium.robot.drawing import draw_robot

            if outputs.draw(draw, lambda _: draw_robot(machine), "drawing"):
                tell(f"Drawn in {draw}")
        outputs.answer("facts", robot_facts(machine), as_json)
        outputs.check()
        return
    if draw is not None:
        raise ParameterError("--draw", "the name of one robot before it", str(draw))
    found = [describe_robot(load_robot(name)) for name in preset_names()]
    if as_json:
        say_json(found)
    else:
        heads = ["robot", "joints", "wings", "strips", "mass [kg]", "span [m]", "wing area [m^2]"]
        show_table(Table(heads, [[facts[head] for head in heads] for facts in found]))
        say_next("patagium robots aerobat --draw aerobat.png", "patagium simulate aerobat")
