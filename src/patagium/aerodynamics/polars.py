"""Lift and drag coefficients of a section, as expressions with named parameters.

Coefficients depend on the angle of attack, those of `ReynoldsPolar` on the Reynolds
number too. Neglected: aspect ratio, history of the flow (dynamic stall), pitching
moment about the point where the force acts.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import cos, isfinite, pi, radians, sin
from typing import Any, ClassVar, Protocol, TypeVar, runtime_checkable

import casadi as ca
import numpy as np

from patagium.aerodynamics.named_descriptions import field_values, from_named_description
from patagium.aerodynamics.smooth_functions import smooth_norm, smooth_sign
from patagium.arguments import check_fields
from patagium.arrays import Array, brief
from patagium.errors import ParameterError
from patagium.native import expression_digest, named_function


def table_values(x: Any, knots: ca.SX, values: ca.SX) -> ca.SX:
    """Values at an abscissa, (m, 1); constant before the first knot and after the last.

    Args:
        x: Abscissa, scalar [any unit].
        knots: Ascending abscissas, (n, 1), n >= 2 [of x].
        values: One column a quantity, (n, m) [any unit].
    """
    return table_function(*values.shape)(x, knots, values)


@functools.cache
def table_function(knots: int, columns: int) -> ca.Function:
    """Lines between knots x_k, slopes m_k, rounded within half the shorter interval w_k.

    v(x) = v_0 + sum_k (m_k - m_(k-1)) R_k(x), with R_k zero before x_k - w_k, x - x_k
    after x_k + w_k, and between w (r(t) = t/2 + (35/2 t^2 - 35/4 t^4 + 7/2 t^6 - 5/8 t^8)/32
    + 35/256), t = (x - x_k)/w_k. One call in compiled code: `kernels/table.h`.

    Returns:
        (x, knots (n,) [of x], values (n, m)) -> values at x (m,).
    """
    x, at = ca.SX.sym("x"), ca.SX.sym("knots", knots)
    values = ca.SX.sym("values", knots, columns)
    steps = [at[k + 1] - at[k] for k in range(knots - 1)]
    result, last = values[0, :], ca.SX.zeros(1, columns)
    for k in range(knots):
        half = ca.fmin(steps[max(k - 1, 0)], steps[min(k, knots - 2)]) / 2
        slope = ca.SX.zeros(1, columns)
        if k + 1 < knots:
            slope = (values[k + 1, :] - values[k, :]) / steps[k]
        result = result + (slope - last) * rounded_ramp(x - at[k], half)
        last = slope
    inputs, outputs = {"x": x, "knots": at, "values": values}, {"at_x": ca.densify(result.T)}
    return named_function(f"table_{knots}_{columns}", inputs, outputs, never_inline=True)


def rounded_ramp(x: Any, half: Any) -> Any:
    """max(0, x), but a polynomial within the half width of zero.

    Args:
        x: Scalar.
        half: Half width of what is rounded, positive.
    """
    t = ca.fmax(-1.0, ca.fmin(1.0, x / half))
    square = t * t
    even = square * (17.5 + square * (-8.75 + square * (3.5 - 0.625 * square))) / 16.0
    return half * (0.5 * (t + even) + 0.13671875) + ca.fmax(0.0, x - half)


@dataclass(frozen=True)
class SectionFlow:
    """Velocity of a section relative to the air, in its own plane.

    Attributes:
        forward: Velocity to the leading edge [m/s].
        normal: Velocity out of the upper surface [m/s].
        speed: Norm of the two, smooth and positive [m/s].
        forward_sign: Smooth sign of `forward`.
        chord: Its chord [m].
    """

    forward: Any
    normal: Any
    speed: Any
    forward_sign: Any
    chord: Any = 1.0

    @property
    def angle_of_attack(self) -> Any:
        """Incidence a = atan2(-normal, |forward|), -pi/2 to pi/2, scalar [rad].

        As twice the angle of the half tangent, smooth at rest too.
        """
        return 2 * ca.atan(-self.normal / (self.speed + self.forward * self.forward_sign))


def section_flow(forward: Any, normal: Any, chord: Any = 1.0) -> SectionFlow:
    """Flow of a section of a chord [m] from its two velocities relative to the air [m/s]."""
    speed = smooth_norm(forward * forward + normal * normal)
    return SectionFlow(forward, normal, speed, smooth_sign(forward), chord)


_Kind = TypeVar("_Kind", bound="Polar")
_SMALL = (-radians(5.0), radians(5.0))  # angle of the velocity: incidence of the other sign
_BAND = 0.02
"""Sine of the incidence (1.1 degrees) within which its sign is smoothed: a share of the speed, so
that coefficients are those of the incidence at any speed beyond `SWITCH_SPEED`."""


@runtime_checkable
class Polar(Protocol):
    """Section coefficients: a frozen dataclass whose fields are its parameters.

    The parameters are run-time inputs of the equations, so that they can be calibrated.
    """

    name: ClassVar[str]

    @property
    def structure(self) -> str:
        """Text of all that shapes the equations, numbers aside."""
        own = expression_digest(type(self), self._functions)
        return f"{self.name} {len(self.parameters)}{own}"

    def _functions(self) -> list[ca.Function]:
        flow, p = ca.SX.sym("flow", 3), ca.SX.sym("p", len(self.parameter_names))
        found = self.coefficients(section_flow(*ca.vertsplit(flow)), p)
        return [ca.Function("f", [flow, p], [*found, self.downwash_factor(p)])]

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of `parameters`."""
        return tuple(field.name for field in fields(self))  # type: ignore[arg-type]

    @property
    def parameters(self) -> Array:
        """Values of the parameters, (n,)."""
        return np.array([getattr(self, name) for name in self.parameter_names], float)

    def coefficients(self, flow: SectionFlow, parameters: Any) -> tuple[Any, Any]:
        """Coefficient of lift along (-normal, forward) velocity, and of drag.

        The first is sgn(a) C_L(|a|) sgn(forward), so that lift is
        1/2 rho A |v| C (-v_normal, v_forward) in (forward, normal) axes.

        Args:
            flow: How the section moves.
            parameters: Values or symbols in the order of `parameter_names`.
        """

    def downwash_factor(self, parameters: Any) -> Any:
        """Angle of downwash over C_L that the polar holds already, scalar [rad].

        1/a - 1/(2 pi), a the slope of C_L within 5 degrees of zero: what was measured on a wing
        that ends is flatter than a section's by what its tip vortices induce. The chord is 1 m and
        the speed 1 m/s: a polar of one's own that knows the Reynolds number overrides this.

        Args:
            parameters: Values or symbols in the order of `parameter_names`.
        """
        sides = [self.coefficients(section_flow(cos(a), sin(a)), parameters)[0] for a in _SMALL]
        slope = (sides[0] - sides[1]) / (_SMALL[1] - _SMALL[0])
        return ca.fmax(1.0 / ca.fmax(slope, 0.1) - 1.0 / (2 * pi), 0.0)

    def describe(self) -> dict[str, Any]:
        """Description from which the object can be made again, as JSON-able values."""
        return {"name": self.name, **field_values(self)}

    def require(self, possible: bool, expected: str) -> None:
        """Raise unless every number is finite and the polar takes energy out of the robot.

        Raises:
            ParameterError: If not.
        """
        if not (possible and all(map(isfinite, self.parameters))):
            raise ParameterError(f"polar {self.name}", expected, self.describe())


