"""Noise between samples in every covariance structure: kernel against NumPy, P against its root."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest

import patagium as pt
from patagium.errors import Outcome
from patagium.learning.filters.block_kernel import structure_and_kernel
from patagium.learning.filters.blocks import BlockCovariances, BlockRoots
from patagium.learning.filters.numbers import filter_numbers
from patagium.learning.filters.weight_filter import WeightFilter
from patagium.learning.settings import FilterSettings, NoiseEstimation, Screening
from patagium.native import compiler_name

ROUNDING = 1e-9  # sums in another order, one sample on from the same state
STRUCTURES = ["full", "layer", "node"]
NOISES = {
    "share": {"prior_share": 1e-3},
    "wanders": {"process_std": 1e-3},
    "safe": {
        "prior_share": 1e-5,
        "process_std": 1e-4,
        "forgetting_factor": 0.999,
        "screening": Screening(3.0, 5),
        "noise_estimation": NoiseEstimation(20),
    },
}
pytestmark = pytest.mark.skipif(compiler_name() is None, reason="needs a C compiler")


def numbers_of(network, learner="cubature", **options):
    settings = {"prior_std": 0.3, "measurement_std": 0.03, "spread": 3**0.5} | options
    return filter_numbers(network, FilterSettings(**settings), learner)


def pair_of(numbers):
    first = numbers.network.initial(0)
    return [WeightFilter(numbers, structure_and_kernel(numbers, c), first) for c in (True, False)]


def samples_of(network, rng, count):
    mixing = rng.normal(size=(network.inputs, network.outputs))
    x = rng.normal(size=(count, network.inputs))
    y = np.sin(x @ mixing) + 0.03 * rng.normal(size=(count, network.outputs))
    y[count // 2, 0], y[count // 3] = np.nan, 20.0  # a channel is left out, a sample is doubted
    return x, y


@pytest.mark.parametrize("structure", STRUCTURES, ids=str)
@pytest.mark.parametrize("learner", ["cubature", "extended"])
def test_weights_that_nothing_excites_go_back_to_the_prior(learner, structure):
    """The mean of the weights decays to the prior's, as their variance does, in a copy too."""
    network = pt.DenseNetwork(2, (), 1)
    for one in pair_of(numbers_of(network, learner, covariance=structure, prior_share=0.02)):
        start = one.mean.copy()
        for _ in range(20):
            one.update(np.array([1.0, 0.0]), np.array([3.0]))
        learned, copy = one.mean[0] - start[0], deepcopy(one)
        for _ in range(600):
            for each in (one, copy):
                each.update(np.zeros(2), network.offset)
        assert 0 < abs(one.mean[0] - start[0]) < 0.02 * abs(learned)  # sqrt(.98)^600 = .0023
        np.testing.assert_allclose(copy.mean, one.mean, rtol=ROUNDING)


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("structure", STRUCTURES, ids=str)
@pytest.mark.parametrize("learner", ["cubature", "extended"])
@pytest.mark.parametrize("hidden", [(), (4,), (9, 17)])
def test_kernel_is_its_twin(hidden, learner, structure, noise, rng):
    network = pt.DenseNetwork(4, hidden, 3)
    numbers = numbers_of(network, learner, covariance=structure, **NOISES[noise])
    fast, plain = pair_of(numbers)
    for x, y in zip(*samples_of(network, rng, 12), strict=True):
        plain.resume(fast.state())
        for one, other in zip(fast.predict(x), plain.predict(x), strict=True):
            np.testing.assert_allclose(one, other, rtol=ROUNDING, atol=ROUNDING)
        assert fast.update(x, y)[0] == plain.update(x, y)[0] == Outcome.COMPLETED
        np.testing.assert_allclose(fast.mean, plain.mean, rtol=ROUNDING, atol=ROUNDING)
        apart = np.abs(fast.covariance().dense() - plain.covariance().dense()).max()
        assert apart < ROUNDING * numbers.prior_variance.max()
    for name, array in plain.screen.arrays.items():
        np.testing.assert_allclose(fast.screen.arrays[name], array, rtol=1e-8, atol=1e-300)


@pytest.mark.parametrize("measurement_std", [3e-2, 1e-6])
@pytest.mark.parametrize("learner", ["cubature", "extended"])
@pytest.mark.parametrize("structure", ["full", "layer"])
def test_covariance_itself_follows_its_square_root(structure, learner, measurement_std, rng):
    """P is a difference of matrices, S never is: what is added keeps them together."""
    network = pt.DenseNetwork(6, (), 3)  # linear: rounding is all that may part them
    numbers = numbers_of(
        network, learner, covariance=structure, prior_share=1e-6, measurement_std=measurement_std
    )
    first, rounding = network.initial(0), 1e-16 / 1e-6  # of P0, over what is added of it
    plain = (BlockCovariances(numbers), None), (BlockRoots(numbers), None)
    parts = structure_and_kernel(numbers), *plain
    filters = [WeightFilter(numbers, each, first) for each in parts]
    samples, y = rng.normal(size=(400, 6)), rng.normal(size=(400, 3))
    samples[:, 1] = samples[:, 0] + 1e-6 * samples[:, 1]  # two inputs that can hardly be told apart
    for sample in zip(samples, y, strict=True):
        assert {each.update(*sample)[0] for each in filters} == {Outcome.COMPLETED}
    covariances = [each.covariance().dense() for each in filters]
    scale = np.sqrt(np.outer(*(np.diag(covariances[2]),) * 2))
    for each, covariance in zip(filters[:2], covariances, strict=False):
        assert np.abs((covariance - covariances[2]) / scale).max() < rounding
        np.testing.assert_allclose(each.mean, filters[2].mean, rtol=0, atol=1e-8)
        assert np.linalg.eigvalsh(covariance).min() > 0
