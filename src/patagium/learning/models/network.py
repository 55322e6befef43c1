"""A network as learners meet it: a function y(x; W), its values at weights and its slopes.

Most networks are one perceptron between an encoder and a readout that know the physics
(`perceptron`); others compute y as they like. What only some networks have stands elsewhere:
memory in `memory`, physical parameters in `physical`, quantities of a flight in `FlightTerms`.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, real_array
from patagium.errors import ParameterError, ShapeError
from patagium.learning.models.structure import Layered
from patagium.limits import LARGEST
from patagium.robot.model import Robot

_BLOCK = 4096  # samples evaluated at once: bounds the memory, keeps the caches warm


class Encoding(NamedTuple):
    """Samples as the weights meet them: N samples, or one (no leading axis).

    Attributes:
        features: Inputs of the perceptron, ([N,] m, n_in) [1].
        readout: Matrix from its outputs to y, ([N,] n_y, m n_out) [unit of y].
        offset: Vector added to y, (n_y,) [unit of y].
    """

    features: Array
    readout: Array
    offset: Array


class FlightTerms(NamedTuple):
    """Quantities of a flight that a network reads or explains beyond state and air force.

    Attributes:
        acceleration: Whether the measured inputs are [q, v, a], and not [q, v].
        added_mass: Whether y holds the force of the air carried along.
        strip_forces: Matrix from the strip forces in world axes, x y z of one strip after the
            other, to y, (n_y, 3 n_strips) [unit of y / N]; None where y is a generalized force.
        robot: The machine by whose numbers y is the force of the air, or None: the flight's.
    """

    acceleration: bool = False
    added_mass: bool = False
    strip_forces: Array | None = None
    robot: Robot | None = None


@runtime_checkable
class Network(Layered, Protocol):
    """A function of x with weights to learn.

    A network gives its size, encoding, values, slopes and description; the rest follows.
    """

    def __repr__(self) -> str:
        names = ", ".join(self.output_names[:3]) + ", ..." * (self.outputs > 3)
        shape = f"{self.inputs} inputs, {self.outputs} outputs ({names})"
        return f"<{type(self).__name__}: {shape}, {self.size} weights>"

    def _repr_html_(self) -> str:
        from patagium.report.page import snippet
        from patagium.robot.drawing import draw_robot

        robot = getattr(self, "robot", None)
        facts: dict[str, Any] = {
            "inputs": self.inputs,
            "outputs": ", ".join(self.output_names),
            "neurons of hidden layers": ", ".join(map(str, self.hidden)) or "none",
            "weights": self.size,
        }
        return snippet(repr(self), facts, None if robot is None else draw_robot(robot))

    @property
    def inputs(self) -> int:
        """Length of x, n_x, lag states included."""

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the components of y."""

    @property
    def outputs(self) -> int:
        """Length of y, n_y."""
        return len(self.output_names)

    @property
    def hidden(self) -> tuple[int, ...]:
        """Neurons of each hidden layer."""

    def initial(self, seed: int) -> Array:
        """Weights to start from, (n,).

        Args:
            seed: Seed of the draw.
        """

    def encode(self, x: Array) -> Encoding:
        """Many samples as the weights meet them, x (N, n_x)."""

    def encode_one(self, x: Array) -> Encoding:
        """One sample as the weights meet it, x (n_x,)."""
        features, readout, offset = self.encode(x[None])
        return Encoding(features[0], readout[0], offset)

    def decode(self, encoding: Encoding, weights: Array) -> Array:
        """y of samples encoded before, (N, n_y).

        Args:
            encoding: Of N samples.
            weights: Weights, (n,) [1].
        """

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at many weights, (p, n_y), computed in their precision.

        Args:
            encoding: Of one sample.
            points: (p, n).
        """

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (n_y,), and its derivative for the weights, (n_y, n).

        Args:
            encoding: Of one sample.
            weights: Weights, (n,) [1].
        """

    def describe(self) -> dict[str, Any]:
        """Description of the network that rebuilds it, as JSON-able values."""

    def __call__(self, x: ArrayLike, weights: ArrayLike) -> Array:
        """y of one x, (n_y,) in the unit of y.

        Args:
            x: Input, (n_x,) [units of x].
            weights: Weights, (n,) [1].

        Raises:
            ShapeError: If an argument has another shape.
        """
        sample = real_array("x", x, (self.inputs,))
        return np.asarray(self.evaluate(sample[None], weights)[0])

    def evaluate(self, x: ArrayLike, weights: ArrayLike) -> Array:
        """y of many x, (N, n_y) in the unit of y.

        Args:
            x: Inputs, (N, n_x) [units of x].
            weights: Weights, (n,) [1].

        Raises:
            ShapeError: If an argument has another shape.
        """
        samples = real_array("x", x, ("N", self.inputs))
        w = real_array("weights", weights, (self.size,))
        y = np.empty((len(samples), self.outputs))
        for start in range(0, len(samples), _BLOCK):
            part = slice(start, start + _BLOCK)
            y[part] = self.decode(self.encode(samples[part]), w)
        return y


def flight_terms(network: Network) -> FlightTerms:
    """Quantities of a flight that a network reads or explains; by default state and force alone.

    Args:
        network: The network, which may have an attribute `flight_terms`.
    """
    found: FlightTerms = getattr(network, "flight_terms", FlightTerms())
    return found


def center_of(name: str, value: ArrayLike, size: int) -> Array:
    """A scalar or vector as a read-only vector of finite numbers, (size,).

    Raises:
        ShapeError: If it is neither scalar nor (size,).
        ParameterError: If a number is not finite or beyond 1e30.
    """
    array = real_array(name, value)
    if array.shape not in ((), (size,)):
        raise ShapeError(name, f"() or ({size},)", array.shape)
    if not (np.abs(array) <= LARGEST).all():
        raise ParameterError(name, f"finite numbers up to {LARGEST:g}", value)
    whole = np.broadcast_to(array, (size,)).copy()
    whole.setflags(write=False)
    return whole


def scale_of(name: str, value: ArrayLike, size: int) -> Array:
    """A scalar or vector as a read-only vector of positive numbers, (size,).

    Raises:
        ShapeError: If it is neither scalar nor (size,).
        ParameterError: If a number is not positive.
    """
    whole = center_of(name, value, size)
    if not (whole >= 1 / LARGEST).all():
        raise ParameterError(name, f"positive numbers, {1 / LARGEST:g} at least", value)
    return whole
