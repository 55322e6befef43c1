"""The low-rank extended Kalman filter (LoFi) of rebayes-mini over the weights of a network.

Its own process noise forgets, as its authors use it. Neglected: its robust variants.
"""

from __future__ import annotations

import json
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from patagium.arrays import Array
from patagium.learning.models.registry import network_from_description
from patagium_lab.rivals.jax_network import jax_network
from patagium_lab.rivals.weight_rival import WeightRival


class RebayesLowRank(WeightRival):
    """`rebayes_mini.methods.low_rank_filter.LowRankPrecisionFilter`.

    Args:
        *arguments: As `WeightRival`.
        rank: Columns of the precision beside its diagonal.
        wandering: Process standard deviation of a weight between two samples, over that of
            its prior, root mean square.
        **settings: As `WeightRival`.
    """

    def __init__(self, *arguments: Any, rank: int, wandering: float = 0.0, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        jnp = import_module("jax.numpy")
        self._start, self._step, self._density = _compiled(
            json.dumps(self.network.describe()), rank
        )
        wander = wandering**2 * float(self.prior_variance.mean())
        self._model = jnp.asarray(self.noise), wander
        self._belief = self._start(jnp.asarray(self.start), jnp.asarray(self.prior_variance))

    @property
    def weights(self) -> Array:
        """The estimate, (n,)."""
        return np.asarray(self._belief.mean)

    def update(self, x: Array, y: Array) -> None:
        """Learn one sample, x (n_x,), y (n_y,)."""
        self._belief = self._step(self._belief, x, y, *self._model)
        self._belief.mean.block_until_ready()

    def std(self, x: Array) -> Array:
        """Predicted standard deviation of a measurement at x, noise included, (n_y,)."""
        covariance = self._density(self._belief, x, *self._model)
        return np.asarray(np.sqrt(np.diagonal(np.asarray(covariance))))


@cache
def _compiled(description: str, rank: int) -> tuple[Any, Any, Any]:
    """Start, step and predicted covariance, compiled once for all settings of a network."""
    jax = import_module("jax")
    filters = import_module("rebayes_mini.methods.low_rank_filter")
    network: Any = network_from_description(json.loads(description))
    function = jax_network(network)

    def made(noise: Any, wander: Any) -> Any:
        lofi = filters.LowRankPrecisionFilter(function, lambda y: noise, wander, rank)
        lofi.init_bel(network.initial(0))  # it keeps the network's functions
        return lofi

    def start(weights: Any, variance: Any) -> Any:
        return made(None, 0.0).init_bel(weights, variance)

    def step(belief: Any, x: Any, y: Any, noise: Any, wander: Any) -> Any:
        lofi = made(noise, wander)
        return lofi.update(lofi.predict(belief), y, x)

    def density(belief: Any, x: Any, noise: Any, wander: Any) -> Any:
        lofi = made(noise, wander)
        return lofi.predictive_density(lofi.predict(belief), x).covariance()

    return start, jax.jit(step), jax.jit(density)
