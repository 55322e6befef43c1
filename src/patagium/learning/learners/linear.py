"""Recursive least squares, linear or on random features: the anchor every network must beat.

y = offset + scale (B f(x)), f the scaled inputs and 1, or random softplus features of
them and 1; one covariance of the rows of B serves all outputs. Neglected: different
noise of the outputs; they are weighed alike, each in its own scale. The covariance takes a
channel that is left out for measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from patagium.arguments import checked
from patagium.arrays import Array, Bools
from patagium.errors import Outcome
from patagium.learning.filters.numbers import PRIOR
from patagium.learning.filters.screening import Screen
from patagium.learning.filters.state import packed, symmetric, unpacked, vector
from patagium.learning.filters.weight_covariance import BlockCovariance, block_covariance
from patagium.learning.learners.learner import OnlineLearner, as_input, diverged, found_part
from patagium.learning.models.dense import DenseNetwork, LinearNetwork
from patagium.learning.models.network import scale_of
from patagium.learning.settings import (
    FilterSettings,
    LinearSettings,
    NoiseEstimation,
    Numbers,
    chosen_settings,
)


class LinearLearner(OnlineLearner):
    """Recursive least squares with forgetting.

    With f the features, all outputs in their scales and r their deviation:
    P <- P / forgetting_factor, k = P f / (r^2 + f'P f), B' <- B' + k (y - B f)',
    P <- P - k f'P. The covariance of the features' weights is the same for every output,
    so an update costs of order n_f^2 and n_f n_y.

    Args:
        network: A DenseNetwork without hidden layers: inputs, outputs and their scales.
        settings: Record of settings; None: the defaults. Single settings override it by name.
            The mean of measurement_std over the outputs, in their scales, weighs all of them.
        seed: Seed of the features.
        **given: Settings by name, which override the record.

    Raises:
        ParameterError: If a number is out of its range.
        ShapeError: If a deviation has another shape.

    References:
        Ljung (1999), System Identification, section 11.2.
    """

    _network: LinearNetwork

    @checked
    def __init__(
        self,
        network: DenseNetwork,
        settings: LinearSettings | None = None,
        *,
        seed: int = 0,
        **given: Any,
    ) -> None:
        chosen: LinearSettings = chosen_settings("linear", settings, given)
        self.settings = chosen
        super().__init__(LinearNetwork(network, chosen.features, seed))
        self._prior = PRIOR if chosen.prior_std is None else float(np.asarray(chosen.prior_std))
        self._forgetting = float(chosen.forgetting_factor)
        count = self._network.perceptron.widths[0] + 1
        self._slopes = np.zeros((count, network.outputs))
        self._spread = np.eye(count) * self._prior**2
        self._screen = _screen(network, chosen.measurement_std)

    @property
    def network(self) -> LinearNetwork:
        """The features and their readout."""
        return self._network

    @property
    def weights(self) -> Array:
        """The estimate, (n,): B row by row, then the constants."""
        return np.concatenate([self._slopes[:-1].T.ravel(), self._slopes[-1]])

    @property
    def covariance(self) -> Array:
        """Covariance of the weights, (n, n): that of the features' for every output."""
        return self.kept_covariance().dense(most=self._network.size)

    @property
    def variances(self) -> Array:
        """Diagonal of that covariance, (n,)."""
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
        std, chosen = self.measurement_std.tolist(), self.settings
        given = {
            "kind": "linear",
            "network": self._network.describe(),
            "prior_std": None if chosen.prior_std is None else self._prior,
            "measurement_std": None if chosen.measurement_std is None else std,
            "forgetting_factor": self._forgetting,
        }
        return given | found_part(self.found)

    @property
    def found(self) -> dict[str, Any]:
        """Settings that nobody gave, by name: what the rules or the samples so far say."""
        found: dict[str, Any] = {} if self.settings.prior_std is not None else {"prior_std": PRIOR}
        if self.settings.measurement_std is None and np.isfinite(self.measurement_std).all():
            found["measurement_std"] = self.measurement_std.tolist()
        return found

    @property
    def measurement_std(self) -> Array:
        """Standard deviation of the measurement, as given or estimated so far, (n_y,) [y].

        NaN before the first sample where nobody gave it.
        """
        return np.sqrt(self._screen.variances)

    def kept_covariance(self) -> BlockCovariance:
        """The covariance by outputs, each that of the features' weights."""
        parts = [self._spread] * self._network.outputs
        return block_covariance(self._network, "node", parts)

    def _estimate(self) -> dict[str, Any]:
        return {"slopes": self._slopes, "spread": packed([self._spread])}

    def _place(self, state: Mapping[str, Any]) -> None:
        slopes = vector(state, "slopes", *self._slopes.shape)
        (lower,) = unpacked(np.asarray(state["spread"], float), [len(slopes)])
        self._slopes, self._spread = slopes, symmetric(lower)

    def _features(self, x: Array) -> Array:
        return np.append(self._network.encode_one(x).features[0], 1.0)


def _screen(network: DenseNetwork, std: Numbers | None) -> Screen:
    """Screening with the noise that is given, or that is found from the samples."""
    if std is not None:
        return Screen(scale_of("measurement_std", std, network.outputs) ** 2, network)
    watched = FilterSettings(noise_estimation=NoiseEstimation())
    return Screen(np.full(network.outputs, np.nan), network, watched, network.output_center)