@dataclass(frozen=True)
class DickinsonPolar(Polar):
    """The published polar of a flapping wing at low Reynolds number.

    C_L = lift_offset + lift_amplitude sin(lift_rate a - lift_phase),
    C_D = drag_offset - drag_amplitude cos(drag_rate a - drag_phase), 0 <= a <= pi/2;
    for other incidences C_L(|a|) sgn(a) and C_D(|a|), sgn(a) smoothed where |sin a| < .02.

    Args:
        lift_offset: Constant of C_L.
        lift_amplitude: Amplitude of C_L.
        lift_rate: Cycles of C_L in one turn.
        lift_phase: Phase of C_L [rad].
        drag_offset: Constant of C_D.
        drag_amplitude: Amplitude of C_D.
        drag_rate: Cycles of C_D in one turn.
        drag_phase: Phase of C_D [rad].

    References:
        Dickinson, Lehmann & Sane (1999), Science 284, 1954-1960.
    """

    lift_offset: float = 0.225
    lift_amplitude: float = 1.58
    lift_rate: float = 2.13
    lift_phase: float = radians(7.2)
    drag_offset: float = 1.92
    drag_amplitude: float = 1.55
    drag_rate: float = 2.04
    drag_phase: float = radians(9.82)

    name = "dickinson"

    def __post_init__(self) -> None:
        check_fields(self)
        possible = self.drag_offset >= abs(self.drag_amplitude)
        self.require(possible, "finite numbers, drag_offset >= |drag_amplitude|")

    def coefficients(self, flow: SectionFlow, parameters: Any) -> tuple[Any, Any]:
        """Coefficient of lift along (-normal, forward) velocity, and of drag."""
        normal_sign = smooth_sign(flow.normal, _BAND * flow.speed)
        magnitude = -flow.angle_of_attack * normal_sign
        lift = -normal_sign * flow.forward_sign * self.lift(magnitude, parameters)
        return lift, self.drag(magnitude, parameters)

    def lift(self, angle: Any, parameters: Any) -> Any:
        """C_L as fitted, of an angle of attack [rad]; not odd: C_L(0) = .027."""
        offset, amplitude, rate, phase = (parameters[i] for i in range(4))
        return offset + amplitude * ca.sin(rate * angle - phase)

    def drag(self, angle: Any, parameters: Any) -> Any:
        """C_D as fitted, of an angle of attack [rad]; not even."""
        offset, amplitude, rate, phase = (parameters[i] for i in range(4, 8))
        return offset - amplitude * ca.cos(rate * angle - phase)


