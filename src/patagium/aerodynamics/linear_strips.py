"""Air around wings as a sum of physical terms and of corrections, linear in their weights.

    Q = sum_k w_k Q_k(q, v, a)

The terms Q_k are those of known physics (blade elements, added mass, circulation, drag of
separated flow, drag of bodies without wings), each of which any wing has to some degree, and
corrections: polynomials of the flow at a strip times the coefficients of its section. Friction and
separated flow go with the whole velocity at a strip, the part along its span too. All weights are
dimensionless. A robot with wings of several kinds, fore and hind or wing and tail, has the terms of
strips once for all of them and once more for each kind: a tail of another section departs a little
from what is common. Where flow is attached, a lifting line takes the place of blade elements:
strips with one lag each and the trailing vortices they share. Neglected: Reynolds number, ground,
wind that differs from strip to strip; where flow is not attached, history of the flow and
neighboring strips.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import pi
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from patagium.aerodynamics.added_mass import AddedMass
from patagium.aerodynamics.air import Air
from patagium.aerodynamics.indicial import NO_STATE, ONE_STATE, lag_relaxation
from patagium.aerodynamics.local_flow import (
    airspeed,
    body_airflows,
    lift_place,
    normalwash,
    strip_axes,
)
from patagium.aerodynamics.model import Aerodynamics
from patagium.aerodynamics.quasi_steady import QuasiSteady
from patagium.aerodynamics.smooth_functions import smooth_norm, smooth_sign
from patagium.aerodynamics.strip_loads import AeroExpressions
from patagium.aerodynamics.trailing_vortices import (
    SURFACE_CONSTANT,
    Normalwash,
    attached_lift,
    solve_normalwash,
    surface_gains,
    vortex_system,
)
from patagium.arguments import check_fields
from patagium.arrays import real_array
from patagium.dynamics.chain import vector
from patagium.dynamics.kinematics import Twist, add_wrench, body_poses, generalized_force
from patagium.dynamics.rnea import body_accelerations, kirchhoff_force
from patagium.errors import ParameterError
from patagium.robot.model import Body, Robot
from patagium.robot.planform import sides_of
from patagium.robot.strip_chains import strip_chains


class Term(NamedTuple):
    """Physical term of the air's force, and the prior of its weight.

    Attributes:
        name: What the term is.
        std: Standard deviation of the weight [1].
        mean: Weight that is expected [1].
    """

    name: str
    std: float
    mean: float = 0.0


WHOLE_TERMS = (
    Term("blade elements", 1.0, mean=1.0),
    Term("added mass", 2.0, mean=1.0),
    Term("circulation beside added mass", 5.0, mean=1.0),
)
"""Terms of the whole robot: `QuasiSteady`, and the two parts of `AddedMass`."""
LIFTING_LINE = Term("lifting line", 1.0, mean=1.0)
"""Attached lift of strips with trailing vortices and one lag each; where flow is attached, it takes
the place of blade elements, which are then expected to have no share."""
EDGES = Term("suction of side edges", 0.3)
"""Pull of attached flow at the free ends of a wing, over density Gamma^2 chord / strip's width."""
TURNING = Term("moment of a section that turns", 2.0)
"""Damping by the vortices that the edges of a section shed; attached flow sheds none of them."""
STRIP_TERMS = (
    Term("acceleration of the air carried along", 2.0),
    Term("attached lift", 2.0),
    Term("lift of separated flow", 5.0),
    Term("lift by camber", 0.5),
    Term("lift by pitching", 5.0),
    Term("normal force of separated flow", 2.0),
    Term("normal force at small incidence", 2.0),
    Term("drag along the flow", 0.5),
    Term("drag of the area across the flow", 2.0),
    Term("chordwise force by pitching", 0.5),
    Term("moment of incidence", 2.0),
    Term("moment by pitching", 2.0),
    TURNING,
    Term("drag along the span", 0.2),
    Term("drag beyond a small incidence", 1.0),
)
"""Terms of every strip, the same weight for all strips."""
SURFACE_SHARE = 0.3
"""Prior of how far one kind of wing departs from `STRIP_TERMS`, over the prior of the term [1]."""
BODY_TERMS = (
    Term("drag along x", 5.0),
    Term("drag along y", 5.0),
    Term("drag along z", 5.0),
    Term("drag of rotation", 2.0),
)
"""Terms of every body without strips."""
OUTPUTS = 4
"""Coefficients of a section: force forward, normal and along the span, moment."""
CORRECTIONS = 6, 11
"""Number of polynomials of spanwise flow, and of the flow's direction."""
NOTHING = 1e-6
"""Prior of weights that stand for nothing."""
_SMALL = 0.02  # incidence beyond which a thin wing's flow leaves its leading edge [rad]
LAGS = ONE_STATE
"""Memory of a section."""
LIFT_SLOPE = 2 * pi
"""Lift slope of attached flow [1/rad]."""


