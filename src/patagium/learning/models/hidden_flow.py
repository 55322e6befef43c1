"""A dense network with memory: states of the air around the whole body, learned.

Sigma'_Aero of the source paper: one perceptron drives hidden states xi, another one maps flow
and hidden states to forces. The network knows the robot as `FlowNetwork` does. Neglected:
hidden states that drive each other, Reynolds number, forces on anything but wings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.air import Air
from patagium.errors import ParameterError
from patagium.learning.models.flow import FlowNetwork
from patagium.learning.models.memory import LagEquations, MemoryState, memory_in, row_size
from patagium.learning.models.mlp import Perceptron
from patagium.learning.models.network import Encoding, GroupedNetwork
from patagium.learning.models.structure import stacked
from patagium.learning.models.wing import RobotNetwork
from patagium.robot.model import Robot

Array = NDArray[np.float64]

_SLOWEST, _FASTEST = 0.05, 0.8  # rates to start from [1/semichord]
_REACH = 0.5  # of a weight of one, on the logarithm of a rate


class HiddenFlowNetwork(RobotNetwork, GroupedNetwork):
    """Dense network with hidden states, in dimensionless quantities.

        dxi_k/dt = (2 V b_k / c) (gamma_1(f; W_1)_k - xi_k),    b_k = b_k0 exp(w_k / 2),
        y = 1/2 rho V^2 B(q) (lever * coefficient_scale * gamma_2([f, xi]; W_2)),

    f, V, B and lever are those of `FlowNetwork`, c the mean chord of the strips. Weights are
    w, W_1 and W_2: whatever they are, rates are positive, and a hidden state is a weighted mean
    of what drove it. A step takes e = exp(-2 V b h / c) and means of its ends. x is
    [q, v, xi, vec S, W_m], of which [q, v] is measured and its memory finds the rest.

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
    options = ("states", "drive", "coefficient_scale")

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
        self.states, self.drive = states, tuple(drive)
        self._drive = Perceptron((seen, *drive, states), activation)
        self._perceptron = Perceptron((seen + states, *hidden, robot.dof), activation)
        self._groups = stacked(states, self._drive, self._perceptron)
        chord = float(np.mean([float(strip.chord) for strip in robot.strips]))
        pressure = self.air.density / 2 * self.coefficient_scale * float(self._flow.lever[0])
        slowest = np.geomspace(_SLOWEST, _FASTEST, states)
        self._lags = HiddenStates(self._flow, self._drive, slowest, chord, pressure)

    @property
    def inputs(self) -> int:
        """Length of [q, v, xi, vec S, W_m]."""
        return self.measured_inputs + row_size(self._lags)

    @property
    def measured_inputs(self) -> int:
        """Length of [q, v]."""
        return self.robot.state_size

    @property
    def lag_equations(self) -> tuple[tuple[int, LagEquations], ...]:
        """Equations of the hidden states, whose weights are the first."""
        return ((0, self._lags),)

    def initial(self, seed: int) -> Array:
        """Weights to start from: rates as spread, others standard normal over sqrt(fan-in), (n,).

        Args:
            seed: Seed of the draw.
        """
        weights = np.random.default_rng(seed).standard_normal(self.size) / np.sqrt(self.fan_in)
        weights[: self._lags.states] = 0.0
        return np.asarray(weights)

    def rates(self, weights: ArrayLike) -> Array:
        """Rates b of the hidden states, (n_xi,) [1/semichord].

        Args:
            weights: Weights, (n,) [1].
        """
        return self._lags.rates(np.asarray(weights, float))

    def encode(self, x: Array) -> Encoding:
        """The samples as they are, (N, 1, n_x), and force of unit coefficients, (N, n_y, n_y)."""
        measured = np.ascontiguousarray(x[:, : self.measured_inputs])
        seen = self._flow.encode(measured)
        features = np.concatenate([seen.features, x[:, None, self.measured_inputs :]], axis=2)
        return Encoding(features, seen.readout, seen.offset)

    def decode(self, encoding: Encoding, weights: Array) -> Array:
        """y of N encoded samples at weights (n,), (N, n_y)."""
        seen, _ = self._seen(encoding.features[:, 0], weights[: self._lags.parameters])
        out = self._perceptron.forward(seen, weights[self._lags.parameters :])
        return np.asarray((encoding.readout @ out[:, :, None])[:, :, 0])

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at weights (p, n), (p, n_y)."""
        seen, _ = self._seen(encoding.features, points[:, : self._lags.parameters].astype(float))
        rest = np.ascontiguousarray(points[:, self._lags.parameters :])
        out = self._perceptron.forward(seen.astype(points.dtype)[:, None], rest).astype(float)
        return np.asarray(out[:, 0] @ encoding.readout.T)

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (n_y,), and its derivative for weights (n,), (n_y, n)."""
        own, rest = weights[: self._lags.parameters], weights[self._lags.parameters :]
        seen, slopes = self._seen(encoding.features, own)
        out, inner = self._perceptron.linearized(seen, rest)
        through = self._perceptron.input_slopes(seen, rest, encoding.readout)[:, 0]
        of_states = through[:, -self._lags.states :] @ slopes[0]
        of_weights = encoding.readout @ inner[0]
        return encoding.readout @ out[0], np.hstack([of_states, of_weights])

    def _seen(self, rows: Array, own: Array) -> tuple[Array, Array]:
        """Inputs of gamma_2 at weights, (N, n_f + n_xi), and slopes S, (N, n_xi, n_m).

        Args:
            rows: [f, xi, vec S, W_m], (N or 1, ...).
            own: New weights of the lags, (N, n_m) or (n_m,).
        """
        seen, lags = self._drive.widths[0], self._lags
        flow, memory = rows[:, :seen], memory_in(rows[:, seen:], lags.states, lags.parameters)
        moved = memory.at(np.atleast_2d(own))
        return np.hstack([np.broadcast_to(flow, (len(moved), seen)), moved]), memory.sensitivity


