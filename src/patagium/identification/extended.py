"""Learning a network's weights with the extended Kalman filter, the paper's rival.

The network is linearized at the estimate, H = dy/dW by reverse accumulation through
the perceptron. Neglected: curvature of the network over the spread of its weights.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.identification.array_filter import ArrayFilter, FilterSetting
from patagium.identification.filter_learner import FilterLearner, compact
from patagium.identification.learner import forgetting
from patagium.identification.network import Network
from patagium.identification.root import transformed_root
from patagium.identification.scaling import center_of, scale_of
from patagium.identification.spread import Moments, spread_rule

Array = NDArray[np.float64]


class ExtendedFilter(ArrayFilter):
    """The same square-root step with Z = S' H' and M = R, S not triangular."""

    _measured = staticmethod(transformed_root)

    def _moments(self, x: Array, root: Array) -> Moments:
        network = self.setting.network
        y, slope = network.linearized(network.encode_one(x), self.mean)
        return Moments(y, root.T @ slope.T, np.diag(self.setting.noise))


class ExtendedLearner(FilterLearner):
    """Extended Kalman filter over the weights of a network, in square-root form.

    Before each sample P <- P / forgetting_factor + Q; then with H = dy/dW at W,
    P_yy = H P H' + R, W <- W + P H' P_yy^-1 (y - y(W)), P <- P - P H' P_yy^-1 H P.

    Args:
        network: The network whose weights are learned.
        prior_deviation: Standard deviation of each weight before any sample, divided by
            sqrt(fan-in) of its neuron (biases: fan-in 1); scalar or (n,).
        measurement_deviation: Standard deviation of the measurement, scalar or (n_y,), in
            the unit of y.
        process_deviation: Standard deviation by which each weight wanders between two
            samples, scalar or (n,); not divided by anything.
        seed: Seed of the weights to start from.
        forgetting_factor: Divides the covariance before each sample, 0 < factor <= 1.

    Raises:
        ParameterError: If a number is out of its range.
        ShapeError: If a deviation has another shape.

    References:
        Singhal & Wu (1989), Training multilayer perceptrons with the extended Kalman
        algorithm, NIPS 1.
    """

    def __init__(
        self,
        network: Network,
        *,
        prior_deviation: ArrayLike,
        measurement_deviation: ArrayLike,
        process_deviation: ArrayLike = 0.0,
        seed: int = 0,
        forgetting_factor: float = 1.0,
    ) -> None:
        prior = scale_of("prior_deviation", prior_deviation, network.size)
        noise = scale_of("measurement_deviation", measurement_deviation, network.outputs)
        wander = center_of("process_deviation", process_deviation, network.size)
        setting = FilterSetting(
            network,
            spread_rule(network.size, None),
            noise**2,
            wander**2,
            forgetting(forgetting_factor),
            "float64",
        )
        root = np.diag(prior / np.sqrt(network.fan_in))
        super().__init__(network, ExtendedFilter(setting, network.initial(seed), root))
        self._setting, self._prior, self._seed = setting, prior, seed

    def describe(self) -> dict[str, Any]:
        """What the learner is made of, as JSON-able values; not what it has learned."""
        return {
            "kind": "extended",
            "network": self._network.describe(),
            "prior_deviation": compact(self._prior),
            "measurement_deviation": compact(np.sqrt(self._setting.noise)),
            "process_deviation": compact(np.sqrt(self._setting.process_noise)),
            "seed": self._seed,
            "forgetting_factor": self._setting.forgetting_factor,
        }
