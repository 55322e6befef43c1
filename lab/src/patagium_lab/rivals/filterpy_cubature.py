"""filterpy's cubature filter over the weights of a network.

Its points are drawn directly: its own time update would send them through the identity and
add them up again, one outer product of n by n a point. Neglected: process noise.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from patagium.arrays import Array
from patagium_lab.rivals.weight_rival import WeightRival


class FilterpyCubature(WeightRival):
    """`filterpy.kalman.CubatureKalmanFilter`; arguments as `WeightRival`."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        from filterpy.kalman import CubatureKalmanFilter

        network = self.network
        self._filter = CubatureKalmanFilter(
            network.size,
            network.outputs,
            dt=1.0,
            hx=lambda weights, encoding: self.outputs(encoding, weights),
            fx=lambda weights, dt: weights,
        )
        self._filter.x = self.start[:, None]
        self._filter.P = np.diag(self.prior_variance)
        self._filter.R = self.noise

    @property
    def weights(self) -> Array:
        """The estimate, (n,)."""
        return np.asarray(self._filter.x[:, 0])

    @property
    def covariance(self) -> Array:
        """Covariance of the weights after the last sample, (n, n) [1]."""
        return np.asarray(self._filter.P)

    def update(self, x: Array, y: Array) -> None:
        """Learn one sample, x (n_x,), y (n_y,)."""
        self._filter.P = self._filter.P / self.forgetting_factor
        self._filter.sigmas_f = self._points(self._filter.P)
        self._filter.update(y[:, None], hx_args=(self.encoded(x),))

    def std(self, x: Array) -> Array:
        """Predicted standard deviation of a measurement at x, noise included, (n_y,)."""
        from filterpy.kalman.CubatureKalmanFilter import ckf_transform

        encoding = self.encoded(x)
        points = self._points(self._filter.P / self.forgetting_factor)
        seen = np.array([self.outputs(encoding, weights) for weights in points])
        return np.asarray(np.sqrt(np.diagonal(ckf_transform(seen, self.noise)[1])))

    def _points(self, covariance: Array) -> Array:
        from filterpy.kalman.CubatureKalmanFilter import spherical_radial_sigmas

        return np.asarray(spherical_radial_sigmas(self._filter.x, covariance))
