import math
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from patagium.errors import FilterDiverged, LogError, Outcome, ParameterError, ShapeError
from patagium.learning.result import load_identification
from patagium.learning.stream import Hold, check_samples, holds, stream, used_samples

Array = NDArray[np.float64]


class Lines:
    """y_i = w_i . x: the smallest network there is."""

    def __init__(self, inputs: int, outputs: int) -> None:
        self.inputs, self.outputs = inputs, outputs
        self.size = inputs * outputs
        self.output_names = tuple(f"y{i}" for i in range(outputs))

    def evaluate(self, x: Array, weights: Array) -> Array:
        return x @ weights.reshape(self.outputs, self.inputs).T

    def estimates(self, weights: Array, variances: Array | None = None) -> tuple[()]:
        return ()


class Kalman:
    """Kalman filter over the weights of `Lines`, one covariance for all outputs."""

    time_per_update = 1e-6

    def __init__(self, inputs: int, outputs: int, noise: float = 0.1, fail_at: int = -1) -> None:
        self.network = Lines(inputs, outputs)
        self.weights = np.zeros(inputs * outputs)
        self.one = np.eye(inputs)
        self.noise, self.fail_at, self.count = noise, fail_at, 0

    @property
    def covariance(self) -> Array:
        return np.kron(np.eye(self.network.outputs), self.one)

    @property
    def variances(self) -> Array:
        return np.diagonal(self.covariance)

    def predict(self, x: Array) -> tuple[Array, Array]:
        variance = x @ self.one @ x + self.noise**2
        mean = self.network.evaluate(x[None], self.weights)[0]
        return mean, variance * np.eye(len(mean))

    events: ClassVar[dict[str, int]] = {}

    def update(self, x: Array, y: Array, time: float | None = None) -> Array:
        self.count += 1
        if self.count == self.fail_at:
            raise FilterDiverged("the covariance was lost", Outcome.COVARIANCE_LOST)
        gain = self.one @ x / (x @ self.one @ x + self.noise**2)
        innovation = y - self.network.evaluate(x[None], self.weights)[0]
        self.weights = (self.weights.reshape(len(y), -1) + innovation[:, None] * gain[None]).ravel()
        self.one = self.one - np.outer(gain, x @ self.one)
        return np.asarray(innovation)


def log(count: int, seed: int = 0, noise: float = 0.1) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(count, 3))
    y = x @ np.array([[1.0, -2.0, 0.5], [0.3, 0.0, 4.0]]).T + noise * rng.normal(size=(count, 2))
    return np.arange(count) * 0.01, x, y


def test_hold_intervals_hold_each_sample_once_and_learn_one_in_every() -> None:
    used = used_samples(np.zeros((10, 1)), 4)
    assert used.tolist() == [0, 4, 8]
    assert list(holds(used, 10)) == [
        Hold(0, 1, True), Hold(1, 5, True), Hold(5, 9, True), Hold(9, 10, False)
    ]  # fmt: skip


def test_a_gap_starts_the_count_anew() -> None:
    y = np.zeros((10, 1))
    assert used_samples(y, 4, [6]).tolist() == [0, 4, 6]
    assert used_samples(y, 4, [4, 5]).tolist() == [0, 4, 5, 9]


