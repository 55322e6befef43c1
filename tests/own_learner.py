"""A learner as a user may write it, which is no filter and has no covariance of its weights."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.learning import Network
from patagium.learning.filters.screening import EVENTS

Array = NDArray[np.float64]


class OwnLearner:
    """Half a step of Newton to the measurement of each sample."""

    covariance = variances = None
    time_per_update = 1e-6

    def __init__(self, network: Network) -> None:
        self.network, self.weights, self.count = network, network.initial(0), 0
        self.events = dict.fromkeys(EVENTS, 0)

    def predict(self, x: Array) -> tuple[Array, Array]:
        outputs = self.network.outputs
        return self.network(x, self.weights), np.full((outputs, outputs), np.nan)

    def update(self, x: Array, y: Array, time: float | None = None) -> Array:
        mean, slope = self.network.linearized(self.network.encode_one(x), self.weights)
        self.weights = self.weights + 0.5 * np.linalg.pinv(slope, rcond=1e-3) @ (y - mean)
        self.count += 1
        return y - mean

    def describe(self) -> dict[str, Any]:
        return {"kind": "own", "network": self.network.describe()}
