"""Unsteady lifting line in state-space form: strips with memory that feel each other.

Every strip is an unsteady thin airfoil in the wind that all strips' trailing vortices
induce; its memory of the wake shed across the span is a few lagged normalwashes.
Neglected: added mass (apart, `added_mass`), wake that bends, bound vortices' wind on
strips of the same wing, lift of a body between wings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.indicial import TWO_STATE, Indicial, Lags, Relaxation, lag_relaxation
from patagium.aerodynamics.local_flow import StripMotion, airspeed, normalwash
from patagium.aerodynamics.model import Aerodynamics
from patagium.aerodynamics.of_wings import OfWings
from patagium.aerodynamics.polars import SectionFlow, rounded_ramp, section_flow
from patagium.aerodynamics.sections import (
    DELAYS,
    FEEBLE,
    STATES,
    Section,
    StallDelay,
    StripSection,
    faster,
    held_share,
    vortex_lift,
)
from patagium.aerodynamics.smooth_functions import smooth_norm, smooth_sign
from patagium.aerodynamics.strip_loads import AeroExpressions, StripLoad, assemble
from patagium.aerodynamics.trailing_vortices import (
    SURFACE_CONSTANT,
    Normalwash,
    VortexSystem,
    attached_lift,
    solve_normalwash,
    surface_gains,
    vortex_system,
)
from patagium.arguments import check_fields
from patagium.arrays import Array, brief, real_array
from patagium.errors import not_negative
from patagium.robot.model import Robot
from patagium.robot.strip_chains import StripChain, strip_chains


@dataclass(frozen=True)
class StateSpace:
    """The air as a linear system at a state of the robot, before stall.

    dz/dt = A z + B w, L = C z + D w: z the lagged normalwashes (n_z,) [m/s], w the
    geometric normalwash of each strip (n_s,) [m/s], L its attached lift (n_s,) [N].

    Attributes:
        a: (n_z, n_z) [1/s].
        b: (n_z, n_s) [1/s].
        c: (n_s, n_z) [N s/m].
        d: (n_s, n_s) [N s/m].
    """

    a: Array
    b: Array
    c: Array
    d: Array

    __repr__ = brief


@dataclass(frozen=True)
class LiftingLine(Aerodynamics):
    """State-space unsteady lifting line with induced drag, profile drag and stall.

    With w the normalwash at three quarters of the chord c, Q_n the normal velocity that
    unit circulations induce, g_k, a_k, b_k the amplitudes and rates of the lags z_k:

        circulation  G = 1/2 c a0 (Gamma(0) w_e + sum_k g_k z_k),   w_e = w + Q_n G,
        memory       dz_k/dt = (2U/c) b_k (w_e - z_k),
        lift         L = 1/2 rho c ds a0 U W,                       W = phi(0) w_e + sum_k a_k z_k,

    perpendicular to the wind u + Q G + (W - w_e) along the lift: induced drag is the tilt.
    a0 is the section's slope times the cosine of the sweep of the quarter chord, to whose line
    the force is perpendicular too. Low aspect ratio takes a gain off L and G; profile drag is
    1/2 rho c ds C_d |u| u; the section says what share of the flow is separated at the effective
    incidence atan2(W, |u_chord|), and its loads. A wing that moves backward is its mirror image,
    but for its quarter-chord line, whose slope stays that of forward motion: a delta flown backward
    has 10 % more lift than its mirror image flown forward.
    Signs and norms are smoothed within `smooth_functions.SWITCH_SPEED` of zero.

    Args:
        robot: The machine.
        air: Density, wind and gusts.
        lags: Memory of each strip.
        section: What a strip's section makes of its wind: of all wings, or of each by the name of
            the wing; a mirror image has that of its original where it is not named.
        surface_constant: K of the gain of a lifting surface over a lifting line,
            [1/2pi + 1/(pi AR)] / [1/2pi + 1/(pi AR) + K pi/(180 AR^2)]; 0: none.
        stall_delay: Dynamic stall, three more states a strip; None: separation takes no time.

    Raises:
        ParameterError: If `surface_constant` is negative or not finite, or sections are given by
            wing, and a wing has none or a name is that of none.

    References:
        Izraelevitz, Zhu & Triantafyllou (2017), State-space adaptation of unsteady lifting
        line theory: twisting/flapping wings of finite span, AIAA Journal 55, 1279-1294.
    """

    robot: Robot
    air: Air = field(default_factory=Air)
    lags: Indicial = TWO_STATE
    section: StripSection | Mapping[str, StripSection] = field(default_factory=Section, hash=False)
    surface_constant: float = SURFACE_CONSTANT
    stall_delay: StallDelay | None = None

    name = "lifting_line"

    def __post_init__(self) -> None:
        check_fields(self)
        not_negative(self, "surface_constant")
        self.sections  # raises for wings without one  # noqa: B018

    @cached_property
    def sections(self) -> OfWings[StripSection]:
        """Sections by wing, and their numbers."""
        return OfWings("section", self.section, self.robot)

    @property
    def chains(self) -> tuple[StripChain, ...]:
        """Chains of strips that share trailing vortices."""
        return strip_chains(self.robot)

    @property
    def state_size(self) -> int:
        """Number of states: lagged normalwashes, strip by strip, the lags of each together.

        With a stall delay the lagged pressures of all strips follow, as normalwashes, then
        their separated shares, then what their vortices have shed, as lift coefficients.
        """
        return len(self.robot.strips) * (self.lags.size + (STATES if self.stall_delay else 0))

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the states, in the order of `state_size`."""
        washes = len(self.robot.strips) * (self.lags.size + 1)
        return tuple("m/s" if k < washes else "1" for k in range(self.state_size))

    @property
    def structure(self) -> str:
        """Text of what shapes the equations, numbers aside: part of a compiled function's key."""
        delay = " stall_delay" if self.stall_delay else ""
        ground = " ground" if self.air.ground_parameters else ""
        shape = f"lags={self.lags.size} {self.sections.structure} {self.chains}"
        return f"{self.name} {shape}{delay}{ground}"

    @property
    def numbers(self) -> dict[str, float]:
        """Parameters of the model by name, in their order [SI]."""
        found = {"density": self.air.density, "surface_constant": self.surface_constant}
        for part, values in vars(self.lags).items():
            found |= {f"lags.{part}[{k}]": x for k, x in enumerate(values)}
        found |= self.sections.numbers
        for name in DELAYS if self.stall_delay else ():
            found[f"stall_delay.{name}"] = getattr(self.stall_delay, name)
        return found | self.air.ground_parameters

    def expressions(
        self, robot: Robot, q: ca.SX, v: ca.SX, state: ca.SX, wind: ca.SX, parameters: ca.SX
    ) -> AeroExpressions:
        """Equations of the model; see `Aerodynamics.expressions`."""
        if not robot.strips:
            return assemble(robot, q, [], ca.SX(0, 1))
        p = _Numbers(self, parameters)
        vortices = vortex_system(robot, self.chains, (q, v, wind), p.ground)
        motions, net = vortices.motions, vortices.lattice
        geometric = ca.vertcat(*[normalwash(one) - _camber(one, p) for one in motions])
        wash = solve_normalwash(vortices, geometric, state, p.lags, p.lift_slopes(motions))
        gains = surface_gains(self.robot, robot, p.surface_constant)
        late = geometric - wash.effective
        stalls = [
            self._stall(
                motion, (wash.lagged[i], late[i]), gains[i] * net.cosines[i], state[self._own(i)], p
            )
            for i, motion in enumerate(motions)
        ]
        loads = [_load(vortices, wash, gains[i], p, i, stall) for i, stall in enumerate(stalls)]
        lags = lag_relaxation(motions, wash.effective, p.lags)
        memory = Relaxation(
            ca.vertcat(lags.rate, ca.vec(ca.vertcat(*[stall.rates.T for stall in stalls]))),
            ca.vertcat(lags.target, ca.vec(ca.vertcat(*[stall.targets.T for stall in stalls]))),
        )
        return assemble(robot, q, loads, memory.derivative(state), memory)

    def state_space(self, q: ArrayLike, v: ArrayLike, wind: ArrayLike | None = None) -> StateSpace:
        """The attached flow's matrices at a state of the robot.

        Args:
            q: Generalized coordinates, (n_q,) [m, rad, 1].
            v: Generalized velocities, (n,) [m/s, rad/s].
            wind: Velocity of the air, world axes, (3,) [m/s]; that of `air` at t = 0 by default.

        Raises:
            ShapeError: If an argument has another shape.
        """
        given = self.air.wind_at([0.0])[0] if wind is None else wind
        sizes = self.robot.coordinate_count, self.robot.dof, 3
        named = zip(("q", "v", "wind"), (q, v, given), sizes, strict=True)
        arrays = [real_array(name, value, (size,)) for name, value, size in named]
        matrices = self._state_space(*arrays, 0, 0)  # linear: the same at any lag and normalwash
        return StateSpace(*[np.array(matrix) for matrix in matrices])

    @cached_property
    def _state_space(self) -> ca.Function:
        robot, p = self.robot, _Numbers(self, ca.SX(ca.DM(self.parameters)))
        q, v = ca.SX.sym("q", robot.coordinate_count), ca.SX.sym("v", robot.dof)
        wind = ca.SX.sym("wind", 3)
        count = len(robot.strips)
        state, normalwash = ca.SX.sym("z", count * self.lags.size), ca.SX.sym("w", count)
        vortices = vortex_system(robot, self.chains, (q, v, wind), p.ground)
        motions, net = vortices.motions, vortices.lattice
        wash = solve_normalwash(vortices, normalwash, state, p.lags, p.lift_slopes(motions))
        gains = surface_gains(robot, robot, p.surface_constant)
        derivative = lag_relaxation(motions, wash.effective, p.lags).derivative(state)
        lift = [
            gain * net.cosines[i] * net.shares[i] * _pressure(motion, p) * wash.lagged[i]
            for i, (motion, gain) in enumerate(zip(motions, gains, strict=True))
        ]
        results = [
            ca.densify(ca.jacobian(y, x))
            for y in (derivative, ca.vertcat(*lift))
            for x in (state, normalwash)
        ]
        return ca.Function("state_space", [q, v, wind, state, normalwash], results)

    def _own(self, strip: int) -> list[int]:
        """Places in the state of a strip's stall delay: p, s and y."""
        count = len(self.robot.strips)
        first = count * self.lags.size + strip
        return [first + k * count for k in range(STATES if self.stall_delay else 0)]

    def _stall(
        self, motion: StripMotion, wash: tuple[Any, Any], gain: Any, own: ca.SX, p: _Numbers
    ) -> _Stall:
        """Separation of a strip; `wash` is its lagged, and its geometric less its effective one."""
        lagged, late = wash
        forward, section = motion.forward, p.of(motion)
        effective = section_flow(forward, -lagged)
        static = section.kind.separated_share(effective, section.parameters)
        if self.stall_delay is None:
            return _Stall(static, None, 0.0, ca.SX(0, 1), ca.SX(0, 1))
        pressure, separated, shed = own[0], own[1], own[2]
        held = held_share(effective)
        camber = section.numbers["zero_lift_angle"] * forward * effective.forward_sign
        flow = section_flow(forward, -(pressure + late + camber), motion.strip.chord)
        across, _ = section.kind.stalled.coefficients(flow, section.stalled)
        attached = gain * section.numbers["lift_slope"] * lagged / effective.speed
        fed = held * separated * (attached - across * effective.forward_sign)
        reached = section_flow(forward, -pressure)
        steady = section.kind.separated_share(reached, section.parameters)
        through = faster(airspeed(motion), reached.speed)
        return _Stall(
            share=held * separated + (1.0 - held) * static,
            flow=flow,
            vortex=vortex_lift(fed, shed),
            rates=2 * through / motion.strip.chord / p.delays[:STATES],
            targets=ca.vertcat(lagged, steady, fed),
        )


