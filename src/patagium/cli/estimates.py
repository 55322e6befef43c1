"""Grey boxes on the command line: estimated numbers, their prior standard deviations, models."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn, TypeAlias, get_args

import typer

from patagium.cli.words import named_quantities, only_given, say_json, tell, warn
from patagium.errors import LogError, ParameterError, PatagiumError, similar

if TYPE_CHECKING:
    import xarray as xr

    from patagium.aerodynamics import AddedMass, Aerodynamics, Air
    from patagium.control import NoOrbit, Orbit
    from patagium.learning import Identification
    from patagium.learning.model_file import Model
    from patagium.robot import Robot


DRAWS = 8
"""Draws of learned weights for the uncertainty of an orbit."""
DENSITY = 1.225
"""Density of the air where none is given [kg/m^3]."""
GreyModel: TypeAlias = Literal["quasi-steady", "lifting-line", "delaurier"]
"""Models of the air whose numbers can be learned."""


def air_word(text: str) -> str:
    """A model of the air as an option names it: by its word, or by the file of a learned one.

    Raises:
        ValueError: If it is neither.
    """
    known = get_args(GreyModel)
    if text not in known and not text.endswith(".json"):
        expected = f"{', '.join(known)}, or a model (.json) that patagium identify wrote"
        raise ValueError(f"expected {expected}, found {text!r}{similar(text, known)}")
    return text


AirOption: TypeAlias = Annotated[
    str,
    typer.Option(
        parser=air_word,
        metavar="<quasi-steady|lifting-line|delaurier|FILE>",
        help="Model of the air; FILE: a learned one (.json), that identify wrote.",
    ),
]
EstimateOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        help="Numbers of the air or the robot to estimate, each with its prior standard "
        'deviation: "section.lift_slope=0.5,lags.rate[0]=0.02"; may be repeated.'
    ),
]
AeroOption: TypeAlias = Annotated[
    GreyModel | None,
    typer.Option(
        help="Model of the air for --estimate; by default that of the flight, quasi-steady for an "
        "imported log."
    ),
]


RefineOption: TypeAlias = Annotated[
    bool | None,
    typer.Option(
        "--refine/--no-refine",
        help="Least squares over the whole flight after the one pass: estimates and standard "
        "deviations that do not depend on the order of the samples; by default with --estimate.",
    ),
]


def check_estimate(
    words: Sequence[str] | None, aero: GreyModel | None, refine: bool | None, is_flight: bool
) -> None:
    """Refuse --estimate for a table, and what goes with it without it.

    Raises:
        ParameterError: If they do not go together.
    """
    for name, value in {"--aero": aero, "--refine": refine}.items():
        if value is not None and not words:
            raise ParameterError(name, "--estimate to go with it", value)
    if words and not is_flight:
        raise ParameterError("--estimate", "a flight (.nc), which has a robot", ", ".join(words))


def grey_box(flight: xr.Dataset, words: Sequence[str], aero: GreyModel | None) -> Any:
    """Grey box for a flight or an imported log of one.

    Its air begins at rest where the air of the flight does. Added mass is part of the model
    if its factor is estimated.

    Args:
        flight: Flight.
        words: Prior standard deviations, NAME=VALUE, in each word one or several.
        aero: Model of the air; None: that of the flight, quasi-steady for a log.

    Raises:
        ParameterError: If a word is not NAME=VALUE, there is no such name, or it comes twice.
    """
    from patagium.aerodynamics import AddedMass
    from patagium.learning import GreyBox
    from patagium.learning.models.physical import FACTOR, numbers_of, written_unit
    from patagium.simulation import added_mass_of

    parts = [part for word in words for part in word.split(",")]
    model = _model(flight, aero)
    known = numbers_of(model, None) | {FACTOR: 1.0}
    unit = partial(written_unit, numbers=known, robot=model.robot)
    estimate = named_quantities("--estimate", parts, unit, "a standard deviation")
    added = None
    if FACTOR in estimate:
        added = added_mass_of(flight) or AddedMass(model.robot, model.air)
    still = "aero_state" in flight and not flight["aero_state"].values[0].any()
    start: Any = "still" if still and model.state_size else "steady"
    return GreyBox(model, estimate, added, start=start)


def refined(
    result: Identification, flight: xr.Dataset, every: int, before: Model | None
) -> Identification:
    """Identification whose model comes from least squares over the whole flight.

    Args:
        result: Identification by a learner of this flight, which then goes on from that model.
        flight: Flight.
        every: Stride of the samples that are used.
        before: Model of the flights learned before; None if there are none.
    """
    from patagium.learning import refine
    from patagium.learning.parameter_paths import parameter_scores
    from patagium.learning.verdict import with_verdict

    model: Any = refine(result.learner, flight, every=every, before=before)
    result.learner.go_on_from(model.weights, model.covariance)
    scores = {key: one for key, one in result.scores.items() if key != "parameter_problem"}
    return replace(result, scores=with_verdict(scores | parameter_scores(model)), learner=model)


def _model(flight: xr.Dataset, aero: GreyModel | None) -> Aerodynamics:
    """Model of the air: that of the flight if none is chosen, or none for a log."""
    from patagium.simulation import aero_of, air_of, robot_of

    own = None if "air" in flight.attrs else aero_of(flight)
    if own is not None and (aero is None or isinstance(own, air_class(aero))):
        return own
    if aero is None:
        aero = "quasi-steady"
        tell(f"Model of the air: {aero}; --aero takes another.")
    return air_class(aero)(robot_of(flight), air_of(flight))  # type: ignore[no-any-return]


def air_class(word: str) -> Any:
    """Class of a model of the air."""
    from patagium.aerodynamics import DeLaurier, LiftingLine, QuasiSteady

    return {one.name.replace("_", "-"): one for one in (QuasiSteady, LiftingLine, DeLaurier)}[word]


def chosen_air(
    word: str,
    machine: Robot,
    polars: Sequence[str] | None = None,
    inflow: bool = False,
    usual: float = DENSITY,
    factor: float | None = None,
    **given: Any,
) -> tuple[Aerodynamics, AddedMass | None, Model | None]:
    """Model of the air around a robot, its added mass, and the learned model that both are of.

    Args:
        word: As `air_word` reads it.
        machine: The robot.
        polars: As `air_model` takes them.
        inflow: Whether wings meet the air that they have thrown down.
        usual: Density of a model that was not learned, where none is given [kg/m^3].
        factor: Factor of the added mass; None for none.
        **given: Density, wind and ground [SI]; None: the model's density, still air, no ground.

    Raises:
        LogError: If the file is no learned model.
        ParameterError: If the learned model is none of the air around this robot, or has no such
            options.
    """
    from patagium.aerodynamics import AddedMass, Air
    from patagium.learning import load_model

    known = only_given(given)
    if not word.endswith(".json"):
        found = air_model(word, machine, Air(**{"density": usual, **known}), polars, inflow)
        carried = None if factor is None else AddedMass(machine, found.air, factor=factor)
        return found, carried, None
    if factor is not None:
        raise ParameterError("added_mass", "nothing with a learned model, which has it", factor)
    if polars or inflow:
        raise ParameterError("--polar, --inflow", "nothing beside a learned model", word)
    model = load_model(word)
    if not hasattr(model.network, "air_at"):
        expected = "a model of the air, which patagium identify makes of a flight of a robot with "
        kind = model.network.describe().get("kind")
        raise LogError(word, f"{expected}wings (network linear_strip)", f"a network of kind {kind}")
    learned, _ = model.air(machine)
    air = replace(learned.air, **{"wind": Air().wind, **known})
    told = f"Air of {word}, learned from {model.source or 'a log'}: {air.density:.4g} kg/m^3"
    told += f", wind {air.wind} m/s" * any((*air.wind, *learned.air.wind))
    other = f"; the log's wind was {learned.air.wind} m/s" * (air.wind != learned.air.wind)
    tell(told + other)
    return *model.air(machine, air), model


def orbit_air(
    word: str,
    machine: Robot,
    polars: Sequence[str] | None,
    inflow: bool,
    density: float | None,
    *,
    hovers: bool,
) -> tuple[Aerodynamics, AddedMass | None, Model | None]:
    """Air at rest for an orbit; warnings are printed of what it neglects of this robot."""
    from patagium.simulation.flight_summary import BUOYANT, HINGED, LIQUID, NO_INFLOW, hinged_strips

    found = chosen_air(word, machine, polars, inflow, density=density)
    if hovers and not inflow and found[2] is None:
        warn(NO_INFLOW)
    if word == "quasi-steady" and (turned := hinged_strips(machine)):
        warn(HINGED.format(machine.strips[turned[0]].wing))
    if machine.gravity and found[0].air.density > LIQUID:
        warn(BUOYANT)
    return found


def refuse_missing(found: Any, as_json: bool) -> NoReturn:
    """Say why no orbit or gait was found; its `summary` goes to stdout for a program.

    Raises:
        PatagiumError: Always, with what it tells of itself.
    """
    if as_json:
        say_json(found.summary())
    raise PatagiumError(repr(found))


def tell_unseen(learned: Model | None, orbit: Orbit) -> None:
    """Print the share of the flow of an orbit in learned air that the log did not have."""
    if learned is None:
        return
    from patagium.learning import evaluate
    from patagium.learning.verdict import UNSEEN

    share = evaluate(orbit.flight(beats=1.0), learned).scores.get("unseen_share")
    if share is not None:
        guess = ": there the learned air is a guess" if share > UNSEEN else ""
        tell(f"{100 * share:.0f} % of this flow was not learned{guess}.")


def left_open(
    learned: Model | None, orbit: Orbit, search: Callable[..., Orbit | NoOrbit]
) -> dict[str, float]:
    """Uncertainty of the gait of an orbit in learned air, which is also printed.

    Root mean square of what the same search finds with weights that are drawn instead.

    Args:
        learned: Learned model of its air; None where it was not learned.
        orbit: Orbit with the learned weights.
        search: The search that found it, of the model of the air and `added_mass`.

    Returns:
        By parameter of the gait [its unit]; empty where the air was not learned, the model has no
        covariance, or no draw an orbit.
    """
    import numpy as np

    from patagium.control import Orbit

    if learned is None or learned.kept_covariance is None:
        return {}
    apart, flown = [], (orbit.robot, orbit.aero.air)
    try:
        for seed in range(DRAWS):
            air, added_mass = learned.draw(seed, *flown).air(*flown)
            found = search(air, added_mass=added_mass)
            if isinstance(found, Orbit):
                apart.append([found.parameters[name] - x for name, x in orbit.parameters.items()])
    except ParameterError as refused:
        tell(f"What the log leaves open of this orbit is not known: {refused}.")
        return {}
    lost = f"{DRAWS - len(apart)} of {DRAWS} have no such orbit"
    if not apart:
        tell(f"The log leaves open whether this orbit exists: {lost}.")
        return {}
    sizes = np.sqrt(np.mean(np.square(apart), axis=0)).tolist()
    units = dict(zip(orbit.family.names, orbit.family.units, strict=True))
    named = zip(orbit.parameters, sizes, strict=True)
    told = [f"{name} {size:.2g} {units[name].removesuffix('1')}".strip() for name, size in named]
    tell(
        f"What is learned leaves this orbit uncertain. Of {DRAWS} trims with other weights that "
        f"the log allows, {len(apart)} found an orbit, and these differ from it by (rms): "
        f"{', '.join(told)}."
    )
    return dict(zip(orbit.parameters, sizes, strict=True))


def air_model(
    word: str, machine: Robot, air: Air, polars: Sequence[str] | None = None, inflow: bool = False
) -> Aerodynamics:
    """Model of the air around a robot, with polars given by their names or by their files.

    Raises:
        ParameterError: If the polar is not one of the model, or has the viscosity of other air.
    """
    from patagium import aerodynamics as models

    kind, key = air_class(word), {"quasi-steady": "polar", "lifting-line": "section"}.get(word, "")
    if polars and not key:
        expected = f"none with {word}, whose strips have no polar: take --aero quasi-steady or "
        expected += "lifting-line, or in Python pt.DeLaurier(stall_angle=..., lift_slope=...)"
        raise PatagiumError("--polar", expected, polars[0])
    wings = machine.wing_names
    given: dict[str, Any] = {}
    named = {one.name: one for one in (models.DickinsonPolar, models.ReynoldsPolar)}
    for text in polars or ():
        name, equals, rest = text.partition("=")
        wing, polar = (name, rest) if name in wings else ("", text)
        if key == "polar" and polar in named:
            given[wing] = named[polar]()
        elif key == "polar" and Path(polar).is_file():
            given[wing] = models.measured_polar(*models.read_polar(polar)[:3])
        elif key == "section" and polar not in named:
            given[wing] = models.measured_section(*models.read_polar(polar))
        else:
            expected = f"{', '.join(named)} or a file of a polar (with --aero lifting-line a file)"
            expected += f", for one wing alone as {wings[0] if wings else 'WING'}=FILE"
            found = f"no wing {name!r}" if equals else f"{text!r}, which is no file here"
            raise PatagiumError("--polar", expected, f"{found} (wings: {', '.join(wings)})")
    viscous = any(isinstance(one, models.ReynoldsPolar) for one in given.values())
    if viscous and not 0.5 <= air.density <= 2.0:
        expected = "0.5 to 2 kg/m^3 with reynolds, which has the viscosity of air (of another: "
        expected += "pt.air.ReynoldsPolar(viscosity=...) in Python)"
        raise ParameterError("--density", expected, air.density)
    chosen: dict[str, Any] = {key: given[""]} if "" in given else {}
    if {*given} - {""}:
        others = given.get("") or getattr(kind(machine, air), key)
        own = {*wings} - {image for _, image in machine.mirrored_wings} | {*given} - {""}
        chosen[key] = {wing: given.get(wing, others) for wing in wings if wing in own}
    made: Aerodynamics = kind(machine, air, **chosen)
    return models.Inflow(made) if inflow else made
