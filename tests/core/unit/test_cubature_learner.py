"""The cubature learner at its door: what it keeps, what it refuses, what it survives."""

from __future__ import annotations

import copy
import json
import pickle

import numpy as np
import pytest

import patagium as pt
from patagium.errors import FilterDiverged, Outcome, ParameterError, ShapeError


@pytest.fixture(params=["compiled", "fallback"])
def engine(request, monkeypatch):
    if request.param == "fallback":
        monkeypatch.setenv("PATAGIUM_COMPILER", "none")
    return request.param


def learner_of(**options):
    network = pt.DenseNetwork(3, (4,), 2)
    setting = {"prior_std": 0.5, "measurement_std": 0.1} | options
    return pt.CubatureLearner(network, **setting)


def taught(count=20, **options):
    learner, draw = learner_of(**options), np.random.default_rng(5)
    for _ in range(count):
        learner.update(draw.normal(size=3), draw.normal(size=2))
    return learner


FORMS = [
    {},
    {"square_root": "cholesky"},
    {"process_std": 0.01, "forgetting_factor": 0.99},
    {"dtype": "float32"},
]


@pytest.mark.parametrize("options", FORMS, ids=["plain", "cholesky", "noise", "single"])
def test_a_bad_sample_changes_nothing(options, engine):
    learner = taught(**options)
    weights, covariance = learner.weights, learner.covariance
    good = np.ones(3), np.ones(2)
    for x, y in (([0, np.nan, 0], [0, 0]), ([0, 0, 0], [np.inf, np.nan])):
        assert np.isnan(learner.update(x, y)).all()
    events = learner.events
    assert (events["bad_inputs"], events["missing"], events["blind"]) == (1, 2, 1)
    assert np.isnan(learner.update([0, 0, 1e200], [0, 0])).all()
    assert learner.events["bad_inputs"] == 2 and learner.events["out_of_range"] == 1
    with pytest.raises(FilterDiverged, match="nan"):
        learner.predict([0, np.nan, 0])
    np.testing.assert_array_equal(learner.weights, weights)
    np.testing.assert_array_equal(learner.covariance, covariance)
    assert learner.count == 20
    twin = taught(**options)
    np.testing.assert_array_equal(learner.update(*good), twin.update(*good))
    np.testing.assert_array_equal(learner.weights, twin.weights)


@pytest.mark.parametrize("options", FORMS, ids=["plain", "cholesky", "noise", "single"])
def test_predicting_changes_nothing_and_copies_go_on_alike(options, engine, rng):
    learner = taught(**options)
    weights, covariance = learner.weights, learner.covariance
    learner.predict(rng.normal(size=3))
    np.testing.assert_array_equal(learner.weights, weights)
    np.testing.assert_array_equal(learner.covariance, covariance)
    frozen = copy.deepcopy(learner)
    again = pickle.loads(pickle.dumps(learner))
    for _ in range(5):
        x, y = rng.normal(size=3), rng.normal(size=2)
        expected = learner.predict(x)
        innovation = learner.update(x, y)
        np.testing.assert_allclose(y - innovation, expected[0], atol=1e-12)
        np.testing.assert_allclose(learner.innovation_covariance, expected[1], atol=1e-12)
        np.testing.assert_allclose(again.update(x, y), innovation, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(again.weights, learner.weights, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(frozen.weights, weights)
    assert (learner.count, frozen.count) == (25, 20)


def test_same_seed_same_weights_other_seed_others():
    one, two, other = taught(seed=1), taught(seed=1), taught(seed=2)
    np.testing.assert_array_equal(one.weights, two.weights)
    np.testing.assert_array_equal(one.covariance, two.covariance)
    assert np.abs(one.weights - other.weights).max() > 1e-3


def test_prior_is_divided_by_the_fan_in():
    learner = learner_of(prior_std=0.6)
    np.testing.assert_allclose(
        learner.covariance, np.diag(0.36 / learner.network.fan_in), atol=1e-15
    )
    each = np.arange(1.0, learner.network.size + 1)
    np.testing.assert_allclose(
        np.diag(learner_of(prior_std=each).covariance),
        each**2 / learner.network.fan_in,
        rtol=1e-12,
    )


def test_deviations_may_differ_by_output():
    learner = learner_of(prior_std=1e-9, measurement_std=[0.1, 0.3])
    _, covariance = learner.predict(np.zeros(3))
    np.testing.assert_allclose(covariance, np.diag([0.01, 0.09]), atol=1e-12)


def test_a_lost_covariance_is_said_and_the_state_kept():
    # Algorithm 1 cannot hold what a measurement leaves that is sharper than its rounding.
    learner = learner_of(square_root="cholesky", prior_std=100.0, measurement_std=1e-12)
    draw = np.random.default_rng(0)
    with pytest.raises(FilterDiverged, match="positive definite") as caught:
        for _ in range(200):
            before = learner.weights
            learner.update(draw.normal(size=3), draw.normal(size=2))
    assert caught.value.outcome is Outcome.COVARIANCE_LOST
    assert "measurement_std" in str(caught.value)
    np.testing.assert_array_equal(learner.weights, before)
    with pytest.raises(FilterDiverged):
        learner.predict(np.zeros(3))


def test_forgetting_without_bound_ends_in_a_sentence_not_in_nan(engine):
    learner = learner_of(forgetting_factor=1e-8)
    with pytest.raises(FilterDiverged):
        for _ in range(200):
            learner.update(np.zeros(3), np.zeros(2))
    assert np.isfinite(learner.weights).all() and np.isfinite(learner.covariance).all()


def test_it_describes_itself_and_keeps_time():
    learner = taught(spread=3**0.5, forgetting_factor=0.99)
    words = json.loads(json.dumps(learner.describe()))
    assert words["kind"] == "cubature" and words["spread"] == pytest.approx(3**0.5)
    assert words["prior_std"] == 0.5 and words["forgetting_factor"] == 0.99
    assert words["network"] == learner.network.describe()
    assert learner_of().spread == pytest.approx(learner.network.size**0.5)
    assert 1e-6 < learner.time_per_update < 1.0
    assert np.isnan(learner_of().time_per_update)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"prior_std": 0.0}, "prior_std"),
        ({"measurement_std": -1.0}, "measurement_std"),
        ({"process_std": np.nan}, "process_std"),
        ({"spread": 0.0}, "spread"),
        ({"forgetting_factor": 1.01}, "forgetting_factor"),
        ({"square_root": "qr"}, "square_root"),
        ({"dtype": "float16"}, "dtype"),
    ],
)
def test_wrong_settings_are_named(options, named):
    with pytest.raises(ParameterError, match=named):
        learner_of(**options)


def test_wrong_shapes_are_named():
    with pytest.raises(ShapeError, match="measurement_std"):
        learner_of(measurement_std=[1.0, 1.0, 1.0])
    with pytest.raises(ShapeError, match="x: expected"):
        learner_of().update(np.zeros(2), np.zeros(2))
    with pytest.raises(ShapeError, match="y: expected"):
        learner_of().update(np.zeros(3), np.zeros(3))