@dataclass(frozen=True)
class _Stall:
    """Separation of a strip.

    Attributes:
        share: Share of separated flow.
        flow: Flow that its coefficients answer to; None: that of the strip's own motion.
        vortex: Coefficient of the vortex's lift.
        rates: How fast p, s and y follow, (3, 1) or (0, 1) [1/s].
        targets: What they follow, alike [m/s, -, -].
    """

    share: Any
    flow: SectionFlow | None
    vortex: Any
    rates: ca.SX
    targets: ca.SX

    def load(self, motion: StripMotion, flow: SectionFlow, p: _Numbers) -> tuple[Any, Any, Any]:
        """Coefficients of the separated flow's force forward and normal, and of its moment [1, m].

        The lagged incidence may turn the force along the motion of a wing that feathers fast,
        where it would give power out of nothing. That power is taken out again, as drag.

        Args:
            motion: How the strip moves.
            flow: Geometric, where the force acts.
            p: Parameters.
        """
        seen, sign, chord = self.flow or flow, flow.forward_sign, motion.strip.chord
        section = p.of(motion)
        across, along = section.kind.stalled.coefficients(seen, section.stalled)
        across, along = (self.share * x / seen.speed for x in (across, along))
        forward = -across * seen.normal - along * seen.forward
        normal = across * seen.forward - along * seen.normal
        moment = section.kind.moment(seen, section.parameters) * chord
        if self.flow is not None:
            lost = self.share * self.share  # of the suction, a smooth 1 - sqrt(1 - s)
            to_wind = self.vortex * (1.0 - lost) * sign / flow.speed
            forward = forward - to_wind * flow.normal
            normal = normal + to_wind * flow.forward + self.vortex * lost
            moment = moment - sign * p.delays[-1] * self.vortex * chord
            power = forward * flow.forward + normal * flow.normal + moment * motion.pitch_rate
            drag = rounded_ramp(power / flow.speed - FEEBLE, FEEBLE) / flow.speed
            forward, normal = forward - drag * flow.forward, normal - drag * flow.normal
        return forward, normal, moment


