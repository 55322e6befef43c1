"""The cubature learner against the Kalman filter, Algorithm 1 of the paper, and filterpy."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.learning.filters.root import lower_factor, measured_root, transformed_root

ROUNDING = 1e-9  # fifty updates of some n^2 roundings each, gains up to 1e2


def samples(rng, inputs=3, outputs=2, count=50):
    x = rng.normal(size=(count, inputs))
    return x, np.tanh(x @ rng.normal(size=(inputs, outputs))) + 0.1 * rng.normal(
        size=(count, outputs)
    )


@pytest.mark.parametrize("square_root", ["transform", "cholesky"])
@pytest.mark.parametrize("spread", [None, 3**0.5, 0.5, 10.0])
@pytest.mark.parametrize(("process", "forgetting"), [(0.0, 1.0), (0.02, 0.98), (0.0, 0.97)])
def test_on_a_linear_network_it_is_the_kalman_filter(square_root, spread, process, forgetting, rng):
    network = pt.DenseNetwork(3, (), 2, input_scale=2.0, output_center=[1, 2], output_scale=[3, 1])
    learner = pt.CubatureLearner(
        network,
        prior_std=0.7,
        measurement_std=[0.1, 0.2],
        process_std=process,
        forgetting_factor=forgetting,
        spread=spread,
        square_root=square_root,
    )
    w, p = network.initial(0), np.diag(0.49 / network.fan_in)
    for x, y in zip(*samples(rng), strict=True):
        p = p / forgetting + process**2 * np.eye(8)
        h = np.zeros((2, 8))
        h[0, :3] = 3 * x / 2
        h[1, 3:6] = x / 2
        h[0, 6], h[1, 7] = 3.0, 1.0
        total = h @ p @ h.T + np.diag([0.01, 0.04])
        gain = p @ h.T @ np.linalg.inv(total)
        guess = np.array([1.0, 2.0]) + h @ w
        mean, covariance = learner.predict(x)
        np.testing.assert_allclose(mean, guess, atol=ROUNDING)
        np.testing.assert_allclose(covariance, total, atol=ROUNDING)
        np.testing.assert_allclose(learner.update(x, y), y - guess, atol=ROUNDING)
        np.testing.assert_allclose(learner.innovation_covariance, total, atol=ROUNDING)
        w, p = w + gain @ (y - guess), p - gain @ total @ gain.T
        np.testing.assert_allclose(learner.weights, w, atol=ROUNDING)
        np.testing.assert_allclose(learner.covariance, p, atol=ROUNDING)


def algorithm_1(network, w, p, noise, x, y):
    """Algorithm 1 of the paper, line by line; gives the new mean and covariance."""
    n = len(w)
    s = np.linalg.cholesky(p)
    xi = np.sqrt(n) * np.hstack([np.eye(n), -np.eye(n)])
    points = (s @ xi).T + w
    outputs = np.array([network(x, point) for point in points])
    guess = outputs.mean(axis=0)
    p_yy = outputs.T @ outputs / (2 * n) - np.outer(guess, guess) + noise
    p_wy = points.T @ outputs / (2 * n) - np.outer(w, guess)
    gain = p_wy @ np.linalg.inv(p_yy)
    return w + gain @ (y - guess), p - gain @ p_yy @ gain.T


@pytest.mark.parametrize("square_root", ["cholesky", "transform"])
def test_algorithm_1_written_out_plainly(square_root, rng):
    # The carried factor is the Cholesky factor itself, so even "transform" has its points.
    network = pt.DenseNetwork(3, (5, 4), 2)
    learner = pt.CubatureLearner(
        network, prior_std=0.5, measurement_std=0.1, square_root=square_root
    )
    w, p = network.initial(0), np.diag(0.25 / network.fan_in)
    for x, y in zip(*samples(rng), strict=True):
        w, p = algorithm_1(network, w, p, 0.01 * np.eye(2), x, y)
        learner.update(x, y)
        np.testing.assert_allclose(learner.weights, w, atol=ROUNDING)
        np.testing.assert_allclose(learner.covariance, p, atol=ROUNDING)


def test_filterpy_agrees(rng):
    filterpy = pytest.importorskip("filterpy.kalman", reason="filterpy is in the extra bench")
    network = pt.DenseNetwork(3, (4,), 2)
    learner = pt.CubatureLearner(network, prior_std=0.5, measurement_std=0.1)
    rival = filterpy.CubatureKalmanFilter(
        network.size, 2, 1.0, hx=lambda w: network(sample, w), fx=lambda w, dt: w
    )
    rival.x, rival.P = network.initial(0)[:, None], np.diag(0.25 / network.fan_in)
    rival.R, rival.Q = 0.01 * np.eye(2), np.zeros((network.size, network.size))
    for x, y in zip(*samples(rng, count=20), strict=True):
        sample = x
        rival.predict()
        rival.update(y[:, None])
        learner.update(x, y)
        np.testing.assert_allclose(learner.weights, rival.x.ravel(), atol=1e-7)  # its P drifts
        np.testing.assert_allclose(learner.covariance, rival.P, atol=1e-7)


@pytest.mark.parametrize(("size", "outputs"), [(1, 1), (7, 3), (20, 14), (33, 40)])
def test_a_measured_root_is_the_factor_of_the_measured_covariance(size, outputs, rng):
    root = np.tril(rng.normal(size=(size, size)))
    slopes = rng.normal(size=(size, outputs))
    factor = rng.normal(size=(outputs, outputs))
    remainder = factor @ factor.T + 0.1 * np.eye(outputs)
    total = slopes.T @ slopes + remainder
    cross = root @ slopes
    expected = root @ root.T - cross @ np.linalg.solve(total, cross.T)
    for change in (measured_root, transformed_root):
        after, product = change(root, slopes, remainder)
        np.testing.assert_allclose(after @ after.T, expected, atol=1e-10)
        np.testing.assert_allclose(product, cross, atol=1e-12)
    after = measured_root(root, slopes, remainder)[0]
    np.testing.assert_array_equal(np.triu(after, 1), 0.0)
    assert (np.diag(after) > 0).all()
    if size < 10:  # better conditioned than the squared matrix in the factorization allows
        np.testing.assert_allclose(after, lower_factor(expected), atol=1e-6)


def test_a_sharp_measurement_leaves_no_negative_variance(rng):
    # Variances of 1 measured to 1e-8: P - K P_yy K' loses all digits, the root does not.
    root, slopes = np.eye(6), rng.normal(size=(6, 2))
    after = measured_root(root, slopes, 1e-16 * np.eye(2))[0]
    sharp = np.linalg.qr(slopes)[0]
    left = np.linalg.norm(after.T @ sharp, axis=0)
    assert (left < 1e-7).all() and (np.linalg.svd(after)[1] > 0).all()
