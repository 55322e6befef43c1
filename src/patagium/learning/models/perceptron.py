"""A multilayer perceptron as arithmetic, and networks that are one between encoder and readout.

    y = offset + readout(x) . vec(mlp(features(x); W))

The physics is in the encoder and in the readout, which depend on x alone; only the perceptron
has weights. It is evaluated for m items (the strips of a wing, or one), all with the same
weights. All hidden layers share one activation, the last layer is linear. Weights are one
vector: for every layer W (out, in) row by row, then b (out). The readable twin of the compiled
kernel `cubature.c`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.special import expit

from patagium.arguments import checked
from patagium.arrays import Array, Indices
from patagium.errors import ParameterError, check_names, plain
from patagium.learning.models.network import Encoding, Network
from patagium.limits import WIDEST


def softplus(z: Array) -> Array:
    """Smooth ramp ln(1 + e^z), without overflow."""
    return np.maximum(z, 0) + np.log1p(np.exp(-np.abs(z)))


ACTIVATIONS: dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array]]] = {
    "softplus": (softplus, expit),
    "tanh": (np.tanh, lambda z: 1.0 - np.tanh(z) ** 2),
}
"""Name of an activation to the function and its derivative."""


@dataclass(frozen=True)
class Perceptron:
    """Dense layers with one activation, the last one linear.

    Args:
        widths: Number of inputs, of neurons of each hidden layer, of outputs.
        activation: "softplus" or "tanh".

    Raises:
        ParameterError: If a width is not a positive integer or the activation unknown.
    """

    widths: tuple[int, ...]
    activation: str = "softplus"

    def __post_init__(self) -> None:
        widths = tuple(map(plain, self.widths))
        if len(widths) < 2 or any(not isinstance(w, int) or not 0 < w <= WIDEST for w in widths):
            expected = f"two or more positive integers of at most {WIDEST}"
            raise ParameterError("widths", expected, self.widths)
        check_names("activation", [self.activation], ACTIVATIONS)
        object.__setattr__(self, "widths", widths)

    @property
    def size(self) -> int:
        """Number of weights."""
        return sum((below + 1) * above for below, above in pairwise(self.widths))

    @property
    def fan_in(self) -> Array:
        """Fan-in of the neuron of each weight, 1 for a bias, (size,)."""
        layers = [((below, 1.0), (below * above, above)) for below, above in pairwise(self.widths)]
        return np.concatenate([np.repeat(*layer) for layer in layers])

    @property
    def neurons(self) -> tuple[tuple[Indices, ...], ...]:
        """Weights of each neuron, its bias last, layer by layer, (below + 1,) each."""
        places: Any = np.arange(self.size)
        return tuple(tuple(np.column_stack([matrix, bias])) for matrix, bias in self.layers(places))

    def forward(self, features: Array, weights: Array) -> Array:
        """Outputs for many inputs.

        Args:
            features: Inputs, (..., n_in).
            weights: (size,), or (p, size) beside features (p or 1, m, n_in): each row of
                weights evaluates its own or the common m inputs.

        Returns:
            (..., n_out), or (p, m, n_out).
        """
        function = ACTIVATIONS[self.activation][0]
        z = features
        for number, (matrix, bias) in enumerate(self.layers(weights)):
            z = function(z) if number else z
            z = z @ np.swapaxes(matrix, -1, -2) + (bias if weights.ndim == 1 else bias[:, None])
        return z

    def linearized(self, features: Array, weights: Array) -> tuple[Array, Array]:
        """Outputs and their derivative for the weights, by reverse accumulation.

        For every input and every output at once the seed d out / d z goes back through
        the layers; dz_l/dW_l is the outer product of the seed with the layer's input.

        Args:
            features: Inputs, (m, n_in) [1].
            weights: (size,).

        Returns:
            (m, n_out), and (m, n_out, size).
        """
        function, slope = ACTIVATIONS[self.activation]
        layers, inputs, sums = list(self.layers(weights)), [features], list[Array]()
        for matrix, bias in layers:
            sums.append(inputs[-1] @ matrix.T + bias)
            inputs.append(function(sums[-1]))
        items, outputs = len(features), self.widths[-1]
        seed = np.broadcast_to(np.eye(outputs), (items, outputs, outputs))
        parts: list[Array] = []
        for number in reversed(range(len(layers))):
            outer = seed[..., :, None] * inputs[number][:, None, None, :]
            parts[:0] = [outer.reshape(items, outputs, -1), seed]
            if number:
                seed = (seed @ layers[number][0]) * slope(sums[number - 1])[:, None, :]
        return sums[-1], np.concatenate(parts, axis=-1)

    def layers(self, weights: Array) -> Iterator[tuple[Array, Array]]:
        """Matrix, (..., above, below), and bias, (..., above), of each layer.

        Args:
            weights: Weights, (..., n) [1].
        """
        start, leading = 0, weights.shape[:-1]
        for below, above in pairwise(self.widths):
            middle = start + below * above
            end = start + (below + 1) * above
            yield (
                weights[..., start:middle].reshape(*leading, above, below),
                weights[..., middle:end],
            )
            start = end


class PerceptronNetwork(Network):
    """A network that gives its perceptron, encoder and description; the rest follows.

    Compiled filters evaluate the perceptron themselves: values and slopes are as they are here.

    Attributes:
        perceptron: The part with weights.
        items: Number of evaluations of the perceptron for one x, m.
        offset: Added to y, (n_y,) [unit of y].
    """

    perceptron: Perceptron
    items: int = 1
    offset: Array
    _names: tuple[str, ...]

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the components of y."""
        return self._names

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

    @checked
    def initial(self, seed: int) -> Array:
        """Weights to start from: standard normal over sqrt(fan-in), (n,)."""
        normal = np.random.default_rng(seed).standard_normal(self.size)
        return normal / np.sqrt(self.fan_in)

    def decode(self, encoding: Encoding, weights: Array) -> Array:
        """y of N encoded samples at weights (n,), (N, n_y)."""
        out = self.perceptron.forward(encoding.features, weights)
        flat = out.reshape(len(out), encoding.readout.shape[-1])
        if encoding.readout.strides[0] == 0:  # the same for all samples
            return np.asarray(encoding.offset + flat @ encoding.readout[0].T)
        return encoding.offset + (encoding.readout @ flat[:, :, None])[:, :, 0]

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at weights (p, n), (p, n_y)."""
        out = self.perceptron.forward(encoding.features.astype(points.dtype)[None], points)
        flat = out.astype(float).reshape(len(points), -1)
        return flat @ encoding.readout.T + encoding.offset

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (n_y,), and its derivative for weights (n,), (n_y, n)."""
        out, inner = self.perceptron.linearized(encoding.features, weights)
        y = encoding.offset + encoding.readout @ out.ravel()
        return np.asarray(y), encoding.readout @ inner.reshape(-1, self.size)


def as_perceptron(network: Network) -> PerceptronNetwork:
    """A network of which filters have asked before whether it is one.

    Raises:
        TypeError: If it is not.
    """
    if not isinstance(network, PerceptronNetwork):
        raise TypeError(f"expected a PerceptronNetwork, found {type(network).__name__}")
    return network