@dataclass(frozen=True)
class SmoothPolar(Polar):
    """A polar of three numbers to calibrate, without trigonometry.

    C_L = lift_amplitude sin 2a, C_D = zero_lift_drag + drag_rise sin^2 a.
    The values given are the least-squares fit of the published polar over 0 to 90 degrees.

    Args:
        lift_amplitude: Largest lift coefficient, at 45 degrees.
        zero_lift_drag: Drag coefficient along the chord.
        drag_rise: Further drag coefficient across the chord.
    """

    lift_amplitude: float = 1.81
    zero_lift_drag: float = 0.24
    drag_rise: float = 3.10

    name = "smooth"

    def __post_init__(self) -> None:
        check_fields(self)
        possible = self.zero_lift_drag >= 0 and self.zero_lift_drag + self.drag_rise >= 0
        self.require(possible, "finite numbers, a drag coefficient >= 0 at every incidence")

    def coefficients(self, flow: SectionFlow, parameters: Any) -> tuple[Any, Any]:
        """Coefficient of lift along (-normal, forward) velocity, and of drag."""
        sine, cosine = flow.normal / flow.speed, flow.forward / flow.speed
        lift = -2 * parameters[0] * sine * cosine
        return lift, parameters[1] + parameters[2] * sine * sine


@dataclass(frozen=True)
class ReynoldsPolar(SmoothPolar):
    """The polar of a wing that revolves, by the Reynolds number Re = |v| c / viscosity of a strip.

    C_L = (lift_amplitude - 3.94 Re^-.429) sin 2a,
    C_D = zero_lift_drag + 10.48 Re^-.764 + (drag_rise - 6.28 Re^-.369) sin^2 a,
    rounded off below Re = 20 to end at 6. Neglected: the fit's factors of aspect ratio and radius
    (.97 to 1.05 for wings of insects).

    Args:
        lift_amplitude: Largest lift coefficient, at 45 degrees, without viscosity.
        zero_lift_drag: Drag coefficient along the chord without viscosity.
        drag_rise: Further drag coefficient across the chord without viscosity.
        viscosity: Kinematic viscosity [m^2/s]; that of air unless given, whatever the density
            is: 1.0e-6 in water.

    References:
        Lee, Lua, Lim & Yeo (2016), Bioinspiration & Biomimetics 11, 036005.
    """

    lift_amplitude: float = 1.966
    zero_lift_drag: float = 0.031
    drag_rise: float = 3.746
    viscosity: float = 1.47e-5

    name = "reynolds"

    def __post_init__(self) -> None:
        check_fields(self)
        possible = self.zero_lift_drag >= 0 and self.zero_lift_drag + self.drag_rise >= 1.03
        self.require(possible and self.viscosity > 0, "a drag coefficient >= 0 at any Re, finite")

    def coefficients(self, flow: SectionFlow, parameters: Any) -> tuple[Any, Any]:
        """Coefficient of lift along (-normal, forward) velocity, and of drag."""
        re = smooth_norm((flow.speed * flow.chord / parameters[3]) ** 2, 20.0)
        lift = parameters[0] - 3.94 * re**-0.429
        drag = parameters[1] + 10.48 * re**-0.764
        rise = parameters[2] - 6.28 * re**-0.369
        return super().coefficients(flow, [lift, drag, rise])

    def downwash_factor(self, parameters: Any) -> Any:
        """Downwash over C_L without viscosity: what that takes from the slope is no downwash."""
        return SmoothPolar().downwash_factor(parameters)


