"""Networks that know the robot: their description, and a compiled encoder of the state.

Neglected: gusts; density and steady wind are known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, Self

import casadi as ca

from patagium.aerodynamics.air import Air, air_from_description
from patagium.aerodynamics.named_descriptions import plainly
from patagium.arrays import Array
from patagium.errors import ParameterError
from patagium.learning.models.dense import described
from patagium.learning.models.network import Encoding
from patagium.learning.models.perceptron import PerceptronNetwork
from patagium.native import NativeFunction
from patagium.robot.files import load_robot_text
from patagium.robot.model import Robot


class WingNetwork(PerceptronNetwork):
    """An immutable network of one perceptron between a compiled encoder of the state and a readout.

    A network names its own arguments in `options` and those it shares with others in `shared`,
    and has an attribute for each; pickles and descriptions follow.

    Attributes:
        kind: Name in descriptions.
        shared: Arguments of the constructor that most networks have, other than the robot.
        options: Other arguments of the constructor.
        readers: Inverse of `describe` of those arguments that are not JSON themselves.
        one_by_one: Whether code of many states takes longer to compile than it saves.
        robot: The machine.
        air: Density and steady wind.
    """

    kind: ClassVar[str]
    shared: ClassVar[tuple[str, ...]] = ("hidden", "air", "activation")
    options: ClassVar[tuple[str, ...]]
    readers: ClassVar[dict[str, Callable[[Any], Any]]] = {"air": air_from_description}
    one_by_one = False
    robot: Robot
    air: Air
    _parameters: Array
    _encode: NativeFunction

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        names = ("robot", *self.shared, *self.options)
        return partial(type(self), **{name: getattr(self, name) for name in names}), ()

    @property
    def activation(self) -> str:
        """Activation of the hidden layers of the perceptron."""
        return self.perceptron.activation

    def _fly(self, robot: Robot, air: Air | None) -> None:
        """Set the robot, which must have wings, and its air without gusts; None: still air."""
        if not robot.strips:
            raise ParameterError("robot", "a robot with wings", robot.name)
        self.robot, self.air = robot, replace(air or Air(), gust=None)

    def describe(self) -> dict[str, Any]:
        """Description of the network that rebuilds it, as JSON-able values."""
        values = {name: plainly(getattr(self, name)) for name in (*self.shared, *self.options)}
        return {"kind": self.kind, "robot": self.robot.source, **values}

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> Self:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown.
            RobotFileError: If the text of the robot does not describe one.
        """
        keys = ("robot", *cls.shared, *cls.options)
        values = described(cls.kind, description, keys)
        values |= {name: read(values[name]) for name, read in cls.readers.items()}
        make: Callable[..., Self] = cls
        return make(load_robot_text(values.pop("robot")), **values)

    @property
    def inputs(self) -> int:
        """Length of the state [q, v]."""
        return self.robot.state_size

    def encode(self, x: Array) -> Encoding:
        """Inputs of the perceptron, (N, m, n_in), and force of unit coefficients, (N, n_y, r)."""
        many = self._encode.each if self.one_by_one else self._encode.batch
        return self._encoded((len(x),), *many(x, self._parameters))

    def encode_one(self, x: Array) -> Encoding:
        """Inputs of the perceptron, (m, n_in), and force of unit coefficients, (n_y, r)."""
        return self._encoded((), *self._encode(x, self._parameters))

    def _encoded(self, count: tuple[int, ...], features: Array, readout: Array) -> Encoding:
        features = features.reshape(*count, self.perceptron.widths[0], -1).swapaxes(-1, -2)
        return Encoding(features, readout.reshape(*count, self.outputs, -1), self.offset)

    def encoding(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Inputs of the perceptron and force of unit coefficients, as expressions of x (n_x,)."""
        features, readout = self._encode.expression(x, self._parameters)
        return features, readout

    def compiled_encoder(self) -> tuple[int, Array] | None:
        """Address of the compiled encoder and its constants; None without a compiler."""
        address = self._encode.address
        return None if address is None else (address, self._parameters)


def measured_names(robot: Robot, measured: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the coordinates whose force y is: those that are measured, or all.

    Raises:
        ParameterError: If there is none, one is there twice, or one is unknown.
    """
    names = robot.dof_names if measured is None else tuple(measured)
    if not names or len({*names}) != len(names):
        raise ParameterError("measured", "different names of coordinates", measured)
    for name in names:
        robot.index(name)
    return names
