"""Covariance structures of a user: blocks of weights by a function of the network."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError
from patagium.learning.filters.block_kernel import structure_and_kernel
from patagium.learning.filters.numbers import filter_numbers
from patagium.learning.filters.weight_filter import WeightFilter
from patagium.learning.settings import FilterSettings

NETWORK = pt.DenseNetwork(2, (3,), ["a", "b"], "tanh")


def learned(structure: str) -> pt.CubatureLearner:
    learner = pt.CubatureLearner(NETWORK, prior_std=1.0, measurement_std=0.1, covariance=structure)
    for x in np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2)):
        learner.update(x, [x[0], x[0] * x[1]])
    return learner


@pytest.mark.parametrize("given", ["full", "layer"])
def test_the_same_blocks_under_an_own_name_learn_the_same(given: str, tmp_path) -> None:
    blocks = {
        "full": lambda network: [np.arange(network.size)],
        "layer": lambda network: [np.concatenate(list(layer)) for layer in network.neurons],
    }
    pt.learning.register_blocks(f"own {given}", blocks[given])
    ours, theirs = learned(f"own {given}"), learned(given)
    np.testing.assert_array_equal(ours.weights, theirs.weights)
    np.testing.assert_array_equal(ours.covariance, theirs.covariance)
    ours.save(tmp_path / "own.state")
    np.testing.assert_array_equal(pt.load_learner(tmp_path / "own.state").weights, ours.weights)


def last_layer_whole(network):
    *hidden, last = network.neurons
    return [*(neuron for layer in hidden for neuron in layer), np.concatenate(list(last))]


def halves(network):
    return np.split(np.arange(network.size), [network.size // 2])


@pytest.mark.parametrize("blocks", [last_layer_whole, halves])
@pytest.mark.parametrize("learner", ["cubature", "extended"])
def test_own_blocks_learn_as_in_numpy(blocks, learner: str) -> None:
    """Weights of a block need not follow each other, nor fill their layer."""
    pt.learning.register_blocks(blocks.__name__, blocks)
    settings = FilterSettings(measurement_std=0.1, covariance=blocks.__name__)
    numbers = filter_numbers(NETWORK, settings, learner)
    ours, theirs = (
        WeightFilter(numbers, structure_and_kernel(numbers, compiled), NETWORK.initial(0))
        for compiled in (True, False)
    )
    for x in np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2)):
        for one in (ours, theirs):
            one.update(x, np.array([x[0], x[0] * x[1]]))
    np.testing.assert_allclose(ours.mean, theirs.mean, rtol=1e-9)  # rounding, 20 samples


def test_blocks_that_leave_a_weight_out_are_refused() -> None:
    pt.learning.register_blocks("own half", lambda network: [np.arange(network.size // 2)])
    with pytest.raises(ParameterError, match="each of 17 weights in one block"):
        learned("own half")


def test_names_of_the_package_stay_its_own() -> None:
    with pytest.raises(ParameterError, match="one of its own"):
        pt.learning.register_blocks("full", lambda network: [])