@dataclass(frozen=True)
class LinearStrips(Aerodynamics):
    """Air whose force is a sum of physical terms and corrections, such as a log has taught them.

    In strip axes at mid-chord, relative to the air, with u the forward and n the normal velocity,
    s that outward along the span, p, r and y the rates of pitch, flap and yaw times the chord,
    those of the mirror image on the right side,
    V^2 = u^2 + n^2 + s^2, the corrections are

        s u, s n, r u, r n, y u, y n, and V^2 times f^3, f^2 d, f d^2, d^3, f^4, f^3 d, f^2 d^2,
        f d^3, d^4, f d |d|, d f |f| with (f, d) = (u, n) / V,

    each with a coefficient of the section's force forward, normal and along the span and of its
    moment about mid-chord, shared by all strips. What goes with accelerations is `added_mass`:
    without it the model lacks the air that the wings carry along.

    Args:
        robot: The machine.
        air: Density and wind.
        terms: Weights of physical terms by name [1]; the others are those expected of them.
        corrections: Coefficients of the corrections, one output after the other, (68,) [1]; by
            default none.
        attached: Whether flow is expected to stay attached: a lifting line takes the place of
            blade elements.

    Raises:
        ParameterError: If the robot has no strips, the air has a ground, a name is not that of a
            term, or a number is not finite.
        ShapeError: If the corrections are not (68,).

    References:
        Those of `LinearStripNetwork`, which learns the weights.
    """

    robot: Robot
    air: Air = field(default_factory=Air)
    terms: Mapping[str, float] = field(default_factory=dict, hash=False)
    corrections: Sequence[float] | None = field(default=None, hash=False)
    attached: bool = False

    name = "linear_strips"

    def __repr__(self) -> str:
        flow = "attached flow" if self.attached else "flow that may separate"
        moved = sum(self.terms[one.name] != one.mean for one in terms_of(self.robot, self.attached))
        told = f"{moved} of {len(self.terms)} terms other than expected, {flow}, {self.air}"
        return f"<LinearStrips around {self.robot.name}: {told}>"

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.robot.strips:
            raise ParameterError("robot", "a robot with wings", self.robot.name)
        if self.air.ground is not None:
            expected = "None, since the terms know no ground"
            raise ParameterError("air.ground", expected, self.air.ground)
        usual = {term.name: term.mean for term in terms_of(self.robot, self.attached)}
        for name, weight in self.terms.items():
            if name not in usual:
                raise ParameterError("terms", "names of terms", name, tuple(usual))
            if not np.isfinite(weight):
                raise ParameterError(f"terms: {name}", "a finite number", weight)
        count = OUTPUTS * sum(CORRECTIONS)
        given = np.zeros(count) if self.corrections is None else self.corrections
        corrections = real_array("corrections", given, (count,))
        if not np.isfinite(corrections).all():
            raise ParameterError("corrections", "finite numbers", corrections.tolist())
        object.__setattr__(self, "terms", usual | dict(self.terms))
        object.__setattr__(self, "corrections", tuple(corrections.tolist()))

    @property
    def added_mass(self) -> AddedMass:
        """Air that the wings carry along, with the factor of each wing."""
        carried = _carried(ca.DM([*self.terms.values()]), self.robot)
        factors = {wing: float(share) for wing, share in carried.items()}
        return AddedMass(self.robot, self.air, factor=factors)

    @property
    def state_size(self) -> int:
        """One lag a strip in attached flow."""
        return len(self.robot.strips) * self.attached

    @property
    def structure(self) -> str:
        """Text of what shapes the equations, numbers aside: part of a compiled function's key."""
        chains = strip_chains(self.robot) if self.attached else ""
        sides = *sides_of(self.robot), chains
        return f"{self.name} {surfaces_of(self.robot)} {sides}"

    @property
    def numbers(self) -> dict[str, float]:
        """Density [kg/m^3], then the weights by name, in their order [1]."""
        terms = {f"terms.{name}": weight for name, weight in self.terms.items()}
        corrections = {f"corrections[{k}]": one for k, one in enumerate(self.corrections or ())}
        return {"density": self.air.density, **terms, **corrections}

    def expressions(
        self, robot: Robot, q: ca.SX, v: ca.SX, state: ca.SX, wind: ca.SX, parameters: ca.SX
    ) -> AeroExpressions:
        """Equations of the model; see `Aerodynamics.expressions`."""
        machine, density, count = self.robot, parameters[0], len(self.terms)
        terms, corrections = parameters[1 : 1 + count], parameters[1 + count :]
        coefficients = ca.reshape(corrections, -1, OUTPUTS).T
        mean = ca.sum2(wind) / wind.shape[1]
        motion, lags = (q, v, ca.SX.zeros(robot.dof, 1)), state if self.attached else None
        sums = StripSums(machine, robot, motion, mean, density, self.attached, lags)
        loads = sums.loads(coefficients, terms)
        wrenches = sums.body_drags(terms)
        for strip, load in zip(robot.strips, loads, strict=True):
            add_wrench(wrenches, strip.body, load[:3], load[3:])
        force = generalized_force(robot, q, wrenches) + terms[0] * sums.elements.generalized_force
        added, factors = self.added_mass, _carried(terms, machine).values()
        of_terms, beyond = (
            ca.vertcat(density, *(one - f for f in factors)) for one in (terms[1], terms[2])
        )
        force += kirchhoff_force(robot, *motion, added.inertia(robot, mean, of_terms))
        force += added.circulation_force(robot, q, v, mean, beyond)
        push = ca.SX.zeros(3, 1)
        for body in robot.floating_bodies.values():
            push += force[list((body.floating_dofs or ())[:3])]
        found = replace(
            sums.elements,
            generalized_force=force,
            strip_force=sums.strip_forces(loads, terms),
            power=ca.dot(force, v) - ca.dot(push, mean),
        )
        if sums.line is None:
            return found
        wash = sums.line.wash()
        memory = lag_relaxation(sums.line.motions, wash.effective, LAGS)
        return replace(
            found,
            circulation=wash.circulation,
            state_derivative=memory.derivative(state),
            memory=memory,
        )


