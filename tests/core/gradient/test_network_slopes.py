"""Derivatives of networks for their weights against central differences and CasADi."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.learning.models.perceptron import Perceptron


def made(kind):
    if kind == "strip":
        return pt.StripNetwork(pt.load_robot("aerobat"), (4, 3), measured=("x", "z", "pitch"))
    activation = "tanh" if kind == "tanh" else "softplus"
    return pt.DenseNetwork(5, (4, 3), 2, activation, output_scale=[2.0, 0.5])


@pytest.mark.parametrize("kind", ["softplus", "tanh", "strip"])
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


@pytest.mark.parametrize("activation", ["softplus", "tanh"])
def test_slopes_of_the_perceptron_are_those_of_casadi(activation, rng):
    perceptron = Perceptron((3, 5, 4, 2), activation)
    features, weights = rng.normal(size=(6, 3)), rng.normal(size=perceptron.size)
    w, x = ca.SX.sym("w", perceptron.size), ca.SX.sym("x", 3)
    z, start = x, 0
    for number, (below, above) in enumerate([(3, 5), (5, 4), (4, 2)]):
        if number:
            z = ca.tanh(z) if activation == "tanh" else ca.log(1 + ca.exp(z))
        matrix = ca.reshape(w[start : start + below * above], below, above).T
        z = matrix @ z + w[start + below * above : start + (below + 1) * above]
        start += (below + 1) * above
    oracle = ca.Function("y", [w, x], [z, ca.jacobian(z, w)])
    out, slope = perceptron.linearized(features, weights)
    np.testing.assert_array_equal(out, perceptron.forward(features, weights))
    for k in range(len(features)):
        y, jacobian = oracle(weights, features[k])
        np.testing.assert_allclose(out[k], np.array(y).ravel(), rtol=1e-12)
        np.testing.assert_allclose(slope[k], np.array(jacobian), rtol=1e-11, atol=1e-13)


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
