"""Learning a network's weights with the extended Kalman filter, the paper's rival.

The network is linearized at the estimate, H = dy/dW by reverse accumulation through
the perceptron. Neglected: curvature of the network over the spread of its weights.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.learning.filters.choice import extended_filter
from patagium.learning.filters.spread import spread_rule
from patagium.learning.learners.assumptions import assume
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.models.network import Network
from patagium.learning.settings import ChangeDetection, NoiseEstimation, Screening, Structure

Array = NDArray[np.float64]


class ExtendedLearner(FilterLearner):
    """Extended Kalman filter over the weights of a network, in square-root form.

    Before each sample P <- (1 - prior_share) P / forgetting_factor + prior_share P0 + Q; then
    with H = dy/dW at W, P_yy = H P H' + R, W <- W + P H' P_yy^-1 (y - y(W)),
    P <- P - P H' P_yy^-1 H P; of that, what `covariance` keeps. Compiled for networks of a
    perceptron and for `HiddenStripNetwork`, others are in NumPy. Cost and memory of "full" are of
    order n^2, of "layer" of the sum of its blocks' squares, of "node", in NumPy, as of "full";
    `LowRank(r)` takes n (r + n_y)^2 and n (r + 2 n_y), and is the low-rank filter of Chang et al.

    Args:
        network: The network whose weights are learned.
        prior_std: Standard deviation of each weight before any sample, divided by
            sqrt(fan-in) of its neuron (biases: fan-in 1); scalar or (n,). Weights of which the
            network has its own (`GreyBox`) keep that; None: all have.
        measurement_std: Standard deviation of the measurement, scalar or (n_y,), in
            the unit of y.
        process_std: Standard deviation by which each weight wanders between two
            samples, scalar or (n,); not divided by anything.
        seed: Seed of the weights to start from.
        forgetting_factor: Divides the covariance before each sample, 0 < factor <= 1.
        prior_share: Share of the covariance before any sample that is mixed in before each
            sample, 0 <= share < 1: a memory of 1 / share samples.
        covariance: "full", "layer", "node" or `LowRank(rank)`.
        screening: How far samples are believed; None: as they are, if they are numbers.
        noise_estimation: How the variances of the measurement follow the innovations, from
            measurement_std on; None: it is known.
        change_detection: When the covariance is opened anew; None: never.

    Raises:
        ParameterError: If a number is out of its range.
        ShapeError: If a deviation has another shape.

    References:
        Singhal & Wu (1989), Training multilayer perceptrons with the extended Kalman
        algorithm, NIPS 1; Chang et al. (2023), Low-rank extended Kalman filtering, CoLLAs.
    """

    def __init__(
        self,
        network: Network,
        *,
        prior_std: ArrayLike | None = None,
        measurement_std: ArrayLike,
        process_std: ArrayLike = 0.0,
        seed: int = 0,
        forgetting_factor: float = 1.0,
        prior_share: float = 0.0,
        covariance: Structure = "full",
        screening: Screening | None = None,
        noise_estimation: NoiseEstimation | None = None,
        change_detection: ChangeDetection | None = None,
    ) -> None:
        assumptions = assume(
            network,
            prior_std,
            measurement_std,
            process_std,
            forgetting_factor,
            prior_share,
            covariance,
            screening,
            noise_estimation,
            change_detection,
        )
        setting = assumptions.setting(spread_rule(network.size, None), "float64")
        std = np.sqrt(assumptions.prior_variance)
        weight_filter = extended_filter(setting, network.initial(seed), std)
        super().__init__(assumptions, weight_filter)
        self._seed = seed

    def describe(self) -> dict[str, Any]:
        """What the learner is made of, as JSON-able values; not what it has learned."""
        return {"kind": "extended", **super().describe(), "seed": self._seed}