class StripSums:
    """Force of the air at a sample as a sum: expressions of its terms and corrections.

    Args:
        machine: The robot in numbers.
        robot: Its symbolic twin.
        motion: q, v and a.
        wind: Wind, world axes, (3,) [m/s].
        density: Of the air [kg/m^3].
        attached: Whether flow is expected to stay attached.
        lags: Lag of each strip where it is, (m, 1) [m/s]; None: symbols.

    Attributes:
        line: The lifting line, where flow is attached.
        elements: Blade elements, those of `QuasiSteady`.
    """

    def __init__(
        self,
        machine: Robot,
        robot: Robot,
        motion: tuple[ca.SX, ca.SX, ca.SX],
        wind: ca.SX,
        density: ca.SX,
        attached: bool,
        lags: ca.SX | None = None,
    ) -> None:
        self._machine, self._robot, self._surfaces = machine, robot, surfaces_of(machine)
        self._motion, self._wind, self._density = motion, wind, density
        self._sides = sides_of(machine)
        q, v, a = motion
        self._airflows = body_airflows(robot, q, v, wind)
        moving = zip(self._airflows, body_accelerations(robot, q, v, a, ca.SX(0)), strict=True)
        self._motions = [ca.densify(ca.horzcat(twist.linear, *rest)) for twist, rest in moving]
        self.line = StripFlow(machine, robot, (q, v, wind), lags) if attached else None
        blades = QuasiSteady(machine)
        numbers = ca.vertcat(density, ca.SX(ca.DM(blades.parameters[1:])))
        self.elements = blades.expressions(robot, q, v, ca.SX(0, 1), wind, numbers)

    def parts(self, rows: list[int]) -> tuple[list[ca.SX], list[ca.SX], ca.SX]:
        """Polynomials of each strip, (17, 1), and forces of unit weights.

        Args:
            rows: Degrees of freedom whose force is wanted.

        Returns:
            Polynomials of each strip [m^2/s^2], forces of unit coefficients of each strip,
            (n, 4), and forces of the terms, (n, m) [N, N m].
        """
        machine, jacobians = self._machine, _jacobians(self._robot, self._motion[0], rows)
        units, seen, wrenches = [], [], dict[tuple[int, str], ca.SX]()
        for k, strip in enumerate(self._robot.strips):
            of = strip.body, _kind(machine, strip.wing) if self._surfaces else ""
            jacobian, before = jacobians[strip.body], wrenches.get(of, _NO_TERMS)
            found = _section(jacobian.shape[1])(*self._seen(k), jacobian, before)
            polynomials, unit, wrenches[of] = found
            seen.append(polynomials)
            units.append(unit)
        kinds = {k: ca.SX.zeros(len(rows), len(STRIP_TERMS)) for k in self._surfaces or ("",)}
        for (body, kind), wrench in wrenches.items():
            kinds[kind] += jacobians[body].T @ wrench
        terms = [self._of_whole()[rows, :], sum(kinds.values())]
        for k in _bare(machine):
            drag = _body_wrenches(self._robot.bodies[k], self._airflows[k], self._density)
            terms.append(jacobians[k].T @ drag)
        terms += [kinds[kind] for kind in self._surfaces]
        if self.line:
            lifts, strips = dict[int, ca.SX](), self._robot.strips
            for strip, lift in zip(strips, _lifts(self.line, self._density), strict=True):
                lifts[strip.body] = lifts.get(strip.body, 0) + lift
            terms.append(sum(jacobians[body].T @ one for body, one in lifts.items()))
        return seen, units, ca.horzcat(*terms)

    def loads(self, corrections: ca.SX, terms: ca.SX) -> list[ca.SX]:
        """Wrench of each strip on its body, body axes, (6, 1) [N, N m]; without `WHOLE_TERMS`.

        Args:
            corrections: Coefficients of the corrections, (4, 17) [1].
            terms: Weights of the terms, (m,) [1].
        """
        lifts = _lifts(self.line, self._density) if self.line else []
        found = []
        for k, own in enumerate(_of_strips(terms, self._machine)):
            load = _load()(*self._seen(k), corrections, own)
            found.append(load + lifts[k] @ terms[-2:] if lifts else load)
        return found

    def strip_forces(self, loads: Sequence[ca.SX], terms: ca.SX) -> ca.SX:
        """Force of each strip, world axes, (3, n_strips) [N]; without the added mass of the whole.

        Args:
            loads: Those of `loads`.
            terms: Weights of the terms, (m,) [1].
        """
        turns = [ca.densify(pose.rotation) for pose in body_poses(self._robot, self._motion[0])]
        pairs = zip(self._robot.strips, loads, strict=True)
        own = ca.horzcat(*[turns[strip.body] @ load[:3] for strip, load in pairs])
        return own + terms[0] * self.elements.strip_force

    def body_drags(self, terms: ca.SX) -> dict[int, tuple[ca.SX, ca.SX]]:
        """Force and moment on each body without strips, body axes, (3, 1) each [N, N m].

        Args:
            terms: Weights of the terms, (m,) [1].
        """
        first, found = len(WHOLE_TERMS) + len(STRIP_TERMS), dict[int, tuple[ca.SX, ca.SX]]()
        for place, k in enumerate(_bare(self._machine)):
            own = terms[first + len(BODY_TERMS) * place :][: len(BODY_TERMS)]
            wrench = _body_wrenches(self._robot.bodies[k], self._airflows[k], self._density) @ own
            found[k] = wrench[:3], wrench[3:]
        return found

    def _of_whole(self) -> ca.SX:
        """Generalized forces of `WHOLE_TERMS`, (n, m) [N, N m]."""
        robot, wind, carried = self._robot, self._wind, AddedMass(self._machine)
        (q, v, _), factor = self._motion, ca.vertcat(self._density, 1)
        ideal = kirchhoff_force(robot, *self._motion, carried.inertia(robot, wind, factor))
        circulation = carried.circulation_force(robot, q, v, wind, factor)
        return ca.horzcat(self.elements.generalized_force, ideal, circulation)

    def _seen(self, k: int) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Inputs of `_Section` for a strip."""
        strip = self._robot.strips[k]
        size = strip.chord, strip.width, self._sides[k]
        numbers = ca.vertcat(*strip.quarter_chord, *strip.forward, *strip.normal, *size)
        return self._motions[strip.body], numbers, self._density


class StripFlow:
    """Strips of a lifting line and their trailing vortices, as expressions.

    Args:
        machine: The robot in numbers.
        robot: Its symbolic twin.
        motion: q, v and the wind, world axes.
        state: Lag of each strip, (m, 1) [m/s]; None: symbols.

    Attributes:
        motions: Motion of each strip.
        state: Lag of each strip, (m, 1) [m/s].
        semichords: Half chords that each strip travels in a second, (m, 1) [1/s].
    """

    def __init__(
        self,
        machine: Robot,
        robot: Robot,
        motion: tuple[ca.SX, ca.SX, ca.SX],
        state: ca.SX | None = None,
    ) -> None:
        self.vortices = vortex_system(robot, strip_chains(machine), motion, ca.SX(0, 1))
        self.motions = self.vortices.motions
        self.geometric = ca.vertcat(*[normalwash(one) for one in self.motions])
        self.gains = surface_gains(machine, robot, SURFACE_CONSTANT)
        self.state = ca.SX.sym("state", len(self.motions)) if state is None else state
        self.semichords = ca.vertcat(*[2 * airspeed(m) / m.strip.chord for m in self.motions])

    def wash(self, held: bool = True) -> Normalwash:
        """Normalwashes of all strips; not held: as if nothing were held back by lags."""
        state, lags = (self.state, LAGS) if held else (ca.SX(0, 1), NO_STATE)
        return solve_normalwash(self.vortices, self.geometric, state, lags, LIFT_SLOPE)

    def lift(self, wash: Normalwash, i: int, density: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Attached lift of strip i, forward, normal and spanwise, at `lift_place` [N]."""
        motion, strip = self.motions[i], self.motions[i].strip
        pressure = density * strip.chord * strip.width * LIFT_SLOPE * airspeed(motion) / 2
        return attached_lift(self.vortices, wash, i, self.gains[i], pressure, lift_place(motion))


