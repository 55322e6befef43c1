"""Tuning on samples of a known network finds their noise, however the work is shared out."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from patagium.errors import LogError, ParameterError, ShapeError
from patagium.learning import DenseNetwork, Tuned, identify, tune
from patagium.sensing import LogTable

NOISE = np.array([0.02, 0.3])


def network(*hidden: int) -> DenseNetwork:
    return DenseNetwork(2, hidden or (4,), 2, "tanh")


def log(noise: np.ndarray = NOISE, samples: int = 400) -> LogTable:
    """What a network with known weights says, with noise of a known deviation."""
    rng = np.random.default_rng(11)
    x = rng.uniform(-2.0, 2.0, (samples, 2))
    teacher = network()
    y = teacher.evaluate(x, 1.5 * teacher.initial(5)) + noise * rng.standard_normal((samples, 2))
    bounds = np.array([[-2.0, 2.0]] * 2)
    return LogTable(
        time=np.arange(samples) * 0.01, x=x, y=y,
        input_names=("a", "b"), output_names=("c", "d"),
        input_units=("1", "1"), output_units=("1", "1"),
        input_range=bounds, output_range=bounds,
        gaps=np.empty(0, np.int64), gap=3.0, source="known.csv",
    )  # fmt: skip


def tuned(**options: Any) -> Tuned:
    given = {"every": 1, "trials": 16, "jobs": 1, "covariance": ["node"], "learner": "cubature"}
    asked = given | options
    return tune(log(), network(), **asked)


def test_a_known_measurement_deviation_is_found() -> None:
    table = log(np.array([0.1, 0.1]))
    found = tune(table, network(), every=1, trials=48, jobs=1)
    learner = found.learner()
    identify(table, learner, every=1)  # with noise_estimation it starts from the settings
    std = learner.measurement_std
    assert ((std > 0.05) & (std < 0.2)).all()  # 0.1 within a factor of 2
    assert 0.9 < found.best.prediction["coverage_second_half"] < 0.99


def test_without_estimating_noise_the_deviation_itself_is_found() -> None:
    table = log(np.array([0.1, 0.1]))
    given = {"noise_estimation": None}
    found = tune(table, network(), every=1, trials=48, jobs=1, settings=given)
    std = np.array(found.best.learner.values["measurement_std"])
    level = std / table.y.std(axis=0)  # one level for all, in deviations of the outputs
    assert level[0] == pytest.approx(level[1], rel=0.02)  # three digits
    assert 0.5 < np.sqrt(np.prod(std / 0.1)) < 2.0


def test_tuned_settings_predict_better_than_others() -> None:
    found = tuned()
    assert found.trials[0].prediction.score == max(t.prediction.score for t in found.trials)
    scores = [t.prediction.score for t in found.trials]
    assert scores == sorted(scores, reverse=True)
    learner = found.learner()
    assert learner.count == 0
    assert learner.describe()["covariance"] == "node"
    assert found.best.network.hidden == (4,)


def test_the_answer_depends_on_the_seed_and_not_on_the_number_of_processes() -> None:
    alone, together, other = tuned(), tuned(jobs=2), tuned(seed=1)
    assert together.best == alone.best
    assert together.trials == alone.trials
    assert other.best.learner != alone.best.learner


def test_a_search_that_was_killed_goes_on_where_it_was(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    whole = tuned(journal=path)
    lines = path.read_text("utf-8").splitlines(keepends=True)
    half = len(lines) // 2
    path.write_text("".join(lines[:half]) + lines[half][:40], "utf-8")
    told: list[tuple[int, int]] = []
    again = tuned(journal=path, progress=lambda done, total: told.append((done, total)))
    assert again.best == whole.best
    resumed = path.read_text("utf-8").splitlines(keepends=True)
    assert resumed[:half] == lines[:half]
    assert len(resumed) == len(lines)
    assert told[-1][0] == told[-1][1]


def test_more_trials_use_those_that_are_there(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    tuned(journal=path, trials=8)
    before = path.read_text("utf-8")
    tuned(journal=path, trials=16)
    assert path.read_text("utf-8").startswith(before)


def test_another_question_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    tuned(journal=path, trials=8)
    with pytest.raises(LogError, match="every was 1, is 2"):
        tuned(journal=path, trials=8, every=2)


def test_hidden_widths_are_chosen_among_those_given() -> None:
    found = tune(log(), [network(1), network(4)], every=1, trials=16, jobs=1, covariance=["node"])
    assert {trial.hidden for trial in found.trials} <= {(1,), (4,)}
    assert found.network.perceptron.widths[1:-1] == found.trials[0].hidden
    asked = {json.dumps(trial.describe()) for trial in found.trials}
    assert len(asked) == len(found.trials)


def test_an_output_that_no_sensor_measures_leaves_the_scales_of_the_others() -> None:
    """One column without a number gave all outputs one and the same noise."""
    table = log()
    table.y[:, 0], wide = np.nan, 1e3 * table.y[:, 1:]
    table = replace(table, y=np.hstack([table.y, wide]), output_names=("c", "d", "e"),
                    output_units=("1",) * 3, output_range=np.array([[-2.0, 2.0]] * 3))  # fmt: skip
    found = tune(table, DenseNetwork(2, (4,), 3, "tanh"), every=1, trials=8, jobs=1)
    std = np.array(found.best.learner.values["measurement_std"])
    assert std[2] == pytest.approx(1e3 * std[1], rel=1e-2)  # three digits are kept


class Own(DenseNetwork):
    """Network of a user, with a kind of its own."""

    kind = "own"


def test_an_own_network_is_tuned_once_its_kind_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """All trials ran before the file of settings refused the network."""
    own = Own(2, (4,), 2, "tanh")
    with pytest.raises(ParameterError, match=r"kind: expected one of dense, .*, found 'own'"):
        tune(log(), own, every=1, trials=8, jobs=1)
    monkeypatch.setattr("patagium.learning.models.registry._KINDS", {"own": Own})
    found = tune(log(), own, every=1, trials=8, jobs=1)
    assert found.best.network.kind == "own" and found.learner().network is own


def test_questions_without_an_answer_are_refused(tmp_path: Path) -> None:
    still = log(samples=60)
    still.y[25:] = 1.0  # it moves, but not to the end
    with pytest.raises(ParameterError, match="flight: expected an output that moves"):
        tune(still, network(), every=1, jobs=1)
    with pytest.raises(ParameterError, match="jobs: expected a whole number"):
        tuned(jobs=0)
    with pytest.raises(ParameterError, match="trials: expected at least 8, found 7"):
        tuned(trials=7, journal=tmp_path / "trials.jsonl")
    assert not list(tmp_path.iterdir())  # a journal of the refused question blocked the next
    with pytest.raises(ParameterError, match="different hidden layers"):
        tune(log(), [network(4), network(4)], every=1)
    with pytest.raises(ShapeError, match="network: expected shape 2 inputs, 2 outputs"):
        tune(log(), DenseNetwork(3, (4,), 2), every=1)


def test_a_search_without_its_extra_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(ParameterError, match=r"pip install 'patagium\[tune\]'"):
        tuned()


def test_an_option_that_tune_has_not_is_refused() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'job'"):
        tuned(job=2)
