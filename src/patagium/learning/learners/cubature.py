"""Learning a network's weights with the cubature Kalman filter.

The weights are the state of a filter, W_{k+1} = W_k + noise, y = network(x, W) + noise;
no derivative of the network is needed. Points, mean and covariance: `spread`.
Neglected: correlation of the measurement noise in time; mixed second derivatives.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ParameterError
from patagium.learning.filters.array import CholeskyFilter
from patagium.learning.filters.choice import cubature_filter
from patagium.learning.filters.spread import spread_rule
from patagium.learning.learners.assumptions import assume
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.models.network import Network
from patagium.learning.settings import ChangeDetection, NoiseEstimation, Screening, Structure

Array = NDArray[np.float64]
SquareRoot = Literal["transform", "cholesky"]
Precision = Literal["float64", "float32"]


class CubatureLearner(FilterLearner):
    """Square-root cubature Kalman filter over the weights of a network.

    Before each sample P <- (1 - prior_share) P / forgetting_factor + prior_share P0 + Q,
    Q = diag(process_std^2). The points W +- kappa S e_i, P = S S', give mean and
    covariance of y and, with a sample,

        W <- W + S Z P_yy^-1 (y - mean),    P <- P - S Z P_yy^-1 Z' S'.

    `covariance` says what is kept of P (cost of an update, memory in numbers; k weights a
    neuron, b a layer):

    - "full": all of it; n^2 (n_y + 8), n^2 / 2. Noise between samples adds n^3.
    - "layer": one block a layer; the same with the sum of b^2 in place of n^2.
    - "node": one block a neuron; 2 n k, n k / 2 where at most one linear layer follows, about
      n n_y (k + 2 n_y) further from the outputs; noise between samples adds n k^2 / 3.
    - LowRank(r): the inverse of a diagonal plus r columns; n (r + n_y)^2, n (r + 2 n_y): for
      10^4 weights and more. The passes over the weights are compiled, the small algebra is
      NumPy; the points lie along n_y columns and dy/dW is used.

    `square_root="transform"` carries S itself, lower triangular, through the update: compiled,
    positive definite by construction. Its points are those of the Cholesky factor, so with
    "full" it equals Algorithm 1 of the paper but for rounding. `"cholesky"` is Algorithm 1 to
    rounding: P is carried, full, and factorized at every sample (order n^3).

    Forgetting alone makes P grow without bound along what the samples do not excite; with
    prior_share alone it never exceeds P0.

    Args:
        network: The network whose weights are learned.
        prior_std: Standard deviation of each weight before any sample, divided by
            sqrt(fan-in) of its neuron (biases: fan-in 1); scalar or (n,). Weights of which the
            network has its own (`GreyBox`) keep that; None: all have.
        measurement_std: Standard deviation of the measurement, scalar or (n_y,), in
            the unit of y.
        process_std: Standard deviation by which each weight wanders between two
            samples, scalar or (n,); not divided by anything.
        spread: kappa, distance of the points in standard deviations; None is sqrt(n), the
            cubature rule; see `spread` for mean and covariance at any other.
        square_root: "transform" or "cholesky".
        dtype: Precision of S and of the points, "float64" or "float32"; the weights
            themselves and the algebra of y are double in both.
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
        ParameterError: If a number is out of its range, or "cholesky" is not of "full".
        ShapeError: If a deviation has another shape.

    References:
        Arasaratnam & Haykin (2009), Cubature Kalman filters, IEEE TAC 54(6); Puskorius &
        Feldkamp (1991), Decoupled extended Kalman filter training, IJCNN; Chang et al. (2023),
        Low-rank extended Kalman filtering, CoLLAs.
    """

    def __init__(
        self,
        network: Network,
        *,
        prior_std: ArrayLike | None = None,
        measurement_std: ArrayLike,
        process_std: ArrayLike = 0.0,
        spread: float | None = None,
        square_root: SquareRoot = "transform",
        dtype: Precision = "float64",
        seed: int = 0,
        forgetting_factor: float = 1.0,
        prior_share: float = 0.0,
        covariance: Structure = "full",
        screening: Screening | None = None,
        noise_estimation: NoiseEstimation | None = None,
        change_detection: ChangeDetection | None = None,
    ) -> None:
        if square_root not in get_args(SquareRoot):
            raise ParameterError("square_root", '"transform" or "cholesky"', square_root)
        if dtype not in get_args(Precision):
            raise ParameterError("dtype", '"float64" or "float32"', dtype)
        if square_root == "cholesky" and covariance != "full":
            raise ParameterError("covariance", '"full" with square_root="cholesky"', covariance)
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
        setting = assumptions.setting(spread_rule(network.size, spread), dtype)
        self._setting, self._square_root, self._seed = setting, square_root, seed
        mean, std = network.initial(seed), np.sqrt(assumptions.prior_variance)
        weight_filter = (
            CholeskyFilter(setting, mean, np.diag(std))
            if square_root == "cholesky"
            else cubature_filter(setting, mean, std)
        )
        super().__init__(assumptions, weight_filter)

    @property
    def spread(self) -> float:
        """kappa, distance of the points in standard deviations."""
        return self._setting.rule.spread

    def describe(self) -> dict[str, Any]:
        """What the learner is made of, as JSON-able values; not what it has learned."""
        return {
            "kind": "cubature",
            **super().describe(),
            "spread": self.spread,
            "square_root": self._square_root,
            "dtype": self._setting.dtype,
            "seed": self._seed,
        }