@dataclass(frozen=True)
class _SectionNumbers:
    """Section of a strip, its parameters, those that have names, and those of its polar."""

    kind: StripSection
    parameters: Any
    numbers: dict[str, Any]
    stalled: Any


class _Numbers:
    """Parameters of a lifting line by name, from its symbols or values."""

    def __init__(self, model: LiftingLine, parameters: Any) -> None:
        count = model.lags.size
        parts = [[parameters[2 + part * count + k] for k in range(count)] for part in range(3)]
        self.density, self.surface_constant = parameters[0], parameters[1]
        self.lags = Lags(*parts)
        last = 2 + 3 * count + len(model.sections.numbers)
        delays = last + (len(DELAYS) if model.stall_delay else 0)
        self._sections, self._of_sections = model.sections, parameters[2 + 3 * count : last]
        self.delays, self.ground = parameters[last:delays], parameters[delays:]

    def of(self, motion: StripMotion) -> _SectionNumbers:
        """Section of a strip."""
        kind, parameters = self._sections.of(motion.strip.wing, self._of_sections)
        return _SectionNumbers(kind, parameters, *kind.named(parameters))

    def lift_slopes(self, motions: Sequence[StripMotion]) -> list[Any]:
        """Lift slope of the section of each strip [1/rad]."""
        return [self.of(motion).numbers["lift_slope"] for motion in motions]