def _size(x: ca.SX) -> ca.SX:
    """|x|, smooth at zero."""
    return x * smooth_sign(x)


_NO_TERMS = ca.SX.zeros(6, len(STRIP_TERMS))


def _speed(velocity: ca.SX) -> ca.SX:
    """V, never zero [m/s]."""
    return smooth_norm(ca.sumsqr(velocity))


def _strip_terms(velocity: ca.SX, spin: ca.SX, rate: ca.SX) -> ca.SX:
    """Force forward, normal, along the span and moment of `STRIP_TERMS`, (4, m) [m^2/s^2].

    The rate is that of the normal velocity times the chord, and that of pitch times its square.
    Times density, chord and width over two they are forces; the last row, times the chord too,
    is a moment about mid-chord that raises the leading edge.
    """
    (u, n, s), (p, r, _) = ca.vertsplit(velocity), ca.vertsplit(spin)
    (normal_rate, pitch_rate), speed = ca.vertsplit(rate), _speed(velocity)
    quarter = smooth_sign(u) / 4  # of the chord ahead of mid-chord: where lift acts
    wash = -(n - quarter * p)  # normalwash at three quarters of the chord
    rising = normal_rate - p * u - r * s  # rate of n, the axes turning along
    across = 2 * _size(n)
    vortex = across * n / speed**2
    beyond = n**2 / (n**2 + (_SMALL * speed) ** 2) * speed
    columns = [
        (0, -pi / 2 * rising, 0, -pi / 64 * pitch_rate),
        (-2 * pi * wash * n, 2 * pi * wash * u, 0, 2 * pi * wash * u * quarter),
        (vortex * n * u, -vortex * (u**2 + s**2), vortex * n * s, 0),
        (-speed * n, speed * u, 0, quarter * speed * u),
        (-p * n, p * u, 0, 0),
        (0, -across * n, 0, 0),
        (0, -2 * speed * n, 0, 0),
        (-speed * u, -speed * n, -speed * s, 0),
        (-across * u, -across * n, -across * s, 0),
        (p * n, 0, 0, 0),
        (0, 0, 0, u * n),
        (0, 0, 0, -speed * p),
        (0, 0, 0, -p * _size(p)),
        (0, 0, -speed * s, 0),
        (-beyond * u, -beyond * n, -beyond * s, 0),
    ]
    return ca.horzcat(*[ca.vertcat(*column) for column in columns])


