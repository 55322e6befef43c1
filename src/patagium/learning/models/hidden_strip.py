"""A strip network with memory: the lifting line's equations with its numbers learned.

Sigma'_Aero of the source paper by strips. The encoder is the state-space lifting line: lags of
every strip, trailing vortices that carry them to its neighbors, lift across the induced wind,
from the same functions as `LiftingLine`. Its lag rates, amplitudes, lift slope and stall are
weights (`SectionNumbers`); the rest of a section's force is one perceptron for all
strips. Neglected: forces on anything but strips, Reynolds number, camber in the normalwash (the
perceptron sees it), separation with a memory of its own, amplitudes of lift that differ in sign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import log, pi, radians, sin
from typing import Any, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.indicial import Indicial, Lags, fitted_indicial
from patagium.aerodynamics.named_descriptions import from_field_values
from patagium.aerodynamics.polars import SectionFlow, section_flow
from patagium.aerodynamics.trailing_vortices import (
    Normalwash,
)
from patagium.arguments import checked
from patagium.arrays import Array
from patagium.dynamics.chain import cross, vector
from patagium.dynamics.kinematics import generalized_force
from patagium.errors import ParameterError
from patagium.learning.models.memory import (
    LagEquations,
    MemoryState,
    compiled_steps,
    memory_in,
    row_size,
)
from patagium.learning.models.network import Encoding, GroupedNetwork
from patagium.learning.models.perceptron import Perceptron
from patagium.learning.models.strip import direction_inputs
from patagium.learning.models.strip_lags import (
    StripFlow,
    StripLags,
    lag_functions,
    lift_place,
)
from patagium.learning.models.structure import stacked
from patagium.learning.models.wing import RobotNetwork
from patagium.native import load_functions, named_function
from patagium.robot.model import Robot
from patagium.robot.strip_chains import strip_chains

_COEFFICIENTS = 8  # outputs of the perceptron a strip; see `_wrench`
_FEATURES = 4  # its inputs: direction of the effective and of the geometric flow
_SLOWEST, _FASTEST = 0.05, 0.8  # rates of lags asked for by number [1/semichord]
# of logarithms, for a weight of one; far from stall a step in its numbers changes too much
_REACH = {"lags": 5.0, "lift_slope": 1.0, "stall": 1.5, "stall_width": 0.5}
_STALL_SLOPE = 8.75  # widths of the logistic function in a smooth step of the same slope
_LAST = 0.05  # of the usual size: at first the section is that of theory
_NUMBERS = {
    "lift_slope": 2 * pi,
    "stall_begins": radians(15.0),
    "stall_complete": radians(35.0),
    "coefficient_scale": 4.0,
}


class HiddenStripNetwork(RobotNetwork, GroupedNetwork):
    """Lifting line with hidden states, its numbers and its section learned.

    With w_e the normalwash of a strip at three quarters of its chord in the wind that all
    strips' trailing vortices induce, W = phi(0) w_e + sum_k a_k z_k, and s the separated share,

        dz_k/dt = (2 U b_k / c) (w_e - z_k),
        m = mlp(effective direction, geometric direction; W),   effective: (forward, -W),
        F = (1 - s) (m_0 L + q (m_1, m_2)) + s q (m_4, m_5 sin a),

    L the lifting line's lift with its induced drag, q = 2 rho A |v|^2, a the geometric incidence;
    m_3 and m_7 are drag along the span, m_6 is a moment of separated flow. At first m_0 = 1,
    m_5 = 1/2 (a plate's normal force), the lift slope is 2 pi, stall goes from 15 to 35 degrees,
    the rest is almost nothing. s = 1 / (1 + exp((sin^2 stall - sin^2 a_e) / width)) of the
    effective incidence a_e.

    The first weights are rates b, amplitudes of circulation, lift slope, amplitudes of lift a,
    stall and its width, each as a logarithm from its prior: whatever the weights, rates are
    positive and amplitudes sum to less than one. A deviation of .1 for these is one of .5 for
    the logarithms of lags, .1 for the lift slope's, .15 and .05 for the stall's. x is
    [q, v, z, vec S, W_m], of which [q, v] is measured and its memory finds the rest.

    A measurement_std of .003 N for positions and of .003 N times the distance from the axis to
    the strips for angles, prior_std .1 and spread 1.7 did well for flapping flights of a small
    robot, free and mounted.

    Args:
        robot: The machine; its numbers are taken as they are.
        hidden: Neurons of each hidden layer.
        lags: Where the lags start from; or how many, their rates then spread evenly in
            logarithm from .05 to .8 a semichord, with fitted amplitudes.
        air: Density and steady wind; gusts are not known to the network.
        activation: "softplus" or "tanh".

    Raises:
        ParameterError: If the robot has no strips, there is no lag, or a width or the activation
            is not what it may be.

    References:
        Izraelevitz, Zhu & Triantafyllou (2017), AIAA Journal 55, 1279-1294.
    """

    kind = "hidden_strip"
    options = ("lags",)
    readers = {**RobotNetwork.readers, "lags": partial(from_field_values, "lags", Indicial)}

    @checked
    def __init__(
        self,
        robot: Robot,
        hidden: Sequence[int] = (8, 8),
        lags: int | Indicial = 2,
        air: Air | None = None,
        activation: str = "tanh",
    ) -> None:
        if not robot.strips:
            raise ParameterError("robot", "a robot with wings", robot.name)
        self.lags = starting_lags(lags)
        self.robot, self._names = robot, robot.dof_names
        self.air = Air() if air is None else air
        self.items = len(robot.strips)
        self.perceptron = Perceptron((_FEATURES, *hidden, _COEFFICIENTS), activation)
        self._count, parameters = coded_size(self.lags.size)
        self._groups = stacked(self._count, self.perceptron)
        stall = _NUMBERS["stall_begins"], _NUMBERS["stall_complete"]
        self._prior = coded_start(self.lags, _NUMBERS["lift_slope"], stall)
        self._reach = coded_reach(self.lags.size)
        constants = [*self.air.wind, self.air.density, _NUMBERS["coefficient_scale"]]
        self._constants = np.array([*constants, *robot.parameters])
        self._functions = load_functions(
            f"hidden strip network {self.lags.size} {strip_chains(robot)} {robot.structure}",
            lambda: hidden_functions(robot, self.lags.size),
            label=f"hidden strip network of {robot.name}",
            many_only=("slopes",),
        )
        sizes = robot.state_size, len(robot.strips) * self.lags.size, len(robot.strips), parameters
        coded = self._prior, self._reach, self._constants
        begin, step = (self._functions[name].address for name in ("begin", "step"))
        steps = compiled_steps(begin, step, *coded)
        self._lags = StripLags(self._functions, *coded, *sizes, steps)

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> Self:
        """Inverse of `describe`; files up to 0.2.0 hold numbers too that are constants now."""
        kept = {name: x for name, x in description.items() if _NUMBERS.get(name) != x}
        return super().from_description(kept)

    @property
    def inputs(self) -> int:
        """Length of [q, v, z, vec S, W_m]."""
        return self.measured_inputs + row_size(self._lags)

    @property
    def measured_inputs(self) -> int:
        """Length of [q, v]."""
        return self.robot.state_size

    @property
    def lag_equations(self) -> LagEquations:
        """Equations of the strips' lags, whose weights are the first."""
        return self._lags

    @checked
    def initial(self, seed: int) -> Array:
        """Weights to start from, (n,): the air's numbers and the section as given.

        Neurons are standard normal over sqrt(fan-in), a twentieth of that in the last layer.
        """
        fan_in, (below, above) = self.perceptron.fan_in, self.perceptron.widths[-2:]
        normal = np.random.default_rng(seed).standard_normal(len(fan_in)) / np.sqrt(fan_in)
        weights = np.where(fan_in > 1, normal, 0.0)
        weights[-(below + 1) * above :] *= _LAST
        weights[-above] += 1.0
        weights[-above + 5] += 2.0 / _NUMBERS["coefficient_scale"]
        return np.append(np.zeros(self._count), weights)

    def constants(self, weights: ArrayLike) -> dict[str, float]:
        """Numbers of the air by the names of `LiftingLine`.

        Beside those `stall` [rad], where half of the flow is separated, and `stall_width` in
        the square of its sine.

        Args:
            weights: Weights, (n,) [1].
        """
        own = np.asarray(weights, float)[: self._count]
        found = learned_air((self._prior + self._reach * own).tolist(), self.lags.size)
        parts = {name: getattr(found.lags, name) for name in ("rate", "lift", "circulation")}
        named = {f"lags.{part}[{k}]": x for part, all_ in parts.items() for k, x in enumerate(all_)}
        named |= {"section.lift_slope": found.lift_slope, "stall_width": found.stall_width}
        named |= {"stall": np.arcsin(np.sqrt(min(found.stall, 1.0)))}
        return {name: float(value) for name, value in named.items()}

    def compiled_encoder(self) -> StripLags | None:
        """Lags whose compiled functions see a sample at weights; None without a compiler."""
        return None if self._lags.compiled is None else self._lags

    def encode(self, x: Array) -> Encoding:
        """Samples as they are, (N, 1, n_x)."""
        readout = np.ones((len(x), self.outputs, 1))
        return Encoding(x[:, None, :], readout, np.zeros(self.outputs))

    def encode_one(self, x: Array) -> Encoding:
        """One sample, (1, n_x), with the readout at W_m, which scales estimated noise."""
        own = np.zeros(self._count)
        n_m = self._lags.parameters
        own[:n_m] = x[-n_m:]
        _, readout = self._seen(x[None], own[None])
        return Encoding(x[None], readout[0], np.zeros(self.outputs))

    def decode(self, encoding: Encoding, weights: Array) -> Array:
        """y of N encoded samples at weights (n,), (N, n_y)."""
        readout, sections = self.sections(encoding.features[:, 0], weights)
        return np.asarray((readout @ sections[:, :, None])[:, :, 0])

    def sections(self, x: Array, weights: Array) -> tuple[Array, Array]:
        """Readout, (N, n_y, m n_out), and outputs of the perceptron for m strips, (N, m n_out).

        Args:
            x: Inputs, (N, n_x) [units of x].
            weights: Weights, (n,) [1].
        """
        own = np.broadcast_to(weights[: self._count], (len(x), self._count))
        features, readout = self._seen(x, own)
        out = self.perceptron.forward(features, weights[self._count :])
        return readout, out.reshape(len(x), -1)

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at weights (p, n), (p, n_y)."""
        own = points[:, : self._count].astype(float)
        different, place = np.unique(own, axis=0, return_inverse=True)
        x = np.broadcast_to(encoding.features[0], (len(different), self.inputs))
        features, readout = (part[place.ravel()] for part in self._seen(x, different))
        weights = np.ascontiguousarray(points[:, self._count :])
        out = self.perceptron.forward(features.astype(points.dtype), weights).astype(float)
        return np.asarray((readout @ out.reshape(len(points), -1, 1))[:, :, 0])

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (n_y,), and its derivative for weights (n,), (n_y, n)."""
        x = encoding.features[0]
        own = weights[: self._count]
        rest = weights[self._count :]
        features, readout = (part[0] for part in self._seen(x[None], own[None]))
        out, inner = self.perceptron.linearized(features, rest)
        memory = self._memory_in(x[None])
        n_m = self._lags.parameters
        moved = np.zeros((self._lags.states, self._count))
        moved[:, :n_m] = memory.sensitivity[0] / self._reach[:n_m]
        state = memory.at(own[None, :n_m])
        through = self.perceptron.input_slopes(features, rest, readout).reshape(len(readout), -1)
        coded = self._prior + self._reach * own
        known = x[: self.measured_inputs], state[0], coded, out.ravel(), self._constants
        along = moved.T, np.eye(len(own)), np.concatenate(known)
        of_features, of_y = self._functions["slopes"].batch(*along)
        of_air = (of_y + of_features @ through.T).T * self._reach
        of_weights = readout @ inner.reshape(-1, len(rest))
        return readout @ out.ravel(), np.hstack([of_air, of_weights])

    def encoding(self, x: ca.SX, weights: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Features, (n_in, m), and readout, (n_y, m n_out), as expressions of x and weights."""
        n = self.measured_inputs
        n_z = self._lags.states
        n_m = self._lags.parameters
        slopes = ca.reshape(x[n + n_z : -n_m], n_m, n_z).T
        state = x[n : n + n_z] + slopes @ (weights[:n_m] - x[-n_m:])
        coded = self._prior + self._reach * weights[: self._count]
        encode = self._functions["encode"].expression
        features, readout = encode(x[:n], state, coded, self._constants)
        return features, readout

    def _memory_in(self, x: Array) -> MemoryState:
        """Lags, their sensitivity and W_m in the inputs, x (N, n_x)."""
        rows = x[:, self.measured_inputs :]
        return memory_in(rows, self._lags.states, self._lags.parameters)

    def _seen(self, x: Array, own: Array) -> tuple[Array, Array]:
        """Features of strips, (N, m, n_in), and readout, (N, n_y, m n_out)."""
        state = self._memory_in(x).at(own[:, : self._lags.parameters])
        measured = np.ascontiguousarray(x[:, : self.measured_inputs])
        coded = self._prior + self._reach * own
        encode = self._functions["encode"]
        if len(x) == 1:
            features, readout = encode(measured[0], state[0], coded[0], self._constants)
            return features.T[None], readout[None]
        features, readout = encode.batch(measured, state, coded, self._constants)
        return features.transpose(0, 2, 1), readout


def strip_forces(network: HiddenStripNetwork, x: Array, weights: Array) -> Array | None:
    """Force of each strip along x, y, z of the floating body, (N, m, 3) [N]; None without one.

    Args:
        network: The network.
        x: Inputs, (N, n_x) [units of x].
        weights: Weights, (n,) [1].
    """
    floating = [body.floating_dofs for body in network.robot.bodies if body.floating_dofs]
    if len(floating) != 1:
        return None
    readout, sections = network.sections(x, weights)
    shape = len(x), len(network.robot.strips), -1
    along = readout[:, list(floating[0][:3])].reshape(shape[0], 3, *shape[1:])
    return np.asarray(np.einsum("nksc,nsc->nsk", along, sections.reshape(shape)))


@dataclass(frozen=True)
class SectionNumbers:
    """Numbers of the air that are learned, as symbols or values.

    Whatever the coded numbers are, rates are positive, amplitudes positive with sums below one.

    Attributes:
        lags: Memory of a section.
        lift_slope: Of attached flow [1/rad].
        stall: sin^2 of the effective incidence at which half of the flow is separated.
        stall_width: How far from there in sin^2 the attached share falls by e.
    """

    lags: Lags
    lift_slope: Any
    stall: Any
    stall_width: Any


def learned_air(coded: Any, lags: int) -> SectionNumbers:
    """The numbers behind their code, any real numbers.

    They are logarithms of the rates, of the circulation's amplitudes over what they leave of one,
    of the lift slope, of the lift's amplitudes likewise, of stall and its width.
    """
    rate = [ca.exp(coded[k]) for k in range(lags)]
    circulation = _shares([coded[lags + k] for k in range(lags)])
    lift = _shares([coded[2 * lags + 1 + k] for k in range(lags)])
    slope, stall, width = (ca.exp(coded[k]) for k in (2 * lags, 3 * lags + 1, 3 * lags + 2))
    return SectionNumbers(Lags(rate, lift, circulation), slope, stall, width)


def coded_size(lags: int) -> tuple[int, int]:
    """Number of coded numbers, and of the first ones, on which the lags depend."""
    return 3 * lags + 3, 2 * lags + 1


def coded_start(lags: Indicial, lift_slope: float, stall: tuple[float, float]) -> Array:
    """Code of numbers that are known, (n,); stall begins and is complete at angles [rad]."""
    low, high = (sin(angle) ** 2 for angle in stall)
    stalled = [log((low + high) / 2), log((high - low) / _STALL_SLOPE)]
    parts = [np.log(lags.rate), _logarithms(lags.circulation), [log(lift_slope)]]
    return np.concatenate([*parts, _logarithms(lags.lift), stalled])


def coded_reach(lags: int) -> Array:
    """Change of each coded number for a weight of one, (n,)."""
    of_lags = [_REACH["lags"]]
    others = [_REACH["stall"], _REACH["stall_width"]]
    return np.array([*of_lags * (2 * lags), _REACH["lift_slope"], *of_lags * lags, *others])


def starting_lags(lags: int | Indicial) -> Indicial:
    """Lags to start from: as given, or so many of evenly spread rates, with fitted amplitudes.

    Args:
        lags: How many, or themselves.

    Raises:
        ParameterError: If there is none, or an amplitude has no code.
    """
    if isinstance(lags, Indicial):
        found = lags
    elif isinstance(lags, int) and lags > 0:
        middle = [(_SLOWEST * _FASTEST) ** 0.5]
        spread = np.geomspace(_SLOWEST, _FASTEST, lags).tolist()
        found = fitted_indicial(middle if lags == 1 else spread)
    else:
        raise ParameterError("lags", "a positive number, or an Indicial", lags)
    amplitudes = (found.lift, found.circulation)
    if not all(part and min(part) > 0 and sum(part) < 1 for part in amplitudes):
        expected = "at least one lag, amplitudes above 0 that sum to less than 1"
        raise ParameterError("lags", expected, found.describe())
    return found


def _shares(logarithms: Sequence[Any]) -> list[Any]:
    """Positive numbers whose sum is below one; what is missing counts as exp(0)."""
    parts = [ca.exp(value) for value in logarithms]
    total = 1.0 + sum(parts)
    return [part / total for part in parts]


def _logarithms(shares: Sequence[float]) -> Array:
    """Logarithms of positive numbers over what their sum leaves of one."""
    return np.asarray(np.log(shares) - np.log(1.0 - sum(shares)))


def hidden_functions(machine: Robot, lags: int) -> list[ca.Function]:
    """Functions begin, step, encode, and slopes, which is called with many directions."""
    air = _Air(machine, lags)
    known = air.x, air.coded, air.constants
    return [*lag_functions(air.strips, known, air.learned), _encode(air), _slopes(air)]


class _Air:
    """A robot in the air, as expressions of [q, v], coded numbers and constants."""

    def __init__(self, machine: Robot, lags: int) -> None:
        self.robot, robot_parameters = machine.symbolic()
        size, parameters = coded_size(lags)
        of_lags = ca.SX.sym("lag_numbers", parameters)
        self.coded = ca.vertcat(of_lags, ca.SX.sym("others", size - parameters))
        self.x = ca.SX.sym("x", machine.state_size)
        wind = ca.SX.sym("wind", 3)
        self.density = ca.SX.sym("rho")
        self.scale = ca.SX.sym("scale")
        self.constants = ca.vertcat(wind, self.density, self.scale, robot_parameters)
        n_q = machine.coordinate_count
        self.q = self.x[:n_q]
        self.numbers = learned_air(self.coded, lags)
        motion = self.q, self.x[n_q:], wind
        self.strips = StripFlow(
            machine, self.robot, motion, self.numbers.lags, self.numbers.lift_slope
        )
        self.learned = of_lags, ca.diag(ca.SX(coded_reach(lags)[:parameters]))


def _encode(air: _Air) -> ca.Function:
    outputs = ca.SX.sym("m", _COEFFICIENTS, len(air.strips.motions))
    features, y = _seen(air, outputs)
    m = ca.vec(outputs)
    readout = ca.substitute(ca.jacobian(y, m), m, 0)  # y is linear; CasADi keeps terms m - m
    return named_function(
        "encode",
        {
            "x": air.x,
            "state": air.strips.state,
            "coded": air.coded,
            "network_parameters": air.constants,
        },
        {"features": features, "readout": readout},
    )


def _slopes(air: _Air) -> ca.Function:
    """Derivatives of features and of y as read out, where lags and coded numbers move.

    What all directions have in common comes last, in one vector.
    """
    outputs = ca.SX.sym("m", _COEFFICIENTS, len(air.strips.motions))
    moved = ca.SX.sym("dz", air.strips.state.numel()), ca.SX.sym("dcoded", air.coded.numel())
    features, y = _seen(air, outputs)
    seen = ca.vertcat(ca.vec(features), y)
    variables = ca.vertcat(air.strips.state, air.coded)
    slope = ca.densify(ca.jtimes(seen, variables, ca.vertcat(*moved)))
    sample = ca.vertcat(air.x, air.strips.state, air.coded, ca.vec(outputs), air.constants)
    common = ca.SX.sym("sample", sample.numel())
    slope = ca.substitute(slope, sample, common)
    return named_function(
        "slopes",
        {"state_moved": moved[0], "coded_moved": moved[1], "sample_parameters": common},
        {"of_features": slope[: features.numel()], "of_y": slope[features.numel() :]},
    )


def _seen(air: _Air, outputs: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Inputs of the perceptron for each strip, and y as a function of its outputs."""
    wash = air.strips.wash(air.strips.state, air.numbers.lags)
    seen: list[ca.SX] = []
    wrenches: dict[int, tuple[ca.SX, ca.SX]] = {}
    for i, motion in enumerate(air.strips.motions):
        ahead = lift_place(motion)
        flow = section_flow(motion.forward, motion.normal_ahead(ahead))
        effective = section_flow(motion.forward, -wash.lagged[i])
        seen.append(ca.vertcat(_direction(effective), _direction(flow)))
        force, moment = _wrench(air, wash, i, ahead, flow, effective, outputs[:, i])
        body, still = motion.strip.body, (ca.SX.zeros(3, 1), ca.SX.zeros(3, 1))
        total = wrenches.get(body, still)
        wrenches[body] = (total[0] + force, total[1] + moment)
    return ca.horzcat(*seen), generalized_force(air.robot, air.q, wrenches)


def _wrench(
    air: _Air,
    wash: Normalwash,
    i: int,
    ahead: Any,
    flow: SectionFlow,
    effective: SectionFlow,
    m: ca.SX,
) -> tuple[ca.SX, ca.SX]:
    """Force and moment of a strip about its body's origin, body axes, linear in m.

    Attached: m_0 of the lifting line's lift, coefficients m_1 forward, m_2 normal, m_3 along the
    span. Separated: m_4 forward, m_5 normal for the sine of the incidence, m_6 of the moment
    that raises the tail, m_7 along the span.
    """
    motion = air.strips.motions[i]
    strip = motion.strip
    forward = vector(strip.forward)
    normal = vector(strip.normal)
    span = cross(normal, forward)
    area = strip.chord * strip.width
    sine_square = (effective.normal / effective.speed) ** 2
    separated = 1 / (1 + ca.exp((air.numbers.stall - sine_square) / air.numbers.stall_width))
    attached = 1 - separated
    lift = air.strips.lift(wash, i, air.density)
    unit = air.scale * air.density * area * flow.speed / 2
    sine = -flow.normal / flow.speed
    along = unit * motion.spanwise_ahead(ahead)
    push = unit * flow.speed
    force = forward * (attached * (m[0] * lift[0] + push * m[1]) + separated * push * m[4])
    force += normal * (attached * (m[0] * lift[1] + push * m[2]) + separated * push * sine * m[5])
    force += span * (attached * (m[0] * lift[2] + along * m[3]) + separated * along * m[7])
    point = vector(strip.quarter_chord) + forward * ahead
    return force, cross(point, force) - span * (separated * push * strip.chord * m[6])


def _direction(flow: SectionFlow) -> ca.SX:
    return direction_inputs(ca.vertcat(flow.forward, flow.normal) / flow.speed)
