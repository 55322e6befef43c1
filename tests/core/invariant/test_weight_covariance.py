"""The covariance of the weights stays symmetric, positive definite and, without noise, shrinks."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt


def streams(rng, count):
    time = np.arange(count) * 1e-2
    x = np.column_stack([np.sin(3 * time), np.cos(5 * time), np.sin(0.2 * time)])
    y = np.column_stack([np.abs(x[:, 0]) - x[:, 1] ** 2, x[:, 2] * x[:, 0]])
    return x, y + 1e-3 * rng.normal(size=y.shape)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("spread", [None, 3**0.5])
def test_over_thousands_of_samples(dtype, spread, rng):
    network = pt.DenseNetwork(3, (8,), 2)
    learner = pt.CubatureLearner(
        network, prior_std=1.0, measurement_std=1e-3, spread=spread, dtype=dtype
    )
    before = learner.covariance
    for k, (x, y) in enumerate(zip(*streams(rng, 4000), strict=True)):
        learner.update(x, y)
        if k % 500 == 499:
            p = learner.covariance
            np.testing.assert_array_equal(p, p.T)
            # n^2 roundings of the root, squared by the product that forms P
            least = -1e-14 if dtype == "float64" else -1e-6
            assert np.linalg.eigvalsh(p)[0] > least * np.linalg.eigvalsh(p)[-1]
            assert (np.diag(p) > 0).all()
            slack = 1e-12 if dtype == "float64" else 1e-5
            assert np.linalg.eigvalsh(before - p)[0] > -slack * np.linalg.eigvalsh(before)[-1]
            before = p
    assert np.isfinite(learner.weights).all()


def test_process_noise_holds_the_covariance_up(rng):
    network = pt.DenseNetwork(3, (4,), 2)
    setting = {"prior_std": 0.5, "measurement_std": 1e-2}
    still = pt.CubatureLearner(network, **setting)
    restless = pt.CubatureLearner(network, process_std=1e-3, **setting)
    for x, y in zip(*streams(rng, 300), strict=True):
        still.update(x, y)
        restless.update(x, y)
    assert np.linalg.eigvalsh(restless.covariance)[0] > 1e-7
    assert np.linalg.eigvalsh(restless.covariance)[0] > np.linalg.eigvalsh(still.covariance)[0]
    assert np.trace(restless.covariance) > np.trace(still.covariance)


def test_exchanging_outputs_exchanges_predictions(rng):
    one = pt.DenseNetwork(3, (), 2)
    learners = [
        pt.CubatureLearner(one, prior_std=0.5, measurement_std=std)
        for std in ([0.1, 0.2], [0.2, 0.1])
    ]
    start = [learner.predict(np.zeros(3))[0] for learner in learners]
    np.testing.assert_allclose(start[0], start[1])
    for x, y in zip(*streams(rng, 20), strict=True):
        learners[0].update(x, y)
        learners[1].update(x, y[::-1])
    covariances = [learner.predict(np.ones(3))[1] for learner in learners]
    np.testing.assert_allclose(covariances[0], covariances[1][::-1, ::-1], atol=1e-12)
