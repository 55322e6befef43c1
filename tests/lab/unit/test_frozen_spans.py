"""Spans with frozen weights: where they begin, and their errors by hand."""

from __future__ import annotations

import numpy as np

import patagium as pt
from patagium.learning.stream import stream
from patagium_lab.frozen_spans import FrozenSpans
from patagium_lab.rivals.linear_learner import LinearLearner


def test_spans_freeze_the_weights_after_an_update_and_cross_no_gap(
    rng: np.random.Generator,
) -> None:
    time, x = np.arange(60) * 0.01, rng.normal(size=(60, 3))
    y = x @ np.array([[1.0, -2.0, 0.5], [0.3, 0.0, 4.0]]).T + 0.1 * rng.normal(size=(60, 2))

    def learner() -> LinearLearner:
        return LinearLearner(pt.DenseNetwork(3, (), 2), prior_std=1.0, measurement_std=0.1)

    taught, plain = learner(), learner()
    spans = FrozenSpans({"long": 0.25}, taught, time, y, 20)
    stream(taught, time, x, y, every=20, watches=[spans])
    ahead, held, truth = [], [], []
    for k in (0, 20):  # after 40 only 19 samples are left
        plain.update(x[k], y[k])
        ahead.append(plain.network.evaluate(x[k + 1 : k + 26], plain.weights))
        held.append(np.repeat(y[k : k + 1], 25, axis=0))
        truth.append(y[k + 1 : k + 26])
    whole, scores = np.concatenate(truth), spans.scores()
    for key, guess in (("nmse", ahead), ("persistence", held)):
        hand = ((whole - np.concatenate(guess)) ** 2).mean(axis=0) / whole.var(axis=0)
        found = list(scores[f"horizon_long_{key}"].values())
        np.testing.assert_allclose(found, hand, rtol=1e-12)  # rounding
    assert (scores["horizon_long_windows"], scores["horizon_long_samples"]) == (2, 25)
    crossing = FrozenSpans({"long": 0.25}, taught, time, y, 20, gaps=[30])
    stream(taught, time, x, y, every=20, gaps=[30], watches=[crossing])
    assert crossing.scores()["horizon_long_windows"] == 2  # after 0 and 30: 20 and 50 see too far
