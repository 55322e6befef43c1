"""Settings that nobody gave: found from the samples and the network, kept, in C as in Python."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import patagium as pt
from patagium.learning.filters.block_kernel import structure_and_kernel
from patagium.learning.filters.numbers import filter_numbers
from patagium.learning.filters.weight_filter import WeightFilter
from patagium.learning.learners.registry import first_difference
from patagium.learning.settings import FilterSettings
from patagium.native import compiler_name

LEARNERS = (pt.CubatureLearner, pt.ExtendedLearner)
NOISE = np.array([0.02, 0.3])


def taught(learner, rng, count=1500, scale=1.0):
    """Learner after samples of two smooth outputs, whose noise is `NOISE` times the scale."""
    for _ in range(count):
        x = rng.uniform(-1, 1, 2)
        y = np.array([x[0] + 0.5 * x[1], np.sin(2 * x[0]) - x[1]])
        learner.update(x, scale * (y + NOISE * rng.normal(size=2)))
    return learner


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_the_noise_is_found_whatever_the_unit(scale, rng):
    network = pt.DenseNetwork(2, (6,), 2, output_scale=scale)
    learner = taught(pt.ExtendedLearner(network), rng, scale=scale)
    # a memory of 200 samples: the variance to 1 / sqrt(100), the standard deviation to 5 %; three
    # times that, and the small noise may hold what the network leaves
    assert np.allclose(learner.measurement_std[1] / scale, NOISE[1], rtol=0.2)
    assert 0.8 * NOISE[0] < learner.measurement_std[0] / scale < 2.5 * NOISE[0]


def test_a_hand_set_number_overrides_one_by_one(rng):
    network = pt.DenseNetwork(2, (4,), 2)
    given = taught(pt.CubatureLearner(network, measurement_std=0.1), rng, 50)
    assert set(given.describe()["found"]) == {"prior_std"}
    assert np.array_equal(given.measurement_std, [0.1, 0.1])
    half = taught(pt.CubatureLearner(network, prior_std=0.5), rng, 50)
    assert set(half.describe()["found"]) == {"measurement_std"}
    whole = taught(pt.CubatureLearner(network, prior_std=0.5, measurement_std=0.1), rng, 50)
    assert "found" not in whole.describe()


def test_nothing_is_known_before_the_first_sample():
    network = pt.DenseNetwork(2, (4,), 2, output_scale=[3.0, 1.0])
    learner = pt.ExtendedLearner(network)
    assert np.isnan(learner.measurement_std).all()
    assert "measurement_std" not in learner.describe()["found"]
    _, covariance = learner.predict(np.zeros(2))  # by the network's own scale
    assert np.isfinite(covariance).all()


def test_an_output_that_is_silent_is_weighed_by_the_scale_of_the_network():
    """Rounding noise of an output must not claim the hidden layer for itself."""
    rng = np.random.default_rng(0)
    network = pt.DenseNetwork(2, (6,), 2)
    learner = pt.ExtendedLearner(network)
    for _ in range(400):
        x = rng.uniform(-1, 1, 2)
        learner.update(x, [np.sin(2 * x[0]) - x[1], 1e-17 * rng.normal()])
    x = rng.uniform(-1, 1, (200, 2))
    error = network.evaluate(x, learner.weights)[:, 0] - (np.sin(2 * x[:, 0]) - x[:, 1])
    assert error.std() < 0.25  # 0.17 without the second output; 4 where rounding noise rules


@pytest.mark.parametrize("make", LEARNERS)
def test_what_was_found_is_described_and_kept(make, rng, tmp_path):
    network = pt.DenseNetwork(2, (4,), 2)
    learner = taught(make(network), rng, 60)
    description = learner.describe()
    assert description["found"]
    learner.save(tmp_path / "learner.state")
    resumed = pt.learning.load_learner(tmp_path / "learner.state", like=make(network))
    twins = [resumed, pickle.loads(pickle.dumps(learner)), copy.deepcopy(learner)]
    for twin in twins:
        assert twin.describe() == description
    for one in (learner, *twins):
        taught(one, np.random.default_rng(3), 40)
        assert np.array_equal(one.weights, learner.weights)


def test_what_was_found_is_no_difference_of_settings(rng):
    network = pt.DenseNetwork(2, (4,), 2)
    fresh, old = (pt.ExtendedLearner(network) for _ in range(2))
    assert first_difference(taught(old, rng, 30).describe(), fresh.describe()) is None


@pytest.mark.parametrize("structure", ["full", "layer", "node"])
@pytest.mark.parametrize("kind", ["cubature", "extended"])
def test_kernels_find_the_noise_as_their_twins(structure, kind, rng):
    if compiler_name() is None:
        pytest.skip("no C compiler here")
    network = pt.DenseNetwork(3, (5,), 2)
    network.levers = np.array([[0.0, 1.0, 0.1], [9.0, 0.0, 9.0]]), rng.uniform(size=(2, 3))
    numbers = filter_numbers(network, FilterSettings(covariance=structure), kind)
    fast, plain = (
        WeightFilter(numbers, structure_and_kernel(numbers, compiled), network.initial(0))
        for compiled in (True, False)
    )
    for k in range(80):
        x, y = rng.normal(size=3), rng.normal(size=2) * (1.0 if k < 50 else 30.0)  # it grows
        if k % 7 == 0:
            y[1] = np.nan
        assert fast.update(x, y)[0] == plain.update(x, y)[0]
        np.testing.assert_allclose(fast.mean, plain.mean, rtol=1e-7, atol=1e-9)  # 80 samples on
        for name, array in fast.screen.arrays.items():
            np.testing.assert_allclose(
                array, plain.screen.arrays[name], rtol=1e-7, atol=1e-9, err_msg=name
            )


def test_a_strip_network_learns_without_settings():
    """As well as with the numbers of the first quick start, 3e-3 after a second."""
    robot = pt.load_robot("aerobat")
    flight = pt.simulate(
        robot,
        pt.QuasiSteady(robot),
        pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5),
        duration=1.0,
        time_step=1e-3,
        q=robot.coordinates(pitch=0.1),
        v=robot.coordinates(x=4.0),
    )
    learner = pt.ExtendedLearner(pt.StripNetwork(robot))
    scores = pt.identify(flight, learner, every=2).scores
    assert scores["nmse_second_half_worst"] < 3e-3
    assert min(v for v in scores["coverage_by_output"].values() if np.isfinite(v)) > 0.9


def test_numbers_of_numpy_are_numbers():
    """`NoiseEstimation(np.int64(50))` expected a whole number and found 50."""
    settings = pt.learning.NoiseEstimation(np.int64(50)), pt.learning.Screening(np.float32(5), 50)
    assert settings[0].memory == 50 and settings[1].outlier_std == 5.0
    network = pt.DenseNetwork(3, np.array([4, 3]), 1)
    assert network.hidden == (4, 3)
    learner = pt.CubatureLearner(network, forgetting_factor=np.float32(0.5))
    assert learner.settings.forgetting_factor == 0.5