def test_outputs_that_are_measured_seldom_are_learned() -> None:
    """A torque measured in one row of ten, and not in the first, was never learned."""
    y = np.zeros((1000, 4))
    y[np.arange(1000) % 10 != 3, 1] = np.nan
    y[np.arange(1000) % 20 != 17, 2] = np.nan
    y[:, 3] = np.nan
    used = used_samples(y, 10)
    assert (used // 10).tolist() == list(range(100))
    assert np.isfinite(y[used]).sum(axis=0).tolist() == [100, 50, 50, 0]


def test_every_must_be_positive() -> None:
    with pytest.raises(ParameterError, match="every"):
        used_samples(np.zeros((10, 1)), 0)


def test_interval_checks_see_all_distances_to_the_update() -> None:
    intervals = list(holds(used_samples(np.zeros((3000, 1)), 10), 3000))
    offsets = {
        i - hold.begin
        for hold, checks in zip(intervals, check_samples(intervals), strict=True)
        for i in checks
    }
    assert offsets == set(range(10))


def test_predictions_are_those_of_a_plain_loop() -> None:
    time, x, y = log(95)
    result = stream(Kalman(3, 2), time, x, y, every=10)
    plain, expected = Kalman(3, 2), np.zeros_like(y)
    for k in range(95):
        expected[k] = plain.network.evaluate(x[k : k + 1], plain.weights)[0]
        if k % 10 == 0:
            plain.update(x[k], y[k])
    np.testing.assert_allclose(result.prediction["prediction"], expected, rtol=1e-13)
    np.testing.assert_array_equal(result.learner.weights, plain.weights)
    assert result.scores["updates"] == 10 and result.outcome is Outcome.COMPLETED


@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("k", [0, 13, 14, 20])
def test_no_prediction_sees_its_own_sample_or_a_later_one(every: int, k: int) -> None:
    time, x, y = log(40)
    changed = y.copy()
    changed[k:] += 100.0
    honest = stream(Kalman(3, 2), time, x, y, every=every).prediction["prediction"].values
    again = stream(Kalman(3, 2), time, x, changed, every=every).prediction["prediction"].values
    np.testing.assert_array_equal(honest[: k + 1], again[: k + 1])
    following = used_samples(y, every)
    following = following[following >= k][0]
    assert not np.array_equal(honest[following + 1], again[following + 1])


def test_samples_that_are_not_used_teach_nothing() -> None:
    time, x, y = log(40)
    changed = y.copy()
    changed[np.arange(40) % 7 != 0] += 100.0
    honest = stream(Kalman(3, 2), time, x, y, every=7).prediction["prediction"]
    again = stream(Kalman(3, 2), time, x, changed, every=7).prediction["prediction"]
    np.testing.assert_array_equal(honest, again)


def test_scores_are_of_all_samples_and_persistence_is_beside() -> None:
    time, x, y = log(400)
    result = stream(Kalman(3, 2), time, x, y, every=10, names=("lift", "drag"))
    guess = result.prediction["prediction"].values
    hand = ((y - guess) ** 2).mean(axis=0) / y.var(axis=0)
    assert list(result.scores["nmse"]) == ["lift", "drag"]
    np.testing.assert_allclose(list(result.scores["nmse"].values()), hand, rtol=1e-13)
    assert result.scores["nmse_second_half_mean"] < 0.02
    # white inputs: holding a sample doubles the variance
    assert result.scores["persistence_mean"] == pytest.approx(2.0, rel=0.25)


def test_a_calibrated_filter_covers_ninety_five_percent() -> None:
    time, x, y = log(3000)
    scores = stream(Kalman(3, 2), time, x, y, every=10).scores
    assert scores["coverage_checks"] > 500
    assert scores["coverage"] == pytest.approx(0.95, abs=0.03)  # four standard errors
    assert set(scores["coverage_by_output"]) == {"y0", "y1"}


def test_an_overconfident_filter_is_found_out() -> None:
    time, x, y = log(3000)
    assert stream(Kalman(3, 2, noise=0.02), time, x, y, every=10).scores["coverage"] < 0.5


def test_a_gap_is_counted_and_splits_the_hold_interval() -> None:
    time, x, y = log(50)
    time[23:] += 1.0
    result = stream(Kalman(3, 2), time, x, y, every=10, gaps=[23], horizons={"h": 0.05})
    assert result.scores["gaps"] == 1
    updates = np.flatnonzero(np.isin(time, result.prediction["update_time"]))
    assert updates.tolist() == [0, 10, 20, 23, 33, 43]


def test_silent_outputs_are_named() -> None:
    time, x, y = log(50)
    y[:, 1] = 0.0
    scores = stream(Kalman(3, 2), time, x, y, every=1).scores
    assert scores["silent"] == ["y1"]
    assert math.isnan(scores["nmse"]["y1"]) and scores["nmse_worst"] == scores["nmse"]["y0"]


def test_a_diverged_learner_keeps_what_it_had_and_says_when_and_why() -> None:
    time, x, y = log(100)
    result = stream(Kalman(3, 2, fail_at=6), time, x, y, every=10)
    assert result.outcome is Outcome.COVARIANCE_LOST
    assert "t = 0.5 s" in result.message and "the covariance was lost" in result.message
    assert result.scores["updates"] == 5 and result.scores["samples_predicted"] == 51
    guess = result.prediction["prediction"].values
    assert np.isfinite(guess[:51]).all() and np.isnan(guess[51:]).all()
    assert math.isfinite(result.scores["nmse_mean"])


def test_weights_that_are_lost_are_noticed() -> None:
    class Poisoned(Kalman):
        def update(self, x: Array, y: Array, time: float | None = None) -> Array:
            innovation = super().update(x, y, time)
            if self.count == 3:
                self.weights = self.weights * np.nan
            return innovation

    time, x, y = log(100)
    result = stream(Poisoned(3, 2), time, x, y, every=10)
    assert result.outcome is Outcome.NOT_FINITE and result.scores["updates"] == 2


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"x": np.ones((5, 2))}, ShapeError, "x: expected shape"),
        ({"y": np.ones((5, 3))}, ShapeError, "y: expected shape"),
        ({"names": ("a",)}, ShapeError, "names"),
        ({"time": np.array([0.0, 1, 1, 2, 3])}, LogError, "found 1 s after 1 s at sample 2"),
        ({"x": np.full((5, 3), np.nan)}, LogError, "x: expected finite numbers"),
    ],
)
def test_what_does_not_fit_is_refused(
    change: dict[str, Any], error: type[Exception], message: str
) -> None:
    time, x, y = log(5)
    given: dict[str, Any] = {"time": time, "x": x, "y": y, **change}
    with pytest.raises(error, match=message):
        stream(Kalman(3, 2), every=1, **given)


