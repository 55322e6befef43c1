"""The compiled extended filter against the same in NumPy, sample by sample."""

import pickle

import numpy as np
import pytest

import patagium as pt
from patagium.errors import Outcome
from patagium.learning.filters.block_kernel import structure_and_kernel
from patagium.learning.filters.numbers import filter_numbers
from patagium.learning.filters.weight_filter import WeightFilter
from patagium.learning.models import memory as module
from patagium.learning.models.memory import measured_inputs, memory_of, network_inputs
from patagium.learning.settings import FilterSettings, Misfit, NoiseEstimation, Screening
from patagium.native import compiler_name
from patagium.robot import load_robot_text

pytestmark = pytest.mark.skipif(compiler_name() is None, reason="needs a C compiler")
COUNT = 24
# sums in another order; P of a strip network that knows only its section is nearly singular
ROUNDING = 1e-8


@pytest.fixture(scope="module")
def robot():
    return load_robot_text(pt.load_robot("aerobat").source.replace("strips: 5", "strips: 2"))


@pytest.fixture(scope="module")
def states(robot):
    random, time = np.random.default_rng(2), np.linspace(0.0, 0.1, COUNT)
    phases, size = random.uniform(0, 6, 2 * robot.dof), random.uniform(0.1, 0.5, 2 * robot.dof)
    state = size * np.sin(50 * time[:, None] + phases)
    state[:, robot.dof :] *= 10
    state[:, robot.dof] += 5.0
    return time, np.hstack([state, np.gradient(state[:, robot.dof :], time, axis=0)])


NETWORKS = {
    "attached": lambda robot: pt.learning.LinearStripNetwork(robot, attached=True),
    "strip": lambda robot: pt.StripNetwork(robot, (4, 3)),
}
HOW = {
    "full": {},
    "layer": {"covariance": "layer"},
    "node": {"covariance": "node"},
    "node wanders": {"covariance": "node", "process_std": 1e-3},
    "every third": {"covariance": "every third"},
    "forgets": {"forgetting_factor": 0.95},
    "wanders": {"process_std": 1e-3},
    "screened": {"screening": Screening(3.0, 5), "noise_estimation": NoiseEstimation(20)},
    "misfit": {"misfit": Misfit()},
    "safe": {
        "prior_share": 1e-3,
        "screening": Screening(3.0, 5),
        "noise_estimation": NoiseEstimation(20),
    },
    "safe by layers": {"prior_share": 1e-3, "covariance": "layer", "process_std": 1e-3},
}


def every_third(network):
    return [np.arange(first, network.size, 3) for first in (1, 0, 2)]


def setting_of(network, size, **options):
    pt.learning.register_blocks("every third", every_third)
    settings = FilterSettings(prior_std=0.1, measurement_std=1e-2 * size, **options)
    found = filter_numbers(network, settings, "extended")
    return found, found.prior_variance**0.5


def log_of(network, states):
    random = np.random.default_rng(5)
    weights = network.initial(3) + 0.05 * random.standard_normal(network.size)
    time, seen = states
    x = network_inputs(network, weights, time, seen[:, : measured_inputs(network)])
    y = network.evaluate(x, weights)
    y += 1e-2 * np.abs(y).max() * random.standard_normal(y.shape)
    y[10, 3], y[20] = np.nan, np.nan
    y[15] *= 20.0
    return x, y


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("name", NETWORKS)
def test_sample_by_sample_it_is_the_filter_in_numpy(name, how, robot, states):
    network, rounding = NETWORKS[name](robot), ROUNDING
    x, y = log_of(network, states)
    setting, std = setting_of(network, np.nanmedian(np.abs(y), axis=0).max(), **HOW[how])
    first = network.initial(0)
    ours = WeightFilter(setting, structure_and_kernel(setting), first, std)
    theirs = WeightFilter(setting, structure_and_kernel(setting, False), first, std)
    assert ours.compiled is not None
    assert theirs.compiled is None
    for k in range(COUNT):
        theirs.resume(ours.state())  # so that rounding does not grow from sample to sample
        for one, other in zip(ours.predict(x[k]), theirs.predict(x[k]), strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=rounding * np.abs(other).max())
        outcome, _ = ours.update(x[k], y[k])
        assert outcome == theirs.update(x[k], y[k])[0]
        assert outcome == (Outcome.BLIND if k == 20 else Outcome.COMPLETED)
        apart = np.abs(ours.mean - theirs.mean).max()
        assert apart < rounding * np.abs(theirs.mean).max()
        covariance = theirs.covariance().dense()
        apart = np.abs(ours.covariance().dense() - covariance).max()
        assert apart < rounding * np.abs(covariance).max()
    np.testing.assert_allclose(ours.nis, theirs.nis, rtol=1e-8)
    for name_of, array in theirs.screen.arrays.items():
        np.testing.assert_allclose(ours.screen.arrays[name_of], array, rtol=1e-8, atol=1e-300)
    assert np.abs(ours.mean - first).max() > 1e-3


