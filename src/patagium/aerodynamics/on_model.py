"""Base of the models of the air that are put on another model of the air.

Such a model takes robot, air, states and parameters from the model under it, and appends its
own. Neglected: nothing; each such model names what it neglects.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.model import Aerodynamics
from patagium.aerodynamics.named_descriptions import field_values
from patagium.errors import ParameterError
from patagium.robot.model import Robot


@dataclass(frozen=True)
class OnModel(Aerodynamics):
    """Model of the air that is put on another one, whose states and parameters come first.

    Args:
        model: Model of the air under this one.

    Raises:
        ParameterError: If the model is one of the same kind, or on one.
    """

    model: Aerodynamics

    def __post_init__(self) -> None:
        if not hasattr(self.model, "air") or has_layer(self.model, type(self)):
            expected = f"a model without {self.name} in it, such as pt.QuasiSteady(robot)"
            raise ParameterError("model", expected, self.model)

    @property
    def robot(self) -> Robot:  # type: ignore[override]
        """The machine."""
        return self.model.robot

    @property
    def air(self) -> Air:  # type: ignore[override]
        """Density, wind and gusts."""
        return self.model.air

    @property
    def state_size(self) -> int:
        """Number of states of the model and of its own."""
        return self.model.state_size

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states of the model, then of its own."""
        return self.model.state_names

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the states of the model, then of its own."""
        return self.model.state_units

    @property
    def structure(self) -> str:
        """Text of what shapes the equations, numbers aside: part of a compiled function's key."""
        return f"{self.name} on {self.model.key}"

    @property
    def own_parameters(self) -> dict[str, float]:
        """Parameters of its own, by name [SI]."""
        raise NotImplementedError

    @property
    def numbers(self) -> dict[str, float]:
        """Parameters of the model, then of its own, by name [SI]."""
        return {**self.model.numbers, **self.own_parameters}

    def describe(self) -> dict[str, Any]:
        """Description that makes the model again for a robot, as JSON-able values."""
        own = field_values(self)
        return {"model": self.name, "of": own.pop("model"), **own}


def has_layer(aero: Any, kind: type) -> bool:
    """Whether a model of the air is of a kind, or on a model that is."""
    return isinstance(aero, kind) or (isinstance(aero, OnModel) and has_layer(aero.model, kind))
