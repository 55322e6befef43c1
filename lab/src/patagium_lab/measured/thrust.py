"""Vertical specific force of four rotors: their lag and thrust, and a dense network beside.

A rotor follows its command late and pulls with the square of its speed; what else there is,
the network beside may say. Neglected: the battery, drag of the rotors, unequal rotors, and the
ground, which holds the weight of a standing robot: all these are left to the network beside.
Learned weights are for this study; model files do not know the network.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ParameterError
from patagium.learning.models.dense import DESCRIBED, DenseNetwork, described
from patagium.learning.models.network import Encoding
from patagium.learning.models.recalling import RecallingNetwork
from patagium.learning.models.structure import Indices
from patagium.learning.tables import network_for
from patagium.sensing.logs.table import LogTable

Array = NDArray[np.float64]

ROTORS = 4
PHYSICAL = 3  # weights of the physics: lag, k2, k1
FIRST_LAG = 0.05
"""Time constant of a rotor to start from [s]."""


class _Remembered(NamedTuple):
    """What is carried: time and commands of the last sample; z, dz/dw, and w it was found at."""

    time: float
    command: Array
    state: Array
    slopes: Array
    weight: float


class ThrustNetwork(RecallingNetwork):
    """Specific force of four lagging rotors, and a dense network beside.

        dz_i/dt = (u_i - z_i) / tau,    tau = tau_0 exp(w),
        y = range * mean_i(k2 z_i^2 + k1 z_i) + range / 2 * mlp([2 z - 1, rates]; W),

    u_i is a command as a share of its range, `range` that of y, rates are scaled as by
    `DenseNetwork`. Weights are w, k2, k1 and W. To start from, k2 is 1, k1 is 0, and the
    network beside says 0: a full command pulls with the end of the range. x is
    [u, rates, z, dz/dw, w], of which [u, rates] is measured and `recall` finds the rest.

    Args:
        dense: Inputs, of which the first four are the commands, one output, their ranges, and
            the neurons of the network beside.

    Raises:
        ParameterError: If there are no rates beside four commands, or not one output.
    """

    kind = "thrust"

    def __init__(self, dense: DenseNetwork) -> None:
        if dense.inputs <= ROTORS or dense.outputs != 1:
            found = f"{dense.inputs} inputs, {dense.outputs} outputs"
            raise ParameterError("network beside", "4 commands, then rates, and one output", found)
        self._dense, self._scale = dense, float(dense.output_scale[0])
        self._perceptron = dense.perceptron

    @property
    def inputs(self) -> int:
        """Length of [u, rates, z, dz/dw, w]."""
        return self.measured_inputs + 2 * ROTORS + 1

    @property
    def measured_inputs(self) -> int:
        """Length of [u, rates]."""
        return self._dense.inputs

    @property
    def output_names(self) -> tuple[str, ...]:
        """Name of the force."""
        return self._dense.output_names

    @property
    def size(self) -> int:
        """How many weights, n."""
        return PHYSICAL + self._dense.size

    @property
    def neurons(self) -> tuple[tuple[Indices, ...], ...]:
        """Weights of the physics together, then those of each neuron, layer by layer."""
        beside = (tuple(n + PHYSICAL for n in layer) for layer in self._perceptron.neurons)
        return ((np.arange(PHYSICAL),), *beside)

    @property
    def fan_in(self) -> Array:
        """How many inputs the neuron of each weight sums; 1 for the physics, (n,)."""
        return np.concatenate([np.ones(PHYSICAL), self._perceptron.fan_in])

    def initial(self, seed: int) -> Array:
        """Weights to start from, (n,): the physics alone, the last layer beside being zero.

        Args:
            seed: Seed of the draw.
        """
        weights = np.random.default_rng(seed).standard_normal(self.size) / np.sqrt(self.fan_in)
        weights[:PHYSICAL] = 0.0, 1.0, 0.0
        weights[-(self._perceptron.widths[-2] + 1) :] = 0.0
        return np.asarray(weights)

    def recall(
        self,
        weights: Array,
        time: ArrayLike,
        x: Array,
        carried: _Remembered | None = None,
        gaps: ArrayLike = (),
    ) -> tuple[Array, _Remembered | None]:
        """Samples of a block with the lagged commands at each and their slopes.

        At the beginning of a memory rotors have followed their commands. A step takes
        e = exp(-h / tau) and the mean of the commands at its ends.

        Args:
            weights: That hold over the block, (n,).
            time: Increasing, (N,) [s].
            x: [u, rates], (N, n_measured).
            carried: What the block before left.
            gaps: First sample after each gap, where memory begins anew.

        Returns:
            [u, rates, z, dz/dw, w], (N, n_x), and what the next block goes on from.
        """
        weight, tau = float(weights[0]), self.lag(weights)
        scaled = (x - self._dense.input_center) / self._dense.input_scale
        commands = (scaled[:, :ROTORS] + 1) / 2
        anew, rows = set(np.asarray(gaps, int).tolist()), np.empty((len(x), self.inputs))
        n = self.measured_inputs
        rows[:, :n], rows[:, -1] = x, weight
        for k, stamp in enumerate(np.asarray(time, float).tolist()):
            command = commands[k]
            if carried is None or k in anew:
                state, slopes = command, np.zeros(ROTORS)
            else:
                spent = (stamp - carried.time) / tau
                keep = np.exp(-spent)
                behind = carried.state - (carried.command + command) / 2
                state = carried.state + (keep - 1) * behind
                slopes = keep * (carried.slopes + spent * behind)
            carried = _Remembered(stamp, command, state, slopes, weight)
            rows[k, n : n + ROTORS], rows[k, n + ROTORS : -1] = state, slopes
        return rows, carried

    def corrected(self, carried: _Remembered, change: Array) -> _Remembered:
        """What is carried, moved along its slopes after an update of the weights.

        Args:
            carried: As `recall` left it.
            change: By which the weights moved, (n,).
        """
        step = float(change[0])
        state = carried.state + carried.slopes * step
        return carried._replace(state=state, weight=carried.weight + step)

    def encode(self, x: Array) -> Encoding:
        """[rates scaled, z, dz/dw, w], (N, 1, n), and the scale of y as a readout."""
        n, dense = self.measured_inputs, self._dense
        rates = ((x[:, :n] - dense.input_center) / dense.input_scale)[:, ROTORS:]
        features = np.concatenate([rates, x[:, n:]], axis=1)[:, None]
        readout = np.full((len(x), 1, 1), self._scale)
        return Encoding(features, readout, np.zeros(1))

    def decode(self, encoding: Encoding, weights: Array) -> Array:
        """y of samples encoded before, (N, 1).

        Args:
            encoding: Of N samples.
            weights: (n,).
        """
        seen, state, _ = self._seen(encoding.features[:, 0], weights[0])
        beside = self._perceptron.forward(seen, weights[PHYSICAL:])[:, 0]
        pull = 2 * (weights[1] * state**2 + weights[2] * state).mean(axis=1)
        return np.asarray(self._scale * (pull + beside)[:, None])

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at many weights, (p, 1).

        Args:
            encoding: Of one sample.
            points: (p, n).
        """
        physical = points[:, :PHYSICAL].astype(float)
        seen, state, _ = self._seen(encoding.features, physical[:, :1])
        rest = np.ascontiguousarray(points[:, PHYSICAL:])
        beside = self._perceptron.forward(seen.astype(points.dtype)[:, None], rest)[:, 0, 0]
        pull = 2 * (physical[:, 1:2] * state**2 + physical[:, 2:] * state).mean(axis=1)
        return np.asarray(self._scale * (pull + beside.astype(float))[:, None])

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (1,), and its derivative for the weights, (1, n).

        Args:
            encoding: Of one sample.
            weights: (n,).
        """
        rest = weights[PHYSICAL:]
        seen, state, slopes = self._seen(encoding.features, weights[0])
        out, inner = self._perceptron.linearized(seen, rest)
        through = self._perceptron.input_slopes(seen, rest, np.eye(1))[0, 0, :ROTORS]
        square, plain = 2 * (state[0] ** 2).mean(), 2 * state[0].mean()
        of_state = 2 * through + (2 * weights[1] * state[0] + weights[2]) * (2 / ROTORS)
        slope = np.concatenate([[of_state @ slopes[0], square, plain], inner[0, 0]])
        y = weights[1] * square + weights[2] * plain + out[0]
        return self._scale * y, self._scale * slope[None]

    def lag(self, weights: ArrayLike) -> float:
        """The time constant tau of a rotor [s].

        Args:
            weights: (n,).
        """
        return float(FIRST_LAG * np.exp(np.asarray(weights, float)[0]))

    def describe(self) -> dict[str, Any]:
        """Everything needed to make the network again, as JSON-able values."""
        return {**self._dense.describe(), "kind": self.kind}

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> ThrustNetwork:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown.
        """
        return cls(DenseNetwork(**described(cls.kind, description, DESCRIBED)))

    def _seen(self, rows: Array, weight: ArrayLike) -> tuple[Array, Array, Array]:
        """Inputs of the network beside at w, (N, n_in); z there and dz/dw, (N, 4)."""
        state, slopes = rows[:, -2 * ROTORS - 1 : -ROTORS - 1], rows[:, -ROTORS - 1 : -1]
        state = state + slopes * (np.asarray(weight) - rows[:, -1:])
        rates = np.broadcast_to(rows[:, : -2 * ROTORS - 1], (len(state), self.measured_inputs - 4))
        return np.hstack([2 * state - 1, rates]), state, slopes


def thrust_network_for(table: LogTable, hidden: Sequence[int]) -> ThrustNetwork:
    """Physics and network for a log of commands and rates, scaled by the stated ranges.

    Args:
        table: The log, four motor commands first among its inputs.
        hidden: Neurons of each hidden layer of the network beside.

    Raises:
        LogError: If the mapping states no range for a column.
        ParameterError: If there are no rates, or not one output.
    """
    return ThrustNetwork(network_for(table, hidden))
