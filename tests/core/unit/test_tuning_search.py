"""What may be tuned, where a search looks, what a trial is worth, and what is kept of it."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from math import inf, isnan
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from patagium.errors import FilterDiverged, LogError, Outcome, ParameterError
from patagium.learning import CubatureLearner, DenseNetwork, ExtendedLearner, load_settings
from patagium.learning.tuning.foresight import Foresight, moving, predict
from patagium.learning.tuning.journal import Journal
from patagium.learning.tuning.knobs import (
    KNOBS,
    Choice,
    Level,
    keywords,
    knobs_for,
    values_at,
)
from patagium.learning.tuning.search import LEAST_TRIALS, Asked, evaluations, search
from patagium.learning.tuning.settings import Settings

LEARNERS = {"cubature": CubatureLearner, "extended": ExtendedLearner}
GOOD = Foresight(1.5, 1.0, 10, 0.1, 0.95)
LOST = Foresight(-inf, -inf, 3, outcome=Outcome.NOT_FINITE, reason="too far")


@pytest.mark.parametrize("knob", KNOBS, ids=lambda knob: knob.name)
def test_every_knob_turns_a_keyword_of_its_learners(knob: Level | Choice) -> None:
    for kind in knob.learners:
        assert knob.name in inspect.signature(LEARNERS[kind]).parameters
    found = {str(knob.value([u] * len(knob.axes))) for u in (0.05, 0.55, 0.95)}
    assert len(found) == 3


@pytest.mark.parametrize("kind", LEARNERS)
def test_learners_take_whatever_the_knobs_say(kind: str) -> None:
    network = DenseNetwork(2, (3,), 2)
    knobs = knobs_for(kind, (0.1, 0.2), ("full", {"rank": 2}))  # type: ignore[arg-type]
    axes = sum(len(knob.axes) for knob in knobs)
    for point in np.random.default_rng(3).random((10, axes)):
        values = values_at(knobs, point)
        learner = LEARNERS[kind](network, **keywords(values))
        assert learner.describe()["covariance"] == values["covariance"]
        ratio = values["measurement_std"][1] / values["measurement_std"][0]
        assert ratio == pytest.approx(2.0, rel=0.01)  # three digits


def test_levels_stay_in_their_range_and_have_three_digits() -> None:
    level = Level("spread", 0.3, 4.0)
    assert (level.value([0.0]), level.value([1.0])) == (0.3, 4.0)
    assert level.value([0.4321]) == float(f"{level.value([0.4321]):.3g}")
    memory = Level("forgetting_factor", 1e-5, 0.1, below_one=True, off=1.0)
    assert memory.value([0.5, 0.2]) == 1.0
    assert memory.value([1.0, 0.8]) == pytest.approx(0.9, rel=1e-12)  # rounding


def hill(asked: Sequence[Asked]) -> list[float]:
    """Highest at 0.7, 0.2, in the upper half of the third coordinate."""
    return [
        -((a.point[0] - 0.7) ** 2) - (a.point[1] - 0.2) ** 2 - (a.point[2] < 0.5) for a in asked
    ]


def test_search_ends_near_the_top_and_asks_as_often_as_it_says() -> None:
    asked: list[Asked] = []

    def judge(points: Sequence[Asked]) -> list[float]:
        asked.extend(points)
        return hill(points)

    found = search([False, False, True], 64, 0, judge)
    assert found[0][1] == max(score for _, score in found)
    np.testing.assert_allclose(found[0][0][:2], [0.7, 0.2], atol=0.05)  # last box: 1/32
    assert len(asked) == evaluations(64)
    assert sum(not one.whole for one in asked) == 32
    even = max(hill([Asked(p, True) for p in np.random.default_rng(0).random((64, 3))]))
    assert found[0][1] > even


def test_search_is_fixed_by_its_seed_and_refuses_too_few_trials() -> None:
    first, again, other = (search([False] * 3, 16, seed, hill)[0][0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    with pytest.raises(ParameterError, match="trials: expected at least 8, found 7"):
        search([False], LEAST_TRIALS - 1, 0, hill)


def test_likelihood_is_that_of_the_predictions_made_before(rng: np.random.Generator) -> None:
    network = DenseNetwork(2, (3,), 2)
    x, y = rng.standard_normal((20, 2)), rng.standard_normal((20, 2))
    settings = {"prior_std": 0.5, "measurement_std": [0.3, 0.7], "spread": 1.0}
    learner = CubatureLearner(network, **settings)  # type: ignore[arg-type]
    density, inside = np.empty((20, 2)), np.empty((20, 2))
    for k in range(20):
        mean, covariance = learner.predict(x[k])
        std = np.sqrt(np.diagonal(covariance))
        density[k] = norm.logpdf(y[k], mean, std)
        inside[k] = np.abs(y[k] - mean) <= norm.ppf(0.975) * std
        learner.update(x[k], y[k])
    both = np.ones((20, 2), bool)
    gave = predict(CubatureLearner(network, **settings), x, y, both)  # type: ignore[arg-type]
    assert gave.log_likelihood == pytest.approx(density.sum(), rel=1e-9)  # rounding
    assert gave.log_likelihood_second_half == pytest.approx(density[10:].sum(), rel=1e-9)
    assert gave.coverage_second_half == pytest.approx(inside[10:].mean())
    first = both & [True, False]
    one = predict(CubatureLearner(network, **settings), x, y, first)  # type: ignore[arg-type]
    assert one.log_likelihood == pytest.approx(density[:, 0].sum(), rel=1e-9)


def test_only_what_moves_is_scored() -> None:
    time = np.arange(1000) * 0.01
    flown = np.where(time > 5.0, np.sin(6.0 * time), 0.0)  # a robot on the ground, then in flight
    y = np.column_stack([flown, np.sin(6.0 * time), np.full(1000, 3.0), 1e-12 * np.sin(time)])
    y[300, 1] = np.nan
    scored = moving(y)
    assert not scored[:480].any(axis=0)[0] and scored[520:, 0].all()
    assert scored[:, 1].sum() == 999 and not scored[300, 1]
    assert not scored[:, 2:].any()


def test_what_was_not_measured_is_not_scored_and_what_was_left_out_is() -> None:
    y = np.array([[1.0], [np.nan], [3.0], [2.0]])
    innovations = iter([[0.5], [np.nan], [np.nan], [0.1]])
    learner = SimpleNamespace(
        update=lambda x, y: np.array(next(innovations)),
        innovation_covariance=np.eye(1),
        network=SimpleNamespace(inputs=1, measured_inputs=1),
        weights=np.zeros(1),
    )
    gave = predict(learner, np.zeros((4, 1)), y, np.isfinite(y))  # type: ignore[arg-type]
    mean, std = 2.0, np.sqrt(2 / 3)  # of what was measured: 1, 3, 2
    left_out = norm.logpdf(3.0, mean, std)
    expected = norm.logpdf(0.5) + left_out + norm.logpdf(0.1)
    assert gave.log_likelihood == pytest.approx(expected, rel=1e-12)  # rounding


def test_a_learner_that_diverges_is_worth_nothing_and_says_why() -> None:
    def update(x: object, y: object) -> None:
        raise FilterDiverged("update 1: the covariance is lost", Outcome.COVARIANCE_LOST)

    network = SimpleNamespace(inputs=1, measured_inputs=1)
    learner = SimpleNamespace(update=update, count=0, network=network, weights=np.zeros(1))
    y = np.ones((4, 1))
    gave = predict(learner, np.zeros((4, 1)), y, y > 0)  # type: ignore[arg-type]
    assert (gave.score, gave.outcome) == (-inf, Outcome.COVARIANCE_LOST)
    assert "the covariance is lost" in gave.reason


def test_a_journal_goes_on_after_a_line_cut_short(tmp_path: Path) -> None:
    path = tmp_path / "t.jsonl"
    book = Journal({"every": 10}, path)
    book.keep({"spread": 1.0}, GOOD)
    book.keep({"spread": 2.0}, LOST)
    path.write_text(path.read_text("utf-8")[:-7], "utf-8")
    again = Journal({"every": 10}, path)
    assert (again.found({"spread": 1.0}), again.found({"spread": 2.0})) == (GOOD, None)
    again.keep({"spread": 2.0}, LOST)
    last = Journal({"every": 10}, path).found({"spread": 2.0})
    assert last is not None and last.score == -inf and isnan(last.nmse_second_half)
    assert (last.reason, last.outcome) == (LOST.reason, LOST.outcome)


def test_a_journal_of_another_question_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.jsonl"
    Journal({"every": 10}, path)
    with pytest.raises(LogError, match="every was 10, is 100; name another result"):
        Journal({"every": 100}, path)
    path.write_text("time,x\n", "utf-8")
    with pytest.raises(LogError, match="expected a journal of trials"):
        Journal({"every": 10}, path)
    Journal({"every": 10}, tmp_path / "u.jsonl")
    with (tmp_path / "u.jsonl").open("a", encoding="utf-8") as file:
        file.write('{"outcome": "LOST"}\n')
    with pytest.raises(LogError, match="expected a trial in each line"):
        Journal({"every": 10}, tmp_path / "u.jsonl")


SETTINGS = """\
every: 10
network: {kind: dense, hidden: [3]}
learner: {prior_std: 0.5, measurement_std: [0.1, 0.2], covariance: {rank: 2}}
"""


def test_settings_written_by_hand_make_a_learner_and_come_back(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(SETTINGS, "utf-8")
    settings = load_settings(path)
    learner = settings.made(DenseNetwork(2, (3,), 2))
    assert learner.describe()["covariance"] == {"rank": 2}
    assert learner.describe()["measurement_std"] == [0.1, 0.2]
    assert load_settings(settings.save(tmp_path / "again.yaml")) == settings
    assert isinstance(settings, Settings)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("every: 10", "every: 0", "every: Input should be greater than 0, found 0"),
        ("every: 10", "", "every: expected, but not there"),
        (
            "kind: dense",
            "kind: deep",
            "network.kind: Input should be 'strip', 'hidden_strip', 'flow', 'hidden_flow' or",
        ),
        ("[3]}", "[3], color: red}", "network.color: unknown key"),
        ("covariance", "covarance", "learner: covarance: expected one of prior_std, "),
        ("prior_std: 0.5, ", "", "learner: prior_std: expected, but not there"),
        (": 0.5", ": wide", "prior_std: expected a number such as 3.0e-4"),
        ("{rank: 2}", "square", 'covariance: expected "full", "layer", "node"'),
        ("covariance: {rank: 2}", "noise_estimation: {span: 9}", "noise_estimation: expected one"),
        (SETTINGS, "a: b: c", "expected YAML"),
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
    with pytest.raises(LogError, match=r"none\.yaml: cannot be read: No such file"):
        load_settings(tmp_path / "none.yaml")
