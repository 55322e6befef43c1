"""A model of the air from its description, as stored with every flight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from patagium.aerodynamics.air import air_from_description
from patagium.aerodynamics.model import Aerodynamics
from patagium.aerodynamics.polars import polar_from_description
from patagium.aerodynamics.published import Published
from patagium.aerodynamics.quasi_steady import QuasiSteady
from patagium.errors import ParameterError
from patagium.robot.model import Robot

_KEYS = {
    QuasiSteady.name: {"air", "polar", "rotational"},
    Published.name: {"air", "errors"},
}


def aero_from_description(robot: Robot, description: Mapping[str, Any]) -> Aerodynamics:
    """The model of `describe()`, for a robot.

    Raises:
        ParameterError: If the model is unknown, or a key is missing or unknown.
    """
    values = dict(description)
    name = values.pop("model", None)
    if name not in _KEYS:
        raise ParameterError("aerodynamic model", f"one of {', '.join(_KEYS)}", name)
    if set(values) != _KEYS[name]:
        raise ParameterError(f"model {name}", f"the keys {sorted(_KEYS[name])}", sorted(values))
    air = air_from_description(values["air"])
    if name == Published.name:
        return Published(robot, air, errors=values["errors"])
    polar = polar_from_description(values["polar"])
    return QuasiSteady(robot, air, polar=polar, rotational=values["rotational"])
