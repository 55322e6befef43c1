"""A network that knows the robot and how air pushes on strips, but not the section's polar.

The perceptron maps the direction of the local flow of a strip to two section
coefficients, and is the same for every strip of every wing; speed, density, area and
geometry are known. Neglected: what a strip does not see of its own flow (history,
neighbors, Reynolds number), forces on anything but strips, section moments.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.air import Air, air_from_description
from patagium.aerodynamics.loads import StripLoad, assemble
from patagium.aerodynamics.local_flow import strip_motions
from patagium.aerodynamics.smooth import smooth_norm, smooth_sign
from patagium.errors import ParameterError, ShapeError
from patagium.identification.dense import described
from patagium.identification.mlp import Perceptron
from patagium.identification.network import Encoding, Network
from patagium.native import load_functions
from patagium.robot.model import Robot

Array = NDArray[np.float64]
Measured = Sequence[str] | ArrayLike | None

_COEFFICIENTS = 2


class StripNetwork(Network):
    """Section coefficients learned, the rest known: y = sum_i B_i(q) 1/2 rho A_i |v_i|^2 c_i.

    v_i = (forward, normal) is the velocity of the strip's force point relative to the air,
    c_i = scale * mlp(v_i / |v_i|; W) its force coefficients forward and normal, B_i the
    transposed Jacobian of that point. The force point is a quarter chord ahead of mid-chord, behind it
    where the strip moves backward (`smooth_sign`, as `QuasiSteady`); |v| in the direction
    is smoothed near zero. Mirrored wings share the perceptron through their mirrored axes.
    x is the state [q, v].

    Args:
        robot: The machine; its numbers are taken as they are.
        hidden: Neurons of each hidden layer.
        air: Density and steady wind; gusts are not known to the network.
        activation: "softplus" or "tanh".
        measured: What y is. None: the generalized force, (n,) [N, N m]. Names of
            coordinates: those components of it. A matrix (n_y, 3 n_strips): that linear
            function of the strip forces in world axes, x y z of one strip after the other.
        rotation: Whether the reduced pitch rate of the strip, chord * rate / |v|, is a third
            input of the perceptron: what the incidence at another point of the chord, or
            circulation by pitching, needs.
        coefficient_scale: Size of coefficients to expect: what the perceptron takes as one.

    Raises:
        ParameterError: If the robot has no strips, a name is not one of its coordinates,
            the matrix not finite, the scale not positive, or a width or the activation not
            what it may be.
        ShapeError: If the matrix has another shape.
    """

    kind = "strip"

    def __init__(
        self,
        robot: Robot,
        hidden: Sequence[int] = (8, 8),
        air: Air | None = None,
        activation: str = "softplus",
        measured: Measured = None,
        rotation: bool = False,
        coefficient_scale: float = 1.0,
    ) -> None:
        if not robot.strips:
            raise ParameterError("robot", "a robot with wings", robot.name)
        if not (np.isfinite(coefficient_scale) and coefficient_scale > 0):
            raise ParameterError("coefficient_scale", "a positive number", coefficient_scale)
        self.rotation, self.coefficient_scale = rotation, float(coefficient_scale)
        self.robot, self.air = robot, Air() if air is None else air
        self._perceptron = Perceptron((2 + rotation, *hidden, _COEFFICIENTS), activation)
        self._names, self._matrix = _measurement(robot, measured)
        self._offset = np.zeros(len(self._names))
        pressure = self.air.density * self.coefficient_scale
        self._parameters = np.array([*self.air.wind, pressure, *robot.parameters])
        symbolic, _ = robot.symbolic()
        key = f"strip network {self._names} {self._matrix_key()} {rotation} {symbolic!r}"
        label = f"strip network of {robot.name}"
        self._encode = load_functions(key, lambda: [self._function()], label=label)["encode"]

    def __reduce__(self) -> tuple[Any, ...]:
        measured = self._names if self._matrix is None else self._matrix
        hidden, activation = self._perceptron.widths[1:-1], self._perceptron.activation
        options = (measured, self.rotation, self.coefficient_scale)
        return StripNetwork, (self.robot, hidden, self.air, activation, *options)

    def __deepcopy__(self, memo: dict[int, Any]) -> StripNetwork:
        return self  # nothing in it changes

    @property
    def inputs(self) -> int:
        """Length of the state [q, v], 2 n."""
        return 2 * self.robot.dof

    @property
    def items(self) -> int:
        """Number of strips."""
        return len(self.robot.strips)

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the components of y."""
        return self._names

    @property
    def offset(self) -> Array:
        """No air, no force: zero, (n_y,)."""
        return self._offset

    @property
    def perceptron(self) -> Perceptron:
        """From the direction of the flow to the section coefficients."""
        return self._perceptron

    def encode(self, x: Array) -> Encoding:
        """Directions of flow, (N, n_strips, 2), and force of unit coefficients, (N, n_y, 2 n_s)."""
        features, readout = self._encode.batch(x, self._parameters)
        return Encoding(
            features.reshape(len(x), self._perceptron.widths[0], -1).transpose(0, 2, 1),
            readout.reshape(len(x), len(self._names), -1),
            self._offset,
        )

    def encode_one(self, x: Array) -> Encoding:
        """The same of one sample."""
        features, readout = self._encode(x, self._parameters)
        return Encoding(
            features.reshape(self._perceptron.widths[0], -1).T,
            readout.reshape(len(self._names), -1),
            self._offset,
        )

    def compiled_encoder(self) -> tuple[int, Array] | None:
        """Address of the compiled encoder and its constants; None without a compiler."""
        address = self._encode.address
        return None if address is None else (address, self._parameters)

    def describe(self) -> dict[str, Any]:
        """Everything needed to make the network again, as JSON-able values."""
        return {
            "kind": self.kind,
            "robot": self.robot.source,
            "hidden": list(self._perceptron.widths[1:-1]),
            "air": self.air.describe(),
            "activation": self._perceptron.activation,
            "measured": list(self._names) if self._matrix is None else self._matrix.tolist(),
            "rotation": self.rotation,
            "coefficient_scale": self.coefficient_scale,
        }

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> StripNetwork:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown.
            RobotFileError: If the text of the robot does not describe one.
        """
        from patagium.robot import load_robot_text

        names = ("robot", "hidden", "air", "activation", "measured")
        keys = (*names, "rotation", "coefficient_scale")
        values = described(cls.kind, description, keys)
        air = air_from_description(values.pop("air"))
        return cls(load_robot_text(values.pop("robot")), air=air, **values)

    def _matrix_key(self) -> str:
        return "" if self._matrix is None else repr(self._matrix.tolist())

    def _function(self) -> ca.Function:
        robot, robot_parameters = self.robot.symbolic()
        x, wind, density = ca.SX.sym("x", self.inputs), ca.SX.sym("wind", 3), ca.SX.sym("rho")
        q, v = x[: robot.dof], x[robot.dof :]
        coefficients = ca.SX.sym("c", _COEFFICIENTS, len(robot.strips))
        seen, loads = [], []
        for number, motion in enumerate(strip_motions(robot, q, v, wind)):
            strip = motion.strip
            ahead = (smooth_sign(motion.forward) - 1.0) * (strip.chord / 4)
            flow = ca.vertcat(motion.forward, motion.normal_ahead(ahead))
            square = ca.sumsqr(flow)
            speed = smooth_norm(square)
            turn = [strip.chord * motion.pitch_rate / speed] if self.rotation else []
            seen.append(ca.vertcat(flow / speed, *turn))
            force = density * strip.chord * strip.width * square / 2 * coefficients[:, number]
            loads.append(StripLoad(motion, force[0], force[1], ahead, ca.SX(0)))
        air = assemble(robot, q, loads, ca.SX(0, 1))
        if self._matrix is None:
            y = ca.vertcat(*[air.generalized_force[robot.index(name)] for name in self._names])
        else:
            y = ca.sparsify(ca.DM(self._matrix)) @ ca.vec(air.strip_force)
        outputs = [ca.horzcat(*seen), ca.jacobian(y, ca.vec(coefficients))]
        parameters = ca.vertcat(wind, density, robot_parameters)
        names_in, names_out = ["x", "network_parameters"], ["features", "readout"]
        return ca.Function("encode", [x, parameters], outputs, names_in, names_out)


def _measurement(robot: Robot, measured: Measured) -> tuple[tuple[str, ...], Array | None]:
    """Names of y, and the matrix on strip forces where y is not the generalized force."""
    if measured is None:
        return robot.dof_names, None
    if isinstance(measured, Sequence) and all(isinstance(name, str) for name in measured):
        names = (measured,) if isinstance(measured, str) else tuple(map(str, measured))
        if not names or len(set(names)) != len(names):
            raise ParameterError("measured", "different names of coordinates", measured)
        for name in names:
            robot.index(name)
        return names, None
    matrix = np.array(measured, float)
    columns = 3 * len(robot.strips)
    if matrix.ndim != 2 or matrix.shape[1] != columns or not len(matrix):
        raise ShapeError("measured", ("n_y", columns), matrix.shape)
    if not np.isfinite(matrix).all():
        raise ParameterError("measured", "finite numbers", measured)
    return tuple(f"y{k}" for k in range(len(matrix))), matrix
