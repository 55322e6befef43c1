"""Forces of strips and bodies that are linear in the weights: physics first, then corrections.

    y = sum_k w_k y_k(q, v, a)

The terms y_k are those of known physics (blade elements, added mass, circulation, drag of
separated flow, drag of bodies without wings), each of which any wing has to some degree, and
corrections: polynomials of the flow at a strip times the coefficients of its section. Friction and
separated flow go with the whole velocity at a strip, the part along its span too. All weights are
dimensionless; the prior says what is expected of each, and how far it may be from that. Flow that
was never seen is predicted by the physics as far as it was confirmed, flow that was seen by what
was measured. A robot with wings of several kinds, fore and hind or wing and tail, has the terms of
strips once for all of them and once more for each kind: a tail of another section departs a little
from what is common. The priors were chosen on flights in foreign air (docs/foreign.md). Where flow
is attached, a lifting line takes the place of blade elements: strips with one lag each and the
trailing vortices they share, which the memory of the network follows. Neglected: Reynolds number,
gusts; elsewhere history of the flow and neighboring strips.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from math import pi
from typing import Any, NamedTuple, Self

import casadi as ca
import numpy as np

from patagium.aerodynamics.added_mass import AddedMass
from patagium.aerodynamics.air import Air
from patagium.aerodynamics.local_flow import body_airflows
from patagium.aerodynamics.quasi_steady import QuasiSteady
from patagium.aerodynamics.smooth_functions import smooth_norm, smooth_sign
from patagium.aerodynamics.strip_loads import AeroExpressions
from patagium.arguments import checked
from patagium.arrays import Array
from patagium.dynamics.chain import cross, vector
from patagium.dynamics.kinematics import Twist, body_poses, generalized_force
from patagium.dynamics.rnea import body_accelerations, kirchhoff_force
from patagium.errors import ParameterError
from patagium.learning.models.memory import LagEquations, compiled_steps, row_size
from patagium.learning.models.network import Encoding, FlightTerms
from patagium.learning.models.perceptron import Perceptron
from patagium.learning.models.strip_lags import (
    StripFlow,
    StripLags,
    lag_functions,
    lift_place,
)
from patagium.learning.models.wing import WingNetwork
from patagium.learning.settings import Misfit
from patagium.native import load_functions, named_function
from patagium.robot.model import Body, Robot, Strip
from patagium.robot.strip_chains import strip_chains


class Term(NamedTuple):
    """Physical term of the air's force, and the prior of its weight.

    Attributes:
        name: What the term is.
        mean: Weight that is expected [1].
        std: Standard deviation of the weight [1].
    """

    name: str
    mean: float
    std: float


WHOLE_TERMS = (
    Term("blade elements", 1.0, 1.0),
    Term("added mass", 1.0, 2.0),
    Term("circulation beside added mass", 1.0, 5.0),
)
"""Terms of the whole robot: `QuasiSteady`, and the two parts of `AddedMass`."""
LIFTING_LINE = Term("lifting line", 1.0, 1.0)
"""Attached lift of strips with trailing vortices and one lag each; where flow is attached, it takes
the place of blade elements, which are then expected to have no share."""
EDGES = Term("suction of side edges", 0.0, 0.3)
"""Pull of attached flow at the free ends of a wing, over density Gamma^2 chord / strip's width."""
ATTACHED_SHARE = 0.25
"""Prior of corrections where flow is attached, over that elsewhere [1]."""
TURNING = Term("moment of a section that turns", 0.0, 2.0)
"""Damping by the vortices that the edges of a section shed; attached flow sheds none of them."""
STRIP_TERMS = (
    Term("acceleration of the air carried along", 0.0, 2.0),
    Term("attached lift", 0.0, 2.0),
    Term("lift of separated flow", 0.0, 5.0),
    Term("lift by camber", 0.0, 0.5),
    Term("lift by pitching", 0.0, 5.0),
    Term("normal force of separated flow", 0.0, 2.0),
    Term("normal force at small incidence", 0.0, 2.0),
    Term("drag along the flow", 0.0, 0.5),
    Term("drag of the area across the flow", 0.0, 2.0),
    Term("chordwise force by pitching", 0.0, 0.5),
    Term("moment of incidence", 0.0, 2.0),
    Term("moment by pitching", 0.0, 2.0),
    TURNING,
    Term("drag along the span", 0.0, 0.2),
    Term("drag beyond a small incidence", 0.0, 1.0),
)
"""Terms of every strip, the same weight for all strips."""
SURFACE_SHARE = 0.3
"""Prior of how far one kind of wing departs from `STRIP_TERMS`, over the prior of the term [1]."""
BODY_TERMS = (
    Term("drag along x", 0.0, 5.0),
    Term("drag along y", 0.0, 5.0),
    Term("drag along z", 0.0, 5.0),
    Term("drag of rotation", 0.0, 2.0),
)
"""Terms of every body without strips."""
_SMALL = 0.02  # incidence beyond which a thin wing's flow leaves its leading edge [rad]
_OUTPUTS = 4  # of a section: force forward, normal and spanwise, moment
_CORRECTIONS = (6, 0.5), (11, 0.2)  # polynomials of spanwise flow, of direction; prior of each
_POLYNOMIALS = sum(count for count, _ in _CORRECTIONS)
_TERMS = "of the whole velocity", "with side edges"  # in files: what the weights mean, attached
_NOTHING = 1e-6  # prior of weights that stand for nothing


