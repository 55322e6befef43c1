"""Recursive least squares, linear or on random features: the anchor every network must beat.

y = offset + scale (B f(x)), f the scaled inputs and 1, or random softplus features of
them and 1; one covariance of the rows of B serves all outputs. Neglected: different
noise of the outputs; they are weighed alike, each in its own scale. The covariance takes a
channel that is left out for measured.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, Bools
from patagium.errors import Outcome, ParameterError
from patagium.learning.filters.numbers import PRIOR
from patagium.learning.filters.screening import Screen
from patagium.learning.filters.weight_covariance import BlockCovariance, block_covariance
from patagium.learning.learners.learner import as_input, diverged, found_part
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.network import scale_of
from patagium.learning.models.perceptron import softplus
from patagium.learning.settings import FilterSettings, NoiseEstimation
from patagium_lab.rivals.rival_learner import RivalLearner


class LinearNetwork(DenseNetwork):
    """Linear readout of fixed random softplus features of the scaled inputs.

    Args:
        base: Network without hidden layers: inputs, outputs and their scales.
        features: Number of random features; 0: the scaled inputs themselves.
        seed: Seed of the features.

    Raises:
        ParameterError: If `base` has hidden layers.
    """

    kind = "linear"

    def __init__(self, base: DenseNetwork, features: int = 0, seed: int = 0) -> None:
        if len(base.perceptron.widths) != 2:
            raise ParameterError("network", "a DenseNetwork without hidden layers", base)
        super().__init__(
            features or base.inputs,
            (),
            base.output_names,
            output_center=base.output_center,
            output_scale=base.output_scale,
        )
        self.inputs_jump = base.inputs_jump
        self._base = base
        self._features = features
        self._seed = seed
        draw = np.random.default_rng(seed)
        self._mixing = draw.standard_normal((base.inputs, features)) * np.sqrt(2 / base.inputs)
        self._bias = draw.standard_normal(features)

    @property
    def inputs(self) -> int:
        """Length of x, n_x."""
        return self._base.inputs

    def compiled_encoder(self) -> None:
        """None: random features are made in NumPy."""

    def initial(self, seed: int) -> Array:
        """Zero weights: least squares needs no start, (n,) [1]."""
        return np.zeros(self.size)

    def describe(self) -> dict[str, Any]:
        """Description of the network as JSON-able values."""
        base = self._base.describe()
        return {**base, "kind": self.kind, "features": self._features, "seed": self._seed}

    def _seen(self, x: Array) -> Array:
        """Random features of the scaled inputs, or these themselves, (N, n_f)."""
        scaled = (x - self._base.input_center) / self._base.input_scale
        return softplus(scaled @ self._mixing + self._bias) if self._features else scaled


class LinearLearner(RivalLearner):
    """Recursive least squares with forgetting.

    With f the features, all outputs in their scales and r their deviation:
    P <- P / forgetting_factor, k = P f / (r^2 + f'P f), B' <- B' + k (y - B f)',
    P <- P - k f'P. The covariance of the features' weights is the same for every output,
    so an update costs of order n_f^2 and n_f n_y.

    Args:
        network: A DenseNetwork without hidden layers: inputs, outputs and their scales.
        prior_std: Standard deviation of each weight before any sample [1]; None: 1.
        measurement_std: Standard deviation of the measurement noise, one number or (n_y,) [unit
            of y], of which the mean over the outputs, in their scales, weighs all of them; None:
            found from the samples.
        forgetting_factor: Factor that divides the covariance before each sample, above 0 and at
            most 1.
        features: Number of random softplus features; 0: linear in the inputs.
        seed: Seed of the features.

    Raises:
        ParameterError: If the network has hidden layers, or a deviation is not positive.
        ShapeError: If a deviation has another shape.

    References:
        Ljung (1999), System Identification, section 11.2.
    """

    _network: LinearNetwork

    def __init__(
        self,
        network: DenseNetwork,
        *,
        prior_std: float | None = None,
        measurement_std: ArrayLike | None = None,
        forgetting_factor: float = 1.0,
        features: int = 0,
        seed: int = 0,
    ) -> None:
        super().__init__(LinearNetwork(network, features, seed), _screen(network, measurement_std))
        self._given = {"prior_std": prior_std, "measurement_std": measurement_std}
        self._prior = PRIOR if prior_std is None else prior_std
        self._forgetting = forgetting_factor
        count = self._network.perceptron.widths[0] + 1
        self._slopes = np.zeros((count, network.outputs))
        self._spread = np.eye(count) * self._prior**2

    @property
    def weights(self) -> Array:
        """The estimate, (n,) [1]: B row by row, then the constants."""
        return np.concatenate([self._slopes[:-1].T.ravel(), self._slopes[-1]])

    @property
    def covariance(self) -> Array:
        """Covariance of the weights, (n, n) [1]: that of the features' for every output."""
        return self.kept_covariance().dense(most=self._network.size)

    @property
    def variances(self) -> Array:
        """Diagonal of that covariance, (n,) [1]."""
        return self.kept_covariance().variances()

    def predict(self, x: ArrayLike) -> tuple[Array, Array]:
        """Measurement at x before it is made.

        Args:
            x: Input, (n_x,) [units of x].

        Returns:
            Mean, (n_y,), and covariance with the noise of the measurement, (n_y, n_y).

        Raises:
            ShapeError: If x has another shape.
        """
        features = self._features(as_input(self._network, x))
        scale = self._network.output_scale
        spread = float(features @ self._spread @ features) / self._forgetting
        mean = self._network.output_center + scale * (features @ self._slopes)
        return mean, np.diag(spread * scale**2 + self._screen.noise(np.diag(scale)))

    def _learn(self, x: Array, y: Array, kept: Bools) -> Array:
        features, scale = self._features(x), self._network.output_scale
        noise = self._screen.noise(np.diag(scale))
        variance = float(np.mean((noise**0.5 / scale) ** 2))
        spread = self._spread / self._forgetting
        cross = spread @ features
        seen = float(features @ cross)
        total = variance + seen
        error = (y - self._network.output_center) / scale - features @ self._slopes
        slopes = self._slopes + np.outer(cross / total, np.where(kept, error, 0.0))
        smaller = spread - np.outer(cross, cross / total)
        if not np.isfinite(slopes).all() or not np.isfinite(total):
            raise diverged(Outcome.NOT_FINITE, self.count, x, y)
        if total <= variance / 2 or not (np.diagonal(smaller) > 0).all():
            raise diverged(Outcome.COVARIANCE_LOST, self.count, x, y)
        self._slopes, self._spread = slopes, (smaller + smaller.T) / 2
        innovation = np.asarray(error * scale)
        self._screen.marks["left_out"][:] = ~kept
        expected = seen * scale**2 + noise
        gain = np.where(kept, innovation, 0.0) / expected
        mean = y - innovation
        self._screen.learned(mean, innovation, gain, 1 / expected, float("nan"))
        return innovation

    def describe(self) -> dict[str, Any]:
        """Kind, network and settings of the learner as JSON values, without the weights."""
        std = self._given["measurement_std"]
        given = {
            "kind": "linear",
            "network": self._network.describe(),
            "prior_std": self._given["prior_std"],
            "measurement_std": None if std is None else self.measurement_std.tolist(),
            "forgetting_factor": self._forgetting,
        }
        return given | found_part(self.found)

    @property
    def found(self) -> dict[str, Any]:
        """Settings that nobody gave, by name: what the rules or the samples so far say."""
        found: dict[str, Any] = {} if self._given["prior_std"] is not None else {"prior_std": PRIOR}
        if self._given["measurement_std"] is None and np.isfinite(self.measurement_std).all():
            found["measurement_std"] = self.measurement_std.tolist()
        return found

    @property
    def measurement_std(self) -> Array:
        """Standard deviation of the measurement, given or estimated, (n_y,) [unit of y].

        NaN before the first sample where nobody gave it.
        """
        return np.sqrt(self._screen.variances)

    def kept_covariance(self) -> BlockCovariance:
        """Covariance by outputs, each that of the features' weights."""
        parts = [self._spread] * self._network.outputs
        return block_covariance(self._network, "node", parts)

    def _features(self, x: Array) -> Array:
        return np.append(self._network.encode_one(x).features[0], 1.0)


def _screen(network: DenseNetwork, std: ArrayLike | None) -> Screen:
    """Screening with the noise that is given, or that is found from the samples."""
    if std is not None:
        return Screen(scale_of("measurement_std", std, network.outputs) ** 2, network)
    watched = FilterSettings(noise_estimation=NoiseEstimation())
    return Screen(np.full(network.outputs, np.nan), network, watched, network.output_center)
