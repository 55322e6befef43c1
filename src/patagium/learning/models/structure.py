"""Blocks of weights whose covariance a learner keeps: all weights, layers or neurons.

Full: every pair of weights. Layer: pairs within a layer. Node: pairs within a neuron, its
bias included. After each sample the covariance over all weights is computed, and the part in the
structure is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from patagium.arguments import checked
from patagium.arrays import Array, Indices
from patagium.errors import ParameterError
from patagium.learning.settings import BLOCKS, OWN_BLOCKS


class Layered(Protocol):
    """Weights in layers of neurons."""

    @property
    def size(self) -> int:
        """Number of weights, n."""

    @property
    def fan_in(self) -> Array:
        """Fan-in of the neuron of each weight, 1 for a bias, (n,)."""

    @property
    def neurons(self) -> Sequence[Sequence[Indices]]:
        """Weights of each neuron in rising order, layer by layer."""


Blocks = Callable[[Layered], Sequence[Indices]]


@checked
def register_blocks(name: str, blocks: Blocks) -> None:
    """Make `covariance=name` a structure of independent blocks of weights.

    Args:
        name: Name of the structure, as settings and files have it.
        blocks: Function from a network to the weights of each block; each weight is in one block.

    Raises:
        ParameterError: If the package has a structure of the name.
    """
    if name in BLOCKS:
        raise ParameterError("name of the structure", "one of its own", name)
    OWN_BLOCKS[name] = blocks


def blocks_of(weights: Layered, structure: str) -> tuple[Indices, ...]:
    """Weights of each block of a structure, each weight in one block, in rising order.

    Args:
        weights: A network, or the part of it with weights.
        structure: "full", "layer", "node", or a registered name.

    Raises:
        ParameterError: If a registered structure does not put each weight in one block.
    """
    if structure in OWN_BLOCKS:
        return _checked(structure, weights, OWN_BLOCKS[structure](weights))
    if structure == "full":
        return (np.arange(weights.size),)
    if structure == "layer":
        return tuple(np.sort(np.concatenate(list(layer))) for layer in weights.neurons)
    return tuple(neuron for layer in weights.neurons for neuron in layer)


def _checked(structure: str, weights: Layered, blocks: Sequence[Indices]) -> tuple[Indices, ...]:
    """Blocks in rising order, refused unless they hold each weight once."""
    found = tuple(np.sort(np.asarray(block, np.int64)) for block in blocks)
    every = np.sort(np.concatenate(found)) if found else np.empty(0, np.int64)
    if not np.array_equal(every, np.arange(weights.size)):
        expected = f"each of {weights.size} weights in one block"
        raise ParameterError(f"blocks of {structure!r}", expected, every.tolist())
    return found
