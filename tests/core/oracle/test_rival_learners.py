"""The rivals against closed forms: Kalman filter, ridge regression, CasADi's derivatives."""

from __future__ import annotations

import copy
import pickle

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError
from patagium.learning import network_from_description
from patagium.learning.models.perceptron import Perceptron

ROUNDING = 1e-9  # fifty updates, each some n^2 roundings


def samples(rng, inputs=3, outputs=2, count=50):
    x = rng.normal(size=(count, inputs))
    return x, x @ rng.normal(size=(inputs, outputs)) + 0.1 * rng.normal(size=(count, outputs))


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
    for x, y in zip(*samples(rng), strict=True):
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


@pytest.mark.parametrize("features", [0, 7])
def test_linear_learner_is_ridge_regression(features, rng):
    base = pt.DenseNetwork(
        3, (), 2, input_center=0.3, input_scale=2.0, output_center=[1, -1], output_scale=[2, 3]
    )
    learner = pt.LinearLearner(base, prior_std=0.5, measurement_std=[0.2, 0.3], features=features)
    xs, ys = samples(rng)
    for x, y in zip(xs, ys, strict=True):
        learner.update(x, y)
    f = learner.network.encode(xs).features[:, 0]
    f = np.column_stack([f, np.ones(len(f))])
    z = (ys - base.output_center) / base.output_scale
    inverse = np.linalg.inv(f.T @ f / 0.01 + np.eye(f.shape[1]) / 0.25)
    slopes = inverse @ f.T @ z / 0.01
    predicted = learner.network.evaluate(xs, learner.weights)
    np.testing.assert_allclose(
        predicted, base.output_center + base.output_scale * (f @ slopes), atol=ROUNDING
    )
    mean, covariance = learner.predict(xs[0])
    np.testing.assert_allclose(mean, predicted[0], atol=ROUNDING)
    spread = f[0] @ inverse @ f[0]
    np.testing.assert_allclose(
        np.diag(covariance), spread * np.array([4, 9]) + [0.04, 0.09], atol=ROUNDING
    )
    _, slope = learner.network.linearized(learner.network.encode_one(xs[0]), learner.weights)
    np.testing.assert_allclose(
        slope @ learner.covariance @ slope.T + np.diag([0.04, 0.09]), covariance, atol=ROUNDING
    )
    again = network_from_description(learner.network.describe())
    np.testing.assert_array_equal(again.evaluate(xs, learner.weights), predicted)


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


@pytest.mark.parametrize("replay", [0, 8])
def test_gradient_learner_descends(replay, rng):
    network = pt.DenseNetwork(3, (6,), 2, "tanh")
    learner = pt.GradientLearner(network, learning_rate=0.02, replay=replay)
    xs, ys = samples(rng, count=1500)
    first = np.mean((ys - network.evaluate(xs, learner.weights)) ** 2)
    for x, y in zip(xs, ys, strict=True):
        learner.update(x, y)
    last = np.mean((ys - network.evaluate(xs, learner.weights)) ** 2)
    assert last < first / 20
    assert learner.covariance is None
    _, covariance = learner.predict(xs[0])
    assert 0.005 < covariance[0, 0] < 0.5  # the noise of the samples is 0.01


def make_learners():
    linear = pt.DenseNetwork(3, (), 2)
    network = pt.DenseNetwork(3, (4,), 2)
    prior = {"prior_std": 0.5, "measurement_std": 0.1}
    return {
        "extended": pt.ExtendedLearner(network, **prior),
        "gradient": pt.GradientLearner(network, learning_rate=0.01, replay=3),
        "linear": pt.LinearLearner(linear, features=5, **prior),
    }


@pytest.mark.parametrize("kind", ["extended", "gradient", "linear"])
def test_a_bad_sample_changes_nothing_and_copies_go_on_alike(kind, rng):
    learner = make_learners()[kind]
    xs, ys = samples(rng)
    for x, y in zip(xs[:20], ys[:20], strict=True):
        learner.update(x, y)
    before = learner.weights
    assert np.isnan(learner.update(xs[0], [np.inf, np.nan])).all()
    assert np.isnan(learner.update([0.0, 0.0, np.inf], ys[0])).all()
    assert (learner.events["blind"], learner.events["bad_inputs"]) == (1, 1)
    np.testing.assert_array_equal(learner.weights, before)
    assert learner.count == 20
    twins = [copy.deepcopy(learner), pickle.loads(pickle.dumps(learner))]
    for x, y in zip(xs[20:], ys[20:], strict=True):
        for one in (learner, *twins):
            one.update(x, y)
    for twin in twins:
        np.testing.assert_array_equal(twin.weights, learner.weights)
    assert learner.describe()["kind"] == kind
    assert learner.time_per_update > 0


def test_wrong_settings_are_named():
    network = pt.DenseNetwork(3, (4,), 2)
    with pytest.raises(ParameterError, match="learning_rate"):
        pt.GradientLearner(network, learning_rate=0.0)
    with pytest.raises(ParameterError, match="replay"):
        pt.GradientLearner(network, learning_rate=0.1, replay=-1)
    with pytest.raises(ParameterError, match="without hidden layers"):
        pt.LinearLearner(network, prior_std=1.0, measurement_std=1.0)
    with pytest.raises(ParameterError, match="forgetting_factor"):
        pt.ExtendedLearner(network, prior_std=1.0, measurement_std=1.0, forgetting_factor=1.1)