def test_the_largest_variance_is_looked_at_now_and_then_and_at_the_end() -> None:
    time, x, y = log(400)
    result = stream(Kalman(3, 2), time, x, y, every=1)
    seen = np.isfinite(result.prediction["largest_variance"].values)
    assert seen.sum() == 100 and seen[0] and seen[-1]
    assert result.scores["largest_variance"] == result.learner.covariance.diagonal().max()
    assert result.scores["largest_variance"] < 1e-3  # the prior was 1


def test_progress_ends_with_all_samples() -> None:
    calls: list[tuple[int, int]] = []
    time, x, y = log(300)
    stream(Kalman(3, 2), time, x, y, every=1, progress=lambda *c: calls.append(c))
    assert calls[-1] == (300, 300) and len(calls) <= 301


def test_an_identification_comes_back_from_its_file(tmp_path: Path) -> None:
    time, x, y = log(50)
    result = stream(Kalman(3, 2), time, x, y, every=5, horizons={"h": 0.05})
    lost = dict.fromkeys(result.scores["nmse"], np.nan)
    result = replace(result, scores=result.scores | {"lost": lost}, inputs=("q.x", "v.x"))
    result.save(tmp_path / "run.nc")
    again = load_identification(tmp_path / "run.nc")
    assert again.scores["nmse_mean"] == result.scores["nmse_mean"]
    assert np.isnan([*again.scores["lost"].values()]).all() and again.inputs == ("q.x", "v.x")
    np.testing.assert_array_equal(again.prediction["innovation"], result.prediction["innovation"])
    assert [file.name for file in tmp_path.iterdir()] == ["run.nc"]
    (tmp_path / "no.nc").write_text("no")
    with pytest.raises(LogError, match="expected an identification"):
        load_identification(tmp_path / "no.nc")


def test_the_page_shows_scores_gaps_and_silence(tmp_path: Path) -> None:
    time, x, y = log(80)
    y[:, 1] = 0.0
    result = stream(
        Kalman(3, 2), time, x, y, every=5, horizons={"h": 0.05}, gaps=[23], names=("lift", "mute")
    )
    result.report(tmp_path / "run.html", "A run")
    text = (tmp_path / "run.html").read_text(encoding="utf-8")
    for words in ("A run", "lift", "Silent, and left out of mean and worst: mute", "1 gap(s)"):
        assert words in text
    assert (
        "Forecast 0.05 s ahead from samples up to a time alone" in text and "one in 5 used" in text
    )
    assert "each output by itself" in text  # NIS


@pytest.mark.parametrize("gaps", [[[1.0]], [-1], [1e9], ["a"]])
def test_gaps_that_are_no_samples_are_refused(gaps: Any) -> None:
    time = np.arange(30) * 0.01
    x, y = np.ones((30, 3)), np.ones((30, 2))
    with pytest.raises(ParameterError, match="gaps: expected"):
        stream(Kalman(3, 2), time, x, y, every=10, gaps=gaps)
