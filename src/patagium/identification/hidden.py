"""A strip network with memory: what the air remembers is a state, what it does is learned.

Sigma'_Aero of the source paper by strips. Every strip carries lags of its normalwash at
fixed stable rates (`StripMemory`); trailing vortices carry them to its neighbors; the
perceptron learns what section coefficients they make. Fixed: the rates, the Biot-Savart law
on the known geometry. Learned: how lags and neighbors are weighed, and the coefficients.
Neglected: forces on anything but strips, Reynolds number, separation with a memory of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.air import Air, air_from_description
from patagium.aerodynamics.horseshoes import horseshoe_function, lattice, strip_chains
from patagium.aerodynamics.local_flow import StripMotion, strip_motions
from patagium.aerodynamics.smooth import smooth_norm, smooth_sign
from patagium.aerodynamics.wash import normalwash
from patagium.dynamics.chain import cross, vector
from patagium.dynamics.kinematics import generalized_force
from patagium.errors import ParameterError
from patagium.identification.dense import described
from patagium.identification.memory import StripMemory
from patagium.identification.mlp import Perceptron
from patagium.identification.network import Memory
from patagium.identification.strip import StripNetwork
from patagium.native import load_functions
from patagium.robot.model import Robot

Array = NDArray[np.float64]

_COEFFICIENTS = 6  # forward, normal, moment, along the span; slopes of the first two
_DIRECTION, _WASH, _LAG = 2.0, 1.5, 3.0  # features then are about one in flapping flight
_SLOWEST, _FASTEST = 0.05, 0.8  # rates of lags asked for by number [1/semichord]


class HiddenStripNetwork(StripNetwork):
    """Section coefficients from the local flow and its memory, y = sum_i B_i(q) p_i c_i.

    x is [q, v, xi]: the state of the robot and the lagged normalwashes of its strips, which
    `memory` advances with the flow, and `recall` finds for a log. For each strip

        m = scale * mlp([2f, 2n, 1.5w/U, 3xi_k/U, 1.5i/U, 3i_k/U]; W),
        c_forward = m_1 + m_5 w/U,    c_normal = m_2 + m_6 w/U + sum_k m_(6+k) xi_k/U,

    with U = |v| and (f, n) = v / U at the force point as in `StripNetwork`, w the normalwash
    at three quarters of the chord, and i, i_k the normal velocity that all strips' trailing
    vortices would induce if their circulations were pi c w or pi c xi_k. m_3 is
    the moment about the span at the force point, m_4 drag along the span (times the velocity
    along it); p_i = 1/2 rho A_i U^2, a chord more for the moment. So C(x, xi) xi + D(x, xi) w
    of the state-space lifting line is there to begin with, C and D to be learned.

    Whatever the weights, the hidden states cannot grow: their rates are 2 U b_k / c, b_k > 0.

    Args:
        robot: The machine; its numbers are taken as they are.
        hidden: Neurons of each hidden layer.
        lags: How many a strip, their rates spread evenly in logarithm from .05 to .8 a
            semichord; or the rates themselves [1/semichord].
        air: Density and steady wind; gusts are not known to the network.
        activation: "softplus" or "tanh".
        coefficient_scale: Size of coefficients to expect: what the perceptron takes as one.

    Raises:
        ParameterError: If the robot has no strips, the scale or a rate is not positive, or a
            width or the activation not what it may be.

    References:
        Izraelevitz, Zhu & Triantafyllou (2017), AIAA Journal 55, 1279-1294 (the lags).
    """

    kind = "hidden_strip"

    def __init__(
        self,
        robot: Robot,
        hidden: Sequence[int] = (8, 8),
        lags: int | Sequence[float] = 2,
        air: Air | None = None,
        activation: str = "tanh",
        *,
        coefficient_scale: float = 4.0,
    ) -> None:
        if not robot.strips:
            raise ParameterError("robot", "a robot with wings", robot.name)
        if not (np.isfinite(coefficient_scale) and coefficient_scale > 0):
            raise ParameterError("coefficient_scale", "a positive number", coefficient_scale)
        self.coefficient_scale = float(coefficient_scale)
        self.robot, self.air = robot, Air() if air is None else air
        self._memory = StripMemory(robot, self.air, _rates(lags))
        inputs = 4 + 2 * len(self._memory.rates)
        outputs = _COEFFICIENTS + len(self._memory.rates)
        self._perceptron = Perceptron((inputs, *hidden, outputs), activation)
        self._names, self._offset = robot.dof_names, np.zeros(robot.dof)
        pressure = self.air.density * self.coefficient_scale
        self._parameters = np.array([*self.air.wind, pressure, *robot.parameters])
        symbolic, _ = robot.symbolic()
        key = f"hidden strip network {len(self._memory.rates)} {symbolic!r}"
        label = f"hidden strip network of {robot.name}"
        self._encode = load_functions(key, lambda: [self._function()], label=label)["encode"]

    def __reduce__(self) -> tuple[Any, ...]:
        return self.from_description, (self.describe(),)

    @property
    def inputs(self) -> int:
        """Length of [q, v, xi]."""
        return self.robot.state_size + self._memory.size

    @property
    def memory(self) -> StripMemory:
        """The lags, to be advanced with the flow."""
        return self._memory

    @property
    def measured_inputs(self) -> int:
        """Length of [q, v]."""
        return self.robot.state_size

    def recall(
        self,
        weights: Array,
        time: ArrayLike,
        x: Array,
        carried: Memory | None = None,
        gaps: ArrayLike = (),
    ) -> tuple[Array, Memory]:
        """States of a block with what the strips remember at each; no weight changes that.

        Args:
            weights: Not used, (n,).
            time: Increasing, (N,) [s].
            x: [q, v], (N, n_q + n).
            carried: What the block before left.
            gaps: First sample after each gap.

        Returns:
            [q, v, xi], (N, n_x), and what the next block goes on from.
        """
        stamps, starts = np.asarray(time, float), np.asarray(gaps, int)
        if carried is None:
            lags = self._memory.states(stamps, x, starts)
        else:
            earlier = np.append(carried.time, stamps), np.vstack([carried.x, x])
            lags = self._memory.states(*earlier, starts + 1, carried.state)[1:]
        nothing = np.zeros((self._memory.size, 0))
        left = Memory(float(stamps[-1]), x[-1], lags[-1], nothing, np.zeros(0))
        return np.hstack([x, lags]), left

    def describe(self) -> dict[str, Any]:
        """Everything needed to make the network again, as JSON-able values."""
        return {
            "kind": self.kind,
            "robot": self.robot.source,
            "hidden": list(self._perceptron.widths[1:-1]),
            "lags": list(self._memory.rates),
            "air": self.air.describe(),
            "activation": self._perceptron.activation,
            "coefficient_scale": self.coefficient_scale,
        }

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> HiddenStripNetwork:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown.
            RobotFileError: If the text of the robot does not describe one.
        """
        from patagium.robot import load_robot_text

        keys = ("robot", "hidden", "lags", "air", "activation", "coefficient_scale")
        values = described(cls.kind, description, keys)
        air = air_from_description(values.pop("air"))
        return cls(load_robot_text(values.pop("robot")), air=air, **values)

    def _function(self) -> ca.Function:
        robot, robot_parameters = self.robot.symbolic()
        count, lags = len(robot.strips), len(self._memory.rates)
        x, wind, pressure = ca.SX.sym("x", self.inputs), ca.SX.sym("wind", 3), ca.SX.sym("rho")
        n_q, n_x = robot.coordinate_count, robot.state_size
        q, v = x[:n_q], x[n_q:n_x]
        motions = strip_motions(robot, q, v, wind)
        washes = [ca.vertcat(*[normalwash(motion) for motion in motions])]
        washes += [x[n_x + k :: lags] for k in range(lags)]
        induced = self._induced(robot, q, v, wind, motions, washes)
        coefficients = ca.SX.sym("m", _COEFFICIENTS + lags, count)
        seen: list[ca.SX] = []
        wrenches: dict[int, tuple[ca.SX, ca.SX]] = {}
        for i, motion in enumerate(motions):
            ahead = (smooth_sign(motion.forward) - 1.0) * (motion.strip.chord / 4)
            flow = ca.vertcat(motion.forward, motion.normal_ahead(ahead))
            speed = smooth_norm(ca.sumsqr(flow))
            gains = [_WASH] + [_LAG] * lags
            parts = [
                gain * wash[i] / speed
                for washed in (washes, induced)
                for gain, wash in zip(gains, washed, strict=True)
            ]
            seen.append(ca.vertcat(_DIRECTION * flow / speed, *parts))
            m = coefficients[:, i]
            slopes = ca.vertcat(*[wash[i] for wash in washes]) / speed
            c = ca.vertcat(m[0] + m[4] * slopes[0], m[1] + ca.dot(m[5:], slopes), m[2:4])
            wrench = _wrench(motion, flow, speed, ahead, pressure * c)
            body, still = motion.strip.body, (ca.SX.zeros(3, 1), ca.SX.zeros(3, 1))
            force, moment = wrenches.get(body, still)
            wrenches[body] = (force + wrench[0], moment + wrench[1])
        y = generalized_force(robot, q, wrenches)
        outputs = [ca.horzcat(*seen), ca.jacobian(y, ca.vec(coefficients))]
        parameters = ca.vertcat(wind, pressure, robot_parameters)
        names_in, names_out = ["x", "network_parameters"], ["features", "readout"]
        return ca.Function("encode", [x, parameters], outputs, names_in, names_out)

    def _induced(
        self,
        robot: Robot,
        q: ca.SX,
        v: ca.SX,
        wind: ca.SX,
        motions: Sequence[StripMotion],
        washes: Sequence[ca.SX],
    ) -> list[ca.SX]:
        """Normal velocity at each strip if the circulations were pi c wash, (n_strips, 1) each."""
        chains = strip_chains(self.robot)
        net = lattice(robot, chains, q, v, wind)
        order = [i for chain in chains for i in chain.strips]
        right = [sign for chain in chains for sign in chain.right]
        gain = ca.vertcat(
            *[
                pi * along * smooth_sign(motions[i].forward) * motions[i].strip.chord
                for i, along in zip(order, right, strict=True)
            ]
        )
        vortices = horseshoe_function(tuple(len(chain.strips) for chain in chains))
        place = [order.index(i) for i in range(len(order))]
        found = []
        for wash in washes:
            _, velocity = vortices(
                *(net.points[:, order], net.normals[:, order]),
                *(net.edges, net.directions, net.core_squares, gain, wash[order], 0.0),
            )
            found.append(ca.sum1(net.normals * velocity[:, place]).T)
        return found


def _wrench(
    motion: StripMotion, flow: ca.SX, speed: ca.SX, ahead: ca.SX, coefficients: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Force and moment about the body's origin of coefficients times density, body axes."""
    strip = motion.strip
    forward, normal = vector(strip.forward), vector(strip.normal)
    span, half_area = cross(normal, forward), strip.chord * strip.width / 2
    along = coefficients[3] * speed * motion.spanwise_ahead(ahead)
    square = ca.sumsqr(flow)
    force = forward * (coefficients[0] * square) + normal * (coefficients[1] * square)
    force = half_area * (force + span * along)
    point = vector(strip.quarter_chord) + forward * ahead
    twist = half_area * strip.chord * square * coefficients[2]
    return force, cross(point, force) - span * twist


def _rates(lags: int | Sequence[float]) -> tuple[float, ...]:
    if not isinstance(lags, int):
        return tuple(lags)
    if lags < 0:
        raise ParameterError("lags", "a number of at least 0, or rates", lags)
    return tuple(np.geomspace(_SLOWEST, _FASTEST, lags).tolist())
