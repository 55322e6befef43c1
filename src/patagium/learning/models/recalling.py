"""What networks have in common whose memory has weights: numbers first, then a perceptron.

Neglected: what is remembered, and what the numbers are; each network says it.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from patagium.learning.models.mlp import Perceptron
from patagium.learning.models.network import Encoding, Network

Array = NDArray[np.float64]


class RecallingNetwork(Network):
    """A network that nothing changes, made again from its description; a perceptron comes last.

    A network gives its perceptron, encoder and memory; the rest follows.
    """

    _perceptron: Perceptron

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self).from_description, (self.describe(),)  # type: ignore[attr-defined]

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    @property
    def hidden(self) -> tuple[int, ...]:
        """Neurons of each hidden layer of the perceptron."""
        return self._perceptron.widths[1:-1]

    def encode_one(self, x: Array) -> Encoding:
        """What one sample shows to the weights."""
        features, readout, offset = self.encode(x[None])
        return Encoding(features[0], readout[0], offset)
