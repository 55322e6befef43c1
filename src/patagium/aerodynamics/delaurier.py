"""DeLaurier's strip model: the unsteady strip theory of the ornithopter literature.

Every strip answers for itself; the finite span is a factor and a memory from the wing's
aspect ratio, leading-edge suction pulls, and beyond a stall angle only a normal force of
crossflow is left. The published model is written for harmonic motion; its memory is that
of one lag a strip, and so it is written here, for any motion. Neglected: what strips do to
each other, the pitching moment of camber; added mass is apart (`AddedMass`), where stall
does not halve it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import pi, radians
from typing import Any, TypeAlias

import casadi as ca

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.ground import strip_ground_shares
from patagium.aerodynamics.indicial import Relaxation
from patagium.aerodynamics.local_flow import StripMotion, airspeed, normalwash, strip_motions
from patagium.aerodynamics.model import Aerodynamics
from patagium.aerodynamics.of_wings import wings_of
from patagium.aerodynamics.polars import section_flow
from patagium.aerodynamics.sections import check_zero_lift
from patagium.aerodynamics.smooth_functions import smooth_norm, smooth_sign, smooth_step
from patagium.aerodynamics.strip_loads import AeroExpressions, StripLoad, assemble
from patagium.aerodynamics.trailing_vortices import spans_and_areas
from patagium.arguments import check_fields
from patagium.errors import ParameterError
from patagium.robot.model import Robot

_Number: TypeAlias = float | Mapping[str, float]
"""Number of the section: of all wings, or of each by the name of the wing."""


@dataclass(frozen=True)
class DeLaurier(Aerodynamics):
    """Strips with the memory of a finite wing, leading-edge suction, and stall.

    With w the normalwash at three quarters of the chord c (camber included), A the wing's
    aspect ratio, U and V the airspeeds at three quarters and, downwash included, at a
    quarter of the chord, r the pitch rate, u the speed to the leading edge:

        W = A/(2+A) [(1 - C1) w + C1 z],   dz/dt = (2U/c) C2 (w - z),
        C1 = A/2 / (2.32+A),               C2 = .181 + .772/A,
        normal force      N = 1/2 rho a0 c ds V W,
        suction           T = eta 1/2 rho a0 c ds V/U (W - c r/2) W,
        friction          F = 1/2 rho C_f c ds |u| u,

    N and T at the quarter chord; W without camber in T, where camber adds its own pull. The
    published suction's (c r/4)^2 is the carried air's and comes with `AddedMass`. Where the
    incidence of the leading edge passes the stall angle, only a normal force is left,
    1/2 rho C_c c ds |v| v_n at mid-chord, v not slowed by downwash; within `stall_width` of
    that angle both have a share. A wing that moves backward is its mirror image; signs and
    norms are smoothed within `smooth_functions.SWITCH_SPEED` of zero. Ground that takes away the
    share s of the downwash makes A an aspect ratio of A/(1 - s). Each strip's memory loses
    energy in any plunging motion: 0 < |C|^2 <= Re C for C = 1 - C1 i k/(i k + C2).

    Each number below is that of all wings, or a mapping by the name of the wing, such as
    zero_lift_angle={"left_wing": -.05, "fin": 0}; a mirror image has that of its original where it
    is not named.

    Args:
        robot: The machine.
        air: Density, wind and gusts.
        lift_slope: a0 [1/rad].
        zero_lift_angle: Incidence of no lift, negative for usual camber [rad].
        suction_efficiency: eta, 0 to 1.
        friction_drag: C_f; that of a turbulent plate, .89/(log10 Re)^2.58, at Re = 3e4.
        stall_angle: [rad].
        stall_width: Half of the band of incidence in which both flows share [rad].
        crossflow_drag: C_c.

    Raises:
        ParameterError: If a number is not finite or not possible, or numbers are given by wing,
            and a wing has none or a name is that of none.

    References:
        DeLaurier (1993), An aerodynamic model for flapping-wing flight, Aeronautical
        Journal 97, 125-130.
        Scherer (1968), Hydronautics Report 350 (memory of finite wings).
    """

    robot: Robot
    air: Air = field(default_factory=Air)
    lift_slope: _Number = 2 * pi
    zero_lift_angle: _Number = 0.0
    suction_efficiency: _Number = 0.98
    friction_drag: _Number = 0.0186
    stall_angle: _Number = radians(13.0)
    stall_width: _Number = radians(2.0)
    crossflow_drag: _Number = 1.98

    name = "delaurier"

    def __post_init__(self) -> None:
        check_fields(self)
        for wing in {strip.wing: None for strip in self.robot.strips} or [""]:
            _check(self._of(wing, self.numbers))

    def _of(self, wing: str, numbers: Mapping[str, Any]) -> dict[str, Any]:
        """Section parameters of one wing by name, picked from the parameters of the model."""
        found = {}
        for name in NUMBERS:
            given = getattr(self, name)
            own = isinstance(given, Mapping) and wings_of(name, given, self.robot)[wing]
            found[name] = numbers[f"{name}.{own}" if own else name]
        return found

    @property
    def state_size(self) -> int:
        """One lagged normalwash a strip [m/s]."""
        return len(self.robot.strips)

    @property
    def structure(self) -> str:
        """Text of what shapes the equations, numbers aside: part of a compiled function's key."""
        own = [name for name in self.numbers if "." in name]
        return " ".join([self.name, *own, *["ground"] * bool(self.air.ground_parameters)])

    @property
    def numbers(self) -> dict[str, float]:
        """Parameters of the model by name, in their order [SI]."""
        found = {"density": self.air.density}
        for name in NUMBERS:
            given = getattr(self, name)
            own = given if isinstance(given, Mapping) else {"": given}
            found |= {f"{name}.{wing}".rstrip("."): value for wing, value in own.items()}
        return found | self.air.ground_parameters

    def expressions(
        self, robot: Robot, q: ca.SX, v: ca.SX, state: ca.SX, wind: ca.SX, parameters: ca.SX
    ) -> AeroExpressions:
        """Equations of the model; see `Aerodynamics.expressions`."""
        p = {name: parameters[k] for k, name in enumerate(self.parameter_names)}
        sizes = spans_and_areas(self.robot, robot)
        spans = [span for span, _ in sizes]
        shares = strip_ground_shares(self.air, robot, q, spans, parameters)
        ratios = [
            span * span / area / (1.0 - share)
            for (span, area), share in zip(sizes, shares, strict=True)
        ]
        motions = strip_motions(robot, q, v, wind)
        sections = [self._of(strip.wing, p) | {"density": p["density"]} for strip in robot.strips]
        parts = [_strip(one, ratios[i], state[i], sections[i]) for i, one in enumerate(motions)]
        memory = Relaxation(*(ca.vertcat(ca.SX(0, 1), *[one[k] for one in parts]) for k in (1, 2)))
        return assemble(robot, q, [load for load, *_ in parts], memory.derivative(state), memory)


