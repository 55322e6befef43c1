"""Search space of the settings, the trials drawn from it, their scores, and their journal."""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from math import inf, isnan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import optuna
import pytest
from optuna.distributions import FloatDistribution
from scipy.integrate import trapezoid
from scipy.stats import norm
from tests.robots import FLAPPER

import patagium as pt
from patagium.cli.learner_options import LearnerChoice, NetworkKind, winged_network
from patagium.cli.learner_options import _completed as completed
from patagium.errors import FilterDiverged, LogError, Outcome, OutputError, ParameterError
from patagium.learning import (
    CubatureLearner,
    DenseNetwork,
    LinearStripNetwork,
    load_settings,
)
from patagium.learning.learners.registry import LEARNERS, make_learner
from patagium.learning.settings import Alternatives, LogRange, settings_of
from patagium.learning.stream import Samples
from patagium.learning.tuning.prediction_score import (
    Flown,
    PredictionScore,
    moving,
    score_predictions,
)
from patagium.learning.tuning.search import (
    DrawnTrial,
    SearchSpace,
    TrialJournal,
    search,
    search_space,
)
from patagium.learning.tuning.settings_file import LearnerSettings, NetworkSettings, Settings
from patagium.robot import load_robot_text

ROBOT = load_robot_text(FLAPPER)
GOOD = PredictionScore(10, 0.1, 0.95, crps=0.2)
LOST = PredictionScore(3, outcome=Outcome.NOT_FINITE, reason="too far")
LINE = {"x": FloatDistribution(0.0, 1.0), "y": FloatDistribution(0.0, 1.0)}


def test_the_command_line_builds_the_networks_of_python() -> None:
    choice = LearnerChoice(network=NetworkKind.STRIP, hidden=(3,))
    made = winged_network(choice, ROBOT, pt.Air())
    assert made.describe() == pt.StripNetwork(ROBOT, (3,)).describe()


def test_a_settings_file_builds_the_network_that_was_tuned(tmp_path: Path) -> None:
    networks = (
        pt.StripNetwork(ROBOT, (3,), measured=["z"], rotation=True, coefficient_scale=2.0),
        LinearStripNetwork(ROBOT, measured=["z"]),
    )
    for network in networks:
        kept = Settings(every=1, network=NetworkSettings.of(network), learner=LearnerSettings())
        choice = completed(LearnerChoice(), set(), kept.save(tmp_path / "settings.yaml"))
        made = winged_network(choice, ROBOT, pt.Air())
        assert made.describe() == network.describe()
    other = completed(
        LearnerChoice(network=NetworkKind.STRIP), {"network"}, tmp_path / "settings.yaml"
    )
    assert not other.options  # those of another kind


def drawn(space: SearchSpace, count: int) -> list[dict[str, Any]]:
    """Parameters drawn at random."""
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=3))
    return [study.ask(space.distributions()).params for _ in range(count)]


@pytest.mark.parametrize("kind", LEARNERS)
def test_every_tuned_setting_of_the_record_is_searched_over_its_range(kind: str) -> None:
    space = search_space(kind, [(3,)], [1.0], {})
    tuned = {one.name: one.metadata["meaning"].search for one in settings_of(kind)}
    tuned = {name: where for name, where in tuned.items() if where is not None}
    assert {*space.searched} == {*tuned, "hidden"}
    parameters = drawn(space, 60)
    values = [space.values(one)[1] for one in parameters]
    for name, where in tuned.items():
        found = [one[name] for one in values]
        if isinstance(where, Alternatives):
            assert {str(one) for one in found} == {str(one) for one in where.values}
            continue
        numbers = [1 - one if where.one_minus else one for one in found if one != where.off]
        assert 0.99 * where.low <= min(numbers) < max(numbers) <= 1.01 * where.high
        assert max(numbers) > 3 * min(numbers)
        assert (len(numbers) < len(found)) == (where.off is not None)


