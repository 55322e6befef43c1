"""A strip network with memory: the lifting line's equations with its numbers learned.

Sigma'_Aero of the source paper by strips. The encoder is the state-space lifting line: lags of
every strip, trailing vortices that carry them to its neighbors, lift across the induced wind.
Its lag rates, amplitudes, lift slope and stall are weights; what a section makes of its flow
beyond that is one perceptron for all strips. Neglected: forces on anything but strips, Reynolds
number, camber in the normalwash, separation with a memory of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi, radians
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.air import Air, air_from_description
from patagium.aerodynamics.indicial import Indicial, indicial_from_description
from patagium.errors import ParameterError, positive
from patagium.learning.models.dense import described
from patagium.learning.models.hidden_equations import (
    COEFFICIENTS,
    FEATURES,
    Remembered,
    hidden_functions,
)
from patagium.learning.models.hidden_numbers import (
    coded_reach,
    coded_size,
    coded_start,
    learned_air,
    starting_lags,
)
from patagium.learning.models.lag_memory import CompiledLags, LagMemory, LiveLags
from patagium.learning.models.mlp import Perceptron
from patagium.learning.models.network import Encoding
from patagium.learning.models.recalling import RecallingNetwork
from patagium.learning.models.structure import Indices
from patagium.native import load_functions
from patagium.robot.model import Robot

Array = NDArray[np.float64]

_LAST = 0.05  # of the usual size: at first the section is that of theory


class HiddenStripNetwork(RecallingNetwork):
    """Lifting line with hidden states, its numbers and its section learned.

    With w_e the normalwash of a strip at three quarters of its chord in the wind that all
    strips' trailing vortices induce, W = phi(0) w_e + sum_k a_k z_k, and s the separated share,

        dz_k/dt = (2 U b_k / c) (w_e - z_k),
        m = mlp(effective direction, geometric direction; W),   effective: (forward, -W),
        F = (1 - s) (m_0 L + q (m_1, m_2)) + s q (m_4, m_5 sin a),

    L the lifting line's lift with its induced drag, q = 1/2 rho A |v|^2 coefficient_scale, a the
    geometric incidence; m_3 and m_7 are drag along the span, m_6 is a moment of separated flow.
    At first m_0 = 1, m_5 = 2 / coefficient_scale (a plate's normal force), the rest almost
    nothing. s = 1 / (1 + exp((sin^2 stall - sin^2 a_e) / width)) of the effective incidence a_e.

    The first weights are rates b, amplitudes of circulation, lift slope, amplitudes of lift a,
    stall and its width, each as a logarithm from its prior: whatever the weights, rates are
    positive and amplitudes sum to less than one. A deviation of .1 for these is one of .5 for
    the logarithms of lags, .1 for the lift slope's, .15 and .05 for the stall's. x is
    [q, v, z, vec S, W_m], of which [q, v] is measured and `recall` finds the rest.

    A deviation of the measurement of .003 N times `lever_arms`, prior_std .1 and spread
    1.7 did well for flapping flights of a small robot, free and mounted.

    Args:
        robot: The machine; its numbers are taken as they are.
        hidden: Neurons of each hidden layer.
        lags: Where the lags start from; or how many, their rates then spread evenly in
            logarithm from .05 to .8 a semichord, with fitted amplitudes.
        air: Density and steady wind; gusts are not known to the network.
        activation: "softplus" or "tanh".
        lift_slope: Where it starts from [1/rad].
        stall_begins: Effective incidence up to which flow is attached, to start from [rad].
        stall_complete: That beyond which it is separated, to start from [rad].
        coefficient_scale: Size of coefficients to expect: what the perceptron takes as one.

    Raises:
        ParameterError: If the robot has no strips, there is no lag, a number is not positive,
            stall is complete before it begins, or a width or the activation not what it may be.

    References:
        Izraelevitz, Zhu & Triantafyllou (2017), AIAA Journal 55, 1279-1294.
    """

    kind = "hidden_strip"

    def __init__(
        self,
        robot: Robot,
        hidden: Sequence[int] = (8, 8),
        lags: int | Indicial = 2,
        air: Air | None = None,
        activation: str = "tanh",
        *,
        lift_slope: float = 2 * pi,
        stall_begins: float = radians(15.0),
        stall_complete: float = radians(35.0),
        coefficient_scale: float = 4.0,
    ) -> None:
        if not robot.strips:
            raise ParameterError("robot", "a robot with wings", robot.name)
        if not 0 < stall_begins < stall_complete <= pi / 2:
            angles = (stall_begins, stall_complete)
            raise ParameterError("stall", "0 < stall_begins < stall_complete <= pi/2", angles)
        self.lags = starting_lags(lags)
        self.lift_slope = positive("lift_slope", lift_slope)
        self.stall_begins, self.stall_complete = float(stall_begins), float(stall_complete)
        self.coefficient_scale = positive("coefficient_scale", coefficient_scale)
        self.robot, self.air = robot, Air() if air is None else air
        self._perceptron = Perceptron((FEATURES, *hidden, COEFFICIENTS), activation)
        self._numbers, self._remembered = coded_size(self.lags.size)
        self._states = len(robot.strips) * self.lags.size
        stall = (self.stall_begins, self.stall_complete)
        self._prior = coded_start(self.lags, self.lift_slope, stall)
        self._reach = coded_reach(self.lags.size)
        constants = [*self.air.wind, self.air.density, self.coefficient_scale]
        self._constants = np.array([*constants, *robot.parameters])
        symbolic, _ = robot.symbolic()
        self._functions = load_functions(
            f"hidden strip network {self.lags.size} {symbolic!r}",
            lambda: hidden_functions(robot, self.lags.size),
            label=f"hidden strip network of {robot.name}",
            many_only=("slopes",),
        )
        sizes = self.measured_inputs, self._states, self._remembered, len(robot.strips)
        numbers = self._prior, self._reach, self._constants
        self._memory = LagMemory(self._functions, *numbers, sizes)

    @property
    def inputs(self) -> int:
        """Length of [q, v, z, vec S, W_m]."""
        return self.measured_inputs + self._memory.size

    @property
    def measured_inputs(self) -> int:
        """Length of [q, v]."""
        return self.robot.state_size

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the components of y: all coordinates."""
        return self.robot.dof_names

    @property
    def size(self) -> int:
        """How many weights, n, those of the air before those of the perceptron."""
        return self._numbers + self._perceptron.size

    @property
    def items(self) -> int:
        """How often the perceptron is evaluated for one x: once a strip."""
        return len(self.robot.strips)

    @property
    def perceptron(self) -> Perceptron:
        """From directions of the flow to coefficients of the section."""
        return self._perceptron

    @property
    def neurons(self) -> tuple[tuple[Indices, ...], ...]:
        """Weights of the air together, then of each neuron, layer by layer."""
        layers = self._perceptron.neurons
        moved = tuple(tuple(neuron + self._numbers for neuron in layer) for layer in layers)
        return ((np.arange(self._numbers),), *moved)

    @property
    def fan_in(self) -> Array:
        """How many inputs the neuron of each weight sums; 1 for the air's, (n,)."""
        return np.append(np.ones(self._numbers), self._perceptron.fan_in)

    def initial(self, seed: int) -> Array:
        """Weights to start from, (n,): the air's numbers and the section as given.

        Neurons are standard normal over sqrt(fan-in), a twentieth of that in the last layer.

        Args:
            seed: Seed of the draw.
        """
        fan_in, (below, above) = self._perceptron.fan_in, self._perceptron.widths[-2:]
        normal = np.random.default_rng(seed).standard_normal(len(fan_in)) / np.sqrt(fan_in)
        weights = np.where(fan_in > 1, normal, 0.0)
        weights[-(below + 1) * above :] *= _LAST
        weights[-above] += 1.0
        weights[-above + 5] += 2.0 / self.coefficient_scale
        return np.append(np.zeros(self._numbers), weights)

    def constants(self, weights: ArrayLike) -> dict[str, float]:
        """Numbers of the air by name, as a `LiftingLine` calls them where it has them.

        Beside those `stall` [rad], where half of the flow is separated, and `stall_width` in
        the square of its sine.

        Args:
            weights: (n,).
        """
        coded = self._coded(np.asarray(weights, float)[: self._numbers])
        found = learned_air(coded.tolist(), self.lags.size)
        parts = {name: getattr(found.lags, name) for name in ("rate", "lift", "circulation")}
        named = {f"lags.{part}[{k}]": x for part, all_ in parts.items() for k, x in enumerate(all_)}
        named |= {"section.lift_slope": found.lift_slope, "stall_width": found.stall_width}
        named |= {"stall": np.arcsin(np.sqrt(min(found.stall, 1.0)))}
        return {name: float(value) for name, value in named.items()}

    def compiled_lags(self) -> CompiledLags | None:
        """What a compiled filter calls to see a sample at weights; None without a compiler."""
        return self._memory.compiled()

    def live_lags(self, x: Array, mean: Array) -> LiveLags | None:
        """Memory of samples that come one by one, beside a compiled filter; None without.

        Args:
            x: Input that the filter reads, (n_x,).
            mean: Weights of the filter, (n,).
        """
        return self._memory.live(x, mean)

    def recall(
        self,
        weights: Array,
        time: ArrayLike,
        x: Array,
        carried: Remembered | None = None,
        gaps: ArrayLike = (),
    ) -> tuple[Array, Remembered | None]:
        """States of a block with the lags at each sample and their slopes for the weights.

        At the beginning of a memory the flow is taken as steady.

        Args:
            weights: That hold over the block, (n,).
            time: Increasing, (N,) [s].
            x: [q, v], (N, n_q + n).
            carried: What the block before left.
            gaps: First sample after each gap, where memory begins anew.

        Returns:
            [q, v, z, vec S, W_m], (N, n_x), and what the next block goes on from.
        """
        own = np.asarray(weights, float)[: self._numbers]
        rows, carried = self._memory.recall(own, np.asarray(time, float), x, carried, gaps)
        return np.hstack([x, rows]), carried

    def corrected(self, carried: Remembered, change: Array) -> Remembered:
        """What is carried, moved along its slopes after an update of the weights.

        Args:
            carried: As `recall` left it.
            change: By which the weights moved, (n,).
        """
        own = change[: self._remembered]
        coded = own * self._reach[: self._remembered]
        return carried._replace(
            state=carried.state + carried.slopes @ coded,
            effective=carried.effective + carried.effective_slopes @ coded,
            weights=carried.weights + own,
        )

    def encode(self, x: Array) -> Encoding:
        """The samples as they are, (N, 1, n_x); see `encode_one`."""
        readout = np.ones((len(x), self.outputs, 1))
        return Encoding(x[:, None, :], readout, np.zeros(self.outputs))

    def encode_one(self, x: Array) -> Encoding:
        """The same of one sample: noise that is estimated grows with its readout."""
        own = np.zeros(self._numbers)
        own[: self._remembered] = x[-self._remembered :]
        _, readout = self._seen(x[None], own[None])
        return Encoding(x[None], readout[0], np.zeros(self.outputs))

    def decode(self, encoding: Encoding, weights: Array) -> Array:
        """y of samples encoded before, (N, n_y).

        Args:
            encoding: Of N samples.
            weights: (n,).
        """
        readout, sections = self.sections(encoding.features[:, 0], weights)
        return np.asarray((readout @ sections[:, :, None])[:, :, 0])

    def sections(self, x: Array, weights: Array) -> tuple[Array, Array]:
        """Readout, (N, n_y, m n_out), and what the perceptron says of m strips, (N, m n_out).

        Args:
            x: Inputs, (N, n_x).
            weights: (n,).
        """
        own = np.broadcast_to(weights[: self._numbers], (len(x), self._numbers))
        features, readout = self._seen(x, own)
        out = self._perceptron.forward(features, weights[self._numbers :])
        return readout, out.reshape(len(x), -1)

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at many weights, (p, n_y).

        Args:
            encoding: Of one sample.
            points: (p, n).
        """
        own = points[:, : self._numbers].astype(float)
        different, place = np.unique(own, axis=0, return_inverse=True)
        x = np.broadcast_to(encoding.features[0], (len(different), self.inputs))
        features, readout = (part[place.ravel()] for part in self._seen(x, different))
        weights = np.ascontiguousarray(points[:, self._numbers :])
        out = self._perceptron.forward(features.astype(points.dtype), weights).astype(float)
        return np.asarray((readout @ out.reshape(len(points), -1, 1))[:, :, 0])

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (n_y,), and its derivative for the weights, (n_y, n).

        Args:
            encoding: Of one sample.
            weights: (n,).
        """
        x, own, rest = encoding.features[0], weights[: self._numbers], weights[self._numbers :]
        features, readout = (part[0] for part in self._seen(x[None], own[None]))
        out, inner = self._perceptron.linearized(features, rest)
        state, slopes = self._lags_at(x[None], own[None])
        moved = np.zeros((self._states, self._numbers))
        moved[:, : self._remembered] = slopes[0] / self._reach[: self._remembered]
        through = self._perceptron.input_slopes(features, rest, readout).reshape(len(readout), -1)
        known = x[: self.measured_inputs], state[0], self._coded(own), out.ravel(), self._constants
        along = moved.T, np.eye(len(own)), np.concatenate(known)
        of_features, of_y = self._functions["slopes"].batch(*along)
        of_air = (of_y + of_features @ through.T).T * self._reach
        of_weights = readout @ inner.reshape(-1, len(rest))
        return readout @ out.ravel(), np.hstack([of_air, of_weights])

    def encoding(self, x: ca.SX, weights: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Features, (n_in, m), and readout, (n_y, m n_out), as expressions of x and weights."""
        n, n_z, n_m = self.measured_inputs, self._states, self._remembered
        slopes = ca.reshape(x[n + n_z : -n_m], n_m, n_z).T
        state = x[n : n + n_z] + slopes @ (weights[:n_m] - x[-n_m:])
        coded = self._prior + self._reach * weights[: self._numbers]
        encode = self._functions["encode"].expression
        features, readout = encode(x[:n], state, coded, self._constants)
        return features, readout

    def describe(self) -> dict[str, Any]:
        """Everything needed to make the network again, as JSON-able values."""
        return {
            "kind": self.kind,
            "robot": self.robot.source,
            "hidden": list(self.hidden),
            "lags": self.lags.describe(),
            "air": self.air.describe(),
            "activation": self._perceptron.activation,
            **{name: getattr(self, name) for name in _NUMBERS},
        }

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> HiddenStripNetwork:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown.
            RobotFileError: If the text of the robot does not describe one.
        """
        from patagium.robot import load_robot_text

        keys = ("robot", "hidden", "lags", "air", "activation", *_NUMBERS)
        values = described(cls.kind, description, keys)
        air, lags = air_from_description(values.pop("air")), values.pop("lags")
        robot = load_robot_text(values.pop("robot"))
        return cls(robot, lags=indicial_from_description(lags), air=air, **values)

    def _coded(self, own: Array) -> Array:
        """Coded numbers of the air at their weights."""
        return np.asarray(self._prior + self._reach * own)

    def _lags_at(self, x: Array, own: Array) -> tuple[Array, Array]:
        """Lags at weights, z + S (W - W_m), (N, n_z), and S, (N, n_z, n_m)."""
        rest, n_m = x[:, self.measured_inputs :], self._remembered
        slopes = rest[:, self._states : -n_m].reshape(len(x), self._states, n_m)
        change = own[:, :n_m] - rest[:, -n_m:]
        return rest[:, : self._states] + np.einsum("kij,kj->ki", slopes, change), slopes

    def _seen(self, x: Array, own: Array) -> tuple[Array, Array]:
        """Features of strips, (N, m, n_in), and readout, (N, n_y, m n_out)."""
        state, _ = self._lags_at(x, own)
        measured = np.ascontiguousarray(x[:, : self.measured_inputs])
        coded = self._coded(own)
        encode = self._functions["encode"]
        if len(x) == 1:
            features, readout = encode(measured[0], state[0], coded[0], self._constants)
            return features.T[None], readout[None]
        features, readout = encode.batch(measured, state, coded, self._constants)
        return features.transpose(0, 2, 1), readout


_NUMBERS = ("lift_slope", "stall_begins", "stall_complete", "coefficient_scale")