NUMBERS = tuple(field.name for field in fields(DeLaurier))[2:]
"""Parameters in addition to the density, in their order."""


def _check(section: dict[str, float]) -> None:
    """Refuse section parameters out of their range."""
    for name, value in section.items():
        if not (value >= 0 or name == "zero_lift_angle"):
            raise ParameterError(name, "zero or more", value)
    check_zero_lift(section["zero_lift_angle"])
    if section["suction_efficiency"] > 1:
        raise ParameterError("suction_efficiency", "0 to 1", section["suction_efficiency"])
    width, angle = section["stall_width"], section["stall_angle"]
    if not 0 < width < min(angle, pi / 2 - angle):
        stall = (angle, width)
        raise ParameterError("stall", "0 < stall_angle -+ stall_width < pi/2", stall)


def _strip(
    motion: StripMotion, aspect_ratio: Any, lag: Any, p: dict[str, Any]
) -> tuple[StripLoad, Any, Any]:
    """Load of a strip; how fast its lagged normalwash follows, and what."""
    forward, chord = motion.forward, motion.strip.chord
    sign = smooth_sign(forward)
    camber = p["zero_lift_angle"] * forward * sign
    wash, through = normalwash(motion) - camber, airspeed(motion)
    held_back = aspect_ratio / 2 / (2.32 + aspect_ratio)
    rate = (0.181 + 0.772 / aspect_ratio) * 2 * through / chord
    share_of_span = aspect_ratio / (2 + aspect_ratio)
    lagged = share_of_span * ((1 - held_back) * wash + held_back * lag)

    swing = sign * chord * motion.pitch_rate
    uncambered = lagged + camber
    at_edge = section_flow(forward, 0.75 * swing - uncambered)
    sine = at_edge.normal / at_edge.speed
    begins, complete = (ca.sin(p["stall_angle"] + side * p["stall_width"]) ** 2 for side in (-1, 1))
    separated = smooth_step((sine * sine - begins) / (complete - begins))
    attached = 1.0 - separated
    ahead = (sign - 1.0 - sign * separated) * (chord / 4)

    density_area = p["density"] * chord * motion.strip.width / 2
    at_quarter = uncambered - swing / 2
    speed = smooth_norm(forward * forward + at_quarter * at_quarter)
    circulatory = attached * density_area * p["lift_slope"] * speed
    suction = p["suction_efficiency"] * uncambered * at_quarter
    pull = sign * circulatory * (suction / through - p["zero_lift_angle"] * uncambered)
    friction = attached * density_area * p["friction_drag"] * forward * forward * sign
    crossflow = motion.normal_ahead(ahead)
    crossing = smooth_norm(forward * forward + crossflow * crossflow)
    normal = separated * density_area * p["crossflow_drag"] * crossing * crossflow
    load = StripLoad(
        motion=motion,
        forward=pull - friction,
        normal=circulatory * lagged - normal,
        ahead=ahead,
        effective_angle_of_attack=at_edge.angle_of_attack,
        circulation=attached * chord * p["lift_slope"] / 2 * lagged,
        downwash=wash - lagged,
    )
    return load, rate, wash
