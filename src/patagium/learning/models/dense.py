"""A network that knows no physics: any vector in, any vector out.

The paper's network is one of these, with two softplus layers and a linear one.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ParameterError
from patagium.learning.models.mlp import Perceptron
from patagium.learning.models.network import Encoding
from patagium.learning.models.perceptron import PerceptronNetwork
from patagium.learning.models.scaling import center_of, scale_of
from patagium.native import load_kernel

Array = NDArray[np.float64]


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
    """

    kind = "dense"

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
        names = named_outputs(outputs)
        self._perceptron = Perceptron((inputs, *hidden, len(names)), activation)
        self._names = names
        self.input_center = center_of("input_center", input_center, inputs)
        self.input_scale = scale_of("input_scale", input_scale, inputs)
        self.output_center = center_of("output_center", output_center, len(names))
        self.output_scale = scale_of("output_scale", output_scale, len(names))
        self._readout = np.diag(self.output_scale)

    @property
    def inputs(self) -> int:
        """Length of x, n_x."""
        return self._perceptron.widths[0]

    @property
    def items(self) -> int:
        """The perceptron is evaluated once."""
        return 1

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the components of y."""
        return self._names

    @property
    def offset(self) -> Array:
        """Centers of the outputs, (n_y,)."""
        return self.output_center

    @property
    def perceptron(self) -> Perceptron:
        """The part with weights."""
        return self._perceptron

    def encode(self, x: Array) -> Encoding:
        """Scaled inputs, (N, 1, n_x), and the output scales as a readout."""
        features = (x - self.input_center) / self.input_scale
        readout = np.broadcast_to(self._readout, (len(x), *self._readout.shape))
        return Encoding(features[:, None, :], readout, self.output_center)

    def encode_one(self, x: Array) -> Encoding:
        """Scaled input of one sample, (1, n_x)."""
        features = ((x - self.input_center) / self.input_scale)[None]
        return Encoding(features, self._readout, self.output_center)

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
            "hidden": list(self._perceptron.widths[1:-1]),
            "outputs": list(self._names),
            "activation": self._perceptron.activation,
            "input_center": self.input_center.tolist(),
            "input_scale": self.input_scale.tolist(),
            "output_center": self.output_center.tolist(),
            "output_scale": self.output_scale.tolist(),
        }

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> DenseNetwork:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown.
        """
        values = described(cls.kind, description, DESCRIBED)
        return cls(**values)


DESCRIBED = (
    "inputs",
    "hidden",
    "outputs",
    "activation",
    "input_center",
    "input_scale",
    "output_center",
    "output_scale",
)


def named_outputs(outputs: int | Sequence[str]) -> tuple[str, ...]:
    """Names of outputs given by number or by name.

    Raises:
        ParameterError: If there are none, or two of one name.
    """
    names = tuple(f"y{k}" for k in range(outputs)) if isinstance(outputs, int) else tuple(outputs)
    if not names or len(set(names)) != len(names):
        raise ParameterError("outputs", "one or more different names, or how many", outputs)
    return names


def described(kind: str, description: Mapping[str, Any], keys: Sequence[str]) -> dict[str, Any]:
    """Values of a description without its kind.

    Raises:
        ParameterError: If a key is missing or unknown.
    """
    values = {key: value for key, value in description.items() if key != "kind"}
    if set(values) != set(keys):
        raise ParameterError(f"{kind} network", f"the keys {sorted(keys)}", sorted(values))
    return values