class HiddenStates(NamedTuple):
    """Equations of hidden states.

    Behind the hidden states stand what drives each of them and the logarithms of their rates.

    Attributes:
        flow: Network whose inputs drive the states.
        drive: Perceptron gamma_1.
        start: Rates b_0 to start from, (n_xi,) [1/semichord].
        chord: Mean chord of the strips [m].
        pressure: Force of a unit coefficient on the first coordinate over V^2 [N s^2/m^2].
    """

    flow: FlowNetwork
    drive: Perceptron
    start: Array
    chord: float
    pressure: float

    @property
    def measured(self) -> int:
        """Length of [q, v]."""
        return self.flow.inputs

    @property
    def states(self) -> int:
        """Number of hidden states, n_xi."""
        return len(self.start)

    @property
    def carried(self) -> tuple[int, int]:
        """Hidden states, drives and rates; no driver."""
        return 3 * self.states, 0

    @property
    def parameters(self) -> int:
        """Number of rates and of weights of gamma_1, n_m."""
        return self.states + self.drive.size

    @property
    def compiled(self) -> None:
        """None: the equations are NumPy's."""

    def rates(self, weights: Array) -> Array:
        """Rates b at weights, (n_xi,) [1/semichord].

        Args:
            weights: Weights, (n,) [1], those of the rates first.
        """
        return np.asarray(self.start * np.exp(_REACH * weights[: self.states]))

    def drivers(self, weights: Array, x: Array) -> list[tuple[Array, Array, Array]]:
        """Carried numbers of each sample but for the hidden states, and rates.

        Args:
            weights: Weights, (n,) [1].
            x: [q, v], (N, n_q + n).

        Returns:
            Of each sample: state, (3 n_xi,), and sensitivity, (3 n_xi, n_m), of which the first
            n_xi rows are not known yet, and rates, (n_xi,) [1/s].
        """
        n, seen = self.states, self.flow.encode(x)
        drives, slopes = self.drive.linearized(seen.features[:, 0], weights[n : self.parameters])
        # force of a unit coefficient turns with B, its size is V^2's
        speeds = np.sqrt(np.linalg.norm(seen.readout[:, :, 0], axis=1) / self.pressure)
        rates = 2 * speeds[:, None] / self.chord * self.rates(weights)
        state = np.hstack([drives, drives, np.log(rates)])
        sensitivity = np.zeros((len(x), 3 * n, self.parameters))
        sensitivity[:, n : 2 * n, n:] = slopes
        sensitivity[:, 2 * n :, :n] = _REACH * np.eye(n)
        return list(zip(state, sensitivity, rates, strict=True))

    def begin(
        self, driver: tuple[Array, Array, Array], weights: Array
    ) -> tuple[Array, Array, Array]:
        """Hidden states of a flow that was always as it is at a sample."""
        state, sensitivity, rates = driver
        sensitivity[: self.states] = sensitivity[self.states : 2 * self.states]
        return state, sensitivity, rates[:0]

    def step(
        self,
        driver: tuple[Array, Array, Array],
        weights: Array,
        time_step: float,
        before: MemoryState,
    ) -> tuple[Array, Array, Array]:
        """Hidden states a step later: e = exp(-2 V b h / c), and means of the ends."""
        n, (state, sensitivity, rates) = self.states, driver
        old, slopes = before.state, before.sensitivity
        spent = time_step * (np.exp(old[2 * n :]) + rates) / 2
        keep = np.exp(-spent)
        mean = (old[n : 2 * n] + state[n : 2 * n]) / 2
        moved = sensitivity[:n]
        np.multiply(keep[:, None], slopes[:n], out=moved)
        both = slopes[n : 2 * n, n:] + sensitivity[n : 2 * n, n:]
        moved[:, n:] += (1 - keep)[:, None] * both / 2
        # the rate's own slope: d keep / d w = -keep spent / 2
        k = np.arange(n)
        moved[k, k] -= _REACH * keep * spent * (old[:n] - mean)
        state[:n] = keep * old[:n] + (1 - keep) * mean
        return state, sensitivity, rates[:0]

    def first_format(self, numbers: Iterator[Array]) -> MemoryState:
        """Memory from a learner file of the first format."""
        time, drive, drive_slopes, rates, state, slopes, weights = (next(numbers) for _ in range(7))
        n = self.states
        sensitivity = np.zeros((3 * n, self.parameters))
        sensitivity[:n], sensitivity[n : 2 * n, n:] = slopes, drive_slopes
        sensitivity[2 * n :, :n] = _REACH * np.eye(n)
        whole = np.concatenate([state, drive, np.log(rates)])
        return MemoryState(whole, sensitivity, weights, np.zeros(0), float(time))
