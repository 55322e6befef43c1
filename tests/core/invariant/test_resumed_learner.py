"""A learner that was killed and resumed is the one that never stopped, bit for bit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.learning.learners.filter_learner import FilterLearner

NOISE = {"prior_std": 0.5, "measurement_std": [0.1, 0.3]}
DRIFT = {"process_std": 0.01, "forgetting_factor": 0.99, "prior_share": 0.01}
CAREFUL = {
    "screening": pt.learning.Screening(outlier_std=3.0, stuck_samples=5),
    "noise_estimation": pt.learning.NoiseEstimation(memory=20),
}
CHANGE = {
    "change_detection": pt.learning.ChangeDetection(0.05, window=8, reference=16, reopening=0.5)
}


def dense() -> pt.DenseNetwork:
    return pt.DenseNetwork(3, (5, 3), ("lift", "drag"), input_scale=2.0, output_center=[0.1, -1])


def cubature(**options: Any) -> Callable[[], FilterLearner]:
    return lambda: pt.CubatureLearner(dense(), **NOISE, **options)


def extended(**options: Any) -> Callable[[], FilterLearner]:
    return lambda: pt.ExtendedLearner(dense(), **NOISE, **options)


KINDS: dict[str, Callable[[], FilterLearner]] = {
    "full": cubature(),
    "full, close points": cubature(spread=1.7, seed=3),
    "full, spread in words": cubature(spread=np.sqrt(dense().size)),
    "full, drifting": cubature(**DRIFT),
    "full, single": cubature(dtype="float32", **DRIFT),
    "full, changes": cubature(**CHANGE),
    "algorithm 1": cubature(square_root="cholesky", **CAREFUL),
    "algorithm 1, single": cubature(square_root="cholesky", dtype="float32", **DRIFT),
    "full, careful": cubature(**CAREFUL, **CHANGE),
    "layer": cubature(covariance="layer"),
    "layer, drifting": cubature(covariance="layer", dtype="float32", **DRIFT, **CHANGE),
    "node": cubature(covariance="node", spread=1.7),
    "node, drifting": cubature(covariance="node", **DRIFT, **CHANGE),
    "node, careful": cubature(covariance="node", **CAREFUL, **CHANGE),
    "node, single": cubature(covariance="node", dtype="float32", forgetting_factor=0.99),
    "extended": extended(),
    "extended, drifting": extended(**DRIFT, **CHANGE),
    "extended, layer": extended(covariance="layer", **DRIFT),
    "extended, node": extended(covariance="node"),
}


def teach(learner: FilterLearner, begin: int, end: int, size: int = 2) -> None:
    """Samples `begin` to `end` of one stream.

    Channels are missing and one is stuck while the learner is saved, a sample is late, and the
    air changes at sample 130.
    """
    draw = np.random.default_rng(11)
    x = draw.normal(size=(200, learner.network.inputs))
    y = np.tanh(x[:, :size]) + 0.1 * draw.normal(size=(200, size))
    y[::7, 0], y[130:], y[60] = np.nan, -2.0 * y[130:], 30.0
    y[95:110, 1] = y[95, 1]
    for k in range(begin, end):
        if k % 3 == 0:
            learner.predict(x[k])  # changes nothing, wherever a learner is saved
        learner.update(x[k], y[k], 1e-3 * (k - 3 * (k % 20 == 1)))


COMPILED = [name for name in KINDS if name.startswith(("full", "layer", "node"))]


@pytest.mark.parametrize(
    ("name", "engine"),
    [*((name, "compiled") for name in KINDS), *((name, "fallback") for name in COMPILED)],
)
def test_a_resumed_learner_is_the_one_that_never_stopped(
    name: str, engine: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if engine == "fallback":
        monkeypatch.setenv("PATAGIUM_COMPILER", "none")
    straight = KINDS[name]()
    teach(straight, 0, 100)
    straight.predict([0.3, 0.1, -1.0])  # some do what time does to P before it is saved
    straight.save(tmp_path / "learner.state")
    teach(straight, 100, 200)
    resumed = pt.load_learner(tmp_path / "learner.state")
    assert resumed.describe() == straight.describe()
    assert resumed.count == 94  # five samples are late, one is out of every range
    teach(resumed, 100, 200)
    assert resumed.count == straight.count > 180
    assert resumed.events == straight.events and resumed.events["late"] == 10
    if straight.describe().get("screening"):
        assert min(resumed.events[name] for name in ("missing", "outliers", "stuck")) > 0
    np.testing.assert_array_equal(resumed.weights, straight.weights)
    for part in (0, 1):
        ahead = [learner.predict([0.1, -0.4, 2.0])[part] for learner in (resumed, straight)]
        np.testing.assert_array_equal(*ahead)
    for name in ("covariance", "nis", "changes", "innovation_covariance", "measurement_std"):
        np.testing.assert_array_equal(getattr(resumed, name), getattr(straight, name))
    if isinstance(straight, pt.CubatureLearner) and straight.describe()["change_detection"]:
        assert straight.changes, "the stream has a change, and the monitor was to see it"


def test_saving_changes_nothing_and_is_repeatable(tmp_path: Path) -> None:
    for number, make in enumerate(KINDS.values()):
        learner, twin = make(), make()
        teach(learner, 0, 20)
        first = learner.save(tmp_path / f"{number}.first").read_bytes()
        again = pt.load_learner(tmp_path / f"{number}.first")
        assert again.save(tmp_path / "second").read_bytes() == first
        teach(learner, 20, 25)
        teach(twin, 0, 25)
        np.testing.assert_array_equal(learner.weights, twin.weights)


@pytest.mark.parametrize("covariance", ["full", "node"])
def test_a_learner_that_knows_the_wing_goes_on(covariance: str, tmp_path: Path) -> None:
    network = pt.StripNetwork(pt.load_robot("aerobat"), (4,))
    learners = [
        pt.CubatureLearner(network, prior_std=0.3, measurement_std=3e-3, covariance=covariance)
        for _ in range(2)
    ]
    teach(learners[0], 0, 40, network.outputs)
    teach(learners[1], 0, 20, network.outputs)
    resumed = pt.load_learner(learners[1].save(tmp_path / "learner.state"), like=learners[0])
    teach(resumed, 20, 40, network.outputs)
    np.testing.assert_array_equal(resumed.weights, learners[0].weights)


@pytest.mark.parametrize("name", ["full", "full, drifting", "layer", "node", "node, careful"])
@pytest.mark.parametrize("writer", ["compiled", "fallback"])
def test_a_machine_with_no_compiler_goes_on_to_rounding(
    name: str, writer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def work_as(engine: str) -> None:
        monkeypatch.delenv("PATAGIUM_COMPILER", raising=False)
        if engine == "fallback":
            monkeypatch.setenv("PATAGIUM_COMPILER", "none")

    work_as(writer)
    straight = KINDS[name]()
    teach(straight, 0, 30)
    weights = straight.weights
    straight.save(tmp_path / "learner.state")
    teach(straight, 30, 60)
    work_as("compiled" if writer == "fallback" else "fallback")
    resumed = pt.load_learner(tmp_path / "learner.state")
    np.testing.assert_array_equal(resumed.weights, weights)
    teach(resumed, 30, 60)
    np.testing.assert_allclose(resumed.weights, straight.weights, atol=1e-9)  # 30 updates' rounding
