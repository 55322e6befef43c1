"""Network linear in its weights: a readout of the scaled inputs or of fixed random features.

y = offset + scale B f(x), f the scaled inputs and 1, or random softplus features of them and 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.errors import ParameterError
from patagium.learning.models.dense import DESCRIBED, DenseNetwork, described
from patagium.learning.models.mlp import softplus
from patagium.learning.models.network import Encoding

Array = NDArray[np.float64]


class LinearNetwork(DenseNetwork):
    """A linear readout of fixed random softplus features of the scaled inputs.

    Args:
        base: Gives inputs, outputs and their scales; must have no hidden layer.
        features: Number of random features; 0: the scaled inputs themselves.
        seed: Seed of the features.

    Raises:
        ParameterError: If `base` has hidden layers, or `features` is negative.
    """

    kind = "linear"

    def __init__(self, base: DenseNetwork, features: int = 0, seed: int = 0) -> None:
        if not isinstance(base, DenseNetwork) or len(base.perceptron.widths) != 2:
            raise ParameterError("network", "a DenseNetwork without hidden layers", base)
        if not (isinstance(features, int) and features >= 0):
            raise ParameterError("features", "a whole number of at least 0", features)
        super().__init__(
            features or base.inputs,
            (),
            base.output_names,
            output_center=base.output_center,
            output_scale=base.output_scale,
        )
        self._base, self._features, self._seed = base, features, seed
        draw = np.random.default_rng(seed)
        self._mixing = draw.standard_normal((base.inputs, features)) * np.sqrt(2 / base.inputs)
        self._bias = draw.standard_normal(features)

    @property
    def inputs(self) -> int:
        """Length of x, n_x."""
        return self._base.inputs

    def encode(self, x: Array) -> Encoding:
        """Features, (N, 1, n_f), and the output scales as a readout."""
        scaled = (x - self._base.input_center) / self._base.input_scale
        mixed = softplus(scaled @ self._mixing + self._bias) if self._features else scaled
        readout = np.broadcast_to(self._readout, (len(x), *self._readout.shape))
        return Encoding(mixed[:, None, :], readout, self.output_center)

    def encode_one(self, x: Array) -> Encoding:
        """Features of one sample, (1, n_f)."""
        many = self.encode(x[None])
        return Encoding(many.features[0], self._readout, self.output_center)

    def compiled_encoder(self) -> None:
        """None: random features are made in NumPy."""

    def initial(self, seed: int) -> Array:
        """Zero weights: least squares needs no start, (n,).

        Args:
            seed: Not used.
        """
        return np.zeros(self.size)

    def describe(self) -> dict[str, Any]:
        """Description of the network that rebuilds it, as JSON-able values."""
        base = self._base.describe()
        return {**base, "kind": self.kind, "features": self._features, "seed": self._seed}

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> LinearNetwork:
        """Inverse of `describe`.

        Raises:
            ParameterError: If a key is missing or unknown.
        """
        values = described(cls.kind, description, (*DESCRIBED, "features", "seed"))
        features, seed = values.pop("features"), values.pop("seed")
        return cls(DenseNetwork(**values), features, seed)
