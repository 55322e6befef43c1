"""A section of a lifting line: lift slope, profile drag, and what happens beyond stall.

Attached up to an effective incidence, fully separated from another on, a smooth share of both
between; or split as Kirchhoff's flow about a plate has it, so that a section held still gives
its measured polar. Neglected: Reynolds number, the rise of profile drag while flow is attached.
Separation takes time, and the lift that it takes away travels off with a vortex
(`StallDelay`); which way the vortex travels, and the vortices after it, are neglected.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from math import pi, radians
from typing import Any, ClassVar, Protocol, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.polars import (
    DickinsonPolar,
    Polar,
    SectionFlow,
    TablePolar,
    rounded_ramp,
    section_flow,
    table_values,
)
from patagium.aerodynamics.smooth_functions import smooth_step
from patagium.arguments import check_fields
from patagium.arrays import Array, brief, real_array
from patagium.errors import ParameterError, not_negative, positive


@dataclass(frozen=True)
class StallDelay:
    """Dynamic stall: lags of separation behind the effective incidence, and its vortex.

    With W the normalwash that the lift answers to, s_0 the share of separated flow in
    steady flow, C_a and C_s the lift coefficients of attached and separated flow, V the
    airspeed or that with p in it, whichever is greater, and c the chord,

        dp/dt = 2V/c (W - p) / pressure,      ds/dt = 2V/c (s_0(p) - s) / separation,
        dy/dt = 2V/c (s (C_a - C_s) - y) / vortex,

    s takes the place of s_0(W), and separated flow has the coefficients of the incidence that
    the pressure has reached. Lift that separation takes away is shed as a vortex above the
    chord: it adds C_v = s (C_a - C_s) - y, while that has the sign of the lift, `vortex_arm`
    behind the quarter chord. It is perpendicular to the chord by the share of suction that is
    lost, s^2 (Leishman and Beddoes' 1 - sqrt(1 - s), smooth), to the wind by the rest. Beyond an
    effective incidence of 30 to 50 degrees no delay holds the flow. Power that separated flow and
    vortex would give a section becomes drag. The states come to rest where the static section is.

    Args:
        pressure: T_p, lag of the pressure behind the lift [semichords].
        separation: T_f, lag of the separation behind the pressure [semichords].
        vortex: T_v, time in which the vortex leaves [semichords].
        vortex_arm: Place of its lift behind the quarter chord [chords].

    Raises:
        ParameterError: If a lag is not positive and finite, or the arm not in 0..0.75.

    References:
        Leishman & Beddoes (1989), A semi-empirical model for dynamic stall, J. American
        Helicopter Society 34, 3-17 (T_p = 1.7, T_f = 3.0, T_v = 6.0, NACA 0012 at low speed;
        arm .2).
        Hansen, Gaunaa & Madsen (2004), Risoe-R-1354 (as states).
    """

    pressure: float = 1.7
    separation: float = 3.0
    vortex: float = 6.0
    vortex_arm: float = 0.2

    def __post_init__(self) -> None:
        check_fields(self)
        for name in DELAYS[:-1]:
            positive(f"stall delay {name}", getattr(self, name))
        if not 0 <= self.vortex_arm <= 0.75:
            raise ParameterError("stall delay vortex_arm", "0 to 0.75 chords", self.vortex_arm)


DELAYS = ("pressure", "separation", "vortex", "vortex_arm")
STATES = 3
"""States of a strip with stall delay: p [m/s], s and y."""
_HELD = (radians(30.0), radians(50.0))
"""Effective incidences from and beyond which no delay holds the flow: no section that pitched was
measured with attached flow there [rad]."""
FEEBLE = 0.005
"""Coefficient within which the end of a vortex and of the power of stalled flow are rounded off."""


def held_share(flow: SectionFlow) -> Any:
    """Share of attached flow that a delay can hold at an effective incidence, 0 to 1."""
    return 1.0 - _share_beyond(flow, *(np.sin(angle) ** 2 for angle in _HELD))


def _share_beyond(flow: SectionFlow, begins: Any, complete: Any) -> Any:
    """Step from 0 to 1 between two squares of the sine of the incidence."""
    sine_square = flow.normal * flow.normal / (flow.speed * flow.speed)
    return smooth_step((sine_square - begins) / (complete - begins))


def faster(speed: Any, other: Any) -> Any:
    """Greater of two positive speeds, rounded off where they are the same within 2 % [m/s].

    So a wing that turns over, slow through air that it has set in motion, still forgets.
    """
    both, apart = speed + other, speed - other
    return (both + ca.sqrt(apart * apart + (0.01 * both) ** 2)) / 2


def vortex_lift(fed: Any, shed: Any) -> Any:
    """Lift coefficient of the vortex, s (C_a - C_s) - y; zero if s (C_a - C_s) has another sign."""
    sign = fed / ca.sqrt(fed * fed + FEEBLE**2)
    left, most = (fed - shed) * sign - FEEBLE, fed * sign
    return sign * (rounded_ramp(left, FEEBLE) - rounded_ramp(left - most, FEEBLE))


CENTER_OF_PRESSURE_SHIFT = 0.175
"""How far behind the quarter chord a separated plate across the flow is pushed, in chords
(Lindenburg 2003, ECN-C--03-025)."""

_NUMBERS = ("lift_slope", "zero_lift_angle", "profile_drag", "stall_begins", "stall_complete")


@runtime_checkable
class StripSection(Protocol):
    """Section of a lifting line: its numbers, then those of its polar, are run-time inputs.

    A section is a frozen dataclass with a field for each of `numbers` and one for the polar.
    Among the numbers are lift_slope [1/rad], zero_lift_angle [rad] and profile_drag.

    Attributes:
        numbers: Names of its numbers.
        stalled: Coefficients of separated flow.
    """

    numbers: ClassVar[tuple[str, ...]]
    stalled: Polar

    @property
    def center_of_pressure_shift(self) -> float:
        """Place of separated flow's push behind the quarter chord, over sin^2 a_e [chords]."""
        return CENTER_OF_PRESSURE_SHIFT

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

    def moment(self, flow: SectionFlow, parameters: Any) -> Any:
        """Coefficient of the moment about the point where the force acts, nose up.

        Args:
            flow: Geometric, as late as the pressure.
            parameters: Values or symbols in the order of `parameter_names`.
        """
        return 0.0

    def inputs(self) -> dict[str, float]:
        """Run-time inputs before those of the polar, by name [1/rad, rad, -]."""
        return {name: getattr(self, name) for name in self.numbers}

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of `parameters`."""
        return (*self.inputs(), *(f"stalled.{name}" for name in self.stalled.parameter_names))

    @property
    def parameters(self) -> Array:
        """Values of the parameters, (n,) [1/rad, rad, -]."""
        return np.array([*self.inputs().values(), *self.stalled.parameters])

    def named(self, parameters: Any) -> tuple[dict[str, Any], Any]:
        """Numbers by name and parameters of the polar, from values or symbols of `parameters`.

        Args:
            parameters: Values or symbols in the order of `parameter_names`, (n,) [1/rad, rad, -].
        """
        numbers = {name: parameters[k] for k, name in enumerate(self.numbers)}
        return numbers, parameters[len(self.inputs()) :]


@dataclass(frozen=True)
class Section(StripSection):
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
        check_fields(self)
        not_negative(self, "lift_slope", "profile_drag")
        check_zero_lift(self.zero_lift_angle)
        if not 0 < self.stall_begins < self.stall_complete <= pi / 2:
            angles = (self.stall_begins, self.stall_complete)
            raise ParameterError("stall", "0 < stall_begins < stall_complete <= pi/2", angles)

    def separated_share(self, flow: SectionFlow, parameters: Any) -> Any:
        """Share of separated flow, 0 to 1; see `StripSection.separated_share`."""
        numbers, _ = self.named(parameters)
        ends = (ca.sin(numbers[k]) ** 2 for k in ("stall_begins", "stall_complete"))
        return _share_beyond(flow, *ends)


def check_zero_lift(angle: float) -> None:
    """Refuse a zero-lift angle [rad] that no wing has: most often it was given in degrees.

    Raises:
        ParameterError: If it is.
    """
    if not abs(angle) <= _LARGEST_CAMBER:
        raise ParameterError("zero_lift_angle", "-0.5 to 0.5 rad; -3 degrees are -0.052", angle)


_LARGEST_CAMBER = 0.5
"""Incidence of no lift, either way, beyond which it is taken for an error [rad]: 29 degrees."""
_LINEAR = (radians(2.0) - 1e-9, radians(10.0) + 1e-9)
"""Distance from the incidence of no lift where the lift slope is read off a polar [rad]."""
_NEAREST = radians(0.5)
"""Distance from the incidence of no lift within which lift over incidence tells no share [rad]."""
_ATTACHED = radians(6.0) - 1e-9
"""Distance from the incidence of no lift that each side of a polar reaches, at least: sections do
not stall before [rad]."""
_SYMMETRIC = 0.01
"""Lift coefficient at no incidence within which a section is symmetric: that of .1 degrees."""
_APART = radians(8.0)
"""Distance of the angles at which a polar goes on as that of a plate, at least [rad]."""
_ACROSS = 2.01
"""Drag coefficient of a long plate across the flow (Viterna & Janetzke 1982)."""
_TELLING = 0.05
"""Share of separated flow from which on the drag of separated flow can be told."""


@dataclass(frozen=True)
class MeasuredSection(StripSection):
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
        static_moment: C_m about the quarter chord, nose up, held still at these angles, (n,) [-];
            empty where it was not measured: then separated flow pushes behind the quarter chord.

    Raises:
        ParameterError: If a number is not finite or not possible.
    """

    lift_slope: float
    zero_lift_angle: float
    profile_drag: float
    separated: tuple[float, ...]
    stalled: TablePolar
    static_moment: tuple[float, ...] = ()

    numbers = _NUMBERS[:3]
    __repr__ = brief

    def __post_init__(self) -> None:
        check_fields(self)
        not_negative(self, "lift_slope", "profile_drag")
        check_zero_lift(self.zero_lift_angle)
        if len(self.separated) != len(self.stalled.angle):
            expected = f"one share for each of {len(self.stalled.angle)} angles"
            raise ParameterError("separated", expected, len(self.separated))
        if len(self.static_moment) not in (0, len(self.separated)):
            expected = f"no moment, or one for each of {len(self.separated)} angles"
            raise ParameterError("static_moment", expected, self.static_moment)
        if not all(0 <= share <= 1 for share in self.separated):
            raise ParameterError("separated", "shares of 0..1", self.separated)

    @property
    def structure(self) -> str:
        """Text of all that shapes the equations, numbers aside."""
        moment = " moment" if self.static_moment else ""
        return f"measured section stalled={self.stalled.structure}{moment}"

    @property
    def center_of_pressure_shift(self) -> float:
        """Zero where the moment was measured [chords]."""
        return 0.0 if self.static_moment else super().center_of_pressure_shift

    def inputs(self) -> dict[str, float]:
        """Run-time inputs before those of the polar, by name [1/rad, rad, -]."""
        tables = {"separated": self.separated, "static_moment": self.static_moment}
        named = {f"{name}[{k}]": x for name, xs in tables.items() for k, x in enumerate(xs)}
        return super().inputs() | named

    def separated_share(self, flow: SectionFlow, parameters: Any) -> Any:
        """Share of separated flow, 0 to 1; see `StripSection.separated_share`."""
        numbers, _ = self.named(parameters)
        camber = numbers["zero_lift_angle"] * flow.forward * flow.forward_sign
        return self._read(0, section_flow(flow.forward, flow.normal - camber), parameters)

    def moment(self, flow: SectionFlow, parameters: Any) -> Any:
        """Coefficient of the moment, nose up; see `StripSection.moment`."""
        if not self.static_moment:
            return 0.0
        return flow.forward_sign * self._read(1, flow, parameters)

    def _read(self, table: int, flow: SectionFlow, parameters: Any) -> Any:
        """Value at an angle of attack of one of the two tables in `inputs`."""
        count = len(self.separated)
        first, angles = len(self.numbers) + table * count, len(self.inputs())
        knots, values = parameters[angles : angles + count], parameters[first : first + count]
        return table_values(flow.angle_of_attack, knots, values)


def measured_section(
    angle: ArrayLike, lift: ArrayLike, drag: ArrayLike, moment: ArrayLike | None = None
) -> MeasuredSection:
    """The section of a measured static polar.

    With a0 the lift slope, x = sin a - a_0 cos a seen from the incidence of no lift, and
    Kirchhoff's flow separated over the share s of the chord,

        C_L = a0 x (1 + sqrt(1 - s))^2 / 4 = (1 - s) a0 x + s C_L,separated.

    It holds at the points but for rounded corners; between points both factors are lines. Points 1
    degree apart keep C_L within .01, points 6 degrees apart within .08 (one polar with stall).

    A polar that ends before 90 degrees goes on from its last point as a plate does:

        C_D = 2.01 sin^2 a + B cos a,    C_L = 2.01 sin a cos a + A cos^2 a / sin a,

    A side of a symmetric section (C_L(0) zero within .01) that ends within 6 degrees is taken from
    the other side, with a `UserWarning`.

    Args:
        angle: Angles of attack, ascending, within -pi/2..pi/2, (n,) [rad].
        lift: C_L, (n,) [-].
        drag: C_D, (n,) [-].
        moment: C_m about the quarter chord, nose up, (n,) [-]; None: not measured.

    Raises:
        ParameterError: If the polar is impossible, or its lift does not pass through zero
            with points between 2 and 10 degrees from there, or a side ends within 6 degrees.

    References:
        Hansen, Gaunaa & Madsen (2004), A Beddoes-Leishman type dynamic stall model in
        state-space and indicial formulations, Risoe-R-1354.
        Viterna & Janetzke (1982), Theoretical and experimental power from large horizontal-axis
        wind turbines, NASA TM-82944 (beyond the polar; 2.01 of a long plate).
    """
    polar = _table(angle, lift, drag)
    static = np.empty(0) if moment is None else real_array("moment", moment).ravel()
    if static.size not in (0, len(polar.angle)):
        expected = f"no moment, or one for each of {len(polar.angle)} angles"
        raise ParameterError("moment", expected, static.size)
    polar, static, zero = _on_both_sides(polar, static)
    a, c_l, c_d = (np.array(x) for x in (polar.angle, polar.lift, polar.drag))
    x = np.sin(a) - zero * np.cos(a)
    away = np.abs(a - zero)
    linear = (away > _LINEAR[0]) & (away < _LINEAR[1])
    if not linear.any():
        found = f"none, but {np.degrees(away).min():.3g} degrees from it and more"
        raise ParameterError("polar", "points 2 to 10 degrees from zero lift", found)
    slope = float((c_l[linear] / x[linear]).max())
    told = away > _NEAREST
    ratio = np.interp(a, a[told], np.clip(c_l[told] / (slope * x[told]), 0.0, 1.0))
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
    return MeasuredSection(slope, zero, profile_drag, tuple(share), stalled, tuple(static))


def measured_polar(angle: ArrayLike, lift: ArrayLike, drag: ArrayLike) -> TablePolar:
    """Polar of blade elements from -90 to 90 degrees; arguments and errors of `measured_section`.

    It is a section's: what the tips of a wing induce is not in it, and `Inflow` adds it.
    """
    return _on_both_sides(_table(angle, lift, drag), np.empty(0))[0]


def _table(angle: ArrayLike, lift: ArrayLike, drag: ArrayLike) -> TablePolar:
    columns = {"angle": angle, "lift": lift, "drag": drag}
    return TablePolar(*(tuple(real_array(*one).ravel()) for one in columns.items()))


def _on_both_sides(polar: TablePolar, moment: Array) -> tuple[TablePolar, Array, float]:
    """Polar and its moments (if any) that reach 90 degrees, and its angle of no lift [rad]."""
    moments = [moment] if moment.size else []
    table = np.array([polar.angle, polar.lift, polar.drag, *moments])
    mirror = np.array([[-1.0], [-1.0], [1.0], [-1.0]])[: len(table)]
    for _ in range(2):  # the negative side, mirrored, and then the positive one
        table = (table * mirror)[:, ::-1]
        begin = max(0.0, table[0, -1])
        if begin < min(_ATTACHED, -table[0, 0]) and abs(np.interp(0, *table[:2])) <= _SYMMETRIC:
            table = np.hstack([table, (table * mirror)[:, table[0] < -begin][:, ::-1]])
            said = f"polar: symmetric, and one side ends at {np.degrees(begin):.3g} degrees; the"
            warnings.warn(f"{said} other side is taken for both", stacklevel=3)
    zero = _zero_lift(*table[:2])
    low, high = table[0, [0, -1]]
    if min(zero - low, high - zero) < _ATTACHED:
        found = "{:.3g} to {:.3g}, no lift at {:.3g} degrees".format(*np.degrees([low, high, zero]))
        expected = "angles to 6 degrees and more on both sides of no lift (XFOIL: aseq -15 15 1)"
        raise ParameterError("polar", expected, found)
    for _ in range(2):
        table = (table * mirror)[:, ::-1]
        begin = table[0, -1]
        if begin < pi / 2 - _APART:
            parts = int((pi / 2 - begin) / _APART)
            angle = np.linspace(begin, pi / 2, parts + 1)[1:]
            table = np.hstack([table, [angle, *_of_plate(angle, *table[:, -1])]])
    return TablePolar(*map(tuple, table[:3])), table[3:].ravel(), zero


def _of_plate(angle: Array, begin: float, lift: float, drag: float, *moment: float) -> list[Array]:
    """C_L, C_D and perhaps C_m of a plate in separated flow that go on from those at an angle."""
    sine, cosine = np.sin(angle), np.cos(angle)
    first, last = np.sin(begin), np.cos(begin)
    along = (drag - _ACROSS * first**2) / last
    up = (lift - _ACROSS * first * last) * first / last**2
    c_l = _ACROSS * sine * cosine + up * cosine**2 / sine
    c_d = _ACROSS * sine**2 + along * cosine
    arms = [-one / (lift * last + drag * first) for one in moment]
    share = (sine**2 - first**2) / last**2
    places = [arm + share * (CENTER_OF_PRESSURE_SHIFT - arm) for arm in arms]
    push = c_l * cosine + c_d * sine
    return [c_l, c_d, *(-place * push for place in places)]


def _zero_lift(angle: Array, lift: Array) -> float:
    """Angle nearest to zero where the lift rises through zero [rad]."""
    rises = np.flatnonzero((lift[:-1] <= 0) & (lift[1:] > 0))
    if not rises.size:
        found = f"C_L {lift.min():.3g} to {lift.max():.3g}"
        raise ParameterError("polar", "a lift that rises through zero", found)
    zeros = [
        angle[k] - lift[k] * (angle[k + 1] - angle[k]) / (lift[k + 1] - lift[k]) for k in rises
    ]
    return float(min(zeros, key=abs))
