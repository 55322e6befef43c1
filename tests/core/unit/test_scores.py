import math
from typing import Any

import numpy as np
import pytest

from patagium.errors import ShapeError
from patagium.learning import scores
from patagium.learning.scores import Scorer
from patagium.reading import json_ready


def scored(truth: np.ndarray, guess: np.ndarray, names: tuple[str, ...]) -> dict[str, Any]:
    scorer = Scorer(names)
    late = np.arange(len(truth)) >= len(truth) // 2
    scorer.add_predictions(truth, guess, np.zeros_like(truth), late)
    return scorer.error_scores()


def coverage(error: np.ndarray, std: np.ndarray) -> np.ndarray:
    sums = scores.IntervalSums(error.shape[1])
    sums.add(error, std)
    return sums.coverage()


def test_error_is_mean_square_over_variance_by_hand() -> None:
    truth = np.array([[1.0, 10.0], [3.0, 30.0], [5.0, 20.0], [7.0, 40.0]])
    guess = truth + np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 10.0], [-1.0, 0.0]])
    # variances 5 and 125; mean squares 1 and 25
    np.testing.assert_allclose(scores.normalized_error(truth, guess), [0.2, 0.2], rtol=1e-15)


def test_predicting_the_mean_scores_one(rng: np.random.Generator) -> None:
    truth = rng.normal(3.0, 2.0, (50, 3))
    mean = np.broadcast_to(truth.mean(axis=0), truth.shape)
    np.testing.assert_allclose(scores.normalized_error(truth, mean), 1.0, rtol=1e-12)  # rounding


def test_silent_outputs_are_named_by_their_variance_and_scored_nan(
    rng: np.random.Generator,
) -> None:
    truth = np.column_stack([rng.normal(size=40), 1e-14 * rng.normal(size=40), np.full(40, 5.0)])
    assert np.isnan(scores.normalized_error(truth, truth)).tolist() == [False, True, True]
    result = scored(truth, truth + 0.1, ("a", "b", "c"))
    assert math.isnan(result["nmse"]["b"]) and math.isnan(result["nmse"]["c"])
    assert result["nmse_mean"] == result["nmse_worst"] == result["nmse"]["a"]


def test_a_quiet_output_is_not_silent(rng: np.random.Generator) -> None:
    truth = np.column_stack([rng.normal(size=40), 1e-6 * rng.normal(size=40)])
    assert not np.isnan(scores.normalized_error(truth, truth)).any()


def test_outputs_are_compared_in_their_scales(rng: np.random.Generator) -> None:
    """A strain that varies was taken for constant and not scored beside a pressure of 1e5 Pa."""
    y = rng.normal(size=(50, 2)) * [1.5e-5, 300.0] + [0.0, 1.01325e5]
    for scale, silent in ((1.0, ["strain"]), (np.array([3e-5, 600.0]), [])):
        scorer = Scorer(("strain", "pressure"), scale)
        scorer.add_predictions(y, y, y, np.arange(50) >= 25)
        assert scorer.error_scores()["silent"] == silent


def test_second_half_looks_at_the_second_half_alone() -> None:
    truth = np.arange(8.0)[:, None]
    guess = truth.copy()
    guess[:4] += 100.0
    result = scored(truth, guess, ("a",))
    assert result["nmse_second_half"]["a"] == 0.0
    assert result["nmse"]["a"] == pytest.approx(5000.0 / 5.25, rel=1e-14)


def test_mean_and_worst_over_outputs() -> None:
    result = scores.span_scores([0.1, math.nan, 0.3], ("a", "b", "c"), "s")
    assert result["s_mean"] == pytest.approx(0.2, rel=1e-15)
    assert result["s_worst"] == 0.3


def test_persistence_holds_the_last_used_sample_and_never_the_present_one() -> None:
    truth = np.arange(10.0, 17.0)[:, None]
    held = scores.persistence(truth, [0, 3, 6])
    assert held[:, 0].tolist() == [0.0, 10.0, 10.0, 10.0, 13.0, 13.0, 13.0]


def test_coverage_counts_each_component() -> None:
    error = np.array([[0.5, 3.0], [1.9, 0.0], [-2.0, -1.0], [0.0, 1.9]])
    np.testing.assert_allclose(coverage(error, np.ones((4, 2))), [0.75, 0.75])


def test_coverage_of_a_gaussian_is_ninety_five_percent(rng: np.random.Generator) -> None:
    share = coverage(rng.normal(0.0, 2.0, (20_000, 1)), np.full((20_000, 1), 2.0))
    assert share[0] == pytest.approx(0.95, abs=0.006)  # four standard errors


def test_coverage_without_a_predicted_deviation_is_unknown() -> None:
    assert np.isnan(coverage(np.ones((3, 2)), np.full((3, 2), np.nan))).all()


def test_shapes_are_refused() -> None:
    with pytest.raises(ShapeError, match="prediction"):
        scores.normalized_error(np.ones((3, 2)), np.ones((3, 1)))
    with pytest.raises(ShapeError, match="measurement"):
        scores.normalized_error(np.ones(3), np.ones(3))


def test_scores_for_json_have_no_nan() -> None:
    ready = json_ready({"a": math.nan, "b": [np.float64(1.0), np.int64(2)], "c": {"d": "e"}})
    assert ready == {"a": None, "b": [1.0, 2], "c": {"d": "e"}}
