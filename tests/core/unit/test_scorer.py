"""Scores from sums: in blocks, saved and gone on from, and far from zero."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from patagium.learning.scores import ErrorSums, IntervalSums, Scorer, normalized_error

NAMES = ("lift", "far", "still")
COUNT = 900


@pytest.fixture
def samples(rng: np.random.Generator) -> dict[str, np.ndarray]:
    y = rng.normal(size=(COUNT, 3)) * [1.0, 0.3, 0.0] + [0.0, 1e6, 0.25]
    y[rng.random(y.shape) < 0.05] = np.nan
    std = rng.uniform(0.05, 0.2, y.shape)
    guess = np.nan_to_num(y) + std * rng.normal(size=y.shape)
    innovation = np.where(np.isfinite(y), y - guess, np.nan)
    nis = np.nansum((innovation / std)[:, :2] ** 2, axis=1)
    held = np.vstack([np.zeros(3), np.nan_to_num(y[:-1])])
    return {"y": y, "guess": guess, "held": held, "innovation": innovation, "std": std, "nis": nis}


def scored(samples: dict[str, np.ndarray], cuts: list[int], saved: bool = False) -> dict[str, Any]:
    scorer = Scorer(NAMES)
    for begin, end in zip([0, *cuts], [*cuts, COUNT], strict=True):
        part = {name: values[begin:end] for name, values in samples.items()}
        late = np.arange(begin, end) >= COUNT // 2
        scorer.add_predictions(part["y"], part["guess"], part["held"], late)
        scorer.add_checks(part["innovation"], part["std"], late)
        scorer.add_updates(part["innovation"], part["std"], part["nis"])
        if saved:
            kept = {name: value.copy() for name, value in scorer.state().items()}
            scorer = Scorer(NAMES)
            scorer.resume(kept)
    return scorer.scores()


def close(found: Any, expected: Any, key: str = "") -> None:
    if isinstance(expected, dict):
        assert list(found) == list(expected), key
        for name, value in expected.items():
            close(found[name], value, f"{key}/{name}")
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=1e-9, nan_ok=True), key
    else:
        assert found == expected, key


@pytest.mark.parametrize("saved", [False, True])
def test_blocks_give_the_scores_of_all_samples(samples: dict[str, np.ndarray], saved: bool) -> None:
    close(scored(samples, [100, 130, 640], saved), scored(samples, []))


def test_sums_give_the_scores_of_arrays(samples: dict[str, np.ndarray]) -> None:
    found = scored(samples, [333])
    heard = np.array([True, True, False])
    innovation, std = samples["innovation"], samples["std"]
    assert found["silent"] == ["still"] and found["coverage_checks"] == COUNT
    for key, part in (("nmse", "guess"), ("persistence", "held")):
        for end, rows in (("", slice(None)), ("_second_half", slice(COUNT // 2, None))):
            each = normalized_error(samples["y"][rows], samples[part][rows])
            assert list(found[key + end].values()) == pytest.approx(each, rel=1e-9, nan_ok=True)
            assert found[f"{key}{end}_worst"] == pytest.approx(np.nanmax(each), rel=1e-9)
    intervals = IntervalSums(len(heard))
    intervals.add(innovation, std)
    each = intervals.coverage(heard)
    assert found["coverage"] == pytest.approx(np.nanmean(each), rel=1e-12)
    channels = np.isfinite(innovation[:, heard]).sum(axis=1)
    ratio = samples["nis"][channels > 0] / channels[channels > 0]
    assert found["nis_per_channel"] == pytest.approx(ratio.mean(), rel=1e-12)
    reach = (np.abs(innovation) / std)[:, heard]
    within = np.nanmean(np.where(np.isnan(reach), np.nan, reach <= 1.959963985))
    assert found["reliability"]["0.95"] == pytest.approx(within, rel=1e-12)
    normal = (innovation / std)[:, 0]
    pairs = np.isfinite(normal[1:]) & np.isfinite(normal[:-1])
    before, after = normal[:-1][pairs], normal[1:][pairs]
    color = before @ after / np.sqrt((before @ before) * (after @ after))
    assert found["innovation_correlation"]["lift"] == pytest.approx(color, rel=1e-9)


def test_an_output_far_from_zero_does_not_cancel(rng: np.random.Generator) -> None:
    small = rng.normal(size=(5000, 1))
    guess = small + 0.1 * rng.normal(size=small.shape)
    near = normalized_error(small, guess)
    sums = ErrorSums(1)
    for k in range(0, 5000, 7):  # 1e6 deviations away, where squares have four digits left
        sums.add(small[k : k + 7] + 1e6, guess[k : k + 7] + 1e6)
    np.testing.assert_allclose(sums.nmse, near, rtol=1e-9)


def test_what_is_forgotten_has_the_weight_of_its_age(rng: np.random.Generator) -> None:
    y, error, keep = rng.normal(size=(400, 2)), 0.1 * rng.normal(size=(400, 2)), 0.99
    sums = ErrorSums(2)
    for part in np.split(np.arange(400), [1, 30, 31, 200]):
        sums.add(y[part], (y + error)[part], keep=keep)
    weight = keep ** np.arange(399, -1, -1.0)[:, None]
    mean = (weight * y).sum(0) / weight.sum()
    expected = (weight * error**2).sum(0) / (weight * (y - mean) ** 2).sum(0)
    np.testing.assert_allclose(sums.nmse, expected, rtol=1e-9)


def test_before_any_sample_nothing_is_said() -> None:
    scores = Scorer(NAMES).scores()
    assert scores["silent"] == [] and np.isnan(scores["coverage"])
    assert np.isnan(scores["nis_per_channel"]) and scores["coverage_checks"] == 0
