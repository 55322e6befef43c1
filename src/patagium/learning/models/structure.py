"""What a learner remembers of how its weights vary together: all of it, or parts.

Full: every pair of weights. Layer: pairs within a layer. Node: pairs within a neuron, its
bias included. Low rank: the inverse of a diagonal plus a product of few columns. After each
sample the covariance of the filter over all weights is found and what the structure keeps
of it is kept. Neglected: structure chosen by what the samples excite.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from patagium.learning.settings import LowRank, Structure

Indices = NDArray[np.int64]


def described_structure(structure: Structure) -> Any:
    """A structure as a JSON-able value."""
    return {"rank": structure.rank} if isinstance(structure, LowRank) else structure


class Layered(Protocol):
    """Weights in layers of neurons."""

    @property
    def size(self) -> int:
        """Number of weights, n."""
        ...

    @property
    def neurons(self) -> Sequence[Sequence[Indices]]:
        """Weights of each neuron in rising order, layer by layer."""
        ...


def blocks_of(weights: Layered, structure: str) -> tuple[Indices, ...]:
    """Weights that are remembered together, each weight in one block, in rising order.

    Args:
        weights: A network, or the part of it with weights.
        structure: "full", "layer" or "node".
    """
    if structure == "full":
        return (np.arange(weights.size),)
    if structure == "layer":
        return tuple(np.sort(np.concatenate(list(layer))) for layer in weights.neurons)
    return tuple(neuron for layer in weights.neurons for neuron in layer)