class _Section(NamedTuple):
    """Strip as its terms see it: symbols of `inputs`, and expressions of the flow at mid-chord.

    Attributes:
        inputs: Velocity in the air and `body_accelerations` of its body, (3, 4) [SI]; quarter
            chord, unit vectors forward and normal, chord, width and side, (12, 1); density.
        flow: Velocity [m/s], spin [m/s] and rates [m^2/s^2], in axes of the strip.
        unit: Wrench on the body of unit coefficients, (6, 4) [N, N m].
        side: See `sides_of`.
    """

    inputs: tuple[ca.SX, ca.SX, ca.SX]
    flow: tuple[ca.SX, ca.SX, ca.SX]
    unit: ca.SX
    side: ca.SX

    @property
    def polynomials(self) -> ca.SX:
        """Polynomials of the corrections, (17, 1) [m^2/s^2], of its mirror image on the right."""
        velocity, spin, _ = self.flow
        (u, n, s), (_, r, y) = ca.vertsplit(velocity), ca.vertsplit(spin)
        s, r, y = self.side * s, self.side * r, self.side * y
        speed = _speed(velocity)
        f, d = u / speed, n / speed
        spanwise = [s * u, s * n, r * u, r * n, y * u, y * n]
        directions = [f**3, f**2 * d, f * d**2, d**3, f**4, f**3 * d, f**2 * d**2, f * d**3, d**4]
        directions += [f * d * _size(n) / speed, d * f * _size(u) / speed]
        return ca.vertcat(*spanwise, *[speed**2 * one for one in directions])

    @property
    def outward(self) -> ca.SX:
        """Wrench on the body of unit coefficients of the corrections, (6, 4) [N, N m]."""
        return ca.horzcat(self.unit[:, :2], self.side * self.unit[:, 2], self.unit[:, 3])


