"""One contract for every learner: a copy goes on as the learner, faults are counted alike."""

from __future__ import annotations

import copy
import itertools
import pickle
from typing import Any

import numpy as np
import pytest

import patagium as pt

FACTORS: dict[str, list[Any]] = {
    "kind": [pt.CubatureLearner, pt.ExtendedLearner],
    "covariance": ["full", "layer", "node"],
    "compiled": [True, False],
    "dtype": ["float64", "float32"],
    "screening": [None, pt.learning.Screening(outlier_std=3.0, stuck_samples=5)],
    "noise_estimation": [None, pt.learning.NoiseEstimation(memory=20)],
    "change_detection": [None, pt.learning.ChangeDetection(0.05, 8, 16, 0.5)],
    "prior_share": [0.0, 0.01],
}
COUNTED = {
    "missing": 12,  # two of them refused: beyond what the sensor can say
    "out_of_range": 2,
    "bad_inputs": 2,
    "late": 2,
    "duplicates": 1,
    "clock_resets": 0,
    "blind": 2,
}
PROBE = np.array([0.1, -0.4, 2.0])


def pairwise(factors: dict[str, list[Any]]) -> list[dict[str, Any]]:
    """Few combinations in which any two values of two factors meet at least once."""
    places = [range(len(values)) for values in factors.values()]
    pairs = list(itertools.combinations(range(len(places)), 2))
    missing = {(a, i, b, j) for a, b in pairs for i, j in itertools.product(places[a], places[b])}
    chosen = []
    while missing:
        best = max(
            itertools.product(*places),
            key=lambda row: sum((a, row[a], b, row[b]) in missing for a, b in pairs),
        )
        missing -= {(a, best[a], b, best[b]) for a, b in pairs}
        each = zip(factors.items(), best, strict=True)
        chosen.append({name: values[place] for (name, values), place in each})
    return chosen


CAREFUL = {name: values[1] for name, values in FACTORS.items() if name.endswith(("ion", "ing"))}
COMBINATIONS = [
    *pairwise(FACTORS),
    *(
        {"kind": kind, "covariance": structure, **CAREFUL}
        for kind, structure in itertools.product(FACTORS["kind"], FACTORS["covariance"])
    ),
]


def name_of(combination: dict[str, Any]) -> str:
    words = [combination["kind"].kind]
    for name, value in combination.items():
        if name == "covariance":
            words.append(value)
        elif name == "compiled":
            words.append("C" if value else "NumPy")
        elif name != "kind" and value not in (None, 0.0, "float64"):
            words.append(name if name != "dtype" else value)
    return ", ".join(words)


def made(combination: dict[str, Any], monkeypatch: pytest.MonkeyPatch, size: int = 6) -> Any:
    settings = {"prior_std": 0.5, "measurement_std": [0.1, 0.3], **combination}
    kind = settings.pop("kind")
    if not settings.pop("compiled", True):
        monkeypatch.setenv("PATAGIUM_COMPILER", "none")
    if kind is pt.ExtendedLearner:
        settings.pop("dtype", None)
    return kind(pt.DenseNetwork(3, (size,), 2), **settings)


def teach(learner: Any, begin: int, end: int) -> None:
    """Samples `begin` to `end` of one stream with every fault of a sensor; the air changes."""
    draw = np.random.default_rng(11)
    x = draw.normal(size=(120, 3))
    y = np.tanh(x[:, :2]) + 0.1 * draw.normal(size=(120, 2))
    time = 1e-3 * np.arange(120)
    y[::8, 0], y[30], y[70:], x[33, 1], x[34, 2] = np.nan, 30.0, -2 * y[70:], np.nan, np.inf
    y[41] = np.nan
    y[49:56, 1] = y[49, 1]
    time[12], time[13], time[14] = time[11], 0.001, np.inf
    time[90:] -= 0.05  # the clock goes back, and is believed after some samples
    for k in range(begin, end):
        learner.update(x[k], y[k], time[k])


def seen(learner: Any) -> dict[str, Any]:
    """Everything that a learner says of itself, and its next prediction."""
    mean, covariance = learner.predict(PROBE)
    found = {
        "mean": mean,
        "covariance": covariance,
        "weights": learner.weights,
        "variances": learner.variances,
        "events": learner.events,
        "count": learner.count,
    }
    for name in ("nis", "changes", "measurement_std", "innovation_covariance"):
        found[name] = getattr(learner, name)
    return found


def assert_same(one: Any, other: Any) -> None:
    ours, theirs = seen(one), seen(other)
    for name, value in ours.items():
        if value is None or isinstance(value, dict | tuple):
            assert theirs[name] == value, name
        else:
            np.testing.assert_array_equal(theirs[name], value, err_msg=name)


@pytest.mark.parametrize("combination", COMBINATIONS, ids=name_of)
def test_a_copy_goes_on_as_the_learner(
    combination: dict[str, Any], tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    learner = made(combination, monkeypatch)
    assert np.isnan(learner.nis), "no sample was learned"
    teach(learner, 0, 60)
    copies = {
        "file": pt.load_learner(learner.save(tmp_path / "learner.state")),
        "pickle": pickle.loads(pickle.dumps(learner)),
        "deepcopy": copy.deepcopy(learner),
    }
    for other in copies.values():
        assert other.describe() == learner.describe()
        assert_same(learner, other)
    for other in (learner, *copies.values()):
        teach(other, 60, 120)
    for other in copies.values():
        assert_same(learner, other)
    if combination.get("noise_estimation"):
        assert (learner.measurement_std != [0.1, 0.3]).all()
    if combination.get("change_detection"):
        assert learner.changes
    assert np.isfinite(learner.nis)


@pytest.mark.parametrize("combination", COMBINATIONS, ids=name_of)
def test_faults_are_counted_alike(
    combination: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    learner = made(combination, monkeypatch)
    teach(learner, 0, 60)
    before = {name: learner.events[name] for name in COUNTED}
    teach(learner, 60, 120)
    after = {name: learner.events[name] for name in COUNTED}
    assert before == COUNTED
    assert after["clock_resets"] == 1 and after["late"] == 2 + 9
    assert after["missing"] > before["missing"]
    teach(copy.deepcopy(learner), 60, 61)  # late for the copy alone
    assert {name: learner.events[name] for name in COUNTED} == after


@pytest.mark.parametrize("combination", COMBINATIONS, ids=name_of)
def test_a_copy_shares_nothing_with_the_learner(
    combination: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    learner = made(combination, monkeypatch)
    teach(learner, 0, 30)
    before = seen(learner)
    for other in (copy.deepcopy(learner), pickle.loads(pickle.dumps(learner))):
        teach(other, 30, 60)
        assert (other.weights != learner.weights).any()
    for name, value in seen(learner).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(value, before[name], err_msg=name)
        elif name != "nis" or not np.isnan(value):
            assert value == before[name], name
