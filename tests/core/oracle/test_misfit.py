"""Error of the model found from the data: C against NumPy, and what is known of the truth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import patagium as pt
from patagium.errors import ParameterError
from patagium.learning import ExtendedLearner, Misfit, NoiseEstimation, Screening
from patagium.learning.filters import block_kernel
from patagium.learning.filters.misfit import PARTS
from patagium.learning.learners import filter_learner
from patagium.learning.model_file import load_model, model_of, save_model
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.result import check

Array = NDArray[np.float64]


def samples(count: int, inputs: int = 3, outputs: int = 2) -> Iterator[tuple[float, Array, Array]]:
    """A plant whose error is correlated, with gaps, missing channels and an outlier."""
    draw, error = np.random.default_rng(3), np.zeros(outputs)
    matrix = draw.standard_normal((outputs, inputs))
    for k in range(count):
        x = np.sin(0.3 * k * (1 + np.arange(inputs))) + 0.1 * draw.standard_normal(inputs)
        error = 0.9 * error + 0.1 * draw.standard_normal(outputs)
        y = matrix @ x + error
        if k % 17 == 3:
            y[k % outputs] = np.nan
        if k == 50:
            y[:] = np.nan
        if k == 40:
            y[0] = 30.0
        yield 0.01 * k + (0.3 if k > 60 else 0.0), x, y


def pair(network: pt.learning.Network, **settings: object) -> tuple[ExtendedLearner, ...]:
    """A learner that is compiled where it can be, and one in NumPy."""
    fast = ExtendedLearner(network, misfit=Misfit(), prior_std=1.0, **settings)
    whole = block_kernel.structure_and_kernel
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            filter_learner, "structure_and_kernel", lambda numbers: (whole(numbers)[0], None)
        )
        slow = ExtendedLearner(network, misfit=Misfit(), prior_std=1.0, **settings)
    return fast, slow


@pytest.mark.parametrize("covariance", ["full", "layer", "node"])
@pytest.mark.parametrize("std", [None, 0.05])
def test_compiled_and_numpy_learners_agree(covariance: object, std: float | None) -> None:
    network = DenseNetwork(3, (5,), ("a", "b"))
    fast, slow = pair(network, covariance=covariance, measurement_std=std, screening=None)
    for k, (time, x, y) in enumerate(samples(100)):
        stamp = None if k in (20, 21) else time
        for one, other in zip(
            fast.predict(x, None, time), slow.predict(x, None, time), strict=True
        ):
            np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-10)
        one, other = fast.update(x, y, stamp), slow.update(x, y, stamp)
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(fast.nis, slow.nis, rtol=1e-6)
    np.testing.assert_allclose(fast.weights, slow.weights, rtol=1e-8, atol=1e-9)


def test_units_of_outputs_change_nothing() -> None:
    """Intervals of a strain were far too wide beside a pressure, whose numbers are far larger."""
    units, names = np.array([2.0**-26, 2.0**10]), ("strain", "pressure")
    plain = pair(DenseNetwork(3, (5,), names))
    scaled = pair(DenseNetwork(3, (5,), names, output_scale=units))
    for time, x, y in samples(100):
        for one, other in zip(plain, scaled, strict=True):
            (mean, covariance), (own, meant) = (m.predict(x, None, time) for m in (one, other))
            np.testing.assert_allclose(own / units, mean, rtol=1e-8, atol=1e-10)
            scaled_back = meant / np.outer(units, units)
            np.testing.assert_allclose(scaled_back, covariance, rtol=1e-8, atol=1e-10)
            one.update(x, y, time)
            other.update(x, units * y, time)
            np.testing.assert_allclose(other.nis, one.nis, rtol=1e-6)


def test_weights_are_as_sure_as_their_errors_are_large() -> None:
    """With an error correlated over ten samples, white noise is too sure of the weights."""
    network, ratios = DenseNetwork(2, (), ("y",)), {}
    for name, settings in (
        ("misfit", {"misfit": Misfit()}),
        ("white", {"noise_estimation": NoiseEstimation()}),
    ):
        squares = []
        for seed in range(30):
            draw, error = np.random.default_rng(seed), 0.0
            learner = ExtendedLearner(network, prior_std=3.0, **settings)
            phase = np.cumsum(0.2 + 0.05 * draw.standard_normal(300))
            for k in range(300):
                x = np.array([np.sin(phase[k]), np.cos(0.37 * phase[k])])
                error = 0.9 * error + 0.2 * np.sqrt(1 - 0.81) * draw.standard_normal()
                learner.update(x, [x @ [1.0, -0.5] + error], 0.01 * k)
            apart = learner.weights[:2] - [1.0, -0.5]
            squares.append(apart @ np.linalg.solve(learner.covariance[:2, :2], apart) / 2)
        ratios[name] = float(np.mean(squares))
    # one is an exact filter: the surplus of certainty is to be a third at most
    assert ratios["misfit"] - 1 < (ratios["white"] - 1) / 3, ratios


def test_error_is_carried_on_for_as_long_as_it_lasts() -> None:
    network = DenseNetwork(1, (), ("y",))
    learner = ExtendedLearner(network, misfit=Misfit(), prior_std=1e-3)
    draw, error = np.random.default_rng(0), 0.0
    for k in range(400):
        error = 0.95 * error + draw.standard_normal()
        learner.update([0.0], [error], 0.01 * k)
    last = error - learner.predict([0.0])[0][0]
    ahead = learner.carried(np.array([3.99 + 0.01, 3.99 + 0.1, 3.99 + 5.0]))[:, 0]
    assert ahead[0] == pytest.approx(0.95 * last, rel=0.1)  # 400 samples: rho to .03
    assert ahead[1] == pytest.approx(0.95**10 * last, rel=0.5, abs=0.3)
    assert abs(ahead[2]) < 1e-3
    mean, _ = learner.predict([0.0], None, 4.0)
    assert mean[0] == pytest.approx(learner.predict([0.0])[0][0] + ahead[0], abs=1e-12)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_spike_within_the_range_leaves_nothing_behind(compiled: bool) -> None:
    """What a wild sample leaves is no error of the model that would still be there later."""
    spoilt, twin = (
        pair(DenseNetwork(1, (), ("y",)), screening=Screening())[not compiled] for _ in range(2)
    )
    draw, error, squares = np.random.default_rng(0), 0.0, np.zeros(2)
    for k in range(600):
        error = 0.95 * error + draw.standard_normal()
        found = spoilt.update([0.0], [60.0 if k == 400 else error], 0.01 * k)
        other = twin.update([0.0], [error], 0.01 * k)
        if k > 400:
            squares += found[0] ** 2, other[0] ** 2
    assert spoilt.events["out_of_range"] == 0  # it reached the filter
    assert squares[0] < 1.5**2 * squares[1]


def test_samples_after_a_gap_count_no_error_from_before_it() -> None:
    """An error that stays as it is from sample to sample is forgotten over a thousand of them."""
    learner = ExtendedLearner(DenseNetwork(1, (), ("y",)), misfit=Misfit(), prior_std=1e-6)
    for k in range(100):
        learner.update([0.0], [5.0], 0.01 * k)
    near, far = learner.carried(np.array([1.0, 11.0]))[:, 0]
    assert near == pytest.approx(5.0, rel=0.02) and abs(far) < 1e-3


def test_intervals_of_the_flow_that_is_learned_hold_95_percent() -> None:
    network, inside, total = DenseNetwork(3, (), ("a", "b")), 0, 0
    learner = ExtendedLearner(network, misfit=Misfit(), prior_std=1.0)
    for k, (time, x, y) in enumerate(samples(1500)):
        mean, covariance = learner.predict(x, None, time)
        if k > 200:
            kept = np.isfinite(y)
            inside += int((abs(y - mean)[kept] < 1.96 * np.sqrt(np.diag(covariance))[kept]).sum())
            total += int(kept.sum())
        learner.update(x, y, time)
    assert inside / total == pytest.approx(0.95, abs=0.015)  # 2600 samples: deviation .004


@pytest.mark.parametrize("compiled", [True, False])
def test_intervals_follow_the_noise_of_each_sample(compiled: bool) -> None:
    """Of noise ten times as large in every other sample 1.00 of the good were held, .7 of the bad.

    Four deviations of a share of 400 samples are 4 %; a frozen model states the same.
    """
    learner = pair(DenseNetwork(1, (), ("y",)), screening=None)[0 if compiled else 1]
    draw, inside = np.random.default_rng(5), {0.01: [0.0], 0.1: [0.0]}
    for k in range(1600):
        x, std = draw.standard_normal(1), (0.01, 0.1)[int(draw.uniform() < 0.5)]
        y = np.array([2.0 * x[0] + std * draw.standard_normal()])
        for one in (learner, model_of(learner)) if k >= 800 and k % 2 else ():
            checked = check(one, k, (x, y), np.array([std]), 0.01 * k)
            inside[std].append(float(abs(checked.error[0]) < 1.96 * checked.std[0]))
        learner.update(x, y, time=0.01 * k, std=np.array([std]))
    for share in map(np.mean, inside.values()):
        assert 0.91 < share < 0.99


def test_interval_grows_in_flow_that_was_not_seen() -> None:
    network = DenseNetwork(2, (), ("y",))
    learner = ExtendedLearner(network, misfit=Misfit(), prior_std=1.0)
    for k in range(300):
        x = np.array([np.sin(0.2 * k), 0.0])
        learner.update(x, [2 * x[0] + 0.01 * np.cos(0.4 * k)], 0.01 * k)
    seen, unseen = learner.predict([0.7, 0.0])[1][0, 0], learner.predict([0.7, 1.0])[1][0, 0]
    assert np.sqrt(seen) < 0.05 and np.sqrt(unseen) > 0.9  # the prior of the weight never seen


def test_a_rest_is_no_flow_of_late() -> None:
    """A log that ends at rest made its own flow unknown, in C and NumPy; a rest before all ends."""
    fast, slow = pair(DenseNetwork(2, (), ("y",)), measurement_std=1e-3)
    for k in range(900):
        x = (200 <= k < 500) * np.array([np.sin(0.2 * k), np.cos(0.2 * k)])
        for one in (fast, slow):
            one.update(x, [x[0] + 0.2 * x[0] ** 3 + 1e-3 * np.sin(7 * k)], 0.01 * k)
        if k == 499:
            flown = one.predict([0.7, 0.7])[1], one.usual_std
    np.testing.assert_allclose(fast.usual_std, slow.usual_std, rtol=1e-9)  # rounding
    np.testing.assert_allclose(slow.usual_std, flown[1], rtol=0.2)
    np.testing.assert_allclose(slow.predict([0.7, 0.7])[1], flown[0], rtol=0.2)


def test_one_wild_sample_does_not_change_the_scale_for_good() -> None:
    network = DenseNetwork(1, (), ("y",))
    learner = ExtendedLearner(
        network, misfit=Misfit(), prior_std=1.0, screening=pt.learning.Screening()
    )
    for k in range(200):
        x = np.sin(0.3 * k)
        learner.update([x], [1e150 if k == 100 else x], 0.01 * k)
    assert np.isfinite(learner.weights).all() and learner.weights[0] == pytest.approx(1, abs=0.05)


def test_a_learner_file_of_the_release_before_misfit_is_read() -> None:
    """Such a file has none of the arrays of the misfit, and none of a noise that was found."""
    network = DenseNetwork(1, (), ("y",))
    learner = ExtendedLearner(network, prior_std=1.0, measurement_std=0.1)
    learner.update([1.0], [0.5], 0.0)
    state = learner.state()
    added = {f"screen_{name}" for name in ("heard", "clock", *PARTS)}
    assert added < set(state)
    again = ExtendedLearner(network, prior_std=1.0, measurement_std=0.1)
    again.resume({name: value for name, value in state.items() if name not in added})
    for one in (learner, again):
        one.update([0.3], [0.2], 0.01)
    np.testing.assert_array_equal(again.weights, learner.weights)


def test_parts_of_the_last_error_at_many_times_are_those_one_by_one() -> None:
    learner = ExtendedLearner(DenseNetwork(3, (), ("a", "b")), misfit=Misfit(), prior_std=1.0)
    for time, x, y in samples(50):
        learner.update(x, y, time)
    times = time + np.array([0.0, 0.004, 0.01, 0.3, np.nan])
    each = [learner.carried(np.array([one]))[0] for one in times]
    np.testing.assert_array_equal(learner.carried(times), each)


def test_misfit_and_estimated_noise_exclude_each_other() -> None:
    with pytest.raises(ParameterError, match="None where misfit is given"):
        ExtendedLearner(
            DenseNetwork(1, (), ("y",)), misfit=Misfit(), noise_estimation=NoiseEstimation()
        )


def test_an_output_that_was_zero_at_first_has_a_misfit_later() -> None:
    learner = ExtendedLearner(DenseNetwork(1, (), ("y",)), misfit=Misfit(), prior_std=1e-6)
    for k in range(300):
        learner.update([0.0], [np.sin(0.3 * k) if k > 30 else 0.0], 0.01 * k)
    _, std = learner.predict([0.0])
    assert 0.3 < std[0] < 3.0  # the rms is .7


def test_outputs_that_are_zero_are_learned_beside_others() -> None:
    network = DenseNetwork(1, (), ("y", "nothing"))
    learner = ExtendedLearner(network, misfit=Misfit(), prior_std=1.0)
    for k in range(50):
        learner.update([np.sin(k)], [np.sin(k), 0.0], 0.01 * k)
    assert np.isfinite(learner.weights).all() and np.isfinite(learner.nis)


def test_model_file_states_the_intervals_of_the_learner(tmp_path: Path) -> None:
    """In flow like that of late and far from it, where an interval without `misfit` differs."""
    learner, _ = pair(DenseNetwork(3, (5,), ("a", "b")))
    for time, x, y in samples(100):
        learner.update(x, y, time)
    model = load_model(save_model(tmp_path / "model.json", learner))
    for size in (0.5, 20.0):
        mean, covariance = learner.predict(np.full(3, size))
        expected, stated = model.predict(np.full(3, size))
        np.testing.assert_allclose(expected, mean, rtol=1e-12)  # rounding
        found, variances = np.diag(stated), np.diag(covariance)
        np.testing.assert_allclose(found, variances, rtol=1e-6)  # rounding of the root
    near, far = (model.predict(np.full(3, size))[1][0, 0] for size in (0.5, 20.0))
    assert far > 10 * near
