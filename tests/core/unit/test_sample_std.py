"""A measurement's own deviation is noise on top of the learner's, in every filter, once."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError, ShapeError
from patagium.learning import stream
from patagium.learning.stream import used_samples

OUTPUTS = ("lift", "drag")
KINDS = {
    "cubature": (pt.CubatureLearner, {}),
    "algorithm 1": (pt.CubatureLearner, {"square_root": "cholesky"}),
    "layers": (pt.CubatureLearner, {"covariance": "layer"}),
    "nodes": (pt.CubatureLearner, {"covariance": "node"}),
    "extended": (pt.ExtendedLearner, {}),
    "extended nodes": (pt.ExtendedLearner, {"covariance": "node"}),
}


def learner(kind: str, std: float | tuple[float, float], **more: object):
    network = pt.DenseNetwork(3, (5,), OUTPUTS)
    make, options = KINDS[kind]
    return make(network, prior_std=0.5, measurement_std=std, **options, **more)


def samples(rng: np.random.Generator, count: int = 12) -> tuple[np.ndarray, np.ndarray]:
    return rng.standard_normal((count, 3)), rng.standard_normal((count, 2))


@pytest.mark.parametrize("compiler", ["", "none"])
@pytest.mark.parametrize("kind", KINDS)
def test_it_adds_to_the_learners_own_noise(kind, compiler, rng, monkeypatch) -> None:
    monkeypatch.setenv("PATAGIUM_COMPILER", compiler)
    x, y = samples(rng)
    one, other = learner(kind, (0.3, 0.6)), learner(kind, (0.5, 0.6))
    extra = (0.4, 0.0)  # 3, 4, 5
    for k in range(len(x)):
        for ours, theirs in zip(one.predict(x[k], extra), other.predict(x[k]), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12)
        first, second = one.update(x[k], y[k], None, extra), other.update(x[k], y[k])
        np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(one.weights, other.weights, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(one.measurement_std, (0.3, 0.6))  # as it was given


@pytest.mark.parametrize("kind", ["cubature", "nodes"])
def test_it_adds_to_noise_that_is_estimated(kind, rng, monkeypatch) -> None:
    x, _ = samples(rng, 600)
    size = np.where(np.arange(600) % 2, 0.0, 2.0)[:, None] * [1.0, 1.0]
    y = 0.3 * rng.standard_normal((600, 2)) + size * rng.standard_normal((600, 2))
    taught = {}
    for compiler in ("", "none"):
        monkeypatch.setenv("PATAGIUM_COMPILER", compiler)
        one = learner(kind, 0.5, noise_estimation=pt.learning.NoiseEstimation(100))
        for k in range(600):
            one.update(x[k], y[k], None, size[k])
        taught[compiler] = one
        # half of the samples are of the learner's own noise; a memory of 100: 20 %
        np.testing.assert_allclose(one.measurement_std, 0.3, rtol=0.3)
    weights = [one.weights for one in taught.values()]
    np.testing.assert_allclose(*weights, rtol=1e-6, atol=1e-9)
    deaf = learner(kind, 0.5, noise_estimation=pt.learning.NoiseEstimation(100))
    for k in range(600):
        deaf.update(x[k], y[k])
    assert (deaf.measurement_std > 1.0).all()  # what it is told is not what it finds


def test_a_sample_without_trust_teaches_nothing(rng) -> None:
    x, y = samples(rng, 1)
    taught = learner("cubature", 0.1)
    before = taught.weights
    taught.update(x[0], y[0], None, (1e6, 1e6))
    np.testing.assert_allclose(taught.weights, before, atol=1e-9)


def test_a_missing_channel_needs_no_std(rng) -> None:
    x, _ = samples(rng, 1)
    one, other = learner("cubature", 0.1), learner("cubature", 0.1)
    one.update(x[0], (1.0, np.nan), None, (0.0, np.nan))
    other.update(x[0], (1.0, np.nan))
    np.testing.assert_array_equal(one.weights, other.weights)


def test_what_cannot_be_is_refused(rng) -> None:
    x, y = samples(rng, 1)
    taught = learner("cubature", 0.1)
    with pytest.raises(ShapeError, match="std"):
        taught.update(x[0], y[0], None, (1.0,))
    with pytest.raises(ParameterError, match="zero or more"):
        taught.update(x[0], y[0], None, (-1.0, 1.0))


def test_a_stream_hands_it_on(rng) -> None:
    x, y = samples(rng, 40)
    time, extra = np.arange(40.0), np.abs(rng.standard_normal((40, 2)))
    one, other = learner("cubature", 0.1), learner("cubature", 0.1)
    stream(one, time, x, y, every=2, std=extra)
    for k in used_samples(y, 2):
        other.update(x[k], y[k], time[k], extra[k])
    np.testing.assert_array_equal(one.weights, other.weights)
    with pytest.raises(ShapeError, match="std"):
        stream(one, time, x, y, every=2, std=extra[:, :1])


def test_what_is_no_option_is_refused(rng) -> None:
    network = pt.DenseNetwork(2, (), 1)
    x, y, time = rng.normal(size=(20, 2)), rng.normal(size=(20, 1)), np.arange(20.0)
    told = {"prior_std": 1.0, "measurement_std": 0.1}
    with pytest.raises(TypeError, match="unexpected keyword argument 'horizon'"):
        stream(pt.CubatureLearner(network, **told), time, x, y, every=1, horizon={})