@dataclass(frozen=True)
class TablePolar(Polar):
    """Polar from a table of points, such as those of a wind tunnel or a panel code.

    Between its points as `table_function` has it: smooth, and drag that is nowhere negative; held
    beyond the first and the last. A section that moves backward is its mirror image.

    Args:
        angle: Angles of attack, ascending, within -pi/2..pi/2, (n,) [rad].
        lift: C_L at each, (n,) [-].
        drag: C_D at each, (n,) [-].

    Raises:
        ParameterError: If they differ in length, are fewer than two, out of order or
            range, not finite, too large, or a drag is negative.
    """

    angle: tuple[float, ...]
    lift: tuple[float, ...]
    drag: tuple[float, ...]

    name = "table"
    __repr__ = brief

    def __post_init__(self) -> None:
        check_fields(self)
        columns = [self.angle, self.lift, self.drag]
        counts = [len(column) for column in columns]
        if not counts[0] == counts[1] == counts[2] >= 2:
            expected = "two or more angles, as many lifts and drags"
            raise ParameterError("polar table", expected, counts)
        angle, lift, drag = np.array(columns, float)
        within = (np.abs(angle) <= pi / 2 + 1e-9) & (np.diff(angle, prepend=-np.inf) > 0)
        sound = within & (drag >= 0) & (np.maximum(np.abs(lift), drag) <= _LARGEST)
        if not sound.all():
            k = int(np.argmin(sound))
            expected = "ascending angles from -90 to 90 degrees (a section that moves backward is"
            expected += f" its mirror image), drags >= 0, coefficients of {_LARGEST:g} at most"
            found = f"{np.degrees(angle[k]):.4g} degrees, C_L {lift[k]:.4g}, C_D {drag[k]:.4g}"
            raise ParameterError(f"polar table: point {k + 1}", expected, found)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of `parameters`."""
        return tuple(f"{column}[{k}]" for column in _COLUMNS for k in range(len(self.angle)))

    @property
    def parameters(self) -> Array:
        """Values of the parameters, (3 n,)."""
        return np.array([*self.angle, *self.lift, *self.drag])

    def coefficients(self, flow: SectionFlow, parameters: Any) -> tuple[Any, Any]:
        """Coefficient of lift along (-normal, forward) velocity, and of drag."""
        table = ca.reshape(parameters, len(self.angle), len(_COLUMNS))
        lift, drag = ca.vertsplit(table_values(flow.angle_of_attack, table[:, 0], table[:, 1:]))
        return flow.forward_sign * lift, drag


_COLUMNS = ("angle", "lift", "drag")
_LARGEST = 1e6  # of a coefficient, far beyond any section's


_KINDS: list[type[Polar]] = [DickinsonPolar, SmoothPolar, ReynoldsPolar, TablePolar]


def register_polar(kind: type[_Kind]) -> type[_Kind]:
    """Class decorator that lets flights flown with an own polar be read again.

    Args:
        kind: Frozen dataclass derived from `Polar`, with a `name` of its own.

    Raises:
        ParameterError: If it is none, or a polar of another class has the name.
    """
    if Polar not in getattr(kind, "__mro__", ()):
        raise ParameterError("kind", "a class derived from Polar", kind)
    for known in [known for known in _KINDS if known.name == kind.name]:
        if known.__qualname__ != kind.__qualname__:
            raise ParameterError("name of the polar", "one of its own", kind.name)
        _KINDS.remove(known)  # the same class, defined once more
    _KINDS.append(kind)
    return kind


def polar_from_description(description: Mapping[str, Any]) -> Polar:
    """Polar of `describe()`.

    Raises:
        ParameterError: If the name is unknown, or a key is missing or unknown.
    """
    polar: Polar = from_named_description("polar", tuple(_KINDS), description)
    return polar
