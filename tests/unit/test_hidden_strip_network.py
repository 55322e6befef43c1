"""A strip network with memory: its lags, what they may do, and who fills them in."""

import pickle

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError, ShapeError
from patagium.identification import network_from_description, stream
from patagium.identification.identify import compare
from patagium.identification.memory import StripMemory
from patagium.robot import load_robot_text

LAGS = (0.1, 0.5)


@pytest.fixture(scope="module")
def robot():
    text = pt.load_robot("aerobat").source.replace("strips: 5", "strips: 2")
    return load_robot_text(text)


@pytest.fixture(scope="module")
def network(robot):
    return pt.HiddenStripNetwork(robot, (4,), LAGS)


@pytest.fixture(scope="module")
def log(robot):
    """Time, and states that fly forward and flap, (N, 2n)."""
    random, time = np.random.default_rng(2), np.linspace(0.0, 0.1, 60)
    phases, size = random.uniform(0, 6, 2 * robot.dof), random.uniform(0.1, 0.5, 2 * robot.dof)
    state = size * np.sin(50 * time[:, None] + phases)
    state[:, robot.dof :] *= 10
    state[:, robot.dof] += 5.0
    return time, state


def recalled(network, time, state):
    """[q, v, xi] of a log."""
    return network.recall(network.initial(0), time, state)[0]


def test_memory_does_not_know_the_future(network, log):
    time, state = log
    changed = state.copy()
    changed[40:] += 1.0
    whole, other = recalled(network, time, state), recalled(network, time, changed)
    assert np.array_equal(whole[:40], other[:40])
    assert not np.allclose(whole[45], other[45])
    assert np.array_equal(recalled(network, time[:40], state[:40]), whole[:40])


def test_memory_of_a_log_is_that_of_its_samples_one_by_one(network, log):
    time, state = log
    memory = network.memory
    lags = memory.start(state[0])
    whole = memory.states(time, state)
    for k in range(1, len(time)):
        lags = memory.advance(lags, state[k - 1], state[k], time[k] - time[k - 1])
        assert np.allclose(lags, whole[k], rtol=0, atol=1e-13)  # rounding


def test_memory_begins_anew_after_a_gap(network, log):
    time, state = log
    broken = network.memory.states(time, state, gaps=[30])
    assert np.array_equal(broken[:30], network.memory.states(time, state)[:30])
    assert np.array_equal(broken[30:], network.memory.states(time[30:], state[30:]))


def test_lags_follow_their_equation(network, log, robot):
    """Halving the step of a steady flow changes nothing: exp(-2 U b t / c) holds at any step."""
    state = log[1][7]
    memory, start = network.memory, np.zeros(network.memory.size)
    once = memory.advance(start, state, state, 0.02)
    half = memory.advance(start, state, state, 0.01)
    assert np.allclose(memory.advance(half, state, state, 0.01), once, rtol=1e-12)  # rounding
    # rates of one strip: ln(1 - xi/w) in proportion to b
    left = np.log(1 - once / memory.start(state)).reshape(-1, len(LAGS))
    assert np.allclose(left[:, 1] / left[:, 0], LAGS[1] / LAGS[0], rtol=1e-10)  # rounding


@pytest.mark.parametrize("rate", [1e-6, 0.3, 1e6])
def test_lags_stay_within_what_was_met_at_any_rate_and_step(robot, log, rate):
    time, state = log
    memory = StripMemory(robot, pt.Air(), [rate])
    steady = np.array([memory.start(row) for row in state])
    for stretch in (1.0, 1e4):
        lags = memory.states(stretch * time, state)
        assert (lags >= steady.min(0) - 1e-12).all()
        assert (lags <= steady.max(0) + 1e-12).all()


def test_without_weights_on_memory_the_network_is_static(network, log):
    time, state = log
    x = recalled(network, time, state)
    weights = network.initial(0)
    first = weights[: 4 * network.perceptron.widths[0]].reshape(4, -1)
    first[:, 3:5] = 0.0  # lags of strips themselves
    first[:, 6:] = 0.0  # and as induced
    below, above = network.perceptron.widths[-2:]
    last = weights[-(below + 1) * above :][: below * above].reshape(above, below)
    last[6:] = 0.0  # coefficients times lags
    other = x.copy()
    other[:, 2 * network.robot.dof :] += 3.0
    assert np.allclose(network.evaluate(x, weights), network.evaluate(other, weights), atol=1e-14)
    remembering = network.initial(0)
    assert not np.allclose(network.evaluate(x, remembering), network.evaluate(other, remembering))


def test_mirrored_flight_makes_mirrored_forces(network, log, robot):
    time, state = log
    n = robot.dof
    mirror, sign = np.arange(n), np.ones(n)
    for name in ("y", "roll", "yaw"):
        sign[robot.index(name)] = -1
    for name in robot.dof_names:
        if name.startswith("left_"):
            left, right = robot.index(name), robot.index(name.replace("left", "right"))
            mirror[left], mirror[right] = right, left
    reflected = np.hstack([state[:, :n][:, mirror] * sign, state[:, n:][:, mirror] * sign])
    weights = network.initial(1)
    y = network.evaluate(recalled(network, time, state), weights)
    seen = network.evaluate(recalled(network, time, reflected), weights)
    assert np.allclose(seen, y[:, mirror] * sign, rtol=0, atol=1e-11 * np.abs(y).max())  # rounding


def test_slopes_are_those_of_differences(network, log):
    x = recalled(network, *log)[20]
    weights, step = network.initial(3), 1e-6
    _, slope = network.linearized(network.encode_one(x), weights)
    for k in range(0, network.size, 7):
        moved = np.zeros(network.size)
        moved[k] = step
        difference = (network(x, weights + moved) - network(x, weights - moved)) / (2 * step)
        assert np.allclose(slope[:, k], difference, atol=1e-8 * np.abs(slope).max())  # step^2


def test_it_comes_back_from_its_description(network, log):
    x = recalled(network, *log)
    weights = network.initial(0)
    y = network.evaluate(x, weights)
    again = network_from_description(network.describe())
    assert np.array_equal(again.evaluate(x, weights), y)
    assert np.array_equal(pickle.loads(pickle.dumps(network)).evaluate(x, weights), y)


def test_what_it_cannot_be_is_refused(robot, network, log):
    time, state = log
    for lags in (-1, (0.1, -0.2), (np.nan,)):
        with pytest.raises(ParameterError):
            pt.HiddenStripNetwork(robot, lags=lags)
    with pytest.raises(ParameterError):
        network.memory.advance(network.memory.start(state[0]), state[0], state[1], 0.0)
    with pytest.raises(ShapeError):
        network.memory.advance(np.zeros(1), state[0], state[1], 1e-3)
    with pytest.raises(ShapeError):
        network.memory.start(state[0][:-1])


def test_streams_and_comparisons_fill_memory_in(network, log):
    time, state = log
    full = recalled(network, time, state)
    y = network.evaluate(full, network.initial(4))
    results = []
    for x in (state, full):
        learner = pt.CubatureLearner(network, prior_deviation=0.3, measurement_deviation=0.003)
        results.append(stream(learner, time, x, y, every=5).prediction["prediction"])
        results.append(compare(learner, time, x, y).prediction["prediction"])
    assert results[0].equals(results[2])
    assert results[1].equals(results[3])
    with pytest.raises(ShapeError):
        stream(learner, time, state[:, 1:], y, every=5)
