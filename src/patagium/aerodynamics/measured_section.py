"""A section of a lifting line from its measured static polar.

The polar is split into attached and separated flow as Kirchhoff's flow about a plate has
it, so that a section with memory gives the measured lift when it is held still, and can
be more or less separated than that when it moves. Neglected: the rise of profile drag
while flow is attached, Reynolds number, the measured pitching moment.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, radians
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.named_descriptions import check_keys
from patagium.aerodynamics.polars import (
    SectionFlow,
    TablePolar,
    polar_from_description,
    section_flow,
)
from patagium.aerodynamics.sections import SectionParameters
from patagium.aerodynamics.table_interpolation import table_values
from patagium.errors import ParameterError

Array = NDArray[np.float64]

_NUMBERS = ("lift_slope", "zero_lift_angle", "profile_drag")
_LINEAR = (radians(2.0), radians(10.0))
"""Distance from the incidence of no lift where the lift slope is read off a polar [rad]."""
_TELLING = 0.05
"""Share of separated flow from which on the drag of separated flow can be told."""


@dataclass(frozen=True)
class MeasuredSection(SectionParameters):
    """Section whose separated share and separated flow are tables over the incidence.

    Attached flow has the lift slope and profile drag, separated flow the polar's
    coefficients; the share is read at the effective incidence, at the polar's angles.
    `measured_section` makes one from a static polar.

    Args:
        lift_slope: Of attached flow, two-dimensional [1/rad].
        zero_lift_angle: Incidence of no lift [rad].
        profile_drag: Drag coefficient of attached flow.
        separated: Share of separated flow in steady flow at the angles of `stalled`, (n,) [-].
        stalled: Coefficients of separated flow.

    Raises:
        ParameterError: If a number is not finite or not possible.
    """

    lift_slope: float
    zero_lift_angle: float
    profile_drag: float
    separated: tuple[float, ...]
    stalled: TablePolar

    numbers = _NUMBERS

    def __post_init__(self) -> None:
        object.__setattr__(self, "separated", tuple(map(float, self.separated)))
        for name in _NUMBERS:
            value = getattr(self, name)
            if not (isfinite(value) and (value >= 0 or name == "zero_lift_angle")):
                raise ParameterError(name, "a finite number, of slope and drag >= 0", value)
        if len(self.separated) != len(self.stalled.angle):
            expected = f"one share for each of {len(self.stalled.angle)} angles"
            raise ParameterError("separated", expected, len(self.separated))
        if not all(0 <= share <= 1 for share in self.separated):
            raise ParameterError("separated", "shares of 0..1", self.separated)

    @property
    def structure(self) -> str:
        """Text of all that shapes the equations, numbers aside."""
        return f"measured section stalled={self.stalled.structure}"

    def inputs(self) -> dict[str, float]:
        """Run-time inputs before those of the polar, by name [1/rad, rad, -]."""
        return super().inputs() | {f"separated[{k}]": s for k, s in enumerate(self.separated)}

    def describe(self) -> dict[str, Any]:
        """Description from which the object can be made again, as JSON-able values."""
        description = super().describe()
        stalled = description.pop("stalled")
        return {**description, "separated": [*self.separated], "stalled": stalled}

    def separated_share(self, flow: SectionFlow, parameters: Any) -> Any:
        """Share of separated flow s in steady flow, 0 to 1.

        Args:
            flow: Effective, seen from the incidence of no lift.
            parameters: Values or symbols in the order of `parameter_names`.
        """
        numbers, polar = self.named(parameters)
        count, first = len(self.separated), len(_NUMBERS)
        camber = numbers["zero_lift_angle"] * flow.forward * flow.forward_sign
        angle = section_flow(flow.forward, flow.normal - camber).angle_of_attack
        return table_values(angle, polar[:count], parameters[first : first + count])


def measured_section(angle: ArrayLike, lift: ArrayLike, drag: ArrayLike) -> MeasuredSection:
    """The section of a measured static polar.

    With a0 the lift slope, x = sin a - a_0 cos a seen from the incidence of no lift, and
    Kirchhoff's flow separated over the share s of the chord,

        C_L = a0 x (1 + sqrt(1 - s))^2 / 4 = (1 - s) a0 x + s C_L,separated.

    Args:
        angle: Angles of attack, ascending, within -pi/2..pi/2, (n,) [rad].
        lift: C_L, (n,) [-].
        drag: C_D, (n,) [-].

    Raises:
        ParameterError: If the polar is impossible, or its lift does not pass through zero
            with points between 2 and 10 degrees from there.

    References:
        Hansen, Gaunaa & Madsen (2004), A Beddoes-Leishman type dynamic stall model in
        state-space and indicial formulations, Risoe-R-1354.
    """
    polar = TablePolar(*[tuple(np.asarray(x, float).ravel()) for x in (angle, lift, drag)])
    a, c_l, c_d = (np.array(x) for x in (polar.angle, polar.lift, polar.drag))
    zero = _zero_lift(a, c_l)
    x = np.sin(a) - zero * np.cos(a)
    away = np.abs(a - zero)
    linear = (away > _LINEAR[0]) & (away < _LINEAR[1])
    if not linear.any():
        raise ParameterError("polar", "points 2 to 10 degrees from zero lift", polar.angle)
    slope = float((c_l[linear] / x[linear]).max())
    ratio = np.ones(len(a))
    told = away > _LINEAR[0]
    ratio[told] = np.clip(c_l[told] / (slope * x[told]), 0.0, 1.0)
    root = np.clip(2.0 * np.sqrt(ratio) - 1.0, 0.0, 1.0)
    share = 1.0 - root**2
    separated_lift = np.where(root > 0, slope * x * (1 + 3 * root) / (4 * (1 + root)), c_l)
    profile_drag = float(np.interp(zero, a, c_d))
    telling = share > _TELLING
    separated_drag = c_d
    if telling.any():
        of_telling = (c_d - (1 - share) * profile_drag)[telling] / share[telling]
        separated_drag = np.interp(a, a[telling], np.maximum(of_telling, 0.0))
    stalled = TablePolar(polar.angle, tuple(separated_lift), tuple(separated_drag))
    return MeasuredSection(slope, zero, profile_drag, tuple(share), stalled)


def measured_section_from_description(description: Mapping[str, Any]) -> MeasuredSection:
    """The section of `describe()`.

    Raises:
        ParameterError: If a key is missing or unknown, or the polar is no table.
    """
    known = {*_NUMBERS, "separated", "stalled"}
    check_keys("section", description, known)
    stalled = polar_from_description(description["stalled"])
    if not isinstance(stalled, TablePolar):
        raise ParameterError("section stalled", "a polar of the name table", stalled.name)
    numbers = {name: description[name] for name in _NUMBERS}
    return MeasuredSection(**numbers, separated=tuple(description["separated"]), stalled=stalled)


def _zero_lift(angle: Array, lift: Array) -> float:
    """Angle nearest to zero where the lift rises through zero [rad]."""
    rises = np.flatnonzero((lift[:-1] <= 0) & (lift[1:] > 0))
    if not rises.size:
        raise ParameterError("polar", "a lift that rises through zero", tuple(lift))
    zeros = [
        angle[k] - lift[k] * (angle[k + 1] - angle[k]) / (lift[k + 1] - lift[k]) for k in rises
    ]
    return float(min(zeros, key=abs))
