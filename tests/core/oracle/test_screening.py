"""Samples with faults: the compiled filters against their twins, missing channels against none."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.errors import Outcome
from patagium.learning.filters.block_kernel import structure_and_kernel
from patagium.learning.filters.blocks import blocks_in
from patagium.learning.filters.numbers import filter_numbers
from patagium.learning.filters.weight_covariance import scattered
from patagium.learning.filters.weight_filter import WeightFilter
from patagium.learning.settings import FilterSettings
from patagium.native import compiler_name

WATCHFUL = {
    "screening": pt.learning.Screening(outlier_std=3.0, stuck_samples=4),
    "noise_estimation": pt.learning.NoiseEstimation(30),
    "change_detection": pt.learning.ChangeDetection(1e-2, 5, 12),
}
STRUCTURES = ["full", "layer", "node"]


def pair(network, structure, rng, **watchful):
    """The compiled filter and its twin."""
    settings = FilterSettings(
        prior_std=1.0,
        measurement_std=0.1,
        spread=3**0.5,
        forgetting_factor=0.999,
        covariance=structure,
        **watchful,
    )
    setting = filter_numbers(network, settings, "cubature")
    mean, std = network.initial(0), rng.uniform(0.2, 0.6, network.size)
    if compiler_name() is None:
        pytest.skip("no C compiler here")
    return [
        WeightFilter(setting, structure_and_kernel(setting, compiled), mean, std)
        for compiled in (True, False)
    ]


def faulty_samples(network, rng, count):
    """Times, inputs and measurements with everything that a sensor does wrong."""
    time = np.arange(count) * 1e-3
    x, y = rng.normal(size=(count, network.inputs)), rng.normal(size=(count, network.outputs))
    y[rng.random(y.shape) < 0.1] = np.nan
    y[rng.random(y.shape) < 0.05] *= 1e3
    y[7] = 1e300
    y[11] = np.nan
    y[20:40, 0] = 0.123
    x[rng.random(count) < 0.05, 0] = np.inf
    time[13], time[14], time[15] = time[12], 0.001, np.inf
    time[50:] -= 0.03  # the clock goes back
    return time, x, y


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize(
    ("inputs", "hidden", "outputs"), [(3, (5,), 2), (4, (3, 3, 2), 9), (8, (11,), 14)]
)
def test_kernels_screen_as_their_twins(structure, inputs, hidden, outputs, rng):
    network = pt.DenseNetwork(inputs, hidden, outputs)
    fast, plain = pair(network, structure, rng, **WATCHFUL)
    outcomes = set()
    for stamp, x, y in zip(*faulty_samples(network, rng, 90), strict=True):
        fast.screen.numbers[0] = plain.screen.numbers[0] = stamp
        outcome = fast.update(x, y)[0]
        assert outcome == plain.update(x, y)[0]
        outcomes.add(outcome)
        assert fast.screen.events == plain.screen.events
        np.testing.assert_allclose(fast.mean, plain.mean, rtol=1e-9, atol=1e-11)  # 90 samples on
        for name, array in fast.screen.arrays.items():
            other = plain.screen.arrays[name]
            np.testing.assert_allclose(array, other, rtol=1e-9, atol=1e-11, err_msg=name)
    fast_root, plain_root = (scattered(one.kept(), blocks_in(one.numbers)) for one in (fast, plain))
    np.testing.assert_allclose(fast_root, plain_root, rtol=1e-9, atol=1e-11)
    refusals = {Outcome.BAD_INPUT, Outcome.LATE, Outcome.DUPLICATE, Outcome.BLIND}
    assert outcomes == {Outcome.COMPLETED, *refusals}
    events = fast.screen.events
    assert all(events[name] for name in ("missing", "outliers", "stuck", "clock_resets")), events


@pytest.mark.parametrize("learner", [pt.CubatureLearner, pt.ExtendedLearner])
@pytest.mark.parametrize("structure", STRUCTURES)
def test_a_missing_channel_is_one_of_boundless_noise(learner, structure, rng):
    network = pt.DenseNetwork(3, (5,), 3)
    told = {"prior_std": 0.5, "covariance": structure}
    missing = learner(network, measurement_std=0.1, **told)
    noisy = learner(network, measurement_std=[0.1, 1e9, 0.1], **told)
    for _ in range(30):
        x, y = rng.normal(size=3), rng.normal(size=3)
        noisy.update(x, y)
        y[1] = np.nan
        innovation = missing.update(x, y)
        assert np.array_equal(np.isnan(innovation), [False, True, False])
    # 1e9^2 against 1: what is left of it in double precision
    np.testing.assert_allclose(missing.weights, noisy.weights, atol=1e-9)
    np.testing.assert_allclose(missing.covariance, noisy.covariance, atol=1e-9)
    assert missing.events["missing"] == 30


@pytest.mark.parametrize("structure", STRUCTURES)
def test_an_outlier_is_a_sample_of_more_noise(structure, rng):
    """The noise of a channel beyond the limit is raised until its innovation is at the limit."""
    network, limit = pt.DenseNetwork(3, (5,), 2), 4.0
    told = {"prior_std": 0.5, "covariance": structure}
    screened = pt.CubatureLearner(
        network, measurement_std=0.1, screening=pt.learning.Screening(limit), **told
    )
    x, y = rng.normal(size=3), np.array([0.1, 60.0])
    mean, covariance = screened.predict(x)
    raised = (y[1] - mean[1]) ** 2 / limit**2 - covariance[1, 1] + 0.01
    noisier = pt.CubatureLearner(network, measurement_std=[0.1, raised**0.5], **told)
    screened.update(x, y)
    noisier.update(x, y)
    assert screened.events["outliers"] == 1
    np.testing.assert_allclose(screened.weights, noisier.weights, rtol=1e-10)  # rounding
    np.testing.assert_allclose(screened.covariance, noisier.covariance, rtol=1e-10, atol=1e-14)
