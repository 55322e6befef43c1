"""What every network has in common: encoder, shared perceptron, linear readout.

    y = offset + readout(x) . vec(mlp(features(x); W))

Physics sits in the encoder and in the readout, which depend on x alone; only the
perceptron holds weights. It is evaluated for m items (the strips of a wing, or one),
so that what holds for one item holds for all. y depends on the present x only; a network
with memory has it in x, see `remember`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ParameterError, ShapeError
from patagium.identification.mlp import Perceptron

Array = NDArray[np.float64]
_BLOCK = 4096  # samples evaluated at once: bounds the memory, keeps the caches warm


class Encoding(NamedTuple):
    """What a network's weights see of N samples, or of one (no leading axis).

    Attributes:
        features: Inputs of the perceptron, ([N,] m, n_in).
        readout: From its outputs to y, ([N,] n_y, m n_out).
        offset: Added to y, (n_y,).
    """

    features: Array
    readout: Array
    offset: Array


class Network(Protocol):
    """A function of x with weights to learn.

    A network gives its perceptron, encoder and description; the rest follows.
    """

    @property
    def inputs(self) -> int:
        """Length of x, n_x."""
        ...

    @property
    def items(self) -> int:
        """How often the perceptron is evaluated for one x, m."""
        ...

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the components of y."""
        ...

    @property
    def offset(self) -> Array:
        """Added to y, (n_y,)."""
        ...

    @property
    def perceptron(self) -> Perceptron:
        """The part with weights."""
        ...

    def encode(self, x: Array) -> Encoding:
        """Features and readout of many samples, x (N, n_x)."""
        ...

    def encode_one(self, x: Array) -> Encoding:
        """The same of one sample, x (n_x,), with as little overhead as possible."""
        ...

    def compiled_encoder(self) -> tuple[int, Array] | None:
        """Address of a C function that encodes one sample, and its constants; None without.

        `void f(const double *const *arg, double *const *res)`, arg: x, constants;
        res: features (m, n_in), transposed readout (m n_out, n_y), both row by row.
        """
        return None

    def remember(self, time: ArrayLike, x: Array, gaps: ArrayLike = ()) -> Array:
        """Inputs of a log with what the network remembers at each sample, (N, n_x).

        Sample k depends on samples up to k alone, and on no weights. Without memory: x.

        Args:
            time: Increasing, (N,) [s].
            x: What is measured of the inputs, (N, ...).
            gaps: First sample after each gap, where memory begins anew.
        """
        return x

    def describe(self) -> dict[str, Any]:
        """Everything needed to make the network again, as JSON-able values."""
        ...

    @property
    def outputs(self) -> int:
        """Length of y, n_y."""
        return len(self.output_names)

    @property
    def size(self) -> int:
        """Number of weights, n."""
        return self.perceptron.size

    @property
    def fan_in(self) -> Array:
        """How many inputs the neuron of each weight sums, 1 for a bias, (n,)."""
        return self.perceptron.fan_in

    def initial(self, seed: int) -> Array:
        """Weights to start from: standard normal over sqrt(fan-in), (n,).

        Args:
            seed: Seed of the draw.
        """
        normal = np.random.default_rng(seed).standard_normal(self.size)
        return np.asarray(normal / np.sqrt(self.fan_in))

    def __call__(self, x: ArrayLike, weights: ArrayLike) -> Array:
        """y of one x, (n_y,) in the unit of y.

        Args:
            x: Input, (n_x,).
            weights: (n,).

        Raises:
            ShapeError: If an argument has another shape.
        """
        sample = np.asarray(x, float)
        if sample.shape != (self.inputs,):
            raise ShapeError("x", (self.inputs,), sample.shape)
        return np.asarray(self.evaluate(sample[None], weights)[0])

    def evaluate(self, x: ArrayLike, weights: ArrayLike) -> Array:
        """y of many x, (N, n_y) in the unit of y.

        Args:
            x: Inputs, (N, n_x).
            weights: (n,).

        Raises:
            ShapeError: If an argument has another shape.
        """
        samples, w = np.asarray(x, float), np.asarray(weights, float)
        if samples.ndim != 2 or samples.shape[1] != self.inputs:
            raise ShapeError("x", ("N", self.inputs), samples.shape)
        if w.shape != (self.size,):
            raise ShapeError("weights", (self.size,), w.shape)
        y = np.empty((len(samples), self.outputs))
        for start in range(0, len(samples), _BLOCK):
            part = slice(start, start + _BLOCK)
            y[part] = self.decode(self.encode(samples[part]), w)
        return y

    def decode(self, encoding: Encoding, weights: Array) -> Array:
        """y of samples encoded before, (N, n_y).

        Args:
            encoding: Of N samples.
            weights: (n,).
        """
        out = self.perceptron.forward(encoding.features, weights)
        flat = out.reshape(len(out), encoding.readout.shape[-1])
        if encoding.readout.strides[0] == 0:  # the same for all samples
            return np.asarray(encoding.offset + flat @ encoding.readout[0].T)
        return np.asarray(encoding.offset + (encoding.readout @ flat[:, :, None])[:, :, 0])

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (n_y,), and its derivative for the weights, (n_y, n).

        Args:
            encoding: Of one sample.
            weights: (n,).
        """
        out, inner = self.perceptron.linearized(encoding.features, weights)
        y = encoding.offset + encoding.readout @ out.ravel()
        return np.asarray(y), np.asarray(encoding.readout @ inner.reshape(-1, self.size))


def network_from_description(description: Mapping[str, Any]) -> Network:
    """The network of `describe()`.

    Raises:
        ParameterError: If its kind is unknown.
    """
    from patagium.identification.dense import DenseNetwork
    from patagium.identification.flow import FlowNetwork
    from patagium.identification.hidden import HiddenStripNetwork
    from patagium.identification.linear import LinearNetwork
    from patagium.identification.strip import StripNetwork

    known = (DenseNetwork, FlowNetwork, HiddenStripNetwork, LinearNetwork, StripNetwork)
    kinds = {kind.kind: kind for kind in known}
    kind = kinds.get(str(description.get("kind")))
    if kind is None:
        raise ParameterError("network", f"of kind {', '.join(kinds)}", description.get("kind"))
    return kind.from_description(description)
