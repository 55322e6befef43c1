"""A dense network with memory: states of the air around the whole body, learned.

Sigma'_Aero of the source paper as it stands there: hidden states xi driven by one perceptron,
forces from flow and hidden states by another. It knows the robot as `FlowNetwork` does.
Neglected: hidden states that drive each other, Reynolds number, forces on anything but wings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.air import Air, air_from_description
from patagium.errors import ParameterError
from patagium.learning.models.dense import described
from patagium.learning.models.flow import FlowNetwork
from patagium.learning.models.mlp import Perceptron
from patagium.learning.models.network import Encoding
from patagium.learning.models.recalling import RecallingNetwork
from patagium.learning.models.structure import Indices
from patagium.robot.model import Robot

Array = NDArray[np.float64]

_SLOWEST, _FASTEST = 0.05, 0.8  # rates to start from [1/semichord]
_REACH = 0.5  # of a weight of one, on the logarithm of a rate


class _Remembered(NamedTuple):
    """What is carried: of the last sample the drive and rates; states, their slopes, weights."""

    time: float
    drive: Array
    drive_slopes: Array
    rates: Array
    state: Array
    slopes: Array
    weights: Array


class HiddenFlowNetwork(RecallingNetwork):
    """Dense network with hidden states, in dimensionless quantities.

        dxi_k/dt = (2 V b_k / c) (gamma_1(f; W_1)_k - xi_k),    b_k = b_k0 exp(w_k / 2),
        y = 1/2 rho V^2 B(q) (lever * coefficient_scale * gamma_2([f, xi]; W_2)),

    f, V, B and lever are those of `FlowNetwork`, c the mean chord of the strips. Weights are
    w, W_1 and W_2: whatever they are, rates are positive, and a hidden state is a weighted mean
    of what drove it. A step takes e = exp(-2 V b h / c) and means of its ends. x is
    [q, v, xi, vec S, W_m], of which [q, v] is measured and `recall` finds the rest.

    Args:
        robot: The machine; its numbers are taken as they are.
        hidden: Neurons of each hidden layer of gamma_2.
        states: Hidden states, their rates spread evenly in logarithm from .05 to .8 a semichord
            to start from.
        drive: Neurons of each hidden layer of gamma_1.
        air: Density and steady wind; gusts are not known to the network.
        activation: "softplus" or "tanh".
        coefficient_scale: Size of coefficients to expect: what the perceptron takes as one.

    Raises:
        ParameterError: If the robot has no strips, there is no state, the scale is not
            positive, or a width or the activation not what it may be.
    """

    kind = "hidden_flow"

    def __init__(
        self,
        robot: Robot,
        hidden: Sequence[int] = (20,),
        states: int = 4,
        drive: Sequence[int] = (8,),
        air: Air | None = None,
        activation: str = "softplus",
        *,
        coefficient_scale: float = 4.0,
    ) -> None:
        if not isinstance(states, int) or states < 1:
            raise ParameterError("states", "a number of at least 1", states)
        scale = {"coefficient_scale": coefficient_scale}
        self._flow = FlowNetwork(robot, (1,), air, activation, **scale)
        self.robot, self.air = self._flow.robot, self._flow.air
        self.coefficient_scale = self._flow.coefficient_scale
        seen = self._flow.perceptron.widths[0]
        self._drive = Perceptron((seen, *drive, states), activation)
        self._perceptron = Perceptron((seen + states, *hidden, robot.dof), activation)
        self._states, self._remembered = states, states + self._drive.size
        self._start = np.geomspace(_SLOWEST, _FASTEST, states)
        self._chord = float(np.mean([float(strip.chord) for strip in robot.strips]))
        pressure = self.air.density / 2 * self.coefficient_scale
        self._pressure = pressure * float(self._flow.lever[0])

    @property
    def inputs(self) -> int:
        """Length of [q, v, xi, vec S, W_m]."""
        return self.measured_inputs + self._states * (1 + self._remembered) + self._remembered

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
        """How many weights, n: rates, those of gamma_1, those of gamma_2."""
        return self._remembered + self._perceptron.size

    @property
    def neurons(self) -> tuple[tuple[Indices, ...], ...]:
        """Rates together, then weights of each neuron, layer by layer."""
        parts = ((self._drive, self._states), (self._perceptron, self._remembered))
        moved = tuple(
            tuple(neuron + start for neuron in layer)
            for perceptron, start in parts
            for layer in perceptron.neurons
        )
        return ((np.arange(self._states),), *moved)

    @property
    def fan_in(self) -> Array:
        """How many inputs the neuron of each weight sums; 1 for a rate, (n,)."""
        parts = (np.ones(self._states), self._drive.fan_in, self._perceptron.fan_in)
        return np.concatenate(parts)

    def initial(self, seed: int) -> Array:
        """Weights to start from: rates as spread, others standard normal over sqrt(fan-in), (n,).

        Args:
            seed: Seed of the draw.
        """
        weights = np.random.default_rng(seed).standard_normal(self.size) / np.sqrt(self.fan_in)
        weights[: self._states] = 0.0
        return np.asarray(weights)

    def rates(self, weights: ArrayLike) -> Array:
        """Rates b of the hidden states, (n_xi,) [1/semichord].

        Args:
            weights: (n,).
        """
        own = np.asarray(weights, float)[: self._states]
        return np.asarray(self._start * np.exp(_REACH * own))

    def recall(
        self,
        weights: Array,
        time: ArrayLike,
        x: Array,
        carried: _Remembered | None = None,
        gaps: ArrayLike = (),
    ) -> tuple[Array, _Remembered | None]:
        """States of a block with the hidden states at each sample and their slopes.

        At the beginning of a memory the flow is taken as steady.

        Args:
            weights: That hold over the block, (n,).
            time: Increasing, (N,) [s].
            x: [q, v], (N, n_q + n).
            carried: What the block before left.
            gaps: First sample after each gap, where memory begins anew.

        Returns:
            [q, v, xi, vec S, W_m], (N, n_x), and what the next block goes on from.
        """
        own = np.asarray(weights, float)[: self._remembered]
        seen = self._flow.encode(x)
        drives, slopes = self._drive.linearized(seen.features[:, 0], own[self._states :])
        rates = 2 * self._speeds(seen.readout)[:, None] / self._chord * self.rates(own)
        anew, rows = set(np.asarray(gaps, int).tolist()), np.empty((len(x), self.inputs))
        for k, stamp in enumerate(np.asarray(time, float).tolist()):
            now = stamp, drives[k], slopes[k], rates[k]
            if carried is None or k in anew:
                carried = self._steady(*now, own)
            else:
                carried = self._stepped(carried, *now, own)
            rows[k] = np.concatenate([x[k], carried.state, carried.slopes.ravel(), own])
        return rows, carried

    def corrected(self, carried: _Remembered, change: Array) -> _Remembered:
        """What is carried, moved along its slopes after an update of the weights.

        Args:
            carried: As `recall` left it.
            change: By which the weights moved, (n,).
        """
        own = change[: self._remembered]
        drive = carried.drive + carried.drive_slopes @ own[self._states :]
        return carried._replace(
            drive=drive,
            rates=carried.rates * np.exp(_REACH * own[: self._states]),
            state=carried.state + carried.slopes @ own,
            weights=carried.weights + own,
        )

    def encode(self, x: Array) -> Encoding:
        """The samples as they are, (N, 1, n_x), and force of unit coefficients, (N, n_y, n_y)."""
        measured = np.ascontiguousarray(x[:, : self.measured_inputs])
        seen = self._flow.encode(measured)
        features = np.concatenate([seen.features, x[:, None, self.measured_inputs :]], axis=2)
        return Encoding(features, seen.readout, seen.offset)

    def decode(self, encoding: Encoding, weights: Array) -> Array:
        """y of samples encoded before, (N, n_y).

        Args:
            encoding: Of N samples.
            weights: (n,).
        """
        seen, _ = self._seen(encoding.features[:, 0], weights[: self._remembered])
        out = self._perceptron.forward(seen, weights[self._remembered :])
        return np.asarray((encoding.readout @ out[:, :, None])[:, :, 0])

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at many weights, (p, n_y).

        Args:
            encoding: Of one sample.
            points: (p, n).
        """
        seen, _ = self._seen(encoding.features, points[:, : self._remembered].astype(float))
        rest = np.ascontiguousarray(points[:, self._remembered :])
        out = self._perceptron.forward(seen.astype(points.dtype)[:, None], rest).astype(float)
        return np.asarray(out[:, 0] @ encoding.readout.T)

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (n_y,), and its derivative for the weights, (n_y, n).

        Args:
            encoding: Of one sample.
            weights: (n,).
        """
        own, rest = weights[: self._remembered], weights[self._remembered :]
        seen, slopes = self._seen(encoding.features, own)
        out, inner = self._perceptron.linearized(seen, rest)
        through = self._perceptron.input_slopes(seen, rest, encoding.readout)[:, 0]
        of_states = through[:, -self._states :] @ slopes[0]
        of_weights = encoding.readout @ inner[0]
        return encoding.readout @ out[0], np.hstack([of_states, of_weights])

    def describe(self) -> dict[str, Any]:
        """Everything needed to make the network again, as JSON-able values."""
        return {
            "kind": self.kind,
            "robot": self.robot.source,
            "hidden": list(self.hidden),
            "states": self._states,
            "drive": list(self._drive.widths[1:-1]),
            "air": self.air.describe(),
            "activation": self._perceptron.activation,
            "coefficient_scale": self.coefficient_scale,
        }

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> HiddenFlowNetwork:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown.
            RobotFileError: If the text of the robot does not describe one.
        """
        from patagium.robot import load_robot_text

        names = ("robot", "hidden", "states", "drive", "air", "activation", "coefficient_scale")
        values = described(cls.kind, description, names)
        air = air_from_description(values.pop("air"))
        return cls(load_robot_text(values.pop("robot")), air=air, **values)

    def _speeds(self, readout: Array) -> Array:
        """V of samples, (N,) [m/s]: force of a unit coefficient turns with B, its size is V^2's."""
        return np.asarray(np.sqrt(np.linalg.norm(readout[:, :, 0], axis=1) / self._pressure))

    def _steady(
        self, time: float, drive: Array, slopes: Array, rates: Array, own: Array
    ) -> _Remembered:
        still = np.hstack([np.zeros((self._states, self._states)), slopes])
        return _Remembered(time, drive, slopes, rates, drive.copy(), still, own)

    def _stepped(
        self,
        before: _Remembered,
        time: float,
        drive: Array,
        slopes: Array,
        rates: Array,
        own: Array,
    ) -> _Remembered:
        spent = (time - before.time) * (before.rates + rates) / 2
        keep = np.exp(-spent)
        mean = (before.drive + drive) / 2
        moved = keep[:, None] * before.slopes
        moved[:, self._states :] += (1 - keep)[:, None] * (before.drive_slopes + slopes) / 2
        # the rate's own slope: d keep / d w = -keep spent / 2
        k = np.arange(self._states)
        moved[k, k] -= _REACH * keep * spent * (before.state - mean)
        state = keep * before.state + (1 - keep) * mean
        return _Remembered(time, drive, slopes, rates, state, moved, own)

    def _seen(self, rows: Array, own: Array) -> tuple[Array, Array]:
        """Inputs of gamma_2 at weights, (N, n_f + n_xi), and slopes S, (N, n_xi, n_m).

        Args:
            rows: [f, xi, vec S, W_m], (N or 1, ...).
            own: W_m', (N, n_m) or (n_m,).
        """
        seen, n_m = self._drive.widths[0], self._remembered
        flow, state = rows[:, :seen], rows[:, seen : seen + self._states]
        slopes = rows[:, seen + self._states : -n_m].reshape(len(rows), self._states, n_m)
        change = np.atleast_2d(own) - rows[:, -n_m:]
        moved = state + (slopes @ change[:, :, None])[:, :, 0]
        return np.hstack([np.broadcast_to(flow, (len(moved), seen)), moved]), slopes
