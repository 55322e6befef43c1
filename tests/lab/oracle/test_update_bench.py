"""The bench of an update: its rival computes what we do, its floor counts what there is."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium_lab.bench.targets import TARGETS
from patagium_lab.bench.update import in_turns, multiply_adds, noise_results, peak_time
from patagium_lab.rivals.algorithm_1 import Algorithm1

ROUNDING = 1e-9  # thirty updates, P known to 1e-16 of its largest entry


@pytest.mark.parametrize("activation", ["softplus", "tanh"])
def test_algorithm_1_learns_the_same_weights(activation, rng):
    network = pt.DenseNetwork(
        3, (5, 4), 2, activation, input_scale=2.0, output_center=[1, 2], output_scale=[3, 1]
    )
    learner = pt.CubatureLearner(network, prior_std=0.5, measurement_std=0.1)
    rival = Algorithm1(network, 0.5 / np.sqrt(network.fan_in), np.full(2, 0.01))
    for _ in range(30):
        x, y = rng.normal(size=3), rng.normal(size=2)
        np.testing.assert_allclose(rival.update(x, y), learner.update(x, y), atol=ROUNDING)
    np.testing.assert_allclose(rival.mean, learner.weights, atol=ROUNDING)
    np.testing.assert_allclose(rival.covariance, learner.covariance, atol=ROUNDING)


def test_the_floor_counts_what_a_column_reaches():
    network = pt.DenseNetwork(2, (3,), 2)  # layers of 9 and 8 weights
    count = 2 * 17 * 18 // 2 * 2  # S Z and the change of S, entries on and below the diagonal
    for column in range(17):
        layer_end = 9 if column < 9 else 17
        count += layer_end - column + (2 * 2 * 8 if column < 9 else 0)
    assert multiply_adds(network, "triangular") == count
    assert multiply_adds(network, "square") == count + 17 * 16 * 2  # entries above the diagonal


def test_the_peak_of_single_precision_is_higher():
    double, single = (min(peak_time(name) for _ in range(9)) for name in ("float64", "float32"))
    assert 0 < single < double


def test_calls_take_turns():
    order = []
    calls = {"a": (lambda: order.append("a"), 3), "b": (lambda: order.append("b"), 2)}
    times, figures = in_turns(calls, {"c": (lambda: float(len(order)), 1)})
    assert order[:10] == list("aaabbaaabb") and set(times) == {"a", "b"}
    assert figures["c"] == np.median(np.arange(5, len(order) + 1, 5))


def test_every_structure_is_timed_with_noise_between_samples(monkeypatch):
    monkeypatch.setattr(
        "patagium_lab.bench.update.in_turns", lambda calls, _: (dict.fromkeys(calls, 1.0), {})
    )
    names = {row.name for row in noise_results(pt.load_robot("aerobat"))}
    wanted = {target.name for target in TARGETS if "noise between samples" in target.name}
    assert wanted and wanted <= names
    assert {"full covariance", "by layer", "by neuron"} <= {name.split(", ")[-2] for name in names}
