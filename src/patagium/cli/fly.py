"""`patagium fly`: a closed loop of truth, estimate, controller and events becomes a flight."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from patagium.cli.options import DrawingOption, DurationOption, FlightOutput, JsonOption
from patagium.cli.words import only_given, progress_bar, tell

EXAMPLES = (
    "patagium fly ornithopter",
    "patagium fly plan.yaml -o flown.nc",
    'patagium fly aerobat --duration "5 s" --seed 3 --json',
)


def fly(
    plan: Annotated[
        str,
        typer.Argument(help="Plan (.yaml); or a preset or robot file, and the rest is chosen."),
    ],
    duration: DurationOption = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of noise and of what is off in the truth.")
    ] = None,
    output: FlightOutput = Path("flown.nc"),
    figure: DrawingOption = None,
    as_json: JsonOption = False,
) -> None:
    """Fly a robot in a closed loop, in a truth that its controller does not know.

    With a robot's name alone it is trimmed, flown by the predictive controller with noise-free
    states, and disturbed by a gust after a third of the flight; `docs/control.md` has a plan.
    A flight that breaks, or is ended by Ctrl-C, is kept up to there, in FILE.partial.nc, which
    replaces an earlier one; the exit code is then 2 or 130.
    """
    from patagium.cli.interruption import interruptible
    from patagium.cli.plan import load_plan, prepared
    from patagium.cli.simulate import keep

    changed = only_given({"duration": duration, "seed": seed})
    ready = prepared(load_plan(plan).model_copy(update=changed))
    if not as_json:
        for sentence in ready.words:
            tell(sentence)
    with progress_bar("Flying") as bar, interruptible(bar) as progress:
        flight = ready.fly(progress)
    if not as_json:
        tell(str(flight.attrs["controller"]))
    keep(flight, output, figure, as_json)
