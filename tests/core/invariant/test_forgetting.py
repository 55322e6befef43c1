"""What is forgotten between samples: bounded by the prior, opened by a change, never by chance."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError
from patagium.learning.filters.screening import ChangeMonitor

TOLD = {"prior_std": 0.5, "measurement_std": 0.05, "spread": 3**0.5}
STRUCTURES = ["full", "layer", "node"]


def glide(learner, count):
    """The same state again and again: most directions of the weights are never excited."""
    x, y = np.full(3, 0.3), np.array([0.2, -0.1])
    for _ in range(count):
        learner.update(x, y)
    return learner


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("structure", STRUCTURES)
def test_no_wind_up_in_a_steady_glide(structure, dtype):
    network = pt.DenseNetwork(3, (6,), 2)
    learner = pt.CubatureLearner(
        network, covariance=structure, dtype=dtype, prior_share=0.05, **TOLD
    )
    prior = 0.25 / network.fan_in
    glide(learner, 600)  # 30 memories: as 10^6 samples with a share of 3e-5
    rounding = 1e-12 if dtype == "float64" else 1e-5
    assert (learner.variances <= prior * (1 + rounding)).all()
    beyond = np.linalg.eigvalsh(learner.covariance - np.diag(prior))
    assert beyond.max() <= rounding  # not along any direction either
    assert learner.variances.min() < 0.9 * prior.min()  # and something was learned


@pytest.mark.parametrize("structure", STRUCTURES)
def test_forgetting_alone_winds_up(structure):
    network = pt.DenseNetwork(3, (6,), 2)
    learner = pt.CubatureLearner(network, covariance=structure, forgetting_factor=0.95, **TOLD)
    glide(learner, 200)
    assert learner.variances.max() > 100 * 0.25


@pytest.mark.parametrize("structure", STRUCTURES)
def test_forgetting_what_is_learned_again_goes_on_for_ever(structure, rng):
    learner = pt.CubatureLearner(
        pt.DenseNetwork(1, (), 1),
        covariance=structure,
        dtype="float32",
        forgetting_factor=0.9,
        prior_std=0.5,
        measurement_std=0.05,
    )
    for x in rng.normal(size=(2000, 1)):  # 0.9^-2000 is beyond single precision, P is not
        learner.update(x, 2 * x + 1)
    np.testing.assert_allclose(learner.weights, [2, 1], atol=1e-3)
    assert learner.variances.max() < 0.25


@pytest.mark.parametrize("structure", STRUCTURES)
def test_the_share_of_the_prior_is_a_formula(structure):
    network = pt.DenseNetwork(3, (6,), 2)
    learner = glide(pt.CubatureLearner(network, covariance=structure, **TOLD), 5)
    prior, before = np.diag(0.25 / network.fan_in), learner.covariance
    learner.reopen(0.3)
    np.testing.assert_allclose(learner.covariance, 0.7 * before + 0.3 * prior, atol=1e-12)
    learner.reopen(1.0)
    np.testing.assert_allclose(learner.covariance, prior, atol=1e-12)
    for share in (0.0, 1.5, float("nan")):
        with pytest.raises(ParameterError, match="share"):
            learner.reopen(share)


@pytest.mark.parametrize("channels", [1, 14])
def test_false_alarms_come_at_the_rate_promised(channels, rng):
    rate, repeats, window, reference = 0.05, 3000, 8, 30
    detection = pt.learning.ChangeDetection(rate, window, reference)
    alarms = 0
    for nis in 7.0 * rng.chisquare(channels, (repeats, window + reference)):  # any factor will do
        monitor = ChangeMonitor(detection, channels)
        found = [monitor.alarmed_by(each, channels) for each in nis]
        assert not any(found[:-1])  # not before the reference is full
        alarms += found[-1]
    std = np.sqrt(rate * (1 - rate) / repeats)
    assert abs(alarms / repeats - rate) < 4 * std


def test_false_alarms_of_a_running_test_are_no_more_than_that(rng):
    rate = 0.01
    monitor = ChangeMonitor(pt.learning.ChangeDetection(rate, 10, 50), 3)
    alarms = sum(monitor.alarmed_by(each, 3) for each in rng.chisquare(3, 40_000))
    assert 0 < alarms / 40_000 < 1.2 * rate


def damaged_flight(network, rng, count):
    """A teacher's outputs, white noise on them; halfway its last layer is another."""
    weights, x = network.initial(5), rng.normal(size=(count, network.inputs))
    after = weights.copy()
    after[-22:] += rng.normal(size=22)
    half = count // 2
    y = np.vstack([network.evaluate(x[:half], weights), network.evaluate(x[half:], after)])
    return x, y + 0.05 * rng.normal(size=y.shape)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_a_change_is_found_and_learned_sooner(structure, rng):
    network = pt.DenseNetwork(3, (10,), 2, "tanh")
    x, y = damaged_flight(network, rng, 1600)
    detection = pt.learning.ChangeDetection(1e-6, window=10, reference=300, reopening=0.5)
    errors = []
    for detects in (detection, None):
        learner = pt.CubatureLearner(
            network, covariance=structure, change_detection=detects, prior_share=1e-4, **TOLD
        )
        innovation = [learner.update(*sample) for sample in zip(x, y, strict=True)]
        errors.append(np.mean(np.square(innovation[830:1000])))
        if detects is None:
            assert learner.changes == ()
        else:
            (found,) = (one for one in learner.changes if one < 1000)  # later ones are chance
            assert 800 < found <= 800 + detection.window
            assert learner.describe()["change_detection"]["window"] == 10
    assert errors[0] < 0.85 * errors[1]


@pytest.mark.parametrize(
    "wrong",
    [{"false_alarm_rate": 0}, {"window": 0}, {"reference": 1.5}, {"reopening": 0}],
)
def test_detections_out_of_range_are_refused(wrong):
    right = {"false_alarm_rate": 0.01, "window": 5, "reference": 50}
    with pytest.raises(ParameterError, match=next(iter(wrong))):
        pt.learning.ChangeDetection(**{**right, **wrong})


@pytest.mark.parametrize("share", [-0.1, 1.0, float("nan")])
def test_shares_out_of_range_are_refused(share):
    with pytest.raises(ParameterError, match="prior_share"):
        pt.CubatureLearner(pt.DenseNetwork(1, (), 1), prior_share=share, **TOLD)
