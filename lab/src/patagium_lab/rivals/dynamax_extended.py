"""dynamax's extended Kalman filter over the weights of a network, one sample a call.

Its filter takes a sequence; a sequence of one sample, compiled once, is an online update.
Double precision: its covariance is no square root. Neglected: iterated updates.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from patagium.arrays import Array
from patagium_lab.rivals.jax_network import jax_network
from patagium_lab.rivals.weight_rival import WeightRival


class DynamaxExtended(WeightRival):
    """`dynamax.nonlinear_gaussian_ssm.extended_kalman_filter`; arguments as `WeightRival`."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        jax, jnp = import_module("jax"), import_module("jax.numpy")
        ssm = import_module("dynamax.nonlinear_gaussian_ssm")

        network = jax_network(self.network)
        still, noise = np.zeros((self.network.size,) * 2), self.noise

        def step(mean: Any, covariance: Any, x: Any, y: Any) -> Any:
            model = ssm.ParamsNLGSSM(
                initial_mean=mean,
                initial_covariance=covariance / self.forgetting_factor,
                dynamics_function=lambda weights, x: weights,
                dynamics_covariance=still,
                emission_function=network,
                emission_covariance=noise,
            )
            kept = ["filtered_means", "filtered_covariances"]
            found = ssm.extended_kalman_filter(model, y[None], x[None], output_fields=kept)
            return found.filtered_means[0], found.filtered_covariances[0]

        self._step = jax.jit(step)
        self._mean = jnp.asarray(self.start)
        self._covariance = jnp.asarray(np.diag(self.prior_variance))

    @property
    def weights(self) -> Array:
        """The estimate, (n,)."""
        return np.asarray(self._mean)

    @property
    def covariance(self) -> Array:
        """Covariance of the weights after the last sample, (n, n) [1]."""
        return np.asarray(self._covariance)

    def update(self, x: Array, y: Array) -> None:
        """Learn one sample, x (n_x,), y (n_y,)."""
        self._mean, self._covariance = self._step(self._mean, self._covariance, x, y)
        self._covariance.block_until_ready()

    def std(self, x: Array) -> Array:
        """Predicted standard deviation of a measurement at x, noise included, (n_y,)."""
        slope = self.network.linearized(self.network.encode_one(x), self.weights)[1]
        spread = slope @ self.covariance @ slope.T / self.forgetting_factor
        return np.sqrt(np.diagonal(spread + self.noise))
