"""What every network has in common: encoding, values, slopes, memory.

A network is a function y(x; W) that learners meet by its values at weights and its slopes
for them. Most are one perceptron between an encoder and a readout that know the physics
(`perceptron_network`); others compute y as they like.

A network may remember. Its memory z follows the samples of a log and may depend on the
weights, so it is recalled at the weights known by then, block by block between updates:

    x_full, carried = network.recall(W, time, x, carried),
    ... predict and update at x_full, W becomes W' ...
    carried = network.corrected(carried, W' - W).

x_full is [x, z, vec S, W_m] with S = dz/dW_m for those weights W_m that memory depends on:
what y is there at other weights follows from z + S (W - W_m). Without noise of its own on z
this is the joint filter of W and z, whose covariance with W is S P. Neglected there: noise
added to W between samples, which the joint filter would not pass on to z at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ParameterError, ShapeError
from patagium.learning.models.physical import Estimate
from patagium.learning.models.structure import Indices

Array = NDArray[np.float64]
_BLOCK = 4096  # samples evaluated at once: bounds the memory, keeps the caches warm

Carried: TypeAlias = Any
"""What a network takes from one block of a log to the next; its own affair. None: nothing."""


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


class Memory(NamedTuple):
    """What a network remembers at a sample, to go on from.

    Attributes:
        time: Of the sample [s].
        x: What was measured there, (n_measured,).
        state: z, (n_z,).
        slopes: S = dz/dW_m, (n_z, n_m).
        weights: W_m that z was found at, (n_m,).
    """

    time: float
    x: Array
    state: Array
    slopes: Array
    weights: Array

    def moved(self, change: Array) -> Memory:
        """The same at other weights: z + S dW_m.

        Args:
            change: dW_m, (n_m,).
        """
        state = self.state + self.slopes @ change
        return self._replace(state=state, weights=self.weights + change)


class Network(Protocol):
    """A function of x with weights to learn.

    A network gives its size, encoding, values, slopes and description; the rest follows.
    """

    @property
    def inputs(self) -> int:
        """Length of x, n_x, all that is remembered included."""
        ...

    @property
    def measured_inputs(self) -> int:
        """How much of x is measured, from the front; the rest is recalled."""
        return self.inputs

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the components of y."""
        ...

    @property
    def outputs(self) -> int:
        """Length of y, n_y."""
        return len(self.output_names)

    @property
    def size(self) -> int:
        """Number of weights, n."""
        ...

    @property
    def neurons(self) -> Sequence[Sequence[Indices]]:
        """Weights of each neuron in rising order, layer by layer."""
        ...

    @property
    def hidden(self) -> tuple[int, ...]:
        """Neurons of each hidden layer."""
        ...

    @property
    def fan_in(self) -> Array:
        """How many inputs the neuron of each weight sums, 1 for a bias, (n,)."""
        ...

    @property
    def own_prior(self) -> Array:
        """Deviations of weights before any sample that the network knows itself, (n,).

        nan, as for all by default, where that is left to the learner.
        """
        return np.full(self.size, np.nan)

    @property
    def needs_acceleration(self) -> bool:
        """Whether of a flight's samples x is [q, v, a], and not [q, v]."""
        return False

    @property
    def explains_added_mass(self) -> bool:
        """Whether of a flight's samples y holds the force of the air carried along."""
        return False

    def initial(self, seed: int) -> Array:
        """Weights to start from, (n,).

        Args:
            seed: Seed of the draw.
        """
        ...

    def encode(self, x: Array) -> Encoding:
        """What many samples show to the weights, x (N, n_x)."""
        ...

    def encode_one(self, x: Array) -> Encoding:
        """The same of one sample, x (n_x,), with as little overhead as possible."""
        ...

    def decode(self, encoding: Encoding, weights: Array) -> Array:
        """y of samples encoded before, (N, n_y).

        Args:
            encoding: Of N samples.
            weights: (n,).
        """
        ...

    def values(self, encoding: Encoding, points: Array) -> Array:
        """y of one encoded sample at many weights, (p, n_y), computed in their precision.

        Args:
            encoding: Of one sample.
            points: (p, n).
        """
        ...

    def linearized(self, encoding: Encoding, weights: Array) -> tuple[Array, Array]:
        """y at one encoded sample, (n_y,), and its derivative for the weights, (n_y, n).

        Args:
            encoding: Of one sample.
            weights: (n,).
        """
        ...

    def recall(
        self,
        weights: Array,
        time: ArrayLike,
        x: Array,
        carried: Carried = None,
        gaps: ArrayLike = (),
    ) -> tuple[Array, Carried]:
        """Inputs of a block of samples with what the network remembers at each.

        Sample k depends on samples up to k alone. Without memory: x, and nothing to carry.

        Args:
            weights: That hold over the block, (n,).
            time: Increasing, (N,) [s].
            x: What is measured of the inputs, (N, n_measured).
            carried: What the block before left, of the sample just before the first;
                None where the first begins a memory.
            gaps: First sample after each gap, where memory begins anew.

        Returns:
            (N, n_x), and what the next block goes on from.
        """
        return x, None

    def corrected(self, carried: Carried, change: Array) -> Carried:
        """What is carried, after an update of the weights.

        Args:
            carried: As `recall` left it.
            change: By which the weights moved, (n,).
        """
        return carried

    def estimates(self, weights: Array, variances: Array | None = None) -> tuple[Estimate, ...]:
        """Physical parameters among the weights, with their deviations; none by default.

        Args:
            weights: (n,).
            variances: Of the weights, (n,); None: not known.
        """
        return ()

    def describe(self) -> dict[str, Any]:
        """Everything needed to make the network again, as JSON-able values."""
        ...

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


def network_from_description(description: Mapping[str, Any]) -> Network:
    """The network of `describe()`.

    Raises:
        ParameterError: If its kind is unknown.
    """
    from patagium.learning.models.dense import DenseNetwork
    from patagium.learning.models.flow import FlowNetwork
    from patagium.learning.models.grey_box import GreyBox
    from patagium.learning.models.hidden import HiddenStripNetwork
    from patagium.learning.models.hidden_flow import HiddenFlowNetwork
    from patagium.learning.models.linear import LinearNetwork
    from patagium.learning.models.strip import StripNetwork

    dense, strips = (DenseNetwork, LinearNetwork), (StripNetwork, HiddenStripNetwork)
    others = (FlowNetwork, HiddenFlowNetwork, GreyBox)
    kinds: dict[str, Any] = {kind.kind: kind for kind in (*dense, *strips, *others)}
    kind = kinds.get(str(description.get("kind")))
    if kind is None:
        raise ParameterError("network", f"of kind {', '.join(kinds)}", description.get("kind"))
    network: Network = kind.from_description(description)
    return network
