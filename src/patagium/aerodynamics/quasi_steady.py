"""Quasi-steady blade elements: the air answers the present motion of each strip.

Lift is perpendicular to the velocity of the point where it acts and drag opposes
it, so the air never does work on a robot in still air. Neglected: history of the
flow (Wagner, dynamic stall), induced velocity, added mass, flow along the span.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import pi
from typing import Any, Literal

import casadi as ca

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.ground import strip_ground_shares
from patagium.aerodynamics.local_flow import StripMotion, strip_motions
from patagium.aerodynamics.model import Aerodynamics
from patagium.aerodynamics.of_wings import OfWings
from patagium.aerodynamics.polars import DickinsonPolar, Polar, section_flow
from patagium.aerodynamics.smooth_functions import smooth_norm, smooth_sign
from patagium.aerodynamics.strip_loads import AeroExpressions, StripLoad, assemble
from patagium.aerodynamics.trailing_vortices import spans_and_areas
from patagium.arguments import check_fields
from patagium.robot.model import Robot

_ROUNDS = 3
"""Times that lift is found where there is ground, which takes a part of the last one's downwash."""


@dataclass(frozen=True)
class QuasiSteady(Aerodynamics):
    """Quasi-steady blade elements with a polar.

    With v = (v_f, v_n) the velocity of the force point relative to the air, forward
    along the chord and normal to it, a = atan2(-v_n, |v_f|), A = chord x width:

        drag = -1/2 rho A |v| C_D(|a|) v,
        lift = 1/2 rho A |v| sgn(a) C_L(|a|) sgn(v_f) (-v_n, v_f),

    so F . v = -1/2 rho A |v|^3 C_D <= 0. The force point is a quarter chord ahead of
    mid-chord moving forward, behind it moving backward. sgn(v_f) and |v| are smoothed
    within `smooth_functions.SWITCH_SPEED` of zero, the equations exact beyond. The rotational
    term adds circulation C_rot c^2 w of the pitching strip by Kutta-Joukowski,
    rho C_rot c^2 w width (-v_n, v_f) (leading edge rising at w): perpendicular to v,
    it does no work either. Ground takes away a share of the downwash that the polar holds
    (`Polar.downwash_factor`), which turns the flow that the coefficients answer to.

    Args:
        robot: The machine.
        air: Density, wind and gusts.
        polar: Section coefficients: of all wings, or of each by the name of the wing; a mirror
            image has those of its original where it is not named.
        rotational: Whether pitching adds circulation.
        rotational_coefficient: C_rot of it; pi (3/4 - x0), x0 = 1/4 where the incidence is taken.
        force_point: Where the force acts. "switching": as above. "fixed": a quarter chord ahead of
            mid-chord, as models of insects have it in their hinge axis. "moving": .82 |a|/pi + .05
            of the chord behind the edge that leads, a that of mid-chord, for wings that turn by
            themselves on a hinge.

    Raises:
        ParameterError: If polars are given by wing, and a wing has none or a name is that of none.

    References:
        Dickinson, Lehmann & Sane (1999), Science 284, 1954-1960.
        Dickson, Straw, Poelma & Dickinson (2006), AIAA 2006-34 (force point that moves).
        Sane & Dickinson (2002), J. Exp. Biol. 205, 1087-1096 (rotational term).
    """

    robot: Robot
    air: Air = field(default_factory=Air)
    polar: Polar | Mapping[str, Polar] = field(default_factory=DickinsonPolar, hash=False)
    rotational: bool = False
    force_point: Literal["switching", "fixed", "moving"] = "switching"
    rotational_coefficient: float = pi / 2

    name = "quasi_steady"

    def __post_init__(self) -> None:
        check_fields(self)
        self._polars  # raises for wings without one  # noqa: B018

    @cached_property
    def _polars(self) -> OfWings[Polar]:
        return OfWings("polar", self.polar, self.robot)

    @property
    def state_size(self) -> int:
        """No states of its own."""
        return 0

    @property
    def structure(self) -> str:
        """Text of what shapes the equations, numbers aside: part of a compiled function's key."""
        point = "" if self.force_point == "switching" else f" {self.force_point} force point"
        ground = " ground" if self.air.ground_parameters else ""
        shape = f"{self._polars.structure} rotational={self.rotational}"
        return f"{self.name} {shape}{point}{ground}"

    @property
    def numbers(self) -> dict[str, float]:
        """Parameters of the model by name, in their order [SI]."""
        found = {"density": self.air.density, **self._polars.numbers}
        if self.rotational:
            found["rotational_coefficient"] = self.rotational_coefficient
        return found | self.air.ground_parameters

    def expressions(
        self, robot: Robot, q: ca.SX, v: ca.SX, state: ca.SX, wind: ca.SX, parameters: ca.SX
    ) -> AeroExpressions:
        """Equations of the model; see `Aerodynamics.expressions`."""
        motions = strip_motions(robot, q, v, wind)
        spans = [span for span, _ in spans_and_areas(self.robot, robot)]
        shares = strip_ground_shares(self.air, robot, q, spans, parameters)
        pairs = zip(motions, shares, strict=True)
        loads = [self._load(motion, parameters, share) for motion, share in pairs]
        return assemble(robot, q, loads, ca.SX(0, 1))

    def _load(self, motion: StripMotion, parameters: ca.SX, ground: Any = 0.0) -> StripLoad:
        """Force of a strip by its polar at its point of force, with the ground's upwash."""
        strip, density = motion.strip, parameters[0]
        polar, numbers = self._polars.of(strip.wing, parameters[1:])
        ahead, side = ca.SX(0.0), smooth_sign(motion.forward)
        if self.force_point != "fixed":
            ahead = (side - 1.0) * (strip.chord / 4)
        if self.force_point == "moving":
            middle = section_flow(motion.forward, motion.normal_ahead(-strip.chord / 4))
            size = smooth_norm(middle.angle_of_attack**2, 0.02)
            ahead = ahead + side * (0.2 - 0.82 / pi * size) * strip.chord
        factor, own = polar.downwash_factor(numbers), ca.SX(0.0)
        for _ in range(_ROUNDS if self.air.ground_parameters else 1):
            normal = motion.normal_ahead(ahead) - ground * own
            flow = section_flow(motion.forward, normal, strip.chord)
            lift, drag = polar.coefficients(flow, numbers)
            own = lift * flow.forward_sign * flow.speed * factor
        mass_flow = density * strip.width * strip.chord * flow.speed / 2
        across, along = mass_flow * lift, mass_flow * drag
        if self.rotational:
            coefficient = parameters[1 + len(self._polars.numbers)]
            circulation = coefficient * strip.chord**2 * motion.pitch_rate
            across = across + density * strip.width * circulation
        return StripLoad(
            motion=motion,
            forward=-across * flow.normal - along * flow.forward,
            normal=across * flow.forward - along * flow.normal,
            ahead=ahead,
            effective_angle_of_attack=flow.angle_of_attack,
            downwash=own * (1.0 - ground),
        )
