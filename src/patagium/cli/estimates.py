"""Grey boxes on the command line: which numbers, how far they may be off, of which model."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from patagium.cli.words import quantity

if TYPE_CHECKING:
    import xarray as xr

    from patagium.aerodynamics import Aerodynamics
    from patagium.learning import Identification
    from patagium.learning.models.network import Network


class GreyModel(StrEnum):
    """Models of the air whose numbers can be learned."""

    QUASI_STEADY = "quasi-steady"
    LIFTING_LINE = "lifting-line"
    DELAURIER = "delaurier"


EstimateOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        help="Learn numbers of the air or the robot, each with its prior deviation: "
        '"section.lift_slope=0.5,lags.rate[0]=0.02" (also repeated). With --network, a network '
        "beside them learns the rest."
    ),
]
AeroOption: TypeAlias = Annotated[
    GreyModel | None,
    typer.Option(help="Model of the air for --estimate; by default that of the flight."),
]


RefineOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--refine",
        help="Then least squares over the whole flight: numbers of --estimate, and deviations, "
        "that do not depend on the way there.",
    ),
]


def check_estimate(
    words: Sequence[str] | None, aero: GreyModel | None, refine: bool, is_flight: bool
) -> None:
    """Refuse --estimate for a table, and what goes with it without it.

    Raises:
        ParameterError: If they do not go together.
    """
    from patagium.errors import ParameterError

    if aero is not None and not words:
        raise ParameterError("--aero", "--estimate to go with it", aero.value)
    if refine and not words:
        raise ParameterError("--refine", "--estimate to go with it", refine)
    if words and not is_flight:
        raise ParameterError("--estimate", "a flight (.nc), which has a robot", ", ".join(words))


def stds(words: Sequence[str]) -> dict[str, float]:
    """Prior deviations by name, in SI, from words such as "wing[0].chord=5 mm".

    Args:
        words: Each one or several, separated by commas.

    Raises:
        ParameterError: If a word is not NAME=DEVIATION, or a name comes twice.
    """
    from patagium.errors import ParameterError
    from patagium.learning.models.physical import written_unit

    found: dict[str, float] = {}
    for word in (part.strip() for given in words for part in given.split(",")):
        name, equals, value = (part.strip() for part in word.partition("="))
        if not (name and equals and value):
            expected = "NAME=DEVIATION such as section.lift_slope=0.5"
            raise ParameterError("--estimate", expected, word)
        if name in found:
            raise ParameterError("--estimate", f"{name} once", word)
        try:
            found[name] = quantity(written_unit(name), "a deviation")(value)
        except typer.BadParameter as error:
            raise ParameterError(f"--estimate {name}", error.message, value) from None
    return found


def grey_box(
    flight: xr.Dataset, words: Sequence[str], aero: GreyModel | None, beside: Network | None
) -> Any:
    """A grey box for a flight.

    It begins still where the flight's own air does. Added mass is part of what it explains
    if its factor is asked for.

    Args:
        flight: The flight.
        words: See `deviations`.
        aero: Model of the air; None for the flight's own.
        beside: Network that learns the rest, or None.
    """
    from patagium.aerodynamics import AddedMass
    from patagium.learning import GreyBox
    from patagium.learning.models.physical import FACTOR
    from patagium.simulation import added_mass_of

    estimate, model = stds(words), _model(flight, aero)
    added = None
    if FACTOR in estimate:
        added = added_mass_of(flight) or AddedMass(model.robot, model.air)
    still = "aero_state" in flight and not flight["aero_state"].values[0].any()
    start: Any = "still" if still and model.state_size else "steady"
    return GreyBox(model, estimate, added, beside, start=start)


def refined(result: Identification, flight: xr.Dataset, every: int) -> Identification:
    """Identification refined by least squares over the whole flight.

    Args:
        result: Of a learner of this flight.
        flight: The flight.
        every: One sample in so many counts.
    """
    from dataclasses import replace

    from patagium.learning import refine
    from patagium.learning.identify import samples
    from patagium.learning.parameter_paths import estimates_of, parameter_scores

    time, x, y, _ = samples(flight, result.learner.network)
    model = refine(result.learner, time, x, y, every=every)
    return replace(
        result, scores=result.scores | parameter_scores(estimates_of(model)), learner=model
    )


def _model(flight: xr.Dataset, aero: GreyModel | None) -> Aerodynamics:
    from patagium.aerodynamics import DeLaurier, LiftingLine, QuasiSteady
    from patagium.simulation import aero_of

    own = aero_of(flight)
    makes: dict[GreyModel, Any] = {
        GreyModel.QUASI_STEADY: QuasiSteady,
        GreyModel.LIFTING_LINE: LiftingLine,
        GreyModel.DELAURIER: DeLaurier,
    }
    if aero is not None and not isinstance(own, makes[aero]):
        own = makes[aero](own.robot, own.air)
    return own
