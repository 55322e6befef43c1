"""A log recalled in blocks is the log recalled at once, and stays so across an update."""

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ShapeError
from patagium.learning.long_log import identify_record
from patagium.learning.models.memory import memory_of, network_inputs, replay
from patagium.learning.models.network import Network
from patagium.learning.models.perceptron import as_perceptron
from patagium.learning.models.structure import blocks_of
from patagium.learning.stream import Samples, stream
from patagium.learning.tuning.prediction_score import Flown
from patagium.learning.tuning.prediction_score import score_predictions as predict
from patagium.sensing.logs.table import LogTable


class Lag(Network):
    """y = gain z, z <- a z + (1 - a) x with a = 1/(1 + exp(-w)); x_full = [x, z, S, w]."""

    size, measured_inputs, inputs, output_names, outputs, hidden = 2, 1, 4, ("y",), 1, ()
    lag_equations = property(lambda self: self)
    measured, states, parameters, carried, compiled = 1, 1, 1, (1, 0), None

    def evaluate(self, x, weights):
        state = x[:, 1] + x[:, 2] * (weights[0] - x[:, 3])
        return (weights[1] * state)[:, None]

    def begin(self, x, weights):
        return x, np.zeros((1, 1)), np.zeros(0)

    def step(self, x, weights, time_step, before):
        keep = 1 / (1 + np.exp(-weights[0]))
        slope = keep * before.sensitivity + keep * (1 - keep) * (before.state - x)
        return keep * before.state + (1 - keep) * x, slope, np.zeros(0)


LAG, WEIGHTS = Lag(), np.array([0.5, 1.0])
TIME, SIGNAL = np.arange(20) * 0.1, np.sin(np.arange(20.0))[:, None]


@pytest.mark.parametrize("gaps", [(), (7,)])
def test_blocks_make_up_the_whole(gaps):
    whole = network_inputs(LAG, WEIGHTS, TIME, SIGNAL, gaps)
    memory = replay(LAG, TIME, SIGNAL, gaps)
    ahead = memory.ahead(15, WEIGHTS)
    parts = [memory.upto(end, WEIGHTS) for end in (1, 7, 8, 20)]
    assert np.array_equal(np.vstack(parts), whole)
    assert np.array_equal(ahead, whole[:15])
    assert not gaps or np.array_equal(
        whole[7:9], network_inputs(LAG, WEIGHTS, TIME[7:9], SIGNAL[7:9])
    )


def test_an_update_moves_what_is_remembered_along_its_slopes():
    """Of a small change: as if the new weights had held from the start, but for its square."""
    change = np.array([1e-4, 0.3])
    memory = replay(LAG, TIME, SIGNAL)
    memory.upto(10, WEIGHTS)
    memory.corrected(change)
    moved = memory.upto(20, WEIGHTS + change)[:, 1:3]
    always = network_inputs(LAG, WEIGHTS + change, TIME, SIGNAL)[10:, 1:3]
    never = network_inputs(LAG, WEIGHTS, TIME, SIGNAL)[10:, 1:3]
    assert np.abs(moved - always)[0, 0] < 1e-8  # change squared
    assert np.abs(never - always)[0, 0] > 1e-6


def test_a_stream_recalls_with_the_weights_it_has():
    """Weights change at every used sample; what was predicted follows from them by hand."""

    class Clerk:
        network, variances, time_per_update, events = LAG, None, 0.0, {}

        def __init__(self):
            self.weights = WEIGHTS.copy()

        def predict(self, x):
            return LAG.evaluate(x[None], self.weights)[0], np.eye(1)

        def update(self, x, y, time=None):
            assert x.shape == (4,)
            self.weights = self.weights + np.array([0.02, 0.1])
            return np.zeros(1)

    found = stream(Clerk(), TIME, SIGNAL, np.cos(TIME)[:, None], every=5, horizons={"far": 0.3})
    expected, weights, memory, begin = [], WEIGHTS, memory_of(LAG), 0
    for end in (1, 6, 11, 16, 20):
        rows = memory.recall(weights, TIME[begin:end], SIGNAL[begin:end])
        expected.append(LAG.evaluate(rows, weights))
        memory.corrected(np.array([0.02, 0.1]))
        weights, begin = weights + np.array([0.02, 0.1]), end
    assert np.allclose(found.prediction["prediction"], np.vstack(expected), rtol=1e-13)  # rounding
    with pytest.raises(ShapeError, match="x"):
        stream(Clerk(), TIME, np.hstack([SIGNAL] * 2), np.cos(TIME)[:, None], every=5)


class Record:
    """A long log of one input and one output."""

    count, gap, path = 20, 3.0, None

    def time(self, begin=0, end=20):
        return TIME[begin:end]

    def of_role(self, role):
        return ("y",)

    def table(self, begin, end):
        span = slice(begin, end)
        y = np.cos(TIME[span])[:, None]
        names, unit, spans = (("x",), ("y",)), ("1",), (np.array([[-1.0, 1.0]]),) * 2
        return LogTable(
            TIME[span], SIGNAL[span], y, *names, unit, unit, *spans, np.array([], int), 3.0, ""
        )


def test_blocks_of_a_long_log_remember_those_before():
    class Clerk:
        network, variances, time_per_update, events = LAG, None, 0.0, {}
        weights = WEIGHTS.copy()

        def predict(self, x):
            return LAG.evaluate(x[None], self.weights)[0], np.eye(1)

        def update(self, x, y, time=None):
            self.weights = self.weights + np.array([0.02, 0.1])
            return np.zeros(1)

        def describe(self):
            return {"kind": "clerk", "network": {"kind": "lag"}}

    whole = stream(Clerk(), TIME, SIGNAL, np.cos(TIME)[:, None], every=1)
    parts = identify_record(Record(), Clerk(), every=1, block=10)
    count = parts.prediction.sizes["time"]
    assert count < 20  # the last block
    found = parts.prediction["prediction"].values
    expected = whole.prediction["prediction"].values[-count:]
    np.testing.assert_allclose(found, expected, rtol=1e-13)  # rounding
    assert parts.scores["nmse"]["y"] == pytest.approx(whole.scores["nmse"]["y"], rel=1e-9)


def test_what_lies_between_used_samples_is_foreseen_with():
    seen = []

    class Clerk:
        network, weights, innovation_covariance = LAG, WEIGHTS, np.eye(1)

        def update(self, x, y, time=None):
            seen.append(x)
            return y - LAG.evaluate(x[None], WEIGHTS)[0]

    used = np.arange(0, 20, 5)
    log = Samples(TIME, SIGNAL, np.arange(20.0)[:, None], np.zeros(0, int))
    predict(Clerk(), Flown(log, used, np.ones((4, 1), bool), "a log"))
    assert np.array_equal(seen, network_inputs(LAG, WEIGHTS, TIME, SIGNAL)[::5])


def test_neurons_and_values_are_those_of_the_perceptron():
    network = pt.DenseNetwork(3, (4,), 2)
    assert [len(b) for b in blocks_of(network, "node")] == [4] * 4 + [5] * 2
    assert [len(b) for b in blocks_of(network, "layer")] == [16, 10]
    assert sorted(np.concatenate(blocks_of(network, "node"))) == list(range(network.size))
    x, points = np.ones(3), np.array([network.initial(0), network.initial(1)])
    values = network.values(network.encode_one(x), points)
    assert np.allclose(values, [network(x, w) for w in points], rtol=1e-14)  # rounding
    with pytest.raises(TypeError, match="Lag"):
        as_perceptron(LAG)
