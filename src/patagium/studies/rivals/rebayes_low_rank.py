"""The low-rank extended Kalman filter (LoFi) of rebayes-mini over the weights of a network.

Its own process noise forgets, as its authors use it. Neglected: its robust variants.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.studies.rivals.jax_network import jax_network
from patagium.studies.rivals.weight_rival import WeightRival

Array = NDArray[np.float64]


class RebayesLowRank(WeightRival):
    """`rebayes_mini.methods.low_rank_filter.LowRankPrecisionFilter`.

    Args:
        *arguments: As `WeightRival`.
        rank: Columns of the precision beside its diagonal.
        wandering: Deviation by which a weight wanders between two samples, in deviations of
            its prior, root mean square.
        **settings: As `WeightRival`.
    """

    def __init__(self, *arguments: Any, rank: int, wandering: float = 0.0, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        jax, jnp = import_module("jax"), import_module("jax.numpy")
        filters = import_module("rebayes_mini.methods.low_rank_filter")

        noise = jnp.asarray(self.noise)
        self._filter = filters.LowRankPrecisionFilter(
            jax_network(self.network),
            lambda y: noise,
            wandering**2 * float(self.prior_variance.mean()),
            rank,
        )
        self._belief = self._filter.init_bel(
            jnp.asarray(self.start), jnp.asarray(self.prior_variance)
        )
        self._step = jax.jit(
            lambda belief, x, y: self._filter.update(self._filter.predict(belief), y, x)
        )
        self._density = jax.jit(
            lambda belief, x: self._filter.predictive_density(
                self._filter.predict(belief), x
            ).covariance()
        )

    @property
    def weights(self) -> Array:
        """The estimate, (n,)."""
        return np.asarray(self._belief.mean)

    def update(self, x: Array, y: Array) -> None:
        """Learn one sample, x (n_x,), y (n_y,)."""
        self._belief = self._step(self._belief, x, y)
        self._belief.mean.block_until_ready()

    def deviation(self, x: Array) -> Array:
        """Predicted standard deviation of a measurement at x, noise included, (n_y,)."""
        return np.asarray(np.sqrt(np.diagonal(np.asarray(self._density(self._belief, x)))))
