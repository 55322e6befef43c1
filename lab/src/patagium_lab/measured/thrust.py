"""Vertical specific force of four rotors: their lag and thrust, and a dense residual network.

A rotor follows its command late and pulls with the square of its speed; what else there is,
the residual network may say. Neglected: the battery, drag of the rotors, unequal rotors, and the
ground, which holds the weight of a standing robot: all these are left to the residual network.
Learned weights are for this study; model files do not know the network.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, Indices
from patagium.errors import ParameterError
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.memory import LagEquations, MemoryState, memory_in, row_size
from patagium.learning.models.network import Encoding, Network
from patagium.learning.table_network import network_for
from patagium.sensing.logs.table import LogTable

ROTORS = 4
PHYSICAL = 3  # weights of the physics: lag, k2, k1
FIRST_LAG = 0.05
"""Time constant of a rotor to start from [s]."""


class RotorLags(NamedTuple):
    """Equations of the lagged commands z of four rotors; their driver is the command.

    Attributes:
        dense: Network whose first four inputs are the commands.
    """

    dense: DenseNetwork
    states: int = ROTORS
    parameters: int = 1

    @property
    def measured(self) -> int:
        """Length of [u, rates]."""
        return self.dense.inputs

    @property
    def carried(self) -> tuple[int, int]:
        """Number of lagged commands, and of commands."""
        return ROTORS, ROTORS

    @property
    def compiled(self) -> None:
        """None: the equations are NumPy's."""

    def commands(self, x: Array) -> Array:
        """Commands of a sample as shares of their range, (4,)."""
        scaled = (x - self.dense.input_center) / self.dense.input_scale
        return np.asarray((scaled[:ROTORS] + 1) / 2)

    def begin(self, x: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Rotors that have followed their commands."""
        driver = self.commands(x)
        return driver, np.zeros((ROTORS, 1)), driver

    def step(
        self, x: Array, weights: Array, time_step: float, before: MemoryState
    ) -> tuple[Array, Array, Array]:
        """A step later: e = exp(-h / tau), and the mean of the commands at its ends."""
        driver, spent = self.commands(x), time_step / rotor_lag(weights)
        keep = np.exp(-spent)
        behind = before.state - (before.driver + driver) / 2
        slopes = keep * (before.sensitivity + (spent * behind)[:, None])
        return before.state + (keep - 1) * behind, slopes, driver


def rotor_lag(weights: ArrayLike) -> float:
    """Time constant tau of a rotor [s].

    Args:
        weights: Weights, (n,) [1].
    """
    return float(FIRST_LAG * np.exp(np.asarray(weights, float)[0]))


class ThrustNetwork(Network):
    """Specific force of four lagging rotors, and a dense residual network.

        dz_i/dt = (u_i - z_i) / tau,    tau = tau_0 exp(w),
        y = range * mean_i(k2 z_i^2 + k1 z_i) + range / 2 * mlp([2 z - 1, rates]; W),

    u_i is a command as a share of its range, `range` that of y, rates are scaled as by
    `DenseNetwork`. Weights are w, k2, k1 and W. To start from, k2 is 1, k1 is 0, and the
    residual network says 0: a full command pulls with the end of the range. x is
    [u, rates, z, dz/dw, w], of which [u, rates] is measured and its memory finds the rest.

    Args:
        dense: Inputs, of which the first four are the commands, one output, their ranges, and
            the neurons of the residual network.

    Raises:
        ParameterError: If there are no rates after four commands, or not one output.
    """

    kind = "thrust"

    def __init__(self, dense: DenseNetwork) -> None:
        if dense.inputs <= ROTORS or dense.outputs != 1:
            found = f"{dense.inputs} inputs, {dense.outputs} outputs"
            raise ParameterError("network", "4 commands, then rates, and one output", found)
        self._dense, self._scale = dense, float(dense.output_scale[0])
        self._perceptron = dense.perceptron
        self._lags = RotorLags(dense)

    def __reduce__(self) -> tuple[Any, ...]:
        return ThrustNetwork, (self._dense,)

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    @property
    def size(self) -> int:
        """Number of weights, n."""
        return PHYSICAL + self._perceptron.size

    @property
    def neurons(self) -> tuple[tuple[Indices, ...], ...]:
        """Indices of the physical parameters as one group, then those of each neuron."""
        layers = [tuple(one + PHYSICAL for one in layer) for layer in self._perceptron.neurons]
        return ((np.arange(PHYSICAL),), *layers)

    @property
    def fan_in(self) -> Array:
        """Number of inputs behind each weight, (n,); 1 for a bias or a physical parameter."""
        return np.concatenate([np.ones(PHYSICAL), self._perceptron.fan_in])

    @property
    def inputs(self) -> int:
        """Length of [u, rates, z, dz/dw, w]."""
        return self.measured_inputs + row_size(self._lags)

    @property
    def measured_inputs(self) -> int:
        """Length of [u, rates]."""
        return self._dense.inputs

    @property
    def output_names(self) -> tuple[str, ...]:
        """Name of the force."""
        return self._dense.output_names

    @property
    def lag_equations(self) -> LagEquations:
        """Equations of the lagged commands, whose weight is the first."""
        return self._lags

    @property
    def hidden(self) -> tuple[int, ...]:
        """Neurons of each hidden layer of the residual network."""
        return self._dense.hidden

    def initial(self, seed: int) -> Array:
        """Weights to start from, (n,): the physics alone, the last layer being zero.

        Args:
            seed: Seed of the draw.
        """
        weights = np.random.default_rng(seed).standard_normal(self.size) / np.sqrt(self.fan_in)
        weights[:PHYSICAL] = 0.0, 1.0, 0.0
        weights[-(self._perceptron.widths[-2] + 1) :] = 0.0
        return np.asarray(weights)

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
            encoding: Encoding of N samples.
            weights: Weights, (n,) [1].
        """
        seen, state, _ = self._seen(encoding.features[:, 0], weights[0])
        residual = self._perceptron.forward(seen, weights[PHYSICAL:])[:, 0]
        pull = 2 * (weights[1] * state**2 + weights[2] * state).mean(axis=1)
        return np.asarray(self._scale * (pull + residual)[:, None])

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at many weights, (p, 1).

        Args:
            encoding: Encoding of one sample.
            points: (p, n).
        """
        physical = points[:, :PHYSICAL].astype(float)
        seen, state, _ = self._seen(encoding.features, physical[:, :1])
        rest = np.ascontiguousarray(points[:, PHYSICAL:])
        residual = self._perceptron.forward(seen.astype(points.dtype)[:, None], rest)[:, 0, 0]
        pull = 2 * (physical[:, 1:2] * state**2 + physical[:, 2:] * state).mean(axis=1)
        return np.asarray(self._scale * (pull + residual.astype(float))[:, None])

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (1,), and its derivative for the weights, (1, n).

        Args:
            encoding: Encoding of one sample.
            weights: Weights, (n,) [1].
        """
        rest = weights[PHYSICAL:]
        seen, state, slopes = self._seen(encoding.features, weights[0])
        out, inner = self._perceptron.linearized(seen, rest)
        first = np.array(self._perceptron.neurons[0])  # the slope for a bias is that for its sum
        through = inner[0, 0, first[:, -1]] @ rest[first[:, :ROTORS]]
        square, plain = 2 * (state[0] ** 2).mean(), 2 * state[0].mean()
        of_state = 2 * through + (2 * weights[1] * state[0] + weights[2]) * (2 / ROTORS)
        slope = np.concatenate([[of_state @ slopes[0], square, plain], inner[0, 0]])
        y = weights[1] * square + weights[2] * plain + out[0]
        return self._scale * y, self._scale * slope[None]

    def describe(self) -> dict[str, Any]:
        """Description from which the network is made again, as JSON values."""
        return {**self._dense.describe(), "kind": self.kind}

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> ThrustNetwork:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown.
        """
        return cls(DenseNetwork.from_description(description))

    def _seen(self, rows: Array, weight: ArrayLike) -> tuple[Array, Array, Array]:
        """Inputs of the residual network at w, (N, n_in); z there and dz/dw, (N, 4)."""
        memory = memory_in(rows[:, -2 * ROTORS - 1 :], ROTORS, 1)
        state, slopes = memory.at(np.atleast_1d(weight)), memory.sensitivity[:, :, 0]
        rates = np.broadcast_to(rows[:, : -2 * ROTORS - 1], (len(state), self.measured_inputs - 4))
        return np.hstack([2 * state - 1, rates]), state, slopes


def thrust_network_for(table: LogTable, hidden: Sequence[int]) -> ThrustNetwork:
    """Physics and network for a log of commands and rates, scaled by the stated ranges.

    Args:
        table: The log, four motor commands first among its inputs.
        hidden: Neurons of each hidden layer of the residual network.

    Raises:
        LogError: If the mapping states no range for a column.
        ParameterError: If there are no rates, or not one output.
    """
    return ThrustNetwork(network_for(table, hidden))