@pytest.mark.parametrize("kind", LEARNERS)
def test_learners_take_whatever_is_drawn(kind: str) -> None:
    network = DenseNetwork(2, (3,), 2)
    given = {"covariance": Alternatives(("full", "layer"))}
    space = search_space(kind, [(3,)], [0.1, 0.2], given)
    for parameters in drawn(space, 10):
        hidden, values = space.values(parameters)
        learner = make_learner(kind, network, values)
        assert hidden == (3,)
        assert learner.describe()["covariance"] == values["covariance"]
        ratio = values["measurement_std"][1] / values["measurement_std"][0]
        assert ratio == pytest.approx(2.0, rel=0.01)  # three digits


def test_numbers_have_three_digits_and_may_be_off_or_below_one() -> None:
    ranges = {"a": LogRange(0.3, 4.0), "b": LogRange(1e-5, 0.1, one_minus=True, off=1.0)}
    space = SearchSpace("cubature", {**ranges, "hidden": Alternatives(((3,),))}, {"c": 7}, [1.0])
    at = {"a": 0.43219, "b": 0.0999999, "b on": True, "hidden": "[3]"}
    assert space.values(at) == ((3,), {"a": 0.432, "b": 0.9, "c": 7})
    assert space.values(at | {"b on": False})[1]["b"] == 1.0


def test_given_settings_are_not_searched_and_wrong_ones_are_refused() -> None:
    given = {"spread": 1.7, "screening": {"outlier_std": 6.0}}
    space = search_space("cubature", [(3,)], [1.0], given)
    assert "spread" not in space.distributions()
    values = space.values(drawn(space, 1)[0])[1]
    assert (values["spread"], values["screening"]) == (1.7, {"outlier_std": 6.0})
    for wrong in ({"spread": -1.0}, {"spraed": 1.0}, {"screening": {"outlier_std": 1.0}}):
        with pytest.raises(ParameterError):
            search_space("cubature", [(3,)], [1.0], wrong)
    with pytest.raises(ParameterError, match="the extended learner has none"):
        search_space("extended", [(3,)], [1.0], {"spread": 1.0})


def hill(batch: Sequence[DrawnTrial]) -> list[float]:
    """Highest at x = 0.7, y = 0.2."""
    points = [trial.parameters for trial in batch]
    return [-((at["x"] - 0.7) ** 2) - (at["y"] - 0.2) ** 2 for at in points]


def test_search_comes_nearer_to_the_top_than_even_draws() -> None:
    found = search(LINE, 64, 0, hill)
    assert [trial.number for trial in found] == list(range(64))
    even = [{"x": a, "y": b} for a, b in np.random.default_rng(0).random((64, 2))]
    best = max(hill(found))
    assert best > max(hill([DrawnTrial(k, at) for k, at in enumerate(even)]))
    assert best > -(0.05**2)


def test_search_is_fixed_by_its_seed() -> None:
    first, again, other = (search(LINE, 24, seed, hill) for seed in (1, 1, 2))
    assert first == again
    assert first != other
    assert search(LINE, 12, 1, hill) == first[:12]


def flown(x: np.ndarray, y: np.ndarray, scored: np.ndarray) -> Flown:
    """Samples that are all used, (N, n_x) and (N, n_y)."""
    numbers = np.arange(len(x))
    return Flown(Samples(numbers.astype(float), x, y, numbers[:0]), numbers, scored, "a log")


def crps(y: Any, mean: Any, std: Any) -> Any:
    """Integral over x of the square of what the distribution function misses of a step at y."""
    x = np.linspace(-12.0, 12.0, 200_001)[:, None]  # standard deviations
    missed = norm.cdf(x) - (x >= (np.atleast_1d(y) - mean) / std)
    return trapezoid(missed**2, x, axis=0) * std


