"""Packets through the pipeline, against the same samples through the learner one by one."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from tests.own_learner import OwnLearner

import patagium as pt
from patagium.errors import Outcome, ParameterError, ShapeError
from patagium.live import pipeline as module
from patagium.live.packets import flight_packets
from patagium.live.pipeline import Pipeline
from patagium.native import compiler_name

COUNT = 200
ROUNDING = 1e-12  # of the same sums in the same order, or nearly


@pytest.fixture(scope="module")
def flight():
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    air = pt.QuasiSteady(robot, pt.Air())
    return pt.simulate(
        robot, air, gait, duration=COUNT * 1e-3, time_step=1e-3, v=robot.coordinates(x=3.0)
    )


@pytest.fixture(scope="module")
def packets(flight):
    return flight_packets(flight)[:COUNT]


@pytest.fixture(scope="module")
def dense(flight):
    _, x, y = pt.training_data(flight)
    scale = np.where(x.std(axis=0) > 1e-9, x.std(axis=0), 1.0)
    return pt.DenseNetwork(
        28, (20,), pt.load_robot("aerobat").dof_names, input_center=x.mean(axis=0),
        input_scale=scale, output_scale=np.maximum(y.std(axis=0), 1e-3),
    )  # fmt: skip


def learner_of(network, **options):
    return pt.CubatureLearner(network, prior_std=0.3, measurement_std=3e-3, spread=1.7, **options)


KINDS = [("node", "dense"), ("layer", "dense"), ("node", "strip"), ("full", "strip")]


@pytest.fixture(params=KINDS, ids=["-".join(kind) for kind in KINDS])
def pair(request, dense):
    structure, kind = request.param
    network = dense if kind == "dense" else pt.StripNetwork(pt.load_robot("aerobat"))
    return [learner_of(network, covariance=structure) for _ in range(2)]


def test_the_pipeline_is_update_after_update(pair, flight, packets):
    ours, theirs = pair
    pipeline = Pipeline(ours, pt.load_robot("aerobat"))
    records = pipeline.run(packets)
    _, x, y = pt.training_data(flight)
    predicted = []
    for state, force in zip(x[:COUNT], y[:COUNT], strict=True):
        predicted.append(theirs.predict(state))
        theirs.update(state, force)
    mean = np.array([mean for mean, _ in predicted])
    std = np.sqrt([np.diag(covariance) for _, covariance in predicted])
    assert pipeline.compiled == (compiler_name() is not None)
    np.testing.assert_allclose(records.measurement, y[:COUNT], rtol=0, atol=ROUNDING)
    # inverse dynamics of many states at once differs in rounding; the learner amplifies it
    np.testing.assert_allclose(records.prediction, mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(records.std, std, rtol=1e-9)
    np.testing.assert_allclose(ours.weights, theirs.weights, rtol=0, atol=1e-8)
    assert ours.count == theirs.count == COUNT
    np.testing.assert_allclose(
        ours.innovation_covariance, theirs.innovation_covariance, rtol=1e-9, atol=1e-15
    )
    assert records.nis[-1] == ours.nis
    assert (records.outcome == Outcome.COMPLETED).all() and not records.left_out.any()
    assert (records.duration > 0).all()


def test_the_same_in_python(pair, packets, monkeypatch):
    compiled, plain = pair
    expected = Pipeline(compiled, pt.load_robot("aerobat")).run(packets)
    monkeypatch.setattr(module, "_chain", lambda *arguments: None)
    pipeline = Pipeline(plain, pt.load_robot("aerobat"))
    found = pipeline.run(packets)
    assert not pipeline.compiled
    np.testing.assert_allclose(found.rows[:, :-1], expected.rows[:, :-1], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(plain.weights, compiled.weights, rtol=0, atol=ROUNDING)


def test_nearly_the_same_without_a_compiler(packets, monkeypatch):
    network, robot = pt.StripNetwork(pt.load_robot("aerobat")), pt.load_robot("aerobat")
    compiled = learner_of(network)
    expected = Pipeline(compiled, robot).run(packets[:40])
    monkeypatch.setenv("PATAGIUM_COMPILER", "none")
    plain = learner_of(pt.StripNetwork(robot))
    found = Pipeline(plain, robot).run(packets[:40])
    # the kernel sums in another order than NumPy: rounding through 40 updates
    np.testing.assert_allclose(found.prediction, expected.prediction, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.std, expected.std, rtol=1e-7)


@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_in_pieces_and_one_by_one_it_is_the_same(engine, packets, monkeypatch):
    if engine == "python":
        monkeypatch.setattr(module, "_chain", lambda *arguments: None)
    robot = pt.load_robot("aerobat")
    whole, pieces = (learner_of(pt.StripNetwork(robot, (4,))) for _ in range(2))
    expected = Pipeline(whole, robot).run(packets[:30])
    pipeline = Pipeline(pieces, robot)
    rows = [pipeline.run(packets[:10]).rows, pipeline.run(packets[10:17]).rows]
    rows += [pipeline.step(packet).rows for packet in packets[17:30]]
    np.testing.assert_array_equal(np.concatenate(rows)[:, :-1], expected.rows[:, :-1])


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])  # noqa: S301
def test_a_copy_goes_on_bit_for_bit(twin, packets):
    robot = pt.load_robot("aerobat")
    network = pt.StripNetwork(robot, (4,))
    added = pt.AddedMass(robot, pt.Air())
    pipeline = Pipeline(learner_of(network), robot, inputs=None, added_mass=added)
    pipeline.run(packets[:20])
    other = twin(pipeline)
    assert other.columns == pipeline.columns and other.compiled == pipeline.compiled
    found, expected = (one.run(packets[20:40]).rows[:, :-1] for one in (other, pipeline))
    np.testing.assert_array_equal(found, expected)
    assert other.learner is not pipeline.learner


FAULTS = {
    "input": (Outcome.BAD_INPUT, "bad_inputs"),
    "late": (Outcome.LATE, "late"),
    "twice": (Outcome.DUPLICATE, "duplicates"),
    "blind": (Outcome.BLIND, "blind"),
}


@pytest.mark.parametrize("engine", ["compiled", "python"])
@pytest.mark.parametrize("fault", FAULTS)
def test_what_cannot_be_learned_is_recorded_and_leaves_the_learner(
    fault, engine, packets, monkeypatch
):
    if engine == "python":
        monkeypatch.setattr(module, "_chain", lambda *arguments: None)
    robot = pt.load_robot("aerobat")
    learner, twin = (learner_of(pt.StripNetwork(robot, (4,))) for _ in range(2))
    broken = packets[:20].copy()
    names = [column.name for column in Pipeline(learner, robot).columns]
    if fault == "input":
        broken[7, names.index("v.pitch")] = np.nan
    elif fault == "blind":
        broken[7, names.index("u1.x") :] = np.nan
    else:
        broken[7, 0] = broken[6, 0] - (1e-3 if fault == "late" else 0.0)
    records = Pipeline(learner, robot).run(broken)
    Pipeline(twin, robot).run(np.delete(packets[:20], 7, axis=0))
    outcome, event = FAULTS[fault]
    assert np.flatnonzero(records.outcome).tolist() == [7] and records.outcome[7] == outcome
    assert np.isnan(records.prediction[7]).all() == (fault != "blind")
    assert np.isnan(records.nis[7]) and learner.count == 19
    missing = robot.dof if fault == "blind" else 0
    assert learner.events == {**twin.events, event: 1, "missing": missing}
    np.testing.assert_array_equal(learner.weights, twin.weights)


@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_a_missing_channel_is_left_out(engine, packets, monkeypatch):
    if engine == "python":
        monkeypatch.setattr(module, "_chain", lambda *arguments: None)
    robot = pt.load_robot("aerobat")
    learner, twin = (learner_of(pt.StripNetwork(robot, (4,))) for _ in range(2))
    broken = packets[:20].copy()
    pipeline = Pipeline(learner, robot)
    broken[7, [column.name for column in pipeline.columns].index("u1.pitch")] = np.nan
    records = pipeline.run(broken)
    place = robot.index("pitch")
    assert np.argwhere(records.left_out).tolist() == [[7, place]]
    assert not records.outcome.any() and learner.events["missing"] == 1
    for row in broken:
        x, y = pipeline.form.function(*np.split(row[1:], 4), robot.parameters)
        twin.update(x, y, row[0])
    np.testing.assert_array_equal(learner.weights, twin.weights)


@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_a_change_opens_the_covariance_where_update_would(engine, packets, monkeypatch):
    if engine == "python":
        monkeypatch.setattr(module, "_chain", lambda *arguments: None)
    robot = pt.load_robot("aerobat")
    detection = pt.learning.ChangeDetection(1e-4, window=5, reference=30)
    learner, twin = (
        learner_of(pt.StripNetwork(robot, (4,)), change_detection=detection) for _ in range(2)
    )
    broken = packets.copy()
    broken[100:, 43:] += 0.5  # N, N m: something else pushes from now on
    pipeline = Pipeline(learner, robot)
    records = pipeline.run(broken)
    for row in broken:
        x, y = pipeline.form.function(*np.split(row[1:], 4), robot.parameters)
        twin.update(x, y, row[0])
    assert len(records) == COUNT and learner.changes == twin.changes
    assert any(100 < sample <= 106 for sample in learner.changes)
    np.testing.assert_array_equal(learner.weights, twin.weights)
    np.testing.assert_array_equal(learner.covariance, twin.covariance)


def test_inputs_are_chosen_by_name(packets):
    robot = pt.load_robot("aerobat")
    inputs = ("v.pitch", "q.left_plunge")
    learner = learner_of(pt.DenseNetwork(2, (3,), ("pitch", "z")))
    pipeline = Pipeline(learner, robot, inputs=inputs)
    records = pipeline.run(packets[:5])
    twin = learner_of(pt.DenseNetwork(2, (3,), ("pitch", "z")))
    names = [column.name for column in pipeline.columns]
    x = packets[0, [names.index(name) for name in inputs]]
    np.testing.assert_allclose(records.prediction[0], twin.predict(x)[0], atol=ROUNDING)
    forces = packets[0, 1:].reshape(4, -1)
    y = pt.Dynamics(robot).inverse(*forces[:3]) - forces[3] + np.array(robot.damping) * forces[1]
    expected = y[[robot.index("pitch"), robot.index("z")]]
    np.testing.assert_allclose(records.measurement[0], expected, atol=ROUNDING)


def test_other_learners_stream_too(packets):
    robot = pt.load_robot("aerobat")
    network = pt.StripNetwork(robot, (4,))
    options = {"prior_std": 0.3, "measurement_std": 3e-3}
    for learner in (
        pt.CubatureLearner(network, **options, square_root="cholesky"),
        OwnLearner(network),
    ):
        pipeline = Pipeline(learner, robot)
        records = pipeline.run(packets[:10])
        assert not pipeline.compiled
        assert np.isfinite(records.prediction).all() and learner.count == 10


def test_units_of_the_columns():
    robot = pt.load_robot("aerobat")
    columns = {c.name: c.unit for c in Pipeline(learner_of(pt.StripNetwork(robot)), robot).columns}
    assert len(columns) == 1 + 4 * robot.dof
    found = [columns[name] for name in ("time", "q.x", "v.x", "a.roll", "u1.x", "u1.left_plunge")]
    assert found == ["s", "m", "m/s", "rad/s^2", "N", "N m"]


def test_what_does_not_fit_is_refused(packets):
    robot = pt.load_robot("aerobat")
    with pytest.raises(ParameterError, match="outputs of the network.*lift"):
        Pipeline(learner_of(pt.DenseNetwork(28, (3,), ("lift",))), robot)
    with pytest.raises(ShapeError, match="inputs of the network"):
        Pipeline(learner_of(pt.DenseNetwork(8, (3,), ("pitch",))), robot)
    pipeline = Pipeline(learner_of(pt.StripNetwork(robot)), robot)
    with pytest.raises(ShapeError, match="packets"):
        pipeline.run(packets[:, :-1])
    with pytest.raises(ShapeError, match="packet"):
        pipeline.step(packets[:2])