@functools.cache
def _of_any() -> _Section:
    """Any strip."""
    motion, numbers, density = ca.SX.sym("motion", 3, 4), ca.SX.sym("strip", 12), ca.SX.sym("rho")
    linear, w, dw, rising = ca.horzsplit(motion)
    place, forward, normal = numbers[:3], numbers[3:6], numbers[6:9]
    chord, width, span = numbers[9], numbers[10], ca.cross(normal, forward)
    middle = place - forward * (chord / 4)
    moving, axes = Twist(linear, w).at(middle), ca.horzcat(forward, normal, span)
    rising = rising + ca.cross(dw, middle) + ca.cross(w, ca.cross(w, middle))
    velocity, turning = axes.T @ moving, chord * axes.T @ w
    spin = ca.vertcat(-turning[2], turning[0], turning[1])
    rate = ca.vertcat(chord * ca.dot(normal, rising), -(chord**2) * ca.dot(span, dw))
    moments = [*(ca.cross(middle, axis) for axis in (forward, normal, span)), -span * chord]
    unit = ca.vertcat(ca.horzcat(axes, ca.SX.zeros(3, 1)), ca.horzcat(*moments))
    unit = density / 2 * chord * width * unit
    return _Section((motion, numbers, density), (velocity, spin, rate), unit, numbers[11])


