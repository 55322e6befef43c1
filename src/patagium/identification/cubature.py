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
from patagium.identification.array_filter import CholeskyFilter, FilterSetting
from patagium.identification.filter_learner import FilterLearner, compact
from patagium.identification.kernel_filter import restore
from patagium.identification.learner import forgetting
from patagium.identification.network import Network
from patagium.identification.scaling import center_of, scale_of
from patagium.identification.spread import spread_rule

Array = NDArray[np.float64]
SquareRoot = Literal["transform", "cholesky"]
Precision = Literal["float64", "float32"]


class CubatureLearner(FilterLearner):
    """Square-root cubature Kalman filter over the weights of a network.

    Before each sample P <- P / forgetting_factor + Q, Q = diag(process_deviation^2). The
    points W +- kappa S e_i, P = S S', give mean and covariance of y and, with a sample,

        W <- W + S Z P_yy^-1 (y - mean),    P <- P - S Z P_yy^-1 Z' S'.

    `square_root="transform"` carries S itself, lower triangular, through the update: compiled,
    about n^2 (n_y + 8) multiplications and additions and n^2/2 numbers of memory, positive
    definite by construction. Its points are those of the Cholesky factor, so it equals
    Algorithm 1 of the paper but for rounding. Forgetting scales S; Q > 0 costs a
    factorization of order n^3 a sample. `"cholesky"` is Algorithm 1 to rounding: P is
    carried and factorized at every sample (order n^3).

    Args:
        network: The network whose weights are learned.
        prior_deviation: Standard deviation of each weight before any sample, divided by
            sqrt(fan-in) of its neuron (biases: fan-in 1); scalar or (n,).
        measurement_deviation: Standard deviation of the measurement, scalar or (n_y,), in
            the unit of y.
        process_deviation: Standard deviation by which each weight wanders between two
            samples, scalar or (n,); not divided by anything.
        spread: kappa, distance of the points in standard deviations; None is sqrt(n), the
            cubature rule; see `spread` for mean and covariance at any other.
        square_root: "transform" or "cholesky".
        dtype: Precision of S and of the points, "float64" or "float32"; the weights
            themselves and the algebra of y are double in both.
        seed: Seed of the weights to start from.
        forgetting_factor: Divides the covariance before each sample, 0 < factor <= 1.

    Raises:
        ParameterError: If a number is out of its range.
        ShapeError: If a deviation has another shape.

    References:
        Arasaratnam & Haykin (2009), Cubature Kalman filters, IEEE TAC 54(6).
    """

    def __init__(
        self,
        network: Network,
        *,
        prior_deviation: ArrayLike,
        measurement_deviation: ArrayLike,
        process_deviation: ArrayLike = 0.0,
        spread: float | None = None,
        square_root: SquareRoot = "transform",
        dtype: Precision = "float64",
        seed: int = 0,
        forgetting_factor: float = 1.0,
    ) -> None:
        if square_root not in get_args(SquareRoot):
            raise ParameterError("square_root", '"transform" or "cholesky"', square_root)
        if dtype not in get_args(Precision):
            raise ParameterError("dtype", '"float64" or "float32"', dtype)
        prior = scale_of("prior_deviation", prior_deviation, network.size)
        noise = scale_of("measurement_deviation", measurement_deviation, network.outputs)
        wander = center_of("process_deviation", process_deviation, network.size)
        self._setting = FilterSetting(
            network,
            spread_rule(network.size, spread),
            noise**2,
            wander**2,
            forgetting(forgetting_factor),
            dtype,
        )
        self._square_root, self._seed, self._prior = square_root, seed, prior
        root = np.diag(prior / np.sqrt(network.fan_in))
        make = CholeskyFilter if square_root == "cholesky" else restore
        super().__init__(network, make(self._setting, network.initial(seed), root))

    @property
    def spread(self) -> float:
        """kappa, distance of the points in standard deviations."""
        return self._setting.rule.spread

    def describe(self) -> dict[str, Any]:
        """What the learner is made of, as JSON-able values; not what it has learned."""
        setting = self._setting
        return {
            "kind": "cubature",
            "network": self._network.describe(),
            "prior_deviation": compact(self._prior),
            "measurement_deviation": compact(np.sqrt(setting.noise)),
            "process_deviation": compact(np.sqrt(setting.process_noise)),
            "spread": self.spread,
            "square_root": self._square_root,
            "dtype": setting.dtype,
            "seed": self._seed,
            "forgetting_factor": setting.forgetting_factor,
        }