def test_a_state_of_either_goes_on_in_the_other(robot, states):
    network = NETWORKS["attached"](robot)
    x, y = log_of(network, states)
    setting, std = setting_of(network, np.nanmax(np.abs(y)))

    def made(compiled):
        return WeightFilter(
            setting, structure_and_kernel(setting, compiled), network.initial(0), std
        )

    ours, theirs = made(True), made(False)
    for k in range(9):
        ours.update(x[k], y[k])
        theirs.update(x[k], y[k])
    moved = [made(True), made(False)]
    moved[0].resume(theirs.state())
    moved[1].resume(ours.state())
    again = pickle.loads(pickle.dumps(ours))
    for one in (ours, theirs, *moved, again):
        one.update(x[9], y[9])
        np.testing.assert_allclose(one.mean, ours.mean, rtol=0, atol=1e-9)  # grown over the updates
    np.testing.assert_array_equal(again.mean, ours.mean)


def test_lags_in_one_call_are_those_step_by_step(robot, states, monkeypatch):
    network = NETWORKS["attached"](robot)
    weights = network.initial(3) + 0.05 * np.random.default_rng(4).standard_normal(network.size)
    ours, theirs = memory_of(network), memory_of(network)
    found = ours.recall(weights, *states, gaps=[12])
    monkeypatch.setattr(module, "_advanced_in_c", lambda *arguments: None)
    expected = theirs.recall(weights, *states, gaps=[12])
    np.testing.assert_array_equal(found, expected)
    for one, other in zip(ours.last, theirs.last, strict=True):
        np.testing.assert_array_equal(one, other)


def test_an_input_that_is_no_number_changes_nothing(robot, states):
    network = NETWORKS["attached"](robot)
    x, y = log_of(network, states)
    setting, std = setting_of(network, np.nanmax(np.abs(y)))
    ours = WeightFilter(setting, structure_and_kernel(setting), network.initial(0), std)
    ours.update(x[0], y[0])
    mean, covariance = ours.mean, ours.covariance().dense()
    broken = x[1].copy()
    broken[robot.dof] = np.nan
    assert ours.update(broken, y[1])[0] is Outcome.BAD_INPUT
    np.testing.assert_array_equal(ours.mean, mean)
    np.testing.assert_array_equal(ours.covariance().dense(), covariance)


def test_a_measurement_far_better_than_the_prior_is_learned_as_if_alone(robot):
    """The weights then say of y what was measured, with its noise: twice that with the next's.

    The prior takes less than 1e-4 of it where it is 1e8 times wider.
    """
    noise = 1e-8
    network = pt.learning.LinearStripNetwork(robot)
    settings = FilterSettings(prior_std=1.0, measurement_std=noise)
    setting = filter_numbers(network, settings, "extended")
    std = setting.prior_variance**0.5
    ours = WeightFilter(setting, structure_and_kernel(setting), network.initial(0), std)
    x = np.random.default_rng(1).normal(size=network.inputs)
    before = np.diag(ours.predict(x)[1])
    assert ours.update(x, np.zeros(network.outputs))[0] == Outcome.COMPLETED
    after = np.diag(ours.predict(x)[1])[before > 1e8 * noise**2] / noise**2
    assert len(after) > 3
    np.testing.assert_allclose(after, 2.0, rtol=1e-4)
