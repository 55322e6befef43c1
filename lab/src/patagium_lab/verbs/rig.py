"""`patagium study rig`: arm, robot and sensors; a model of the air, learned from logs alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from patagium.cli.words import quantity
from patagium_lab.verbs.options import ResultsPageOption, write_reports

EXAMPLES = (
    "patagium study rig --out rig",
    "patagium study rig --out rig --page docs/rig.md",
    'patagium study rig --out slow --noise 1 --frequency "4 Hz" --speed "1.5 m/s" --quick',
)


def rig(
    out: Annotated[Path, typer.Option(help="Folder of the report, its logs, models and truth.")],
    robot: Annotated[
        str, typer.Option(help="Preset or file of a robot with plunge and elbow on either side.")
    ] = "aerobat",
    noise: Annotated[
        str, typer.Option(help="Errors of all instruments over their data sheets': 0,1,2,4.")
    ] = "0,1,2,4",
    frequency: Annotated[
        float, typer.Option(parser=quantity("Hz", "a frequency"), help="Wingbeat frequency, in Hz.")
    ] = 5.0,
    speed: Annotated[
        float,
        typer.Option(parser=quantity("m/s", "a speed"), help="Largest speed of the arm, in m/s."),
    ] = 2.0,
    wind: Annotated[
        float,
        typer.Option(parser=quantity("m/s", "a speed"), help="Wind against the nose, in m/s."),
    ] = 3.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the instruments' errors.")] = 0,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="One eight of the arm, without the study of what limits the forces."
        ),
    ] = False,
    page: ResultsPageOption = None,
) -> None:
    """Run the rig: fly on an arm, sense, learn the air from logs alone, compare with the truth.

    Writes report.html, metrics.json, logs/, models/, truth/ and figures/.
    """
    from patagium_lab.rig import page as pages
    from patagium_lab.rig.plan import RigPlan
    from patagium_lab.rig.run import run

    plan = RigPlan(
        robot=robot,
        frequency=frequency,
        speed=speed,
        wind=wind,
        noise=_factors(noise),
        seed=seed,
        **({"eights": 1.0, "limits": ()} if quick else {}),  # type: ignore[arg-type]
    )
    write_reports("Rig", out, plan, run, pages.page, page, pages.RESULTS)


def _factors(text: str) -> tuple[float, ...]:
    """Numbers from text such as "0,1,2,4".

    Raises:
        ParameterError: If a word is not a number.
    """
    from patagium.errors import ParameterError

    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise ParameterError("--noise", "numbers such as 0,1,2,4", text) from None
