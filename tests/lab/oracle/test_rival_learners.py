"""The learners that no filter moves against ridge regression and by their faults."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError
from patagium.learning import model_of
from patagium_lab.rivals.gradient_learner import GradientLearner
from patagium_lab.rivals.linear_learner import LinearLearner

ROUNDING = 1e-9  # fifty updates, each some n^2 roundings


def samples(rng, inputs=3, outputs=2, count=50):
    x = rng.normal(size=(count, inputs))
    return x, x @ rng.normal(size=(inputs, outputs)) + 0.1 * rng.normal(size=(count, outputs))


@pytest.mark.parametrize("features", [0, 7])
def test_linear_learner_is_ridge_regression(features, rng):
    base = pt.DenseNetwork(
        3, (), 2, input_center=0.3, input_scale=2.0, output_center=[1, -1], output_scale=[2, 3]
    )
    learner = LinearLearner(base, prior_std=0.5, measurement_std=[0.2, 0.3], features=features)
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
    model = model_of(learner)
    np.testing.assert_allclose(model.predict(xs[0])[1], covariance, rtol=1e-12)  # rounding


@pytest.mark.parametrize("replay", [0, 8])
def test_gradient_learner_descends(replay, rng):
    network = pt.DenseNetwork(3, (6,), 2, "tanh")
    learner = GradientLearner(network, learning_rate=0.02, replay=replay)
    xs, ys = samples(rng, count=1500)
    first = np.mean((ys - network.evaluate(xs, learner.weights)) ** 2)
    for x, y in zip(xs, ys, strict=True):
        learner.update(x, y)
    last = np.mean((ys - network.evaluate(xs, learner.weights)) ** 2)
    assert last < first / 20
    assert learner.covariance is None
    _, covariance = learner.predict(xs[0])
    assert 0.005 < covariance[0, 0] < 0.5  # the noise of the samples is 0.01


def test_the_linear_learner_finds_its_noise(rng):
    learner = LinearLearner(pt.DenseNetwork(2, (), 2, output_scale=2.0))
    for _ in range(600):
        x = rng.uniform(-1, 1, 2)
        learner.update(x, np.array([x[0], 2 * x[1]]) + 0.1 * rng.normal(size=2))
    # a memory of 200 samples: 5 % of the standard deviation; three times that
    assert np.allclose(learner.measurement_std, 0.1, rtol=0.15)
    assert set(learner.describe()["found"]) == {"prior_std", "measurement_std"}


MAKERS = {
    "gradient": lambda: GradientLearner(pt.DenseNetwork(3, (4,), 2), learning_rate=0.01, replay=3),
    "linear": lambda: LinearLearner(
        pt.DenseNetwork(3, (), 2), features=5, prior_std=0.5, measurement_std=0.1
    ),
}


@pytest.mark.parametrize("kind", MAKERS)
def test_a_bad_sample_changes_nothing_and_copies_go_on_alike(kind, rng):
    learner = MAKERS[kind]()
    xs, ys = samples(rng)
    for k, (x, y) in enumerate(zip(xs[:20], ys[:20], strict=True)):
        learner.update(x, y, 0.1 * k)
    before = learner.weights
    for x, y, time in (
        (xs[0], [np.inf, np.nan], 2.0),
        ([0.0, 0.0, np.inf], ys[0], 2.1),
        (xs[0], ys[0], 2.1),
        (xs[0], ys[0], 1.0),
    ):
        assert np.isnan(learner.update(x, y, time)).all()
    counted = ("blind", "bad_inputs", "duplicates", "late", "missing")
    assert [learner.events[name] for name in counted] == [1, 1, 1, 1, 2]
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


def test_a_network_with_hidden_layers_is_refused():
    with pytest.raises(ParameterError, match="without hidden layers"):
        LinearLearner(pt.DenseNetwork(3, (4,), 2))
