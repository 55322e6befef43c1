"""A strip network with memory: its lags, what they may do, and what it says of the air."""

import pickle

import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.indicial import NO_STATE, TWO_STATE
from patagium.errors import ParameterError, ShapeError
from patagium.learning import network_from_description, stream
from patagium.learning.identify import compare
from patagium.learning.models.memory import memory_of, network_inputs
from patagium.robot import load_robot_text


@pytest.fixture(scope="module")
def robot():
    text = pt.load_robot("aerobat").source.replace("strips: 5", "strips: 2")
    return load_robot_text(text)


@pytest.fixture(scope="module")
def network(robot):
    return pt.learning.HiddenStripNetwork(robot, (4,))


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
    return network.initial(3) + 0.05 * np.random.default_rng(4).standard_normal(network.size)


def recalled(network, weights, time, state, **options):
    return network_inputs(network, weights, time, state, **options)


def test_memory_does_not_know_the_future(network, weights, log):
    time, state = log
    changed = state.copy()
    changed[40:] += 1.0
    whole, other = (recalled(network, weights, time, x) for x in (state, changed))
    assert np.array_equal(whole[:40], other[:40])
    assert not np.allclose(whole[45, 2 * network.robot.dof :], other[45, 2 * network.robot.dof :])


def test_blocks_make_up_the_whole_and_gaps_part_it(network, weights, log):
    time, state = log
    whole, memory, rows = recalled(network, weights, time, state), memory_of(network), []
    for part in (slice(0, 1), slice(1, 30), slice(30, 60)):
        rows.append(memory.recall(weights, time[part], state[part]))
    assert np.array_equal(np.vstack(rows), whole)
    broken = recalled(network, weights, time, state, gaps=[30])
    assert np.array_equal(broken[:30], whole[:30])
    assert np.array_equal(broken[30:], recalled(network, weights, time[30:], state[30:]))


def test_a_flow_that_was_always_there_stays(network, weights, log):
    time, state = log
    x = recalled(network, weights, time, np.repeat(state[7:8], len(time), axis=0))
    assert np.allclose(x, x[0], rtol=0, atol=1e-12)  # rounding


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_lags_stay_bounded_at_any_weights_and_step(network, log, size):
    """Rates from 1e-6 to 1e6 a semichord, steps from 2 ms to 20 s."""
    time, state = log
    for seed in range(4):
        weights = size * np.random.default_rng(seed).standard_normal(network.size)
        constants = network.constants(weights)
        assert min(value for name, value in constants.items() if "rate" in name) > 0
        for part in ("lift", "circulation"):
            assert sum(v for name, v in constants.items() if f"lags.{part}" in name) < 1
        for stretch in (1.0, 1e4):
            x = recalled(network, weights, stretch * time, state)
            lags = x[:, 2 * network.robot.dof :][:, : 4 * 2]
            assert np.abs(lags).max() < 100.0  # the fastest strip meets 60 m/s


def test_weights_of_nothing_are_the_prior(network):
    found = network.constants(np.zeros(network.size))
    assert found["lags.rate[0]"] == pytest.approx(network.lags.rate[0])
    assert found["lags.lift[1]"] == pytest.approx(network.lags.lift[1])
    assert found["lags.circulation[0]"] == pytest.approx(network.lags.circulation[0])
    assert found["section.lift_slope"] == pytest.approx(2 * np.pi)
    assert np.radians(15) < found["stall"] < np.radians(35)
    from_two = pt.learning.HiddenStripNetwork(network.robot, (4,), TWO_STATE)
    assert from_two.constants(from_two.initial(0))["lags.rate[1]"] == pytest.approx(0.3)


def test_mirrored_flight_makes_mirrored_forces(network, weights, log, robot):
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
    y, seen = (
        network.evaluate(recalled(network, weights, time, x), weights) for x in (state, reflected)
    )
    assert np.allclose(seen, y[:, mirror] * sign, rtol=0, atol=1e-11 * np.abs(y).max())  # rounding