@functools.cache
def _section(rows: int) -> ca.Function:
    """Function of what a strip adds, the same for every strip: the code calls it.

    Given the inputs of `_Section`, the Jacobian of a wrench on its body (6, rows) and the wrench by
    the terms of strips before it (6, m): its polynomials, forces of unit coefficients (rows, 4),
    the wrench with its own terms.
    """
    jacobian, before = ca.SX.sym("jacobian", 6, rows), ca.SX.sym("before", _NO_TERMS.shape)
    of = _of_any()
    return ca.Function(
        f"each_section_{rows}",
        [*of.inputs, jacobian, before],
        [
            of.polynomials,
            ca.densify(jacobian.T @ of.outward),
            before + of.unit @ _strip_terms(*of.flow),
        ],
        {"never_inline": True},
    )


@functools.cache
def _load() -> ca.Function:
    """Function of the wrench of a strip whose weights are known, the same for every strip.

    Given the inputs of `_Section`, the corrections (4, 17) and weights of its terms, (m,).
    """
    corrections = ca.SX.sym("corrections", OUTPUTS, sum(CORRECTIONS))
    weights, of = ca.SX.sym("weights", len(STRIP_TERMS)), _of_any()
    corrected = of.outward @ (corrections @ of.polynomials)
    result = ca.densify(corrected + of.unit @ (_strip_terms(*of.flow) @ weights))
    given = [*of.inputs, corrections, weights]
    return ca.Function("each_load", given, [result], {"never_inline": True})


def _bare(robot: Robot) -> list[int]:
    """Bodies without strips that have drag: frames without mass have none."""
    winged = {strip.body for strip in robot.strips}
    return [k for k, body in enumerate(robot.bodies) if k not in winged and body.mass]


def _kind(robot: Robot, wing: str) -> str:
    """Name of a wing, the same for its mirror image, on the left and on the right."""
    originals = {image: name for name, image in robot.mirrored_wings}
    each = (zip(*(k.split("_") for k in pair), strict=False) for pair in robot.mirrored_wings)
    told = {k for words in each for k in words if k[0] != k[1] and "".join(k).isalpha()}
    sides = {"left", "right", *(told.pop() if len(told) == 1 else ())}
    own = originals.get(wing, wing)
    return "_".join(k for k in own.split("_") if k not in sides) or own


def surfaces_of(robot: Robot) -> tuple[str, ...]:
    """Kinds of wings of a robot that has several: "fore" and "hind", "wing" and "tail"."""
    kinds = tuple(dict.fromkeys(_kind(robot, strip.wing) for strip in robot.strips))
    return kinds if len(kinds) > 1 else ()


def terms_of(robot: Robot, attached: bool) -> tuple[Term, ...]:
    """Terms of the whole robot, of all strips, of its bodies, and of the strips of each kind.

    Attached flow has `EDGES` and the lifting line besides, no blade elements and no `TURNING`.
    """
    bodies = [
        term._replace(name=f"{term.name} of {robot.bodies[k].name}")
        for k in _bare(robot)
        for term in BODY_TERMS
    ]
    none = TURNING._replace(std=NOTHING)
    strips = [none if attached and term is TURNING else term for term in STRIP_TERMS]
    departures = [
        Term(f"{term.name} of {name}", SURFACE_SHARE * term.std)
        for name in surfaces_of(robot)
        for term in strips
    ]
    terms = (*WHOLE_TERMS, *strips, *bodies, *departures)
    return (terms[0]._replace(mean=0.0), *terms[1:], EDGES, LIFTING_LINE) if attached else terms


