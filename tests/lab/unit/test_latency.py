"""The harness of the pipeline's times: it times what it says, and puts the load away."""

from __future__ import annotations

import json

import numpy as np
import pytest

import patagium as pt
from patagium.cli.main import run
from patagium.errors import ParameterError
from patagium.live.pipeline import Pipeline
from patagium.native import compiler_name
from patagium_lab.bench.latency import LOADS, call_times, measure_latency
from patagium_lab.rivals.gradient_learner import GradientLearner

pytestmark = pytest.mark.skipif(compiler_name() is None, reason="times compiled code")


@pytest.fixture
def pipeline():
    robot = pt.load_robot("aerobat")
    network = pt.DenseNetwork(28, (2,), robot.dof_names)
    learner = pt.CubatureLearner(network, prior_std=0.3, measurement_std=1.0, covariance="node")
    return Pipeline(learner, robot)


@pytest.mark.parametrize("paced", [False, True])
def test_it_learns_the_packets_in_a_circle(pipeline, paced, rng):
    packets = rng.normal(size=(50, 57))
    duration, response = call_times(pipeline, packets, 120, paced)
    twin = Pipeline(
        pt.CubatureLearner(
            pipeline.learner.network, prior_std=0.3, measurement_std=1.0,
            covariance="node",
        ),
        pipeline.robot,
    )  # fmt: skip
    circle = packets[np.arange(120) % 50]
    circle[:, 0] = np.arange(120) * 1e-4
    twin.run(circle)
    np.testing.assert_array_equal(pipeline.learner.weights, twin.learner.weights)
    assert (duration > 0).all()
    if paced:
        assert (response >= duration).all()
    else:
        np.testing.assert_array_equal(response, duration)


def test_python_is_not_timed(monkeypatch, rng):
    robot = pt.load_robot("aerobat")
    learner = GradientLearner(pt.DenseNetwork(28, (2,), robot.dof_names), learning_rate=1e-3)
    with pytest.raises(ParameterError, match="a compiled one"):
        call_times(Pipeline(learner, robot), rng.normal(size=(5, 57)), 5, paced=False)


def test_all_cases_are_there():
    found = measure_latency(100, LOADS, (False,))
    assert len(found) == 5 * len(LOADS)
    for one in found:
        times = list(one.duration.values())
        assert times == sorted(times) and times[0] > 0
    with pytest.raises(ParameterError, match="loads"):
        measure_latency(100, ["on fire"])


def test_the_verb_says_and_writes_what_it_found(tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        run(["latency", "--samples", "100", "--load", "alone", "--json", str(tmp_path / "l.json")])
    assert left.value.code == 0
    found = json.loads((tmp_path / "l.json").read_text())
    assert len(found) == 10 and {one["paced"] for one in found} == {False, True}
    assert "p999 [us]" in capsys.readouterr().out
