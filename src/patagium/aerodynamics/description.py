"""A model of the air from its description, as stored with every flight."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

from patagium.aerodynamics.air import air_from_description
from patagium.aerodynamics.delaurier import DeLaurier
from patagium.aerodynamics.indicial import Indicial
from patagium.aerodynamics.inflow import Inflow
from patagium.aerodynamics.learned_air import LearnedAir
from patagium.aerodynamics.lifting_line import LiftingLine
from patagium.aerodynamics.linear_strips import LinearStrips
from patagium.aerodynamics.model import Aerodynamics
from patagium.aerodynamics.named_descriptions import check_keys, field_values, from_field_values
from patagium.aerodynamics.on_model import OnModel
from patagium.aerodynamics.polars import polar_from_description
from patagium.aerodynamics.quasi_steady import QuasiSteady
from patagium.aerodynamics.sections import MeasuredSection, Section, StallDelay, StripSection
from patagium.aerodynamics.wind_shear import WindShear
from patagium.errors import ParameterError
from patagium.plugins import AIR_MODELS, plugin
from patagium.robot.model import Robot

_MODELS: dict[str, Any] = {
    kind.name: kind for kind in (QuasiSteady, DeLaurier, LiftingLine, LinearStrips)
}
_ON_MODEL: dict[str, type[OnModel]] = {kind.name: kind for kind in (Inflow, LearnedAir, WindShear)}


def innermost(description: dict[str, Any]) -> dict[str, Any]:
    """Description of the model that others are put on, within that of the outermost."""
    while isinstance(description.get("of"), dict):
        description = description["of"]
    return description


def aero_from_description(robot: Robot, description: Mapping[str, Any]) -> Aerodynamics:
    """The model of `describe()`, for a robot.

    Raises:
        ParameterError: If the model is unknown, or a key is missing or unknown.
    """
    values = dict(description)
    name = values.pop("model", None)
    if name in _ON_MODEL:
        values["model"] = aero_from_description(robot, values.pop("of", {}))
        return from_field_values(f"model {name}", _ON_MODEL[name], values)
    added = None if name in _MODELS else plugin(AIR_MODELS, str(name))
    if added is not None:
        made: Aerodynamics = added(robot, air_from_description(values.pop("air")), **values)
        return made
    if name not in _MODELS:
        expected = f"one of {', '.join([*_MODELS, *_ON_MODEL])}"
        raise ParameterError("aerodynamic model", expected, name)
    if name == LiftingLine.name:
        values.setdefault("stall_delay", None)  # flights older than it have none
    if name == QuasiSteady.name:
        switches = values.pop("force_point_switches", True)  # of older flights
        values.setdefault("force_point", "switching" if switches else "fixed")
        values.setdefault("rotational_coefficient", QuasiSteady.rotational_coefficient)
    known = {field.name for field in fields(_MODELS[name])} - {"robot"}
    check_keys(f"model {name}", values, known)
    for key in {*_PARTS} & {*values}:
        values[key] = None if values[key] is None else _PARTS[key](values[key])
    model: Aerodynamics = _MODELS[name](robot, **values)
    return model


def _section(description: Mapping[str, Any]) -> StripSection:
    values = dict(description)
    if "stalled" in values:
        values["stalled"] = polar_from_description(values["stalled"])
    if "separated" not in values:
        return from_field_values("section", Section, values)
    values.setdefault("static_moment", ())  # flights older than it have none
    return from_field_values("section", MeasuredSection, values)


def _of_wings(make: Callable[[Any], Any], values: Any) -> Any:
    """One polar or section, or one for each wing; descriptions of one hold numbers or a name."""
    if values and all(isinstance(one, dict) for one in values.values()):
        return {wing: make(one) for wing, one in values.items()}
    return make(values)


_PARTS: dict[str, Callable[[Any], Any]] = {
    "air": air_from_description,
    "polar": lambda values: _of_wings(polar_from_description, values),
    "lags": lambda values: from_field_values("lags", Indicial, values),
    "section": lambda values: _of_wings(_section, values),
    # older flights do not give all numbers
    "stall_delay": lambda values: from_field_values(
        "stall delay", StallDelay, field_values(StallDelay()) | values
    ),
}
