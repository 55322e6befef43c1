"""Dense networks in dimensionless quantities: flow and joints in, force coefficients out.

The networks know the kinematics of the robot: the direction of the air at each panel, that
forces grow with the square of the speed, and that they turn with the robot. One perceptron
maps the flow at all wings to all forces; with memory (Sigma'_Aero of the source paper), another
one drives hidden states of the air around the whole body, which it reads too. Neglected: history
of the flow where there is no memory, hidden states that drive each other, Reynolds number,
forces on anything but wings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.local_flow import StripMotion, strip_motions
from patagium.aerodynamics.smooth_functions import SWITCH_SPEED
from patagium.dynamics.kinematics import body_velocities
from patagium.errors import ParameterError, positive
from patagium.learning.models.memory import LagEquations, MemoryState, memory_in, row_size
from patagium.learning.models.network import Encoding, GroupedNetwork
from patagium.learning.models.perceptron import Perceptron
from patagium.learning.models.structure import stacked
from patagium.learning.models.wing import RobotNetwork, WingNetwork
from patagium.native import load_functions
from patagium.robot.model import Robot

Array = NDArray[np.float64]

_GAIN = 1.5  # of the inputs, so that neurons saturate outside of the usual flows and angles
_LEAST_LEVER = 1e-3  # of the longest: forces on coordinates that move no wing as drawn
_SLOWEST, _FASTEST = 0.05, 0.8  # rates of hidden states to start from [1/semichord]
_REACH = 0.5  # of a weight of one, on the logarithm of a rate


class FlowNetwork(WingNetwork):
    """Dense network in dimensionless quantities.

        y = 1/2 rho V^2 B(q) (lever * c),  c = coefficient_scale * mlp(z; W).

    V^2 is the mean square over all strips of the velocity (forward, normal) relative to the
    air, z = 1.5 ((forward, normal) / V of the first and last strip of every panel, the
    joints' coordinates). lever_k = sum_i A_i |dp'_i/dv_k|, the robot as drawn, is the
    generalized force of unit coefficients. B(q) turns force and moment on a floating body
    from its own axes to its coordinates, and is one for joints.

    Nothing is scaled by a flight: inputs and outputs of the perceptron are the same at another
    speed, heading or attitude. x is the state [q, v], y the generalized force of the air. A learner
    that follows every sample of a flapping flight does well with prior_std 1,
    measurement_std 0.01 force_scale(speed), and a forgetting over one wingbeat or two.

    Args:
        robot: The machine; its numbers are taken as they are.
        hidden: Neurons of each hidden layer.
        air: Density and steady wind; gusts are not known to the network.
        activation: "softplus" or "tanh".
        coefficient_scale: Size of coefficients to expect: what the perceptron takes as one.

    Raises:
        ParameterError: If the robot has no strips, the scale is not positive, or a width or
            the activation not what it may be.
    """

    kind = "flow"
    options = ("coefficient_scale",)

    def __init__(
        self,
        robot: Robot,
        hidden: Sequence[int] = (28,),
        air: Air | None = None,
        activation: str = "softplus",
        *,
        coefficient_scale: float = 4.0,
    ) -> None:
        if not robot.strips:
            raise ParameterError("robot", "a robot with wings", robot.name)
        self.coefficient_scale = positive("coefficient_scale", coefficient_scale)
        self.robot = robot
        self.air = Air() if air is None else air
        seen = 2 * len(_ends(robot)) + len(_joints(robot))
        self.perceptron = Perceptron((seen, *hidden, robot.dof), activation)
        self.offset = np.zeros(robot.dof)
        symbolic, _ = robot.symbolic()
        key = f"flow network {symbolic!r}"
        label = f"flow network of {robot.name}"
        functions = load_functions(key, lambda: _functions(robot), label=label)
        self._encode = functions["encode"]
        lever = np.ravel(functions["lever"](robot.parameters))
        self.lever = np.maximum(lever, _LEAST_LEVER * lever.max())
        """Generalized force of unit coefficients over dynamic pressure, (n,) [m^2, m^3]."""
        self.lever.setflags(write=False)
        force = self.air.density / 2 * self.coefficient_scale * self.lever
        self._parameters = np.array([*self.air.wind, *force, *robot.parameters])

    def force_scale(self, speed: float) -> Array:
        """Generalized force of unit coefficients at a speed, (n,) [N, N m].

        A share of it is a measurement_std in proportion for every coordinate.

        Args:
            speed: Of the wings through the air, root mean square over strips [m/s].
        """
        return np.asarray(self.air.density / 2 * speed**2 * self.lever)


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
        self.robot = self._flow.robot
        self.air = self._flow.air
        self.coefficient_scale = self._flow.coefficient_scale
        seen = self._flow.perceptron.widths[0]
        self.states, self.drive = states, tuple(drive)
        self._drive = Perceptron((seen, *drive, states), activation)
        self.perceptron = Perceptron((seen + states, *hidden, robot.dof), activation)
        self._groups = stacked(states, self._drive, self.perceptron)
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
        out = self.perceptron.forward(seen, weights[self._lags.parameters :])
        return np.asarray((encoding.readout @ out[:, :, None])[:, :, 0])

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at weights (p, n), (p, n_y)."""
        seen, _ = self._seen(encoding.features, points[:, : self._lags.parameters].astype(float))
        rest = np.ascontiguousarray(points[:, self._lags.parameters :])
        out = self.perceptron.forward(seen.astype(points.dtype)[:, None], rest).astype(float)
        return np.asarray(out[:, 0] @ encoding.readout.T)

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (n_y,), and its derivative for weights (n,), (n_y, n)."""
        own = weights[: self._lags.parameters]
        rest = weights[self._lags.parameters :]
        seen, slopes = self._seen(encoding.features, own)
        out, inner = self.perceptron.linearized(seen, rest)
        through = self.perceptron.input_slopes(seen, rest, encoding.readout)[:, 0]
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
        flow = rows[:, :seen]
        memory = memory_in(rows[:, seen:], lags.states, lags.parameters)
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
        sensitivity[:n] = slopes
        sensitivity[n : 2 * n, n:] = drive_slopes
        sensitivity[2 * n :, :n] = _REACH * np.eye(n)
        whole = np.concatenate([state, drive, np.log(rates)])
        return MemoryState(whole, sensitivity, weights, np.zeros(0), float(time))


def _ends(robot: Robot) -> list[int]:
    """First and last strip of every panel: those between see what lies between."""
    ends = []
    for panel in dict.fromkeys((strip.wing, strip.body) for strip in robot.strips):
        strips = [k for k, s in enumerate(robot.strips) if (s.wing, s.body) == panel]
        ends += sorted({strips[0], strips[-1]})
    return ends


def _joints(robot: Robot) -> list[int]:
    """Places in q of the coordinates that are not of a floating body."""
    floating = {k for body in robot.bodies for k in robot.floating_coordinates(body)}
    return [k for k in range(robot.coordinate_count) if k not in floating]


def _functions(machine: Robot) -> list[ca.Function]:
    """Encoder, and levers of the robot as drawn."""
    robot, robot_parameters = machine.symbolic()
    x = ca.SX.sym("x", robot.state_size)
    wind = ca.SX.sym("wind", 3)
    force = ca.SX.sym("force", robot.dof)
    q = x[: robot.coordinate_count]
    v = x[robot.coordinate_count :]
    motions = strip_motions(robot, q, v, wind)
    square = sum((_square(motion) for motion in motions), ca.SX(0)) / len(motions)
    speed = ca.sqrt(square + SWITCH_SPEED**2)
    flow = [ca.vertcat(motions[k].forward, motions[k].normal) / speed for k in _ends(robot)]
    features = _GAIN * ca.vertcat(*flow, q[_joints(robot)])
    readout = (square + SWITCH_SPEED**2) * _turned(robot, q, v) @ ca.diag(force)
    parameters = ca.vertcat(wind, force, robot_parameters)
    encode = ca.Function(
        "encode",
        [x, parameters],
        [features, readout],
        ["x", "network_parameters"],
        ["features", "readout"],
    )
    drawn = np.concatenate([robot.coordinates(), robot.velocities()])
    lever = ca.substitute(_lever(motions, v), x, ca.SX(ca.DM(drawn)))
    lever = ca.substitute(lever, wind, ca.SX.zeros(3))
    return [
        encode,
        ca.Function("lever", [robot_parameters], [lever], ["network_parameters"], ["lever"]),
    ]


def _square(motion: StripMotion) -> ca.SX:
    return motion.forward**2 + motion.normal**2


def _lever(motions: Sequence[StripMotion], v: ca.SX) -> ca.SX:
    """sum_i A_i |dp'_i/dv|, (n, 1)."""
    total = ca.SX.zeros(v.shape[0], 1)
    for motion in motions:
        velocity = ca.vertcat(motion.forward, motion.spanwise, motion.normal)
        squares = ca.sum1(ca.jacobian(velocity, v) ** 2).T
        total += motion.strip.chord * motion.strip.width * ca.sqrt(squares)
    return total


def _turned(robot: Robot, q: ca.SX, v: ca.SX) -> ca.SX:
    """B(q): from force and moment in body axes to generalized force, (n, n)."""
    turned = ca.SX.eye(robot.dof)
    for body, twist in zip(robot.bodies, body_velocities(robot, q, v), strict=True):
        if body.floating_dofs is None:
            continue
        dofs = list(body.floating_dofs)
        turned[dofs, dofs] = ca.jacobian(ca.vertcat(twist.linear, twist.angular), v[dofs]).T
    return turned
