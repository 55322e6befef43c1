"""A dense network with hidden states: memory, slopes through it, what it may and may not do."""

import pickle

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError
from patagium.learning import network_from_description, stream
from patagium.learning.models.memory import memory_of, network_inputs
from patagium.robot import load_robot_text


@pytest.fixture(scope="module")
def robot():
    text = pt.load_robot("aerobat").source.replace("strips: 5", "strips: 2")
    return load_robot_text(text)


@pytest.fixture(scope="module")
def network(robot):
    return pt.learning.HiddenFlowNetwork(robot, (5,), 3, (4,))


@pytest.fixture(scope="module")
def log(robot):
    """Time, and states that fly forward and flap, (N, 2n)."""
    random, time = np.random.default_rng(2), np.linspace(0.0, 0.1, 60)
    phases, size = random.uniform(0, 6, 2 * robot.dof), random.uniform(0.1, 0.5, 2 * robot.dof)
    state = size * np.sin(50 * time[:, None] + phases)
    state[:, robot.dof :] *= 10
    state[:, robot.dof] += 5.0
    return time, state


@pytest.fixture(scope="module")
def weights(network):
    return network.initial(3) + 0.1 * np.random.default_rng(4).standard_normal(network.size)


def test_slopes_go_through_all_that_was_remembered(network, weights, log):
    time, state = log

    def last(w):
        return network(network_inputs(network, w, time, state)[-1], w)

    row = network_inputs(network, weights, time, state)[-1]
    y, slopes = network.linearized(network.encode_one(row), weights)
    np.testing.assert_allclose(y, last(weights), atol=1e-12)  # rounding
    differences = np.empty_like(slopes)
    for k in range(network.size):
        step = np.zeros(network.size)
        step[k] = 1e-6
        differences[:, k] = (last(weights + step) - last(weights - step)) / 2e-6
    # central differences: rounding over the step
    np.testing.assert_allclose(slopes, differences, atol=1e-8 * np.abs(slopes).max())
    assert (np.abs(slopes) > 0).any(axis=0).all()  # every weight moves an output


def test_values_at_points_are_those_of_the_network(network, weights, log):
    row = network_inputs(network, weights, *log)[-1]
    points = weights + 0.1 * np.random.default_rng(5).standard_normal((4, network.size))
    found = network.values(network.encode_one(row), points)
    expected = [network(row, point) for point in points]
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(found).max())  # rounding


def test_blocks_make_up_the_whole_gaps_part_it_and_the_future_is_unknown(network, weights, log):
    time, state = log
    memory, rows = memory_of(network), []
    whole = network_inputs(network, weights, time, state)
    for part in (slice(0, 1), slice(1, 30), slice(30, 60)):
        rows.append(memory.recall(weights, time[part], state[part]))
    np.testing.assert_allclose(np.vstack(rows), whole, rtol=1e-12)  # rounding
    changed = state.copy()
    changed[40:] += 1.0
    assert np.array_equal(network_inputs(network, weights, time, changed)[:40], whole[:40])
    broken = network_inputs(network, weights, time, state, gaps=[30])
    alone = network_inputs(network, weights, time[30:], state[30:])
    np.testing.assert_allclose(broken[30:], alone, rtol=1e-12)  # rounding


def test_hidden_states_stay_within_what_drove_them_at_any_weights(network, log):
    time, state = log
    for seed in range(5):
        wild = 20.0 * np.random.default_rng(seed).standard_normal(network.size)
        assert (network.rates(wild) > 0).all()
        rows = network_inputs(network, wild, 100.0 * time, state)
        hidden = rows[:, network.measured_inputs : network.measured_inputs + 3]
        drives = [network_inputs(network, wild, time[:1], x[None])[0] for x in state]
        driven = np.array(drives)[:, network.measured_inputs : network.measured_inputs + 3]
        room = 1e-9 * np.abs(driven).max()
        assert (hidden >= driven.min(axis=0) - room).all()
        assert (hidden <= driven.max(axis=0) + room).all()


def test_memory_moves_with_the_weights(network, weights, log):
    """What is carried after an update is what would have been recalled, to first order."""
    time, state = log
    change = 1e-5 * np.random.default_rng(6).standard_normal(network.size)
    memory, other = memory_of(network), memory_of(network)
    memory.recall(weights, time[:40], state[:40])
    other.recall(weights + change, time[:40], state[:40])
    memory.corrected(change)
    (moved,), (expected,) = memory.states, other.states
    # change squared, also of drives and logarithms of rates behind the states
    np.testing.assert_allclose(moved.state, expected.state, atol=1e-8)


@pytest.mark.parametrize("kind", [pt.ExtendedLearner, pt.CubatureLearner])
def test_learners_take_it(kind, network, log):
    time, state = log
    options = {} if kind is pt.ExtendedLearner else {"spread": 1.7}
    learner = kind(network, prior_std=1.0, measurement_std=0.01, **options)
    truth = network.initial(9)
    y = network.evaluate(network_inputs(network, truth, time, state), truth)
    found = stream(learner, time, state, y, every=2)
    assert found.scores["outcome"] == "COMPLETED"
    late = slice(40, None)
    wrong = found.prediction["prediction"].values[late] - y[late]
    untaught = network.initial(0)
    before = (
        network.evaluate(network_inputs(network, untaught, time, state), untaught)[late] - y[late]
    )
    assert (wrong**2).mean() < 0.2 * (before**2).mean()


def test_description_and_pickle_make_it_again(network, weights, log):
    for again in (
        network_from_description(network.describe()),
        pickle.loads(pickle.dumps(network)),
    ):
        rows = [network_inputs(net, weights, *log) for net in (network, again)]
        assert np.array_equal(*rows)


@pytest.mark.parametrize("states", [0, 1.5])
def test_states_that_cannot_be_are_refused(robot, states):
    with pytest.raises(ParameterError, match="states"):
        pt.learning.HiddenFlowNetwork(robot, states=states)
