"""Networks with memory learned live, packet by packet, against the same samples as a log."""

import copy
import pickle

import numpy as np
import pytest

import patagium as pt
from patagium.errors import Outcome, ParameterError, ShapeError
from patagium.learning import load_learner
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.learning.models.memory import LONGEST_STEP, measured_inputs
from patagium.learning.stream import stream
from patagium.live import pipeline as module
from patagium.live.pipeline import Pipeline
from patagium.native import compiler_name
from patagium.robot import load_robot_text

STEP, COUNT = 1e-3, 45


@pytest.fixture(scope="module")
def robot():
    return load_robot_text(pt.load_robot("aerobat").source.replace("strips: 5", "strips: 2"))


@pytest.fixture(scope="module")
def packets(robot):
    """Packets of a robot that flies forward and flaps, (N, 1 + 4 n)."""
    random, time = np.random.default_rng(2), STEP * np.arange(COUNT)
    phases, size = random.uniform(0, 6, robot.dof), random.uniform(0.1, 0.3, robot.dof)
    angle = 30 * time[:, None] + phases
    q, v, a = size * np.sin(angle), 30 * size * np.cos(angle), -900 * size * np.sin(angle)
    v[:, 0] += 5.0
    return np.column_stack([time, q, v, a, np.zeros_like(q)])


def attached(robot):
    return LinearStripNetwork(robot, attached=True)


@pytest.fixture(scope="module", params=["attached", "grey"])
def network(request, robot):
    if request.param == "attached":
        return attached(robot)
    return pt.GreyBox(pt.LiftingLine(robot), {"lags.rate[0]": 0.02}, start="steady")


def learner_of(network, kind=pt.ExtendedLearner, **options):
    return kind(network, prior_std=0.1, measurement_std=1.0, **options)


def same(pipeline, theirs):
    """Weights bit for bit; compiled, memory moves along its slopes in another order of sums."""
    ours = pipeline.learner.weights
    np.testing.assert_allclose(ours, theirs.weights, rtol=0, atol=1e-11 * pipeline.compiled)


def pipeline_of(network, robot, **options):
    return Pipeline(learner_of(network, **options), robot)


def test_live_it_learns_what_it_learns_from_the_log(network, robot, packets):
    pipeline, theirs = pipeline_of(network, robot), learner_of(network)
    records = pipeline.run(packets)
    x = packets[:, 1 : 1 + measured_inputs(network)]
    found = stream(theirs, packets[:, 0], x, records.measurement, every=1)
    np.testing.assert_array_equal(records.outcome, Outcome.COMPLETED)
    same(pipeline, theirs)
    # evaluated for many samples and for one: other sums
    guess = found.prediction["prediction"].to_numpy()
    np.testing.assert_allclose(records.prediction, guess, rtol=1e-11, atol=1e-11)
    assert pipeline.memory_resets == 0
    assert np.abs(theirs.weights - network.initial(0)).max() > 1e-3


def test_in_c_it_is_what_it_is_in_python(robot, packets, monkeypatch, tmp_path):
    network = attached(robot)
    ours = pipeline_of(network, robot)
    assert ours.compiled == (compiler_name() is not None)
    monkeypatch.setattr(module, "_chain", lambda *arguments: None)
    theirs = pipeline_of(network, robot)
    log = np.concatenate([packets[:30], packets[28:30], packets[30:]])  # two of them late
    log[20, 1 + robot.dof] = np.nan
    log[36:, 0] += 2 * LONGEST_STEP
    expected, found = theirs.run(log).rows[:, :-1], ours.run(log).rows[:, :-1]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10)
    assert ours.memory_resets == theirs.memory_resets == 1
    assert ours.learner.events == theirs.learner.events
    one, other = (pipeline.learner.memory.state() for pipeline in (ours, theirs))
    for name, part in other.items():
        np.testing.assert_allclose(one[name], part, rtol=1e-9, atol=1e-10)
    ours.learner.save(tmp_path / "state")
    again = Pipeline(load_learner(tmp_path / "state"), robot)  # in Python from here
    later = packets.copy()
    later[:, 0] += log[-1, 0] + STEP
    rows = again.run(later).rows[:, :-1]
    np.testing.assert_allclose(ours.run(later).rows[:, :-1], rows, rtol=1e-9, atol=1e-10)


def test_with_points_too(robot, packets):
    network = attached(robot)
    options = {"kind": pt.CubatureLearner, "spread": 1.7}
    pipeline, theirs = pipeline_of(network, robot, **options), learner_of(network, **options)
    records = pipeline.run(packets[:15])
    x = packets[:15, 1 : 1 + 3 * robot.dof]
    stream(theirs, packets[:15, 0], x, records.measurement, every=1)
    np.testing.assert_array_equal(pipeline.learner.weights, theirs.weights)


