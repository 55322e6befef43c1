"""Networks that are one shared perceptron between an encoder and a linear readout.

    y = offset + readout(x) . vec(mlp(features(x); W))

The physics is in the encoder and in the readout, which depend on x alone; only the perceptron
has weights. It is evaluated for m items (the strips of a wing, or one), all with the same
weights.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from patagium.learning.models.mlp import Perceptron
from patagium.learning.models.network import Encoding, Network
from patagium.learning.models.structure import Indices

Array = NDArray[np.float64]


class PerceptronNetwork(Network):
    """A network that gives its perceptron, encoder and description; the rest follows.

    Compiled filters evaluate the perceptron themselves: values and slopes are as they are here.
    """

    @property
    @abstractmethod
    def items(self) -> int:
        """Number of evaluations of the perceptron for one x, m."""
        ...

    @property
    @abstractmethod
    def offset(self) -> Array:
        """Added to y, (n_y,)."""
        ...

    @property
    @abstractmethod
    def perceptron(self) -> Perceptron:
        """The part with weights."""
        ...

    def compiled_encoder(self) -> tuple[int, Array] | None:
        """Address of a C function that encodes one sample, and its constants; None without.

        `void f(const double *const *arg, double *const *res)`, arg: x, constants;
        res: features (m, n_in), transposed readout (m n_out, n_y), both row by row.
        """
        return None

    @property
    def size(self) -> int:
        """Number of weights, n."""
        return self.perceptron.size

    @property
    def neurons(self) -> tuple[tuple[Indices, ...], ...]:
        """Weights of each neuron, its bias last, layer by layer."""
        return self.perceptron.neurons

    @property
    def hidden(self) -> tuple[int, ...]:
        """Neurons of each hidden layer."""
        return self.perceptron.widths[1:-1]

    @property
    def fan_in(self) -> Array:
        """Fan-in of the neuron of each weight, 1 for a bias, (n,)."""
        return self.perceptron.fan_in

    def initial(self, seed: int) -> Array:
        """Weights to start from: standard normal over sqrt(fan-in), (n,).

        Args:
            seed: Seed of the draw.
        """
        normal = np.random.default_rng(seed).standard_normal(self.size)
        return np.asarray(normal / np.sqrt(self.fan_in))

    def decode(self, encoding: Encoding, weights: Array) -> Array:
        """y of N encoded samples at weights (n,), (N, n_y)."""
        out = self.perceptron.forward(encoding.features, weights)
        flat = out.reshape(len(out), encoding.readout.shape[-1])
        if encoding.readout.strides[0] == 0:  # the same for all samples
            return np.asarray(encoding.offset + flat @ encoding.readout[0].T)
        return np.asarray(encoding.offset + (encoding.readout @ flat[:, :, None])[:, :, 0])

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at weights (p, n), (p, n_y)."""
        out = self.perceptron.forward(encoding.features.astype(points.dtype)[None], points)
        flat = out.astype(float).reshape(len(points), -1)
        return np.asarray(flat @ encoding.readout.T + encoding.offset)

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (n_y,), and its derivative for weights (n,), (n_y, n)."""
        out, inner = self.perceptron.linearized(encoding.features, weights)
        y = encoding.offset + encoding.readout @ out.ravel()
        return np.asarray(y), np.asarray(encoding.readout @ inner.reshape(-1, self.size))


class Evaluated(Network, Protocol):
    """A network that ends in one perceptron, evaluated for m items, and a linear readout."""

    @property
    def items(self) -> int:
        """Number of evaluations of the perceptron for one x, m."""
        ...

    @property
    def perceptron(self) -> Perceptron:
        """The part at the end of the weights."""
        ...


def evaluated(network: Network) -> Evaluated:
    """A network of which filters know that it ends in a perceptron."""
    return cast("Evaluated", network)


def as_perceptron(network: Network) -> PerceptronNetwork:
    """A network of which filters have asked before whether it is one.

    Raises:
        TypeError: If it is not.
    """
    if not isinstance(network, PerceptronNetwork):
        raise TypeError(f"expected a PerceptronNetwork, found {type(network).__name__}")
    return network
