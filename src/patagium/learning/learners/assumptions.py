"""What a filter takes for granted of weights and measurements before it sees a sample.

Between two samples P <- (1 - s) P / forgetting_factor + s P0 + Q, with s = prior_share, P0
the covariance before any sample and Q = diag(process_std^2). Neglected: deviations
that change with the state.
"""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ParameterError
from patagium.learning.filters.array import FilterSetting
from patagium.learning.filters.spread import SpreadRule
from patagium.learning.learners.learner import forgetting
from patagium.learning.models.network import Network
from patagium.learning.models.scaling import center_of, scale_of
from patagium.learning.models.structure import described_structure
from patagium.learning.settings import (
    ChangeDetection,
    NoiseEstimation,
    Screening,
    Structure,
    checked_structure,
)

Array = NDArray[np.float64]


class Assumptions(NamedTuple):
    """Deviations, what is forgotten, and what of the covariance is kept.

    Attributes:
        network: Whose weights.
        prior_std: Of each weight before any sample, times sqrt(fan-in), (n,); nan where
            the network knows it itself.
        measurement_std: (n_y,) in the unit of y.
        process_std: By which each weight wanders between two samples, (n,).
        forgetting_factor: Divides the covariance before each sample.
        prior_share: Share of the prior covariance mixed in before each sample.
        covariance: What is kept of it.
        screening: How far samples are believed.
        noise_estimation: How the variances of the measurement follow the innovations.
        change_detection: When the covariance is opened anew.
    """

    network: Network
    prior_std: Array
    measurement_std: Array
    process_std: Array
    forgetting_factor: float
    prior_share: float
    covariance: Structure
    screening: Screening | None
    noise_estimation: NoiseEstimation | None
    change_detection: ChangeDetection | None

    @property
    def prior_variance(self) -> Array:
        """Diagonal of P0, (n,)."""
        own, said = self.network.own_prior, self.prior_std**2 / self.network.fan_in
        return np.where(np.isnan(own), said, own**2)

    def setting(self, rule: SpreadRule, dtype: str) -> FilterSetting:
        """The same as numbers of a filter: P <- P / factor + noise before each sample.

        Args:
            rule: Where its points lie.
            dtype: Its precision.
        """
        return FilterSetting(
            self.network,
            rule,
            self.measurement_std**2,
            self.process_std**2 + self.prior_share * self.prior_variance,
            self.forgetting_factor / (1.0 - self.prior_share),
            dtype,
            self.covariance,
            self.screening,
            self.noise_estimation,
            self.change_detection,
        )

    def describe(self) -> dict[str, Any]:
        """As JSON-able values."""
        return {
            "network": self.network.describe(),
            "prior_std": _said(self.prior_std),
            "measurement_std": compact(self.measurement_std),
            "process_std": compact(self.process_std),
            "forgetting_factor": self.forgetting_factor,
            "prior_share": self.prior_share,
            "covariance": described_structure(self.covariance),
            "screening": _described(self.screening),
            "noise_estimation": _described(self.noise_estimation),
            "change_detection": _described(self.change_detection),
        }


def assume(
    network: Network,
    prior_std: ArrayLike | None,
    measurement_std: ArrayLike,
    process_std: ArrayLike,
    forgetting_factor: float,
    prior_share: float,
    covariance: Structure,
    screening: Screening | None = None,
    noise_estimation: NoiseEstimation | None = None,
    change_detection: ChangeDetection | None = None,
) -> Assumptions:
    """Checked assumptions; see there.

    Raises:
        ParameterError: If a number is out of its range or there is no such structure.
        ShapeError: If a deviation has another shape.
    """
    if not (isfinite(prior_share) and 0 <= prior_share < 1):
        raise ParameterError("prior_share", "at least 0 and below 1", prior_share)
    return Assumptions(
        network,
        _prior(network, prior_std),
        scale_of("measurement_std", measurement_std, network.outputs),
        center_of("process_std", process_std, network.size),
        forgetting(forgetting_factor),
        float(prior_share),
        checked_structure(covariance),
        screening,
        noise_estimation,
        change_detection,
    )


def _prior(network: Network, said: ArrayLike | None) -> Array:
    if said is not None:
        return scale_of("prior_std", said, network.size)
    if np.isnan(network.own_prior).any():
        raise ParameterError("prior_std", "positive numbers", None)
    return np.full(network.size, np.nan)


def _said(prior: Array) -> float | list[float] | None:
    return None if np.isnan(prior).all() else compact(prior)


def _described(part: Screening | NoiseEstimation | ChangeDetection | None) -> Any:
    return None if part is None else asdict(part)


def compact(values: Array) -> float | list[float]:
    """A vector as one number where all are equal, for descriptions."""
    return float(values[0]) if (values == values[0]).all() else [float(v) for v in values]
