"""Derivative of every network for its weights against central differences."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.learning.models.dense import LinearNetwork


def made(kind):
    if kind == "strip":
        return pt.StripNetwork(pt.load_robot("aerobat"), (4, 3), measured=("x", "z", "pitch"))
    if kind == "features":
        return LinearNetwork(pt.DenseNetwork(5, (), 2, output_scale=3.0), features=6)
    activation = "tanh" if kind == "tanh" else "softplus"
    return pt.DenseNetwork(5, (4, 3), 2, activation, output_scale=[2.0, 0.5])


@pytest.mark.parametrize("kind", ["softplus", "tanh", "features", "strip"])
def test_slopes_are_differences(kind, rng):
    network = made(kind)
    x, w, step = rng.normal(size=network.inputs), network.initial(1), 1e-5
    encoding = network.encode_one(x)
    y, slope = network.linearized(encoding, w)
    np.testing.assert_allclose(y, network(x, w), rtol=1e-12, atol=1e-14)
    assert slope.shape == (network.outputs, network.size)
    for i in range(network.size):
        ahead, behind = w.copy(), w.copy()
        ahead[i] += step
        behind[i] -= step
        difference = (network(x, ahead) - network(x, behind)) / (2 * step)
        # truncation step^2, cancellation 1e-16 / step
        np.testing.assert_allclose(slope[:, i], difference, rtol=1e-6, atol=1e-8)


def test_small_spreads_tend_to_the_extended_filter(rng):
    network = pt.DenseNetwork(3, (5,), 2)
    setting = {"prior_std": 0.05, "measurement_std": 0.1}
    cubature = pt.CubatureLearner(network, spread=1e-2, **setting)
    extended = pt.ExtendedLearner(network, **setting)
    x, y = rng.normal(size=3), rng.normal(size=2)
    cubature.update(x, y)
    extended.update(x, y)
    moved = extended.weights - network.initial(0)
    # second-order terms are of order prior^2
    np.testing.assert_allclose(
        cubature.weights - network.initial(0), moved, atol=0.02 * np.abs(moved).max()
    )
    np.testing.assert_allclose(cubature.covariance, extended.covariance, atol=2e-5)