def test_scores_are_those_of_the_predictions_made_before(rng: np.random.Generator) -> None:
    network = DenseNetwork(2, (3,), 2)
    x, y = rng.standard_normal((20, 2)), rng.standard_normal((20, 2))
    settings = {"prior_std": 0.5, "measurement_std": [0.3, 0.7], "spread": 1.0}
    learner = CubatureLearner(network, **settings)  # type: ignore[arg-type]
    error, inside = np.empty((20, 2)), np.empty((20, 2))
    for k in range(20):
        mean, covariance = learner.predict(x[k])
        std = np.sqrt(np.diagonal(covariance))
        error[k] = crps(y[k], mean, std)
        inside[k] = np.abs(y[k] - mean) <= norm.ppf(0.975) * std
        learner.update(x[k], y[k])
    both = np.ones((20, 2), bool)
    gave = score_predictions(CubatureLearner(network, **settings), flown(x, y, both))  # type: ignore[arg-type]
    expected = error[10:] / y.std(axis=0)
    assert gave.crps_second_half == pytest.approx(
        expected.mean(), rel=1e-3
    )  # steps of the integral
    assert gave.coverage_second_half == pytest.approx(inside[10:].mean())
    first = both & [True, False]
    one = score_predictions(CubatureLearner(network, **settings), flown(x, y, first))  # type: ignore[arg-type]
    assert one.crps_second_half == pytest.approx(expected[:, 0].mean(), rel=1e-3)


def test_only_what_moves_is_scored() -> None:
    time = np.arange(1000) * 0.01
    flown = np.where(time > 5.0, np.sin(6.0 * time), 0.0)  # a robot on the ground, then in flight
    y = np.column_stack([flown, np.sin(6.0 * time), np.full(1000, 3.0), 1e-12 * np.sin(time)])
    y[300, 1] = np.nan
    scored = moving(y)
    assert not scored[:480].any(axis=0)[0] and scored[520:, 0].all()
    assert scored[:, 1].sum() == 999 and not scored[300, 1]
    assert not scored[:, 2:].any()
    assert moving(y, np.array([1.0, 1.0, 1.0, 1e-12]))[:, 3].any()  # in its own small unit


def test_what_was_not_measured_is_not_scored_and_what_was_left_out_is() -> None:
    y = np.array([[1.0], [np.nan], [3.0], [2.0]])
    innovations = iter([[0.5], [np.nan], [np.nan], [0.1]])
    learner = SimpleNamespace(
        update=lambda x, y, time: np.array(next(innovations)),
        innovation_covariance=np.eye(1),
        network=SimpleNamespace(inputs=1, measured_inputs=1),
        weights=np.zeros(1),
    )
    gave = score_predictions(learner, flown(np.zeros((4, 1)), y, np.isfinite(y)))  # type: ignore[arg-type]
    mean, std = 2.0, np.sqrt(2 / 3)  # of what was measured: 1, 3, 2
    expected = np.mean([crps(3.0, mean, std), crps(0.1, 0.0, 1.0)]) / std  # of the second half
    assert gave.crps_second_half == pytest.approx(expected, rel=1e-3)  # steps of the integral


def test_a_learner_that_diverges_is_worth_nothing_and_says_why() -> None:
    def update(x: object, y: object, time: float) -> None:
        raise FilterDiverged("update 1: the covariance is lost", Outcome.COVARIANCE_LOST)

    network = SimpleNamespace(inputs=1, measured_inputs=1)
    learner = SimpleNamespace(update=update, count=0, network=network, weights=np.zeros(1))
    y = np.ones((4, 1))
    gave = score_predictions(learner, flown(np.zeros((4, 1)), y, y > 0))  # type: ignore[arg-type]
    assert (gave.score, gave.outcome) == (-inf, Outcome.COVARIANCE_LOST)
    assert "the covariance is lost" in gave.reason


def trial(number: int) -> DrawnTrial:
    return DrawnTrial(number, {"x": 0.25, "y": 0.5})


def test_a_journal_goes_on_after_a_line_cut_short(tmp_path: Path) -> None:
    path = tmp_path / "t.jsonl"
    book = TrialJournal({"every": 10}, path)
    book.keep(trial(0), LINE, GOOD)
    book.keep(trial(1), LINE, LOST)
    path.write_text(path.read_text("utf-8")[:-7], "utf-8")
    again = TrialJournal({"every": 10}, path)
    assert str(again.scores) == str({0: GOOD})  # some numbers are nan
    again.keep(trial(1), LINE, LOST)
    last = TrialJournal({"every": 10}, path).scores[1]
    assert last.score == -inf and isnan(last.nmse_second_half)
    assert (last.reason, last.outcome) == (LOST.reason, LOST.outcome)