def _camber(motion: StripMotion, p: _Numbers) -> Any:
    """Normal velocity at which a cambered section has no lift [m/s]."""
    return p.of(motion).numbers["zero_lift_angle"] * motion.forward * smooth_sign(motion.forward)


def _pressure(motion: StripMotion, p: _Numbers) -> Any:
    """Attached lift per normalwash, 1/2 rho c ds a0 U [N s/m]."""
    area = motion.strip.chord * motion.strip.width
    return p.density * area * p.of(motion).numbers["lift_slope"] * airspeed(motion) / 2


def _load(
    vortices: VortexSystem,
    wash: Normalwash,
    gain: Any,
    p: _Numbers,
    i: int,
    stall: _Stall,
) -> StripLoad:
    """Force and moment of a strip from its lagged normalwash, attached and separated parts."""
    motion, net = vortices.motions[i], vortices.lattice
    strip, forward, section = motion.strip, motion.forward, p.of(motion)
    sign, lagged = smooth_sign(forward), wash.lagged[i]
    sine_square = lagged * lagged / smooth_norm(forward * forward + lagged * lagged) ** 2
    separated, attached = stall.share, 1.0 - stall.share
    shift = sign * section.kind.center_of_pressure_shift * sine_square * separated
    ahead = (sign - 1.0) * (strip.chord / 4) - shift * strip.chord
    normal = motion.normal_ahead(ahead)

    flow = section_flow(forward, normal, strip.chord)
    lift = attached_lift(vortices, wash, i, gain, _pressure(motion, p), ahead)
    density_area = p.density * strip.chord * strip.width
    friction = attached * density_area * section.numbers["profile_drag"] / 2
    spanwise = motion.spanwise_ahead(ahead)
    friction = friction * smooth_norm(flow.speed * flow.speed + spanwise * spanwise)
    pressure = density_area * flow.speed * flow.speed / 2
    stalled = [pressure * one for one in stall.load(motion, flow, p)]
    effective = section_flow(forward, -lagged - _camber(motion, p))
    return StripLoad(
        motion=motion,
        forward=attached * lift[0] + stalled[0] - friction * forward,
        normal=attached * lift[1] + stalled[1] - friction * normal,
        ahead=ahead,
        effective_angle_of_attack=effective.angle_of_attack,
        spanwise=attached * lift[2] - friction * spanwise,
        circulation=gain * wash.circulation[i],
        downwash=-gain * ca.dot(net.normals[:, i], wash.induced[:, i]),
        moment=stalled[2],
    )
