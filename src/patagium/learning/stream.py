"""Samples through a learner in order, each predicted before it may be learned from.

The one loop behind `identify`, tables and studies. It scores what a user would have had
at that time: predictions over the whole hold interval, over longer horizons with frozen
weights and true states in, the predicted interval, and beside them the last used sample held.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import FilterDiverged, LogError, Outcome, ShapeError
from patagium.learning.calibration import calibration_scores
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.models.physical import Estimate
from patagium.learning.models.recollection import Recollection
from patagium.learning.parameter_paths import parameter_paths, parameter_scores, told
from patagium.learning.record import Check, Updates, check, interval_scores, record_of
from patagium.learning.result import Identification
from patagium.learning.schedule import (
    Hold,
    Horizon,
    Indices,
    check_samples,
    holds,
    plan_horizons,
    thin,
    used_samples,
)
from patagium.learning.scores import error_scores, persistence, silent_outputs

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

REMEDY = "scale inputs and outputs, lower the prior deviation or the learning rate"
MOST_VARIANCES = 100
"""The covariance of the weights is looked at after at most this many updates, ..."""
MOST_ENTRIES = 2e7
"""... and fewer (ten at least) where that would make it more numbers than this."""


def stream(
    learner: Learner,
    time: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    *,
    every: int,
    horizons: Mapping[str, float] | None = None,
    names: Sequence[str] | None = None,
    units: Sequence[str] | None = None,
    gaps: ArrayLike = (),
    std: ArrayLike | None = None,
    progress: Progress | None = None,
) -> Identification:
    """A log learned online, and how well each sample was predicted.

    One sample in `every` is used. Each sample is predicted by the weights known after the
    last used sample before it; the first one by the initial weights.

    Args:
        learner: What learns; it goes on from where it stands, and is changed.
        time: Increasing, (N,) [s].
        x: What is measured of the network's inputs, (N, n_measured); it recalls the rest.
        y: What it predicts, (N, n_y); NaN where a channel was not measured.
        every: 1 to use each sample, 100 to use one in 100.
        horizons: Label and length [s] of the spans to predict with frozen weights.
        names: Names of the outputs; None for the network's.
        units: Units of the outputs, for axes of figures; None for "1".
        gaps: First sample after each gap in time; see `find_gaps`.
        std: Of each measurement on top of the learner's own noise, (N, n_y); NaN where y
            is. Learners without noise of the measurement leave it aside.
        progress: Called now and then with samples done and samples in all.

    Returns:
        Scores and predictions. If the learner diverged, those up to there, with `outcome`
        and `message` saying when and why.

    Raises:
        ShapeError: If the arrays do not fit each other or the network.
        LogError: If an input is not finite or time does not advance.
    """
    run = StreamRun(learner, *_checked(learner, time, x, y), every, horizons or {}, gaps)
    if std is not None and isinstance(learner, FilterLearner):
        run.noise = np.asarray(std, float)
        if run.noise.shape != run.y.shape:
            raise ShapeError("std", run.y.shape, run.noise.shape)
    labels = tuple(names) if names is not None else tuple(learner.network.output_names)
    measures = tuple(units) if units is not None else ("1",) * len(labels)
    for word, given in (("names", labels), ("units", measures)):
        if len(given) != run.y.shape[1]:
            raise ShapeError(word, (run.y.shape[1],), (len(given),))
    run.go(progress)
    result = run.result(labels)
    result.prediction.coords["unit"] = ("output", list(measures))
    return result


class StreamRun:
    """The state of a run: what was predicted so far, and what the learner said of itself.

    Args:
        learner: What learns.
        time: Increasing, (N,) [s].
        x: What the network sees, (N, n_x).
        y: What it predicts, (N, n_y).
        every: One sample in so many is used.
        durations: Label and length [s] of the spans to predict with frozen weights.
        gaps: First sample after each gap in time.
    """

    def __init__(
        self,
        learner: Learner,
        time: Array,
        x: Array,
        y: Array,
        every: int,
        durations: Mapping[str, float],
        gaps: ArrayLike,
    ) -> None:
        self.learner, self.time, self.y, self.every = learner, time, y, every
        self.gaps: Indices = np.asarray(gaps, np.int64)
        self.recollection = Recollection(learner.network, time, x, self.gaps)
        self.used = used_samples(len(time), every, self.gaps)
        self.horizons = plan_horizons(durations, time, self.used, self.gaps)
        self.noise: Array | None = None
        self.prediction = np.full_like(y, np.nan)
        self.innovation = np.full((len(self.used), y.shape[1]), np.nan)
        self.std = np.full_like(self.innovation, np.nan)
        self.nis = np.full(len(self.used), np.nan)
        self.weights_norm = np.full(len(self.used), np.nan)
        self.largest_variance = np.full(len(self.used), np.nan)
        self.paths: list[tuple[Estimate, ...]] = []
        self.checks: list[Check] = []
        self.windows: dict[str, list[tuple[int, Array]]] = {h.label: [] for h in self.horizons}
        self.updates = 0
        self.reached = 0
        self.outcome, self.message = Outcome.COMPLETED, ""

    def go(self, progress: Progress | None) -> None:
        """All samples in order, or up to where the learner diverged."""
        intervals = list(holds(self.used, len(self.time)))
        checks = check_samples(intervals)
        starts = {h.label: set(h.begins.tolist()) for h in self.horizons}
        most = int(MOST_ENTRIES / self.learner.network.size**2)
        looks = thin(np.arange(len(self.used)), min(MOST_VARIANCES, max(10, most)))
        looked = set(looks.tolist())
        told = max(1, len(intervals) // 200)
        for number, hold in enumerate(intervals):
            try:
                seen = self._foresee(hold, checks[number], starts)
                if hold.learns:
                    self._learn(hold.end - 1, seen[-1], self.updates in looked)
            except FilterDiverged as problem:
                self._stop(hold, problem.outcome, str(problem))
                break
            if progress is not None and (number % told == 0 or hold.end == len(self.time)):
                progress(hold.end, len(self.time))

    def _foresee(self, hold: Hold, checks: tuple[int, ...], starts: dict[str, set[int]]) -> Array:
        """Predict an interval; what the network sees there, (N, n_x)."""
        network, weights = self.learner.network, self.learner.weights
        for horizon in self.horizons:
            if hold.begin in starts[horizon.label]:
                end = hold.begin + horizon.length
                ahead = network.evaluate(self.recollection.ahead(end, weights), weights)
                self.windows[horizon.label].append((hold.begin, ahead))
        seen = self.recollection.upto(hold.end, weights)
        guess = network.evaluate(seen, weights)
        if not np.isfinite(guess).all():
            raise FilterDiverged(f"the prediction is not finite; {REMEDY}", Outcome.NOT_FINITE)
        self.prediction[hold.begin : hold.end] = guess
        self.reached = hold.end
        for index in checks:
            row = seen[index - hold.begin]
            noise = None if self.noise is None else self.noise[index]
            self.checks.append(check(self.learner, index, row, self.y[index], noise))
        return seen

    def _learn(self, index: int, seen: Array, look: bool) -> None:
        before = self.learner.weights
        if self.noise is not None and isinstance(self.learner, FilterLearner):
            noise = self.noise[index]
            innovation = self.learner.update(seen, self.y[index], self.time[index], noise)
        else:
            innovation = self.learner.update(seen, self.y[index], self.time[index])
        weights = self.learner.weights
        if not np.isfinite(weights).all():
            raise FilterDiverged(f"the weights are not finite; {REMEDY}", Outcome.NOT_FINITE)
        self.recollection.heed(weights - before)
        self.innovation[self.updates] = innovation
        if isinstance(self.learner, FilterLearner) and np.isfinite(innovation).any():
            self.nis[self.updates] = self.learner.nis
            variances = np.diagonal(self.learner.innovation_covariance)
            self.std[self.updates] = np.sqrt(variances)
        self.weights_norm[self.updates] = np.linalg.norm(weights)
        if look:
            self.largest_variance[self.updates] = _largest_variance(self.learner)
        self.paths.append(told(self.learner))
        self.updates += 1

    def _stop(self, hold: Hold, outcome: Outcome, reason: str) -> None:
        self.outcome = outcome
        self.message = (
            f"the learner diverged at t = {self.time[hold.end - 1]:.6g} s (sample "
            f"{hold.end - 1} of {len(self.time)}): {reason}"
        )

    def result(self, names: tuple[str, ...]) -> Identification:
        """Scores and predictions of the samples so far."""
        held = persistence(self.y, self.used)
        span = slice(0, self.reached)
        truth, guess = self.y[span], self.prediction[span]
        silent = silent_outputs(truth) if self.reached else np.zeros(len(names), bool)
        scores: dict[str, Any] = {
            "samples": len(self.time),
            "samples_predicted": self.reached,
            "every": self.every,
            "updates": self.updates,
            "median_step": float(np.median(np.diff(self.time))),
            "gaps": len(self.gaps),
            "events": {name: count for name, count in self.learner.events.items() if count},
            "outcome": self.outcome.name,
            "message": self.message,
            "silent": [name for name, mute in zip(names, silent, strict=True) if mute],
        }
        if self.reached > 1:
            scores |= error_scores(truth, guess, names)
            scores |= error_scores(truth, held[span], names, "persistence")
        for horizon in self.horizons:
            scores |= self._horizon_scores(horizon, names)
        scores |= interval_scores(self.checks, names, ~silent, self.reached)
        loud = self.innovation[: self.updates][:, ~silent]
        scores |= calibration_scores(
            loud,
            self.std[: self.updates][:, ~silent],
            self.nis[: self.updates],
            [name for name, mute in zip(names, silent, strict=True) if not mute],
        )
        variance = self.largest_variance[np.isfinite(self.largest_variance)]
        scores["largest_variance"] = float(variance[-1]) if len(variance) else float("nan")
        scores["time_per_update"] = float(self.learner.time_per_update)
        used = slice(0, self.updates)
        updates = Updates(
            self.used[used],
            self.innovation[used],
            self.std[used],
            self.nis[used],
            self.weights_norm[used],
            self.largest_variance[used],
        )
        record = record_of(self.time, self.y, self.prediction, held, names, self.checks, updates)
        record = record.assign(parameter_paths(self.paths))
        scores |= parameter_scores(told(self.learner))
        return Identification(scores, record, self.learner, self.outcome, self.message)

    def _horizon_scores(self, horizon: Horizon, names: tuple[str, ...]) -> dict[str, Any]:
        windows = self.windows[horizon.label]
        key = f"horizon_{horizon.label}"
        scores: dict[str, Any] = {
            f"{key}_seconds": horizon.duration,
            f"{key}_samples": horizon.length,
            f"{key}_windows": len(windows),
        }
        if not windows:
            return scores
        rows = [np.arange(begin, begin + horizon.length) for begin, _ in windows]
        truth = self.y[np.concatenate(rows)]
        ahead = np.concatenate([guess for _, guess in windows])
        held = np.repeat(self.y[[begin - 1 for begin, _ in windows]], horizon.length, axis=0)
        return {
            **scores,
            **error_scores(truth, ahead, names, f"{key}_nmse"),
            **error_scores(truth, held, names, f"{key}_persistence"),
        }


def _largest_variance(learner: Learner) -> float:
    variances = learner.variances
    return float("nan") if variances is None else float(variances.max())


def _checked(
    learner: Learner, time: ArrayLike, x: ArrayLike, y: ArrayLike
) -> tuple[Array, Array, Array]:
    stamps, inputs, outputs = (np.ascontiguousarray(a, float) for a in (time, x, y))
    network = learner.network
    if stamps.ndim != 1 or len(stamps) < 2:
        raise ShapeError("time", "(N,) with N >= 2", stamps.shape)
    if outputs.shape != (len(stamps), network.outputs):
        raise ShapeError("y", (len(stamps), network.outputs), outputs.shape)
    for name, array in (("time", stamps), ("x", inputs)):
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            raise LogError(
                f"{name}: expected finite numbers, found {len(bad)} that are not, the "
                f"first in sample {int(bad[0][0])}"
            )
    if (np.diff(stamps) <= 0).any():
        row = int(np.flatnonzero(np.diff(stamps) <= 0)[0]) + 1
        raise LogError(
            f"time: expected to advance, found {stamps[row]:.9g} s after "
            f"{stamps[row - 1]:.9g} s at sample {row}"
        )
    known = {(len(stamps), n) for n in (network.measured_inputs, network.inputs)}
    if inputs.shape not in known:
        raise ShapeError("x", (len(stamps), network.measured_inputs), inputs.shape)
    return stamps, inputs, outputs
