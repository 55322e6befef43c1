"""Stone Soup's cubature updater over the weights of a network.

Weights are the state, the network at one x the measurement model. Neglected: its predictors
(the weights do not move by themselves), its trackers.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np

from patagium.arrays import Array
from patagium.learning.models.network import Encoding
from patagium_lab.rivals.weight_rival import WeightRival

_WHEN = datetime(2000, 1, 1)


class StoneSoupCubature(WeightRival):
    """`stonesoup.updater.kalman.CubatureKalmanUpdater`; arguments as `WeightRival`."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        from stonesoup.types.array import CovarianceMatrix, StateVector
        from stonesoup.types.state import GaussianState
        from stonesoup.updater.kalman import CubatureKalmanUpdater

        self._updater = CubatureKalmanUpdater(measurement_model=None)
        self._state = GaussianState(
            StateVector(self.start), CovarianceMatrix(np.diag(self.prior_variance)), _WHEN
        )

    @property
    def weights(self) -> Array:
        """The estimate, (n,)."""
        return np.array(self._state.state_vector, float)[:, 0]

    @property
    def covariance(self) -> Array:
        """Covariance of the weights after the last sample, (n, n) [1]."""
        return np.array(self._state.covar, float)

    def update(self, x: Array, y: Array) -> None:
        """Learn one sample, x (n_x,), y (n_y,)."""
        from stonesoup.types.array import StateVector
        from stonesoup.types.detection import Detection
        from stonesoup.types.hypothesis import SingleHypothesis

        seen = Detection(StateVector(y), timestamp=_WHEN, measurement_model=self._model(x))
        self._state = self._updater.update(SingleHypothesis(self._predicted(), seen))
        type(self._updater).predict_measurement.cache_clear()  # it would keep 128 covariances

    def std(self, x: Array) -> Array:
        """Predicted standard deviation of a measurement at x, noise included, (n_y,)."""
        found = self._updater.predict_measurement(self._predicted(), self._model(x))
        return np.asarray(np.sqrt(np.diagonal(np.array(found.covar, float))))

    def _predicted(self) -> Any:
        from stonesoup.types.prediction import GaussianStatePrediction

        covariance = self._state.covar / self.forgetting_factor
        return GaussianStatePrediction(self._state.state_vector, covariance, _WHEN)

    def _model(self, x: Array) -> NetworkAtX:
        return NetworkAtX(self, self.encoded(x))


@dataclass(eq=False)  # the updater keeps them by identity
class NetworkAtX:
    """y = network(x; weights) + noise at one x: what the updater asks of a measurement model.

    Attributes:
        rival: Rival with its network and noise.
        encoding: Encoding of x.
    """

    rival: WeightRival
    encoding: Encoding

    def function(self, state: Any) -> Any:
        """y at the weights of a state, (n_y, 1)."""
        from stonesoup.types.array import StateVector

        weights = np.asarray(state.state_vector, float)[:, 0]
        return StateVector(self.rival.outputs(self.encoding, weights))

    def covar(self) -> Any:
        """Covariance of the noise, (n_y, n_y) [as y squared]."""
        return self.rival.noise
