"""What a learner remembers of how its weights vary together: all of it, or parts.

Full: every pair of weights. Layer: pairs within a layer. Node: pairs within a neuron, its
bias included. Low rank: the inverse of a diagonal plus a product of few columns. After each
sample the covariance of the filter over all weights is found and what the structure keeps
of it is kept. Neglected: structure chosen by what the samples excite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from patagium.errors import ParameterError

Indices = NDArray[np.int64]
BLOCKS = ("full", "layer", "node")


@dataclass(frozen=True)
class LowRank:
    """A covariance whose inverse is a diagonal plus a product of few columns.

    P^-1 = diag(U) + F F', F (n, rank): the directions learned best, and for the rest each
    weight by itself. Memory of n (rank + 1) numbers.

    Args:
        rank: Number of columns.

    Raises:
        ParameterError: If it is not a positive integer.
    """

    rank: int

    def __post_init__(self) -> None:
        if not isinstance(self.rank, int) or self.rank < 1:
            raise ParameterError("rank", "a positive integer", self.rank)


Structure = Literal["full", "layer", "node"] | LowRank


def checked_structure(value: object) -> Structure:
    """A structure as it is.

    Raises:
        ParameterError: If it is none.
    """
    if isinstance(value, LowRank) or value in BLOCKS:
        return value  # type: ignore[return-value]
    raise ParameterError("covariance", '"full", "layer", "node" or LowRank(rank)', value)


def described_structure(structure: Structure) -> Any:
    """A structure as a JSON-able value."""
    return {"rank": structure.rank} if isinstance(structure, LowRank) else structure


def structure_from(description: object) -> Structure:
    """Inverse of `described_structure`.

    Raises:
        ParameterError: If it describes none.
    """
    if isinstance(description, dict) and set(description) == {"rank"}:
        return LowRank(description["rank"])
    return checked_structure(description)


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
