"""A network that knows the robot and the loads on strips, but not the polar of a section.

The perceptron maps the direction of the local flow of a strip to two section
coefficients, and is the same for every strip of every wing; speed, density, area and
geometry are known. Neglected: history of the flow, neighboring strips, Reynolds number,
forces on anything but strips, section moments.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.local_flow import lift_place, strip_motions
from patagium.aerodynamics.smooth_functions import smooth_norm
from patagium.aerodynamics.strip_loads import StripLoad, assemble
from patagium.arguments import checked
from patagium.arrays import Array, real_array
from patagium.errors import ParameterError, ShapeError, positive
from patagium.learning.models.network import FlightTerms
from patagium.learning.models.perceptron import Perceptron
from patagium.learning.models.wing import WingNetwork, measured_names
from patagium.native import load_functions, named_function
from patagium.robot.model import Robot

Measured = Sequence[str] | ArrayLike | None

_COEFFICIENTS = 2
_GAIN = 3.0  # of the direction, so that neurons saturate outside of the usual incidences
_SIDE, _SIDE_WIDTH = 0.4, 0.1  # distance of flow from above and below, and its steepness


class StripNetwork(WingNetwork):
    """Section coefficients learned, the rest known: y = sum_i B_i(q) 1/2 rho A_i |v_i|^2 c_i.

    v_i = (forward, normal) is the velocity of the strip's force point relative to the air,
    (f, n) = v_i / |v_i| its direction, c_i = scale * mlp(g(f, n); W) the section's force
    coefficients forward and normal, B_i the transposed Jacobian of the force point. That is
    a quarter chord ahead of mid-chord, behind it where the strip moves backward
    (`smooth_sign`, as `QuasiSteady`); |v| in the direction is smoothed near zero.
    Mirrored wings share the perceptron through their mirrored axes. x is the state [q, v].

        g(f, n) = 3 (f (1 + 0.4 n / sqrt(n^2 + 0.1^2)), n)

    is the circle of directions with its two crossings of the chord line moved apart along f.
    Coefficients change fastest there, because a section meets flow from above and from below
    with different sides.

    Args:
        robot: The machine; its numbers are taken as they are.
        hidden: Neurons of each hidden layer.
        air: Density and steady wind; gusts are not known to the network.
        activation: "softplus" or "tanh".
        measured: What y is. None: the generalized force, (n,) [N, N m]. Names of
            coordinates: those components of it. A matrix (n_y, 3 n_strips): that linear
            function of the strip forces in world axes, x y z of one strip after the other.
        chord_fraction: Where on the chord v_i is taken, behind the leading edge, 0 to 1;
            None: at the force point. The published experiment takes it at 0.5 (E9).
        rotation: Whether the reduced pitch rate of the strip, chord * rate / |v|, is a third
            input of the perceptron, as circulation by pitching needs.
        coefficient_scale: Size of coefficients to expect: what the perceptron takes as one.

    Attributes:
        measured: Coordinates whose force y is, or the matrix on strip forces, (n_y, 3 n_strips)
            [unit of y / N].
        flight_terms: Matrix from strip forces to y, where y is not the generalized force.

    Raises:
        ParameterError: If the robot has no strips, a name is not one of its coordinates,
            the matrix not finite, the scale not positive, the fraction not on the chord,
            or a width or the activation not what it may be.
        ShapeError: If the matrix has another shape.
    """

    kind = "strip"
    options = ("measured", "chord_fraction", "rotation", "coefficient_scale")

    @checked
    def __init__(
        self,
        robot: Robot,
        hidden: Sequence[int] = (8, 8),
        air: Air | None = None,
        activation: str = "softplus",
        measured: Measured = None,
        *,
        chord_fraction: float | None = None,
        rotation: bool = False,
        coefficient_scale: float = 4.0,
    ) -> None:
        self._fly(robot, air)
        positive("coefficient_scale", coefficient_scale)
        if chord_fraction is not None and not 0 <= chord_fraction <= 1:
            raise ParameterError("chord_fraction", "0 to 1, or None", chord_fraction)
        self.chord_fraction, self.rotation = chord_fraction, rotation
        self.coefficient_scale = float(coefficient_scale)
        self.items = len(robot.strips)
        self.perceptron = Perceptron((2 + rotation, *hidden, _COEFFICIENTS), activation)
        self._names, matrix = _measurement(robot, measured)
        self.measured = self._names if matrix is None else matrix
        self.flight_terms = FlightTerms(strip_forces=matrix)
        self.offset = np.zeros(len(self._names))
        pressure = self.air.density * self.coefficient_scale
        self._parameters = np.array([*self.air.wind, pressure, *robot.parameters])
        balance = "" if matrix is None else repr(matrix.tolist())
        options = f"{self._names} {balance} {chord_fraction} {rotation}"
        key = f"strip network {options} {robot.structure}"
        label = f"strip network of {robot.name}"
        self._encode = load_functions(key, lambda: [self._function()], label=label)["encode"]

    @checked
    def initial(self, seed: int) -> Array:
        """Weights to start from, (n,): small coefficients, and neurons that look all around.

        Directions of the first layer are spread evenly over the circle from a random one
        on; other weights are standard normal over sqrt(fan-in), a quarter of that in the
        last layer; biases zero.
        """
        draw = np.random.default_rng(seed)
        normal = draw.standard_normal(self.size) / np.sqrt(self.fan_in)
        weights = np.where(self.fan_in > 1, normal, 0.0)
        inputs, neurons = self.perceptron.widths[:2]
        if inputs == 2:
            angles = 2 * np.pi * (draw.random() + np.arange(neurons) / neurons)
            directions = np.column_stack([np.cos(angles), np.sin(angles)])
            weights[: inputs * neurons] = directions.ravel()
        below, above = self.perceptron.widths[-2:]
        weights[-(below + 1) * above :] *= 0.25
        return weights

    def _function(self) -> ca.Function:
        """Function of x and parameters: features of all strips, and y by their coefficients."""
        robot, robot_parameters = self.robot.symbolic()
        x, wind, pressure = ca.SX.sym("x", self.inputs), ca.SX.sym("wind", 3), ca.SX.sym("rho")
        q, v = x[: robot.coordinate_count], x[robot.coordinate_count :]
        coefficients = ca.SX.sym("c", _COEFFICIENTS, len(robot.strips))
        seen, loads = [], []
        for number, motion in enumerate(strip_motions(robot, q, v, wind)):
            strip = motion.strip
            ahead = looking = lift_place(motion)
            if self.chord_fraction is not None:
                looking = (0.25 - self.chord_fraction) * strip.chord
            flow = ca.vertcat(motion.forward, motion.normal_ahead(looking))
            square = ca.sumsqr(flow)
            speed = smooth_norm(square)
            turn = [strip.chord * motion.pitch_rate / speed] if self.rotation else []
            seen.append(ca.vertcat(direction_inputs(flow / speed), *turn))
            force = pressure * strip.chord * strip.width * square / 2 * coefficients[:, number]
            loads.append(StripLoad(motion, force[0], force[1], ahead, ca.SX(0)))
        air = assemble(robot, q, loads, ca.SX(0, 1))
        matrix = self.flight_terms.strip_forces
        if matrix is None:
            y = ca.vertcat(*[air.generalized_force[robot.index(name)] for name in self._names])
        else:
            y = ca.sparsify(ca.DM(matrix)) @ ca.vec(air.strip_force)
        readout = ca.jacobian(y, ca.vec(coefficients))
        parameters = ca.vertcat(wind, pressure, robot_parameters)
        outputs = {"features": ca.horzcat(*seen), "readout": readout}
        return named_function("encode", {"x": x, "network_parameters": parameters}, outputs)


def direction_inputs(direction: ca.SX) -> ca.SX:
    """Inputs of the perceptron for a direction of flow, (2, 1) [1].

    Args:
        direction: Forward and normal part, of length one, (2, 1) [1].
    """
    forward, normal = direction[0], direction[1]
    side = normal / ca.sqrt(normal**2 + _SIDE_WIDTH**2)
    return _GAIN * ca.vertcat(forward * (1 + _SIDE * side), normal)


def _measurement(robot: Robot, measured: Measured) -> tuple[tuple[str, ...], Array | None]:
    """Names of y, and the matrix on strip forces where y is not the generalized force."""
    if measured is None:
        return robot.dof_names, None
    if isinstance(measured, Sequence) and all(isinstance(name, str) for name in measured):
        names = (measured,) if isinstance(measured, str) else tuple(map(str, measured))
        return measured_names(robot, names), None
    matrix = real_array("measured", measured)
    columns = 3 * len(robot.strips)
    if matrix.ndim != 2 or matrix.shape[1] != columns or not len(matrix):
        raise ShapeError("measured", ("n_y", columns), matrix.shape)
    if not np.isfinite(matrix).all():
        raise ParameterError("measured", "finite numbers", measured)
    return tuple(f"y{k}" for k in range(len(matrix))), matrix