def _of_strips(weights: Any, machine: Robot) -> list[Any]:
    """Weights of `STRIP_TERMS` at each strip: common ones, and the departures of its wing, (m,)."""
    first, count = len(WHOLE_TERMS), len(STRIP_TERMS)
    common, surfaces = weights[first : first + count], surfaces_of(machine)
    first += count + len(BODY_TERMS) * len(_bare(machine))
    departures = {kind: weights[first + count * k :] for k, kind in enumerate(surfaces)}
    kinds = {kind: common + departures[kind][:count] for kind in surfaces} or {"": common}
    return [kinds[_kind(machine, k.wing) if surfaces else ""] for k in machine.strips]


def _body_wrenches(body: Body, airflow: Twist, density: ca.SX) -> ca.SX:
    """Drag of a body, as of the uniform box with its mass and inertia, (6, m): `BODY_TERMS`."""
    xx, yy, zz = body.inertia[:3]
    squares = (yy + zz - xx, xx + zz - yy, xx + yy - zz)
    x, y, z = (ca.sqrt(ca.fmax(6 * one / body.mass, 0)) for one in squares)
    center = vector(body.center_of_mass)
    areas = ca.vertcat(y * z, x * z, x * y)
    forces = ca.diag(-density / 2 * areas * _square(airflow.at(center)))
    arms = ca.vertcat(x * (y**4 + z**4), y * (x**4 + z**4), z * (x**4 + y**4))
    moment = -density / 64 * arms * _square(airflow.angular)
    moments = [ca.cross(center, forces[:, k]) for k in range(3)]
    return ca.vertcat(ca.horzcat(forces, ca.SX.zeros(3, 1)), ca.horzcat(*moments, moment))


def _square(values: ca.SX) -> ca.SX:
    """Squares with the sign of the values, smooth at zero."""
    return ca.vertcat(*[one * _size(one) for one in ca.vertsplit(values)])


def _lifts(line: StripFlow, density: ca.SX) -> list[ca.SX]:
    """Wrench of each strip, body axes, by `EDGES` and by the lifting line, (6, 2) [N, N m]."""
    found, wash, ends = [], line.wash(), [0] * len(line.motions)
    for chain in line.vortices.chains:
        ends[chain.strips[0]] += chain.right[0]
        ends[chain.strips[-1]] -= chain.right[-1]
    for i, motion in enumerate(line.motions):
        strip, place = motion.strip, vector(motion.strip.quarter_chord)
        forward, normal, span = strip_axes(strip)
        ahead, across, along = line.lift(wash, i, density)
        lift = forward * ahead + normal * across + span * along
        pull = ends[i] * density * wash.circulation[i] ** 2 * strip.chord / strip.width * span
        moments = ca.cross(place - forward * (strip.chord / 4), pull)
        wrench = ca.vertcat(lift, ca.cross(place + forward * lift_place(motion), lift))
        found.append(ca.horzcat(ca.vertcat(pull, moments), wrench))
    return found


def _jacobians(robot: Robot, q: ca.SX, rows: list[int]) -> list[ca.SX]:
    """Jacobian from a wrench on each body, body axes, to the generalized force, (6, rows)."""
    wrenches = {k: (ca.SX.sym("f", 3), ca.SX.sym("m", 3)) for k in range(len(robot.bodies))}
    force = generalized_force(robot, q, wrenches)[rows]
    of = [ca.vertcat(*wrench) for wrench in wrenches.values()]
    return [ca.densify(ca.jacobian(force, one).T) for one in of]


def _carried(weights: Any, machine: Robot) -> dict[str, Any]:
    """Share of the air of an infinite wing that each wing carries along [1]."""
    strips = zip(machine.strips, _of_strips(weights, machine), strict=True)
    return {strip.wing: weights[1] + own[0] for strip, own in strips}
