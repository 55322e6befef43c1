"""The extended filter on a linear network against the equations of the Kalman filter."""

from __future__ import annotations

import numpy as np

import patagium as pt

ROUNDING = 1e-9  # fifty updates, each some n^2 roundings


def test_extended_learner_is_the_kalman_filter_on_a_linear_network(rng):
    network = pt.DenseNetwork(3, (), 2)
    learner = pt.ExtendedLearner(
        network,
        prior_std=0.7,
        measurement_std=[0.1, 0.2],
        process_std=0.01,
        forgetting_factor=0.99,
    )
    w = network.initial(0)
    p = np.diag(0.7**2 / network.fan_in)
    noise = np.diag([0.01, 0.04])
    xs = rng.normal(size=(50, 3))
    ys = xs @ rng.normal(size=(3, 2)) + 0.1 * rng.normal(size=(50, 2))
    for x, y in zip(xs, ys, strict=True):
        p = p / 0.99 + 1e-4 * np.eye(8)
        h = np.zeros((2, 8))
        h[0, :3] = h[1, 3:6] = x
        h[0, 6] = h[1, 7] = 1.0
        total = h @ p @ h.T + noise
        gain = p @ h.T @ np.linalg.inv(total)
        mean, covariance = learner.predict(x)
        np.testing.assert_allclose(mean, h @ w, atol=ROUNDING)
        np.testing.assert_allclose(covariance, total, atol=ROUNDING)
        np.testing.assert_allclose(learner.update(x, y), y - h @ w, atol=ROUNDING)
        w = w + gain @ (y - h @ w)
        p = p - gain @ total @ gain.T
        np.testing.assert_allclose(learner.weights, w, atol=ROUNDING)
        np.testing.assert_allclose(learner.covariance, p, atol=ROUNDING)
