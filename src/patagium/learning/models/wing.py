"""What networks that know the robot have in common: a compiled encoder of the state.

Neglected: what the encoder sees; each network says it.
"""

from __future__ import annotations

from typing import Any, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from patagium.aerodynamics.air import Air
from patagium.learning.models.mlp import Perceptron
from patagium.learning.models.network import Encoding
from patagium.learning.models.perceptron import PerceptronNetwork
from patagium.native import NativeFunction
from patagium.robot.model import Robot

Array = NDArray[np.float64]


class WingNetwork(PerceptronNetwork):
    """A network of the air's force in which robot and density are known; nothing in it changes."""

    robot: Robot
    air: Air
    _perceptron: Perceptron
    _names: tuple[str, ...]
    _offset: Array
    _parameters: Array
    _encode: NativeFunction

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    @property
    def inputs(self) -> int:
        """Length of the state [q, v]."""
        return self.robot.state_size

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
        """From what the air does at the wings to coefficients."""
        return self._perceptron

    def encode(self, x: Array) -> Encoding:
        """What the perceptron sees, (N, m, n_in), and force of unit coefficients, (N, n_y, r)."""
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

    def encoding(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        """What the perceptron sees and force of unit coefficients, as expressions of x (n_x,)."""
        features, readout = self._encode.expression(x, self._parameters)
        return features, readout

    def compiled_encoder(self) -> tuple[int, Array] | None:
        """Address of the compiled encoder and its constants; None without a compiler."""
        address = self._encode.address
        return None if address is None else (address, self._parameters)
