"""A section of a lifting line: lift slope, profile drag, and what happens beyond stall.

Attached up to an effective incidence, fully separated from another on, a smooth
share of both between. Neglected: Reynolds number; the time separation takes is
apart (`stall_delay`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite, pi, radians
from typing import Any, ClassVar, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from patagium.aerodynamics.named_descriptions import check_keys
from patagium.aerodynamics.polars import (
    DickinsonPolar,
    Polar,
    SectionFlow,
    polar_from_description,
)
from patagium.aerodynamics.smooth_functions import smooth_step
from patagium.errors import ParameterError

CENTER_OF_PRESSURE_SHIFT = 0.175
"""How far behind the quarter chord a separated plate across the flow is pushed, in chords
(Lindenburg 2003, ECN-C--03-025)."""

_NUMBERS = ("lift_slope", "zero_lift_angle", "profile_drag", "stall_begins", "stall_complete")


class StripSection(Protocol):
    """Protocol of a section of a lifting line; its numbers are run-time inputs."""

    @property
    def stalled(self) -> Polar:
        """Coefficients of separated flow."""
        ...

    @property
    def structure(self) -> str:
        """Text of all that shapes the equations, numbers aside."""
        ...

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of `parameters`."""
        ...

    @property
    def parameters(self) -> NDArray[np.float64]:
        """Values of the parameters, (n,)."""
        ...

    def named(self, parameters: Any) -> tuple[dict[str, Any], Any]:
        """The numbers by name, and those of the polar, from values or symbols of `parameters`.

        Among the names: lift_slope [1/rad], zero_lift_angle [rad], profile_drag.
        """
        ...

    def separated_share(self, flow: SectionFlow, parameters: Any) -> Any:
        """Share of separated flow s in steady flow, 0 to 1.

        Args:
            flow: Effective, seen from the incidence of no lift.
            parameters: Values or symbols in the order of `parameter_names`.
        """
        ...

    def describe(self) -> dict[str, Any]:
        """Description from which the object can be made again, as JSON-able values."""
        ...


class SectionParameters:
    """Names and values of a section's run-time inputs: its numbers, then those of its polar.

    A section is a frozen dataclass with a field for each of `numbers` and one for the polar.
    """

    numbers: ClassVar[tuple[str, ...]]
    stalled: Polar

    def inputs(self) -> dict[str, float]:
        """Run-time inputs before those of the polar, by name [1/rad, rad, -]."""
        return {name: getattr(self, name) for name in self.numbers}

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of `parameters`."""
        return (*self.inputs(), *(f"stalled.{name}" for name in self.stalled.parameter_names))

    @property
    def parameters(self) -> NDArray[np.float64]:
        """Values of the parameters, (n,) [1/rad, rad, -]."""
        return np.array([*self.inputs().values(), *self.stalled.parameters])

    def named(self, parameters: Any) -> tuple[dict[str, Any], Any]:
        """Numbers by name and parameters of the polar, from values or symbols of `parameters`.

        Args:
            parameters: Values or symbols in the order of `parameter_names`, (n,) [1/rad, rad, -].
        """
        numbers = {name: parameters[k] for k, name in enumerate(self.numbers)}
        return numbers, parameters[len(self.inputs()) :]

    def describe(self) -> dict[str, Any]:
        """Description from which the object can be made again, as JSON-able values."""
        numbers = {name: getattr(self, name) for name in self.numbers}
        return {**numbers, "stalled": self.stalled.describe()}


@dataclass(frozen=True)
class Section(SectionParameters):
    """Section of a thin wing, attached and beyond stall.

    Attached flow has the lift of a thin airfoil and profile drag; separated flow the
    polar's coefficients at the geometric incidence. The separated share s grows with the
    effective incidence a_e: s = x^4 (35 - 84 x + 70 x^2 - 20 x^3), x running from 0 to 1
    in sin^2 a_e from `stall_begins` to `stall_complete`.

    Args:
        lift_slope: Of attached flow, two-dimensional [1/rad].
        zero_lift_angle: Incidence of no lift, negative for usual camber [rad].
        profile_drag: Drag coefficient of attached flow.
        stall_begins: Effective incidence up to which flow is attached [rad].
        stall_complete: Effective incidence beyond which it is separated [rad].
        stalled: Coefficients of separated flow.

    Raises:
        ParameterError: If a number is not finite or not possible.

    References:
        DeLaurier (1993), Aeronautical Journal 97 (stall of flapping wings at 13 degrees).
        Beard & McLain (2012), Small Unmanned Aircraft, section 4.2 (separated at 27 degrees).
        Dickinson, Lehmann & Sane (1999), Science 284 (flapping wing at all incidences).
    """

    lift_slope: float = 2 * pi
    zero_lift_angle: float = 0.0
    profile_drag: float = 0.02
    stall_begins: float = radians(13.0)
    stall_complete: float = radians(27.0)
    stalled: Polar = field(default_factory=DickinsonPolar)

    numbers = _NUMBERS

    def __post_init__(self) -> None:
        for name in _NUMBERS:
            if not isfinite(getattr(self, name)):
                raise ParameterError(name, "a finite number", getattr(self, name))
        for name in ("lift_slope", "profile_drag"):
            if getattr(self, name) < 0:
                raise ParameterError(name, "a number >= 0", getattr(self, name))
        if not 0 < self.stall_begins < self.stall_complete <= pi / 2:
            angles = (self.stall_begins, self.stall_complete)
            raise ParameterError("stall", "0 < stall_begins < stall_complete <= pi/2", angles)

    @property
    def structure(self) -> str:
        """Text of all that shapes the equations, numbers aside."""
        return f"section stalled={self.stalled.structure}"

    def separated_share(self, flow: SectionFlow, parameters: Any) -> Any:
        """Share of separated flow s in steady flow, 0 to 1.

        Args:
            flow: Effective, seen from the incidence of no lift.
            parameters: Values or symbols in the order of `parameter_names`.
        """
        numbers, _ = self.named(parameters)
        sine_square = flow.normal * flow.normal / (flow.speed * flow.speed)
        begins, complete = (ca.sin(numbers[k]) ** 2 for k in ("stall_begins", "stall_complete"))
        return smooth_step((sine_square - begins) / (complete - begins))


def section_from_description(description: Mapping[str, Any]) -> Section:
    """The section of `describe()`.

    Raises:
        ParameterError: If a key is missing or unknown.
    """
    known = {*_NUMBERS, "stalled"}
    check_keys("section", description, known)
    numbers = {name: description[name] for name in _NUMBERS}
    return Section(**numbers, stalled=polar_from_description(description["stalled"]))
