"""A dense network in dimensionless quantities: flow and joints in, force coefficients out.

The network knows the kinematics of the robot: the direction of the air at each panel, that
forces grow with the square of the speed, and that they turn with the robot. One perceptron
maps the flow at all wings to all forces. Neglected: history of the flow, Reynolds number,
forces on anything but wings.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.local_flow import StripMotion, strip_motions
from patagium.aerodynamics.smooth_functions import SWITCH_SPEED
from patagium.dynamics.kinematics import body_velocities
from patagium.errors import ParameterError, positive
from patagium.learning.models.mlp import Perceptron
from patagium.learning.models.wing import WingNetwork
from patagium.native import load_functions
from patagium.robot.model import Robot

Array = NDArray[np.float64]

_GAIN = 1.5  # of the inputs, so that neurons saturate outside of the usual flows and angles
_LEAST_LEVER = 1e-3  # of the longest: forces on coordinates that move no wing as drawn


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
        self.robot, self.air = robot, Air() if air is None else air
        seen = 2 * len(_ends(robot)) + len(_joints(robot))
        self._perceptron = Perceptron((seen, *hidden, robot.dof), activation)
        self._offset = np.zeros(robot.dof)
        symbolic, _ = robot.symbolic()
        key, label = f"flow network {symbolic!r}", f"flow network of {robot.name}"
        functions = load_functions(key, lambda: _functions(robot), label=label)
        self._encode = functions["encode"]
        lever = np.ravel(functions["lever"](robot.parameters))
        self.lever = np.maximum(lever, _LEAST_LEVER * lever.max())
        """Generalized force of unit coefficients over dynamic pressure, (n,) [m^2, m^3]."""
        self.lever.setflags(write=False)
        force = self.air.density / 2 * self.coefficient_scale * self.lever
        self._parameters = np.array([*self.air.wind, *force, *robot.parameters])

    @property
    def items(self) -> int:
        """The perceptron is evaluated once."""
        return 1

    def force_scale(self, speed: float) -> Array:
        """Generalized force of unit coefficients at a speed, (n,) [N, N m].

        A share of it is a measurement_std in proportion for every coordinate.

        Args:
            speed: Of the wings through the air, root mean square over strips [m/s].
        """
        return np.asarray(self.air.density / 2 * speed**2 * self.lever)


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
    x, wind = ca.SX.sym("x", robot.state_size), ca.SX.sym("wind", 3)
    force = ca.SX.sym("force", robot.dof)
    q, v = x[: robot.coordinate_count], x[robot.coordinate_count :]
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
