"""Filters of other programs over the weights of our networks: what all of them share.

Each is used as its own documentation shows, on the same network, prior and noise as ours;
what a model of constant weights makes needless (drawing points through the identity) is left
out where the program lets us. Neglected: their other filters, smoothers and models.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from importlib.util import find_spec

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array
from patagium.errors import ParameterError
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.network import Encoding


class WeightRival(ABC):
    """Weights of a dense network estimated by another program's filter.

    Args:
        network: The network whose weights are learned.
        prior_std: Prior standard deviation of each weight, before division by sqrt(fan-in).
        measurement_std: Standard deviation of the measurement, scalar or (n_y,) [as y].
        forgetting_factor: Divides the covariance before each sample, 0 < factor <= 1.
        seed: Seed of the first weights.

    Raises:
        ParameterError: If the network is not dense.
    """

    def __init__(
        self,
        network: DenseNetwork,
        *,
        prior_std: float,
        measurement_std: ArrayLike,
        forgetting_factor: float = 1.0,
        seed: int = 0,
    ) -> None:
        if not isinstance(network, DenseNetwork):
            raise ParameterError("network", "a dense network", network)
        self.network, self.forgetting_factor = network, forgetting_factor
        self.start = network.initial(seed)
        self.prior_variance = prior_std**2 / network.fan_in
        std = np.broadcast_to(np.asarray(measurement_std, float), (network.outputs,))
        self.noise = np.diag(std**2)

    @property
    @abstractmethod
    def weights(self) -> Array:
        """The estimate, (n,)."""

    @abstractmethod
    def update(self, x: Array, y: Array) -> None:
        """Learn one sample, x (n_x,), y (n_y,)."""

    @abstractmethod
    def std(self, x: Array) -> Array:
        """Predicted standard deviation of a measurement at x, noise included, (n_y,)."""

    def predict(self, x: Array) -> Array:
        """y of many x by the present weights, (N, n_y)."""
        return self.network.evaluate(x, self.weights)

    def encoded(self, x: Array) -> Encoding:
        """One x as `Network.decode` takes it, with a leading axis of one."""
        one = self.network.encode_one(x)
        return Encoding(one.features[None], one.readout[None], one.offset)

    def outputs(self, encoding: Encoding, weights: Array) -> Array:
        """y of one encoded x, (n_y,)."""
        return np.asarray(self.network.decode(encoding, weights)[0])


def missing(package: str) -> bool:
    """Whether a package is not installed."""
    return find_spec(package) is None