def test_a_journal_that_cannot_be_written_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "t.jsonl"
    book = TrialJournal({"every": 10}, path)
    book.keep(trial(0), LINE, GOOD)

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="t.jsonl: cannot be written: No space.*; free space"):
        book.keep(trial(1), LINE, LOST)
    with pytest.raises(OutputError, match="u.jsonl: cannot be written"):
        TrialJournal({"every": 10}, tmp_path / "u.jsonl")
    monkeypatch.undo()
    assert 0 in TrialJournal({"every": 10}, path).scores
    assert sorted(os.listdir(tmp_path)) == ["t.jsonl", "u.jsonl"]


def test_a_journal_of_another_question_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.jsonl"
    TrialJournal({"every": 10}, path)
    with pytest.raises(LogError, match="every was 10, is 100; name another result"):
        TrialJournal({"every": 100}, path)
    path.write_text("time,x\n", "utf-8")
    with pytest.raises(LogError, match="expected a journal of Optuna"):
        TrialJournal({"every": 10}, path)
    path.write_text('{"format": "patagium trials 1"}\n', "utf-8")
    with pytest.raises(LogError, match="expected a journal of Optuna"):
        TrialJournal({"every": 10}, path)


SETTINGS = """\
every: 10
network: {kind: dense, hidden: [3]}
learner: {prior_std: 0.5, measurement_std: [0.1, 0.2], covariance: layer}
"""


def test_settings_written_by_hand_make_a_learner_and_come_back(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(SETTINGS, "utf-8")
    settings = load_settings(path)
    learner = settings.made(DenseNetwork(2, (3,), 2))
    assert learner.describe()["covariance"] == "layer"
    assert learner.describe()["measurement_std"] == [0.1, 0.2]
    assert load_settings(settings.save(tmp_path / "again.yaml")) == settings
    assert isinstance(settings, Settings)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("every: 10", "every: 0", "every: expected a number greater than 0 such as 10, found 0"),
        ("every: 10", "", "every: expected a value such as `every: 10`, found nothing"),
        (
            "kind: dense",
            "kind: deep",
            "network.kind: expected one of dense, strip, linear_strip, grey_box",
        ),
        ("[3]}", "[3], color: red}", "line 2, network.color: expected one of the keys"),
        ("covariance", "covarance", "learner.covarance: expected one of prior_std, "),
        (": 0.5", ": wide", "prior_std: expected "),
        ("layer", "square", 'covariance: expected one of "full", "layer", "node"'),
        ("layer", "{rank: 2}", "covariance: expected one of"),
        (
            "covariance: layer",
            "noise_estimation: {span: 9}",
            "noise_estimation: expected none, or",
        ),
        (SETTINGS, "a: b: c", "expected one `key: value` a line"),
        # true was taken for 1
        ("every: 10", "every: true", "every: expected a whole number such as 10, found True"),
        ("[3]", "[true, 4]", "network.hidden.0: expected a whole number, found True"),
        (": 0.5", ": 0.5, seed: true", "learner.seed: expected a whole number, found True"),
        (": 0.5", ": true", "prior_std: expected real numbers, found 'True or False'"),
        ("0.1, 0.2", "true, 0.2", "measurement_std: expected real numbers, found 'True"),
        (": 0.5", ": 0.5, process_std: true", "process_std: expected real numbers"),
        (": 0.5", ": 0.5, forgetting_factor: true", "forgetting_factor: expected real numbers"),
    ],
)
def test_broken_settings_are_refused_with_their_place(
    old: str, new: str, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(SETTINGS.replace(old, new, 1), "utf-8")
    with pytest.raises(LogError) as refused:
        load_settings(path)
    assert str(refused.value).startswith(f"{path}: ") and said in str(refused.value)


def test_settings_that_are_not_there_are_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"none\.yaml: .*found no such file"):
        load_settings(tmp_path / "none.yaml")


def test_functions_that_use_the_package_go_to_other_processes() -> None:
    """joblib could not pickle a function that uses the package, as `jobs` of `tune` needs it."""
    from cloudpickle import dumps, loads  # as joblib has it

    for module in (pt, pt.sensors):
        assert loads(dumps(module)) is module
