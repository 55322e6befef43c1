"""A dense network as a function that JAX can differentiate, weights laid out as ours."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from itertools import pairwise
from typing import Any

from patagium.learning.models.dense import DenseNetwork


def jax_network(network: DenseNetwork) -> Callable[[Any, Any], Any]:
    """y = f(weights, x), (n_y,), in JAX arrays of double precision.

    Args:
        network: Softplus or tanh.
    """
    jax, jnp = import_module("jax"), import_module("jax.numpy")

    jax.config.update("jax_enable_x64", True)
    widths, function = network.perceptron.widths, network.perceptron.activation
    activation = jax.nn.softplus if function == "softplus" else jnp.tanh

    def y(weights: Any, x: Any) -> Any:
        z, start = (x - network.input_center) / network.input_scale, 0
        for number, (below, above) in enumerate(pairwise(widths)):
            z = activation(z) if number else z
            middle, end = start + below * above, start + (below + 1) * above
            z = weights[start:middle].reshape(above, below) @ z + weights[middle:end]
            start = end
        return network.output_center + network.output_scale * z

    return y
