"""Networks that know no physics: any vector in, any vector out.

The paper's network is a dense one, with two softplus layers and a linear one.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.named_descriptions import check_keys
from patagium.arguments import checked, of_kind
from patagium.arrays import Array
from patagium.errors import ParameterError
from patagium.learning.models.network import Encoding, center_of, scale_of
from patagium.learning.models.perceptron import Perceptron, PerceptronNetwork
from patagium.limits import WIDEST
from patagium.native import load_kernel


class DenseNetwork(PerceptronNetwork):
    """Perceptron between scaled inputs and scaled outputs.

    y = output_center + output_scale * mlp((x - input_center) / input_scale; W).

    Args:
        inputs: Length of x.
        hidden: Neurons of each hidden layer; none makes y linear in x and in W.
        outputs: Length of y, or the names of its components.
        activation: "softplus" or "tanh".
        input_center: Subtracted from x, scalar or (n_x,), in the unit of x.
        input_scale: Divides x, scalar or (n_x,), in the unit of x.
        output_center: Added to y, scalar or (n_y,), in the unit of y.
        output_scale: Multiplies y, scalar or (n_y,), in the unit of y.

    Raises:
        ParameterError: If a width or a scale is not positive, or the activation unknown.
        ShapeError: If a center or scale has another shape.

    Attributes:
        inputs_jump: Whether inputs may jump as commands do; those of a motion do not.
    """

    kind = "dense"

    @checked
    def __init__(
        self,
        inputs: int,
        hidden: Sequence[int],
        outputs: int | Sequence[str],
        activation: str = "softplus",
        *,
        input_center: ArrayLike = 0.0,
        input_scale: ArrayLike = 1.0,
        output_center: ArrayLike = 0.0,
        output_scale: ArrayLike = 1.0,
    ) -> None:
        if isinstance(outputs, int):
            outputs = [f"y{k}" for k in range(min(outputs, WIDEST + 1))]  # one more is refused
        names = tuple(outputs)
        if not names or len(set(names)) != len(names):
            raise ParameterError("outputs", "one or more different names, or how many", outputs)
        self.inputs_jump = False
        self.perceptron = Perceptron((inputs, *hidden, len(names)), activation)
        self._names = names
        self.input_center = center_of("input_center", input_center, inputs)
        self.input_scale = scale_of("input_scale", input_scale, inputs)
        self.output_center = center_of("output_center", output_center, len(names))
        self.output_scale = scale_of("output_scale", output_scale, len(names))
        self.offset = self.output_center
        self._readout = np.diag(self.output_scale)

    @property
    def inputs(self) -> int:
        """Length of x, n_x."""
        return self.perceptron.widths[0]

    def encode(self, x: Array) -> Encoding:
        """Features, (N, 1, n_f), and the output scales as a readout."""
        readout = np.broadcast_to(self._readout, (len(x), *self._readout.shape))
        return Encoding(self._seen(x)[:, None, :], readout, self.offset)

    def compiled_encoder(self) -> tuple[int, Array] | None:
        """Address of the compiled encoder and its constants; None without a compiler."""
        library = load_kernel("scale")
        if library is None:
            return None
        address = ctypes.cast(library.scale_encode, ctypes.c_void_p).value
        readout = self._readout.T.ravel()
        sizes = [float(self.inputs), float(readout.size)]
        constants = np.concatenate([sizes, self.input_center, self.input_scale, readout])
        return None if address is None else (address, constants)

    def describe(self) -> dict[str, Any]:
        """Description of the network that rebuilds it, as JSON-able values."""
        return {
            "kind": self.kind,
            "inputs": self.inputs,
            "hidden": list(self.hidden),
            "outputs": list(self._names),
            "activation": self.perceptron.activation,
            **{name: getattr(self, name).tolist() for name in SCALES},
            **({"inputs_jump": True} if self.inputs_jump else {}),
        }

    def _seen(self, x: Array) -> Array:
        """Scaled inputs, (N, n_x)."""
        return (x - self.input_center) / self.input_scale

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> DenseNetwork:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown.
        """
        values = dict(description)
        jumps = values.pop("inputs_jump", False)  # in a description only where they do
        of_kind("inputs_jump", jumps, bool)
        keys = ("inputs", "hidden", "outputs", "activation", *SCALES)
        network = cls(**described(cls.kind, values, keys))
        network.inputs_jump = jumps
        return network


SCALES = ("input_center", "input_scale", "output_center", "output_scale")
"""Centers and scales of inputs and outputs, as arguments, attributes and in descriptions."""


def described(kind: str, description: Mapping[str, Any], keys: Sequence[str]) -> dict[str, Any]:
    """Values of a description without its kind.

    Raises:
        ParameterError: If a key is missing or unknown.
    """
    values = {key: value for key, value in description.items() if key != "kind"}
    check_keys(f"{kind} network", values, keys)
    return values