def test_slopes_are_those_of_differences_through_all_that_was_recalled(network, weights, log):
    """At the same lags moved along their slopes, and with the whole log recalled anew."""
    time, state = log
    sample = network.encode_one(recalled(network, weights, time[:40], state[:40])[39])
    y, slope = network.linearized(sample, weights)
    assert np.allclose(network.values(sample, weights[None])[0], y, rtol=0, atol=1e-14)  # rounding
    step = 1e-5
    for k in [*range(9), *range(9, network.size, 7)]:
        moved = weights[None] + step * np.outer([1.0, -1.0], np.arange(network.size) == k)
        at = network.values(sample, moved)
        whole = [network(recalled(network, w, time[:40], state[:40])[39], w) for w in moved]
        for high, low in (at, whole):
            close = 1e-7 * np.abs(slope).max()  # step^2
            assert np.allclose(slope[:, k], (high - low) / (2 * step), rtol=0, atol=close)


def test_an_update_moves_lags_as_if_the_new_weights_had_always_held(network, weights, log):
    time, state = log
    change = 1e-5 * np.random.default_rng(1).standard_normal(network.size)
    memory, stale = memory_of(network), memory_of(network)
    for one in (memory, stale):
        one.recall(weights, time[:30], state[:30])
    memory.corrected(change)
    moved = memory.recall(weights + change, time[30:], state[30:])
    always = recalled(network, weights + change, time, state)[30:]
    never = stale.recall(weights + change, time[30:], state[30:])
    lags = slice(2 * network.robot.dof, 2 * network.robot.dof + 8)
    assert np.abs(moved - always)[:, lags].max() < 1e-7  # change squared
    assert np.abs(never - always)[:, lags].max() > 1e-6


def test_it_comes_back_from_its_description(network, weights, log):
    x = recalled(network, weights, *log)
    y = network.evaluate(x, weights)
    again = network_from_description(network.describe())
    assert np.array_equal(again.evaluate(x, weights), y)
    assert np.array_equal(pickle.loads(pickle.dumps(network)).evaluate(x, weights), y)


def test_what_it_cannot_be_is_refused(robot):
    for lags in (0, -1, NO_STATE, (0.1, 0.2)):
        with pytest.raises(ParameterError, match="lags"):
            pt.learning.HiddenStripNetwork(robot, lags=lags)
    before = {**pt.learning.HiddenStripNetwork(robot, (4,)).describe(), "lift_slope": 2 * np.pi}
    assert network_from_description(before).describe().keys() == before.keys() - {"lift_slope"}
    with pytest.raises(ParameterError, match="lift_slope"):
        network_from_description({**before, "lift_slope": 5.5})


@pytest.mark.parametrize("kind", [pt.ExtendedLearner, pt.CubatureLearner])
def test_streams_and_comparisons_recall(network, weights, log, kind):
    time, state = log
    y = network.evaluate(recalled(network, weights, time, state), weights)
    learner = kind(network, prior_std=0.1, measurement_std=1e-3 * np.abs(y).max())
    before = compare(learner, time, state, y).prediction["prediction"].values
    found = stream(learner, time, state, y, every=2).prediction["prediction"].values
    assert np.abs(found - y)[-5:].max() < 0.5 * np.abs(before - y)[-5:].max()
    with pytest.raises(ShapeError, match="x"):
        stream(learner, time, state[:, 1:], y, every=5)


def test_the_live_learner_takes_it(robot):
    from patagium.cli.learner_options import LearnerChoice, NetworkKind
    from patagium.cli.stream import _network

    choice = LearnerChoice(network=NetworkKind.HIDDEN_STRIP, hidden=(4,))
    found = _network(robot, choice, None)
    assert isinstance(found, pt.learning.HiddenStripNetwork)
    assert found.hidden == (4,)