def test_kept_in_a_file_it_goes_on_bit_for_bit(network, robot, packets, tmp_path):
    whole, part = pipeline_of(network, robot), pipeline_of(network, robot)
    expected = whole.run(packets)
    part.run(packets[:25])
    twins = copy.deepcopy(part.learner), pickle.loads(pickle.dumps(part.learner))
    for twin in twins:
        rows = Pipeline(twin, robot).run(packets[25:]).rows
        np.testing.assert_array_equal(rows[:, :-1], expected.rows[25:, :-1])
    resumed = Pipeline(load_learner(part.learner.save(tmp_path / "state")), robot)
    found = resumed.run(packets[25:])
    np.testing.assert_array_equal(found.rows[:, :-1], expected.rows[25:, :-1])
    np.testing.assert_array_equal(resumed.learner.weights, whole.learner.weights)


def test_a_learner_that_is_not_compiled_remembers_too(robot, packets, tmp_path):
    network = attached(robot)
    options = {"prior_std": 0.1, "measurement_std": 0.1, "square_root": "cholesky"}
    whole, part = (Pipeline(pt.CubatureLearner(network, **options), robot) for _ in range(2))
    assert not whole.compiled
    expected = whole.run(packets).rows[:, :-1]
    part.run(packets[:30])
    resumed = Pipeline(load_learner(part.learner.save(tmp_path / "state")), robot)
    np.testing.assert_array_equal(resumed.run(packets[30:]).rows[:, :-1], expected[30:])


def test_refused_samples_leave_the_memory_as_it_was(network, robot, packets):
    clean, disturbed = pipeline_of(network, robot), pipeline_of(network, robot)
    expected = clean.run(packets).rows[:, :-1]
    late, broken = packets[3].copy(), packets[20].copy()
    broken[0] += 0.3 * STEP
    broken[1 + robot.dof] = np.nan  # v.x
    mixed = [packets[:20], packets[19:20], late[None], packets[20:21], broken[None], packets[21:]]
    found = disturbed.run(np.concatenate(mixed))
    refused = [Outcome.DUPLICATE, Outcome.LATE, Outcome.BAD_INPUT]
    np.testing.assert_array_equal(found.outcome[[20, 21, 23]], refused)
    kept = np.delete(found.rows[:, :-1], [20, 21, 23], axis=0)
    np.testing.assert_array_equal(kept, expected)
    assert disturbed.memory_resets == 0


def test_after_a_long_step_memory_begins_anew_and_short_ones_are_bridged(network, robot, packets):
    short, long = packets.copy(), packets.copy()
    short[30:, 0] += 0.5 * LONGEST_STEP
    long[30:, 0] += 2 * LONGEST_STEP
    for log, resets in ((short, 0), (long, 1)):
        pipeline, theirs = pipeline_of(network, robot), learner_of(network)
        records = pipeline.run(log)
        x, gaps = log[:, 1 : 1 + measured_inputs(network)], [30] * resets
        stream(theirs, log[:, 0], x, records.measurement, every=1, gaps=gaps)
        same(pipeline, theirs)
        assert pipeline.memory_resets == resets


def test_usual_steps_are_never_gaps_and_a_new_rate_becomes_usual(robot, packets):
    network = attached(robot)
    slow = packets.copy()
    slow[:, 0] *= 50
    pipeline = pipeline_of(network, robot)
    pipeline.run(slow)
    assert pipeline.memory_resets == 0
    memory = pipeline_of(network, robot).learner.memory
    x, weights = packets[0, 1 : 1 + 3 * robot.dof], network.initial(0)
    resets = []
    for time in np.cumsum([*[1e-3] * 50, *[5e-2] * 300]).tolist():
        memory.next_input(time, x, weights)
        memory.settle(Outcome.COMPLETED, np.zeros(network.size))
        resets.append(memory.resets)
    assert 0 < resets[100] < resets[-100] == resets[-1] < 200


def test_a_clock_that_went_back_is_a_new_memory_once_it_is_believed(robot, packets):
    network = attached(robot)
    pipeline = pipeline_of(network, robot)
    again = packets.copy()
    again[:, 0] -= 1.0
    records = pipeline.run(np.concatenate([packets, again]))
    assert pipeline.learner.events["clock_resets"] == pipeline.memory_resets == 1
    late = COUNT + int((records.outcome == Outcome.LATE).sum())
    assert late == COUNT + 9  # as many as a learner needs to see before it believes the clock
    theirs = learner_of(network)
    x = np.tile(packets[:, 1 : 1 + 3 * robot.dof], (2, 1))
    used = np.r_[:COUNT, late : 2 * COUNT]
    time, y = STEP * np.arange(len(used)), records.measurement[used]
    stream(theirs, time, x[used], y, every=1, gaps=[COUNT])
    # the steps are differences of other stamps
    np.testing.assert_allclose(pipeline.learner.weights, theirs.weights, rtol=0, atol=1e-11)


def test_learners_and_packets_that_do_not_fit_are_told(robot, packets, tmp_path):
    network = attached(robot)

    class Bare:
        def __init__(self):
            self.network = network

    with pytest.raises(ParameterError, match="memory"):
        Pipeline(Bare(), robot)
    with pytest.raises(ShapeError, match="inputs of the network"):
        Pipeline(learner_of(network), robot, inputs=["v.roll"])
    pipeline = pipeline_of(network, robot)
    pipeline.run(packets[:3])
    state = pipeline.learner.state() | {"memory_0_state": np.zeros(2)}
    with pytest.raises(ShapeError, match="memory"):
        pipeline.learner.resume(state)
