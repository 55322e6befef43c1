"""Numbers of a filter: what follows from its settings for the weights of one network.

Between two samples P <- (1 - s) P / forgetting_factor + s P0 + Q, with s = prior_share, P0
the covariance before any sample and Q = diag(process_std^2), and W goes 1 - sqrt(1 - s) of the
way back to W0: weights wander about their prior (a process of Ornstein and Uhlenbeck).
"""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from typing import NamedTuple

import numpy as np

from patagium.arrays import Array
from patagium.learning.models.network import Network, center_of, scale_of
from patagium.learning.models.physical import own_prior
from patagium.learning.settings import FilterSettings, NoiseEstimation, Numbers

PRIOR = 1.0
"""Standard deviation of a dimensionless weight that nobody states [1]."""


class SpreadRule(NamedTuple):
    """Numbers of a cubature rule.

    Attributes:
        spread: kappa, distance of the points in standard deviations.
        curvature_gain: M = curvature_gain sum (c_i - centered D)(c_i - centered D)' ...
        centered: 1 or 0.
        shift_gain: ... + shift_gain D D' + R.
    """

    spread: float
    curvature_gain: float
    centered: float
    shift_gain: float


def spread_rule(weights: int, spread: float | None) -> SpreadRule:
    """Cubature rule for a number of weights.

    Args:
        weights: n.
        spread: kappa, as the settings hold it [standard deviations]; None is sqrt(n), the cubature
            rule.
    """
    if spread is None or spread == sqrt(weights):
        return SpreadRule(sqrt(weights), 1.0 / weights, 1.0, 0.0)
    square = spread * spread
    center = 1.0 - weights / square
    if center > -1e-12:  # sqrt(n) squared is n to rounding
        return SpreadRule(float(spread), 1.0 / square, 1.0, max(center, 0.0))
    return SpreadRule(float(spread), 2.0 / square**2, 0.0, 0.0)


class FilterNumbers(NamedTuple):
    """Numbers of a filter over the weights of a network; its state is kept elsewhere.

    Attributes:
        network: Network whose weights are estimated.
        settings: Settings that the numbers follow from.
        linear: Whether the network is taken as linear around the weights: no cubature points.
        rule: Distances and gains of the cubature points.
        noise: Variances of the measurement before any sample, (n_y,) [y^2]; NaN: found from the
            samples.
        prior_variance: Variances of the weights before any sample, (n,).
        process_noise: Variances added to the weights before each sample, (n,).
        forgetting_factor: Factor that divides the covariance before each sample.
    """

    network: Network
    settings: FilterSettings
    linear: bool
    rule: SpreadRule
    noise: Array
    prior_variance: Array
    process_noise: Array
    forgetting_factor: float

    @property
    def dtype(self) -> str:
        """Precision of the square root and of the points: "float64" or "float32"."""
        return self.settings.dtype

    @property
    def pull(self) -> float:
        """Share of the way back to the prior that the weights go at each sample [1]."""
        return 1.0 - sqrt(1.0 - self.settings.prior_share)

    @property
    def has_process_noise(self) -> bool:
        """Whether anything is added to the covariance before a sample."""
        return bool(self.process_noise.any())


def filter_numbers(network: Network, settings: FilterSettings, learner: str) -> FilterNumbers:
    """Numbers of a filter for the weights of a network.

    Args:
        network: Network whose weights are estimated.
        settings: Settings; what belongs to another kind of learner is left aside.
        learner: Kind of the learner: "cubature" or "extended".

    Raises:
        ParameterError: If a number is out of its range, or one is missing that the network
            does not know.
        ShapeError: If a standard deviation has another shape.
    """
    silent = settings.measurement_std is None and settings.noise_estimation is None
    if silent and settings.misfit is None:
        settings = replace(settings, misfit=getattr(network, "own_misfit", None))
    if settings.measurement_std is not None:
        noise = scale_of("measurement_std", settings.measurement_std, network.outputs) ** 2
    elif settings.misfit is not None:
        noise = np.zeros(network.outputs)
    else:
        noise = np.full(network.outputs, np.nan)
        estimation = settings.noise_estimation or NoiseEstimation()
        settings = replace(settings, noise_estimation=estimation)
    linear = learner == "extended"
    if linear:
        settings = replace(settings, spread=None, square_root="transform", dtype="float64")
    near = settings.spread is None and settings.prior_share > 0  # sqrt(n) would saturate
    rule = spread_rule(network.size, 1.0 if near else settings.spread)
    prior = _prior_variance(network, settings.prior_std)
    process = center_of("process_std", settings.process_std, network.size)
    return FilterNumbers(
        network,
        settings,
        linear,
        rule,
        noise,
        prior,
        process**2 + settings.prior_share * prior,
        settings.forgetting_factor / (1.0 - settings.prior_share),
    )


def compact_settings(numbers: FilterNumbers) -> FilterSettings:
    """Settings as a learner describes them: equal numbers as one, the spread that is used."""
    settings, spread = numbers.settings, None if numbers.linear else numbers.rule.spread
    changed = {}
    for name in ("prior_std", "measurement_std", "process_std"):
        value = getattr(settings, name)
        alike = isinstance(value, tuple) and len(set(value)) == 1
        changed[name] = value[0] if alike else value
    return replace(settings, spread=spread, **changed)


def _prior_variance(network: Network, std: Numbers | None) -> Array:
    """Diagonal of P0, (n,): of the network where it knows it itself.

    Of a network with `scaled_prior`, a number that is stated is a factor on its deviations.
    """
    own = own_prior(network)
    stated = scale_of("prior_std", PRIOR if std is None else std, network.size)
    if getattr(network, "scaled_prior", False):
        return (own * stated) ** 2
    return np.where(np.isnan(own), stated**2 / network.fan_in, own**2)