class LinearStripNetwork(WingNetwork):
    """Force of the air as a sum of physical terms and corrections, linear in the weights.

    x is [q, v, a], y the generalized force of the air, added mass included; in attached flow x as
    the learner sees it goes on with the lags, which its memory finds. In strip axes at
    mid-chord, relative to the air, with u the forward and n the normal velocity, s that along
    the span, p, r and y the rates of pitch, flap and yaw times the chord, V^2 = u^2 + n^2 + s^2,
    the corrections are

        s u, s n, r u, r n, y u, y n, and V^2 times f^3, f^2 d, f d^2, d^3, f^4, f^3 d, f^2 d^2,
        f d^3, d^4, f d |d|, d f |f| with (f, d) = (u, n) / V,

    each with a coefficient of the section's force forward, normal and along the span and of its
    moment about mid-chord, shared by all strips. The terms are in `terms`.

    Taught by `ExtendedLearner` it is learned exactly: recursive least squares with a prior, as
    long as the covariance is "full". Where no noise is stated, the filter takes the network's
    error as `Misfit` says.

    Args:
        robot: The machine; its numbers are taken as they are.
        air: Density and steady wind; gusts are not known to the network.
        measured: Coordinates whose force y is; None: all.
        attached: Whether flow is expected to stay attached: `LIFTING_LINE`, `ATTACHED_SHARE`.

    Attributes:
        terms: Physical terms, whose weights follow the corrections.
        measured: Names of the coordinates whose force y is.
        surfaces: Kinds of wings that may; none where all are of one kind.
        attached: Whether flow is expected to stay attached.
        scaled_prior: True: a stated `prior_std` is a factor on `own_prior`.

    Raises:
        ParameterError: If the robot has no strips, or a name is not one of its coordinates.

    References:
        Dickinson, Lehmann & Sane (1999), Science 284 (blade elements); Theodorsen (1935), NACA
        TR 496 (added mass, attached lift); Izraelevitz, Zhu & Triantafyllou (2017), AIAA Journal
        55 (lifting line); Polhamus (1966), NASA TN D-3767 (lift of separated flow); Sane &
        Dickinson (2002), J. Exp. Biol. 205 (pitching); Andersen, Pesavento & Wang (2005), J. Fluid
        Mech. 541 (sections that turn); Hoerner (1965), Fluid-Dynamic Drag (separated flow, bodies).
    """

    kind = "linear_strip"
    shared = ("air",)
    options = ("measured", "attached")
    scaled_prior = True

    @checked
    def __init__(
        self,
        robot: Robot,
        air: Air | None = None,
        measured: Sequence[str] | None = None,
        attached: bool = False,
    ) -> None:
        if not robot.strips:
            raise ParameterError("robot", "a robot with wings", robot.name)
        self.robot, self.air = robot, Air() if air is None else air
        self._names = self.measured = robot.dof_names if measured is None else tuple(measured)
        rows = [robot.index(name) for name in self._names]
        self.surfaces = _surfaces(robot)
        self.attached = attached
        self.terms = _terms(robot, self.surfaces, attached)
        slots = _slots(len(self.terms))
        self.items = len(robot.strips) + slots
        self.perceptron = Perceptron((_POLYNOMIALS + slots, _OUTPUTS))
        self.offset = np.zeros(len(self._names))
        self._parameters = np.array([*self.air.wind, self.air.density, *robot.parameters])
        chains = strip_chains(robot) if attached else ""
        made = load_functions(
            f"linear strip network {self._names} {self.surfaces} {chains} {robot.structure}",
            lambda: _functions(robot, rows, self.surfaces, attached),
            label=f"air of {robot.name}",
        )
        self._encode = made["encode"]
        self.lag_equations: LagEquations | None = None
        if attached:
            count, begin, step = len(robot.strips), made["begin"].address, made["step"].address
            steps = compiled_steps(begin, step, self._parameters)
            sizes = self.measured_inputs, count
            self.lag_equations = StripLags(made, self._parameters, *sizes, steps)

    def describe(self) -> dict[str, Any]:
        """Description of the network that rebuilds it, as JSON-able values."""
        return super().describe() | {"terms": _TERMS[self.attached]}

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> Self:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown, or the terms were others then.
        """
        values = dict(description)
        found, known = values.pop("terms", None), _TERMS[bool(values.get("attached"))]
        if found != known:
            expected = f"{known}; weights of other terms mean other forces: learn the log anew"
            raise ParameterError("terms of the network", expected, found)
        return super().from_description(values)

    @property
    def inputs(self) -> int:
        """Number of inputs: of [q, v, a] and, in attached flow, of the lag states."""
        lags = self.lag_equations
        return self.measured_inputs + (0 if lags is None else row_size(lags))

    @property
    def measured_inputs(self) -> int:
        """Length of [q, v, a]."""
        return self.robot.state_size + self.robot.dof

    @property
    def flight_terms(self) -> FlightTerms:
        """Accelerations among the inputs, added mass in the outputs."""
        return FlightTerms(acceleration=True, added_mass=True)

    @property
    def own_prior(self) -> Array:
        """Standard deviation of each weight before any sample, (n,) [1]."""
        corrections = np.concatenate([np.full(count, std) for count, std in _CORRECTIONS])
        share = ATTACHED_SHARE if self.attached else 1.0
        return self._placed(share * corrections, [term.std for term in self.terms], _NOTHING)

    @property
    def own_misfit(self) -> Misfit:
        """Error of this network that a filter assumes where no noise is stated."""
        return Misfit()

    def initial(self, seed: int) -> Array:
        """Weights that are expected, those of physics alone, whatever the seed, (n,)."""
        return self.physics()

    def physics(self, added_mass: bool = True) -> Array:
        """Weights of physics alone, with the added mass or without, (n,) [1]."""
        means = [term.mean for term in self.terms]
        means[1:3] = [float(added_mass)] * 2
        return self._placed(np.zeros(_POLYNOMIALS), means, 0.0)

    def encode(self, x: Array) -> Encoding:
        """Polynomials and slots, (N, m, n_in), and forces of unit outputs, (N, n_y, 4 m).

        State by state: code of many states at once takes longer to compile than it saves.
        """
        count, (inputs, outputs) = len(x), self.perceptron.widths
        features = np.empty((count, self.items, inputs))
        readout = np.empty((count, self.outputs, self.items * outputs))
        for k, row in enumerate(np.ascontiguousarray(x)):
            features[k], readout[k], _ = self.encode_one(row)
        return Encoding(features, readout, self.offset)

    def _placed(self, corrections: Array, terms: Sequence[float], others: float) -> Array:
        """Numbers of the corrections, of the terms and of what stands for nothing, (n,)."""
        inputs, _ = self.perceptron.widths
        matrix = np.zeros((_OUTPUTS, inputs))
        matrix[:, :_POLYNOMIALS] = corrections
        slots = np.full((inputs - _POLYNOMIALS) * _OUTPUTS, others)
        slots[: len(terms)] = terms
        matrix[:, _POLYNOMIALS:] = slots.reshape(-1, _OUTPUTS).T
        return np.concatenate([matrix.ravel(), np.full(_OUTPUTS, others)])


def strip_forces(network: LinearStripNetwork, x: Array, weights: Array) -> Array:
    """Force of each strip, world axes, (N, m, 3) [N]: blade elements, terms and corrections.

    Neglected: the added mass and its circulation, which are of a wing and not of its strips.

    Args:
        network: The network.
        x: Inputs, (N, n_x) [units of x].
        weights: Weights, (n,) [1].
    """
    robot, air = network.robot, network.air
    forces = _strip_forces(robot, network.surfaces, network.attached)
    given = air.wind, air.density, robot.parameters, weights
    return np.array([forces(sample, *given).full().T for sample in x])


def _size(x: ca.SX) -> ca.SX:
    """|x|, smooth at zero."""
    return x * smooth_sign(x)


_NO_TERMS = ca.SX.zeros(6, len(STRIP_TERMS))


def _polynomials(velocity: ca.SX, spin: ca.SX) -> ca.SX:
    """Polynomials of the flow, (17, 1) [m^2/s^2]; see `LinearStripNetwork`."""
    (u, n, s), (_, r, y) = ca.vertsplit(velocity), ca.vertsplit(spin)
    speed = _speed(velocity)
    f, d = u / speed, n / speed
    spanwise = [s * u, s * n, r * u, r * n, y * u, y * n]
    directions = [f**3, f**2 * d, f * d**2, d**3, f**4, f**3 * d, f**2 * d**2, f * d**3, d**4]
    directions += [f * d * _size(n) / speed, d * f * _size(u) / speed]
    return ca.vertcat(*spanwise, *[speed**2 * one for one in directions])


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


@functools.cache
def _section(rows: int) -> ca.Function:
    """Function of what a strip adds, the same for every strip: the code calls it.

    Given velocity in the air and `body_accelerations` of its body (3, 4), its `_numbers`, density,
    the Jacobian of a wrench on its body (6, rows) and the wrench by the terms of strips before it
    (6, m): its polynomials, forces of unit coefficients (rows, 4), the wrench with its own terms.
    """
    motion, numbers, density = ca.SX.sym("motion", 3, 4), ca.SX.sym("strip", 11), ca.SX.sym("rho")
    jacobian, before = ca.SX.sym("jacobian", 6, rows), ca.SX.sym("before", _NO_TERMS.shape)
    linear, w, dw, rising = ca.horzsplit(motion)
    place, forward, normal = numbers[:3], numbers[3:6], numbers[6:9]
    chord, width, span = numbers[9], numbers[10], cross(normal, forward)
    middle = place - forward * (chord / 4)
    moving, axes = Twist(linear, w).at(middle), ca.horzcat(forward, normal, span)
    rising = rising + cross(dw, middle) + cross(w, cross(w, middle))
    velocity, turning = axes.T @ moving, chord * axes.T @ w
    spin = ca.vertcat(-turning[2], turning[0], turning[1])
    rate = ca.vertcat(chord * ca.dot(normal, rising), -(chord**2) * ca.dot(span, dw))
    moments = [cross(middle, forward), cross(middle, normal), cross(middle, span), -span * chord]
    unit = ca.vertcat(ca.horzcat(axes, ca.SX.zeros(3, 1)), ca.horzcat(*moments))
    unit = density / 2 * chord * width * unit
    return ca.Function(
        f"each_section_{rows}",
        [motion, numbers, density, jacobian, before],
        [
            _polynomials(velocity, spin),
            ca.densify(jacobian.T @ unit),
            before + unit @ _strip_terms(velocity, spin, rate),
        ],
        {"never_inline": True},
    )


def _numbers(strip: Strip) -> ca.SX:
    """Quarter chord, forward and normal direction, chord and width of a strip, (11, 1)."""
    return ca.vertcat(*strip.quarter_chord, *strip.forward, *strip.normal, strip.chord, strip.width)


def _elements(machine: Robot, robot: Robot, sample: _Sample) -> AeroExpressions:
    """Forces of blade elements, those of `QuasiSteady`."""
    blades, (q, v, _) = QuasiSteady(machine), sample.motion
    numbers = ca.vertcat(sample.density, ca.SX(ca.DM(blades.parameters[1:])))
    return blades.expressions(robot, q, v, ca.SX(0, 1), sample.wind, numbers)


def _whole_terms(machine: Robot, robot: Robot, sample: _Sample) -> ca.SX:
    """Generalized forces of `WHOLE_TERMS`, (n, m) [N, N m]."""
    (q, v, a), wind, carried = sample.motion, sample.wind, AddedMass(machine)
    elements, factor = _elements(machine, robot, sample), ca.vertcat(sample.density, 1)
    ideal = kirchhoff_force(robot, q, v, a, carried.inertia(robot, wind, factor))
    circulation = carried.circulation_force(robot, q, v, wind, factor)
    return ca.horzcat(elements.generalized_force, ideal, circulation)


def _bare(robot: Robot) -> list[int]:
    """Bodies without strips that have drag: frames without mass have none."""
    winged = {strip.body for strip in robot.strips}
    return [k for k, body in enumerate(robot.bodies) if k not in winged and body.mass]


def _kind(strip: Strip) -> str:
    """Name of the wing of a strip, the same on the left and on the right."""
    return strip.wing.removeprefix("left_").removeprefix("right_")


def _surfaces(robot: Robot) -> tuple[str, ...]:
    """Kinds of wings of a robot that has several: "fore" and "hind", "wing" and "tail"."""
    kinds = tuple(dict.fromkeys(_kind(strip) for strip in robot.strips))
    return kinds if len(kinds) > 1 else ()


def _terms(robot: Robot, surfaces: Sequence[str], attached: bool) -> tuple[Term, ...]:
    """Terms of the whole robot, of all strips, of its bodies, and of the strips of each kind.

    Attached flow has `EDGES` and the lifting line besides, no blade elements and no `TURNING`.
    """
    bodies = [
        Term(f"{term.name} of {robot.bodies[k].name}", term.mean, term.std)
        for k in _bare(robot)
        for term in BODY_TERMS
    ]
    none = TURNING._replace(std=_NOTHING)
    strips = [none if attached and term is TURNING else term for term in STRIP_TERMS]
    departures = [
        Term(f"{term.name} of {name}", 0.0, SURFACE_SHARE * term.std)
        for name in surfaces
        for term in strips
    ]
    terms = (*WHOLE_TERMS, *strips, *bodies, *departures)
    return (terms[0]._replace(mean=0.0), *terms[1:], EDGES, LIFTING_LINE) if attached else terms


def _of_strip(weights: ca.SX, machine: Robot, surfaces: Sequence[str], strip: Strip) -> ca.SX:
    """Weights of `STRIP_TERMS` at a strip: what is common, and the departure of its wing, (m,)."""
    first, count = len(WHOLE_TERMS), len(STRIP_TERMS)
    common = weights[first : first + count]
    if not surfaces:
        return common
    place = surfaces.index(_kind(strip))
    first += count + len(BODY_TERMS) * len(_bare(machine))
    first += count * place
    return common + weights[first : first + count]


def _slots(terms: int) -> int:
    """Rows of outputs that the terms take."""
    return -(-terms // _OUTPUTS)


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
    moments = [cross(center, forces[:, k]) for k in range(3)]
    return ca.vertcat(ca.horzcat(forces, ca.SX.zeros(3, 1)), ca.horzcat(*moments, moment))


def _square(values: ca.SX) -> ca.SX:
    """Squares with the sign of the values, smooth at zero."""
    return ca.vertcat(*[one * _size(one) for one in ca.vertsplit(values)])


class _Sample(NamedTuple):
    """Symbols of a sample.

    Attributes:
        x: State, accelerations [q, v, a] and lags, (n_x,).
        wind: Wind, world axes, (3,) [m/s].
        density: Of the air [kg/m^3].
        motion: q, v and a.
        airflows: Velocity of each body relative to the air, body axes.
        motions: The same velocity, then `body_accelerations`, of each body, (3, 4) [SI].
        line: The lifting line, where flow is attached.
    """

    x: ca.SX
    wind: ca.SX
    density: ca.SX
    motion: tuple[ca.SX, ca.SX, ca.SX]
    airflows: Sequence[Twist]
    motions: list[ca.SX]
    line: StripFlow | None


def _sample(machine: Robot, robot: Robot, attached: bool) -> _Sample:
    """Symbols of a sample of a robot in numbers and in symbols."""
    n_q, dof = robot.coordinate_count, robot.dof
    x, wind = ca.SX.sym("x", robot.state_size + dof), ca.SX.sym("wind", 3)
    q, v, a = x[:n_q], x[n_q : n_q + dof], x[n_q + dof :]
    airflows = body_airflows(robot, q, v, wind)
    accelerations = body_accelerations(robot, q, v, a, ca.SX(0))
    moving = zip(airflows, accelerations, strict=True)
    motions = [ca.densify(ca.horzcat(twist.linear, *rest)) for twist, rest in moving]
    line = StripFlow(machine, robot, (q, v, wind)) if attached else None
    x = x if line is None else ca.vertcat(x, line.state)
    return _Sample(x, wind, ca.SX.sym("rho"), (q, v, a), airflows, motions, line)


def _lifts(line: StripFlow, density: ca.SX) -> list[ca.SX]:
    """Wrench of each strip, body axes, by `EDGES` and by the lifting line, (6, 2) [N, N m]."""
    found, wash, ends = [], line.wash(), [0] * len(line.motions)
    for chain in line.vortices.chains:
        ends[chain.strips[0]] += chain.right[0]
        ends[chain.strips[-1]] -= chain.right[-1]
    for i, motion in enumerate(line.motions):
        strip, place = motion.strip, vector(motion.strip.quarter_chord)
        forward, normal = vector(strip.forward), vector(strip.normal)
        ahead, across, along = line.lift(wash, i, density)
        span = cross(normal, forward)
        lift = forward * ahead + normal * across + span * along
        pull = ends[i] * density * wash.circulation[i] ** 2 * strip.chord / strip.width * span
        moments = cross(place - forward * (strip.chord / 4), pull)
        wrench = ca.vertcat(lift, cross(place + forward * lift_place(motion), lift))
        found.append(ca.horzcat(ca.vertcat(pull, moments), wrench))
    return found


def _strip_forces(machine: Robot, surfaces: Sequence[str], attached: bool) -> ca.Function:
    """Force of each strip, world axes, (3, m) [N], by a sample and the weights."""
    robot, robot_parameters = machine.symbolic()
    sample, count = _sample(machine, robot, attached), len(_terms(machine, surfaces, attached))
    density, line = sample.density, sample.line
    weights = ca.SX.sym("w", _OUTPUTS * (_POLYNOMIALS + _slots(count) + 1))
    matrix = ca.reshape(weights[:-_OUTPUTS], -1, _OUTPUTS).T
    terms = ca.vec(matrix[:, _POLYNOMIALS:])[:count]
    turns = [ca.densify(pose.rotation) for pose in body_poses(robot, sample.motion[0])]
    elements = _elements(machine, robot, sample).strip_force
    forces, lifts = [], _lifts(line, density) if line else []
    for k, strip in enumerate(robot.strips):
        world = ca.vertcat(turns[strip.body].T, ca.SX.zeros(3, 3))
        polynomials, unit, wrench = _of_section(sample, strip, world, _NO_TERMS)
        own = wrench[:3, :] @ _of_strip(terms, machine, surfaces, strip)
        own = own + lifts[k][:3, :] @ terms[-2:] if lifts else own
        found = unit @ matrix[:, :_POLYNOMIALS] @ polynomials + turns[strip.body] @ own
        forces.append(found + terms[0] * elements[:, k])
    inputs = [sample.x, sample.wind, density, robot_parameters, weights]
    return ca.Function("strip_forces", inputs, [ca.horzcat(*forces)])


def _functions(
    machine: Robot, rows: Sequence[int], surfaces: Sequence[str], attached: bool
) -> list[ca.Function]:
    """Encoder: polynomials of each strip, then one row a slot; forces of unit outputs.

    Behind it, where flow is attached, begin and step of the lags.
    """
    robot, robot_parameters = machine.symbolic()
    sample, lists = _sample(machine, robot, attached), list(rows)
    jacobians = _jacobians(robot, sample.motion[0], lists)
    units, seen, wrenches = [], [], dict[tuple[int, str], ca.SX]()
    for strip in robot.strips:
        of = strip.body, _kind(strip) if surfaces else ""
        before = wrenches.get(of, _NO_TERMS)
        found = _of_section(sample, strip, jacobians[strip.body], before)
        polynomials, unit, wrenches[of] = found
        seen.append(polynomials)
        units.append(unit)
    kinds = {kind: ca.SX.zeros(len(lists), len(STRIP_TERMS)) for kind in surfaces or ("",)}
    for (body, kind), wrench in wrenches.items():
        kinds[kind] += jacobians[body].T @ wrench
    terms = [_whole_terms(machine, robot, sample)[lists, :], sum(kinds.values())]
    for k in _bare(machine):
        drag = _body_wrenches(robot.bodies[k], sample.airflows[k], sample.density)
        terms.append(jacobians[k].T @ drag)
    terms += [kinds[kind] for kind in surfaces]
    if sample.line:
        lifts = dict[int, ca.SX]()
        for strip, lift in zip(robot.strips, _lifts(sample.line, sample.density), strict=True):
            lifts[strip.body] = lifts.get(strip.body, 0) + lift
        terms.append(sum(jacobians[body].T @ one for body, one in lifts.items()))
    slots = _slots(len(_terms(machine, surfaces, attached)))
    rest = ca.SX.zeros(len(lists), _OUTPUTS * slots - sum(one.shape[1] for one in terms))
    ones = ca.vertcat(ca.SX.zeros(_POLYNOMIALS, slots), ca.SX.eye(slots))
    wide = [ca.vertcat(one, ca.SX.zeros(slots, 1)) for one in seen]
    features = ca.densify(ca.horzcat(*wide, ones))
    readout = ca.densify(ca.horzcat(*units, *terms, rest))
    parameters = ca.vertcat(sample.wind, sample.density, robot_parameters)
    known = {"x": sample.x, "network_parameters": parameters}
    encode = named_function("encode", known, {"features": features, "readout": readout})
    if sample.line is None:
        return [encode]
    measured = sample.x[: machine.state_size + machine.dof]
    return [encode, *lag_functions(sample.line, measured, parameters)]


def _of_section(sample: _Sample, strip: Strip, jacobian: ca.SX, before: ca.SX) -> list[ca.SX]:
    """Results of `_section` for a strip."""
    motion, section = sample.motions[strip.body], _section(jacobian.shape[1])
    return list(section(motion, _numbers(strip), sample.density, jacobian, before))


def _jacobians(robot: Robot, q: ca.SX, rows: list[int]) -> list[ca.SX]:
    """Jacobian from a wrench on each body, body axes, to the generalized force, (6, rows)."""
    wrenches = {k: (ca.SX.sym("f", 3), ca.SX.sym("m", 3)) for k in range(len(robot.bodies))}
    force = generalized_force(robot, q, wrenches)[rows]
    of = [ca.vertcat(*wrench) for wrench in wrenches.values()]
    return [ca.densify(ca.jacobian(force, one).T) for one in of]
