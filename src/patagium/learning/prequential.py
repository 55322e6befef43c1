"""Prequential loop: predict each sample, then learn it.

Flights, tables, blocks of long logs and trials of `tune` go through `prequential`; packets in
Python share its step, `learn`. Each sample is predicted by the weights known after the last used
sample before it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.errors import FilterDiverged, Outcome
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.models.memory import ModelMemory, replay
from patagium.learning.models.physical import Estimate
from patagium.learning.parameter_paths import estimates_of, parameter_paths, parameter_scores
from patagium.learning.record import Arrays, Check, Updates, check, record_of
from patagium.learning.schedule import (
    Hold,
    Indices,
    check_samples,
    holds,
    plan_horizons,
    thin,
    used_samples,
)
from patagium.learning.scorer import Scorer

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

REMEDY = "scale inputs and outputs, lower the prior standard deviation or the learning rate"
MOST_VARIANCES = 100
"""The covariance of the weights is looked at after at most this many updates, ..."""
MOST_ENTRIES = 2e7
"""... and fewer (ten at least) where that would make it more numbers than this."""


@dataclass(frozen=True)
class Samples:
    """A block of samples in order.

    Attributes:
        time: Increasing, (N,) [s].
        x: Measured inputs of the network, (N, n_measured) [units of x].
        y: What the network predicts, (N, n_y) [unit of y]; NaN where a channel was not measured.
        gaps: First sample after each gap in time.
        std: Noise of each measurement beside the learner's own, (N, n_y) [unit of y], or None.
    """

    time: Array
    x: Array
    y: Array
    gaps: Indices
    std: Array | None = None

    def std_at(self, index: int) -> Array | None:
        """Standard deviation of one sample's measurement, (n_y,); None for none."""
        return None if self.std is None else self.std[index]


class Update(NamedTuple):
    """Innovation of one update, with its predicted standard deviation.

    Attributes:
        innovation: (n_y,) [unit of y]; NaN where a channel was left out.
        std: Predicted standard deviation of it, (n_y,) [unit of y]; NaN of learners without.
        nis: Normalized innovation squared; NaN of learners without.
    """

    innovation: Array
    std: Array
    nis: float


class Watch(Protocol):
    """Observer of the loop, called before each update."""

    def before(self, hold: Hold, memory: ModelMemory) -> None:
        """Look at a hold interval that begins; the memory stands at its first sample."""
        ...

    def predicted(self, hold: Hold, rows: Array) -> None:
        """Look at the inputs of the interval, (k, n_x), before its last sample is learned."""
        ...


def learn(
    learner: Learner, x: Array, y: Array, time: float | None = None, std: Array | None = None
) -> Update:
    """Update of a learner by one sample.

    Args:
        learner: It is changed.
        x: Input with what is remembered, (n_x,) [units of x].
        y: Measurement, (n_y,) [unit of y].
        time: Of the sample [s]; None for none.
        std: Noise of the measurement beside the learner's own, (n_y,) [unit of y]; None for none.

    Raises:
        FilterDiverged: If the learner or its weights are lost.
    """
    if std is not None and isinstance(learner, FilterLearner):
        innovation = learner.update(x, y, time, std)
    else:
        innovation = learner.update(x, y, time)
    if not np.isfinite(learner.weights).all():
        raise FilterDiverged(f"the weights are not finite; {REMEDY}", Outcome.NOT_FINITE)
    covariance = getattr(learner, "innovation_covariance", None)
    if covariance is None or not np.isfinite(innovation).any():
        return Update(innovation, np.full_like(innovation, np.nan), float("nan"))
    std = np.sqrt(np.diagonal(covariance))
    return Update(innovation, std, getattr(learner, "nis", float("nan")))


def prequential(
    learner: Learner,
    samples: Samples,
    used: Indices,
    watch: Watch | None = None,
    memory: ModelMemory | None = None,
) -> Iterator[tuple[Hold, Update | None]]:
    """Loop over samples in order: each hold interval is predicted, then its last sample learned.

    Args:
        learner: It is changed.
        samples: A block of them.
        used: Samples to learn from, increasing.
        watch: Looks at each interval before it is learned from; None for nobody.
        memory: Memory of the network after the block before, moved on; None to begin anew.

    Yields:
        Each interval, once it is over, with its update; None for a last one without.

    Raises:
        FilterDiverged: If the learner or its weights are lost.
        ShapeError: If x does not fit the network.
    """
    log = samples.time, samples.x, samples.gaps
    fresh = replay(learner.network, *log)
    if memory is None:
        memory = fresh
    memory.follow(*log)
    for hold in holds(used, len(samples.time)):
        before = learner.weights
        if watch is not None:
            watch.before(hold, memory)
        rows = memory.upto(hold.end, before)
        if watch is not None:
            watch.predicted(hold, rows)
        if not hold.learns:
            yield hold, None
            return
        k = hold.end - 1
        update = learn(learner, rows[-1], samples.y[k], samples.time[k], samples.std_at(k))
        memory.corrected(learner.weights - before)
        yield hold, update


class BlockRun:
    """Run of a block of samples through the loop, with its predictions and updates.

    Args:
        learner: What learns; it is changed.
        samples: The block.
        every: One sample in so many is used.
        durations: Label and length [s] of the spans to predict with frozen weights.
        memory: Memory of the network after the block before, moved on; None to begin anew.

    Attributes:
        used: Samples used for an update, (U,).
        prediction: (N, n_y) [unit of y]; NaN where there is none.
        updates: Number of updates so far.
        reached: Number of samples predicted so far.
        outcome: COMPLETED, or why the learner stopped.
        message: When and why it stopped; empty if it did not.
    """

    def __init__(
        self,
        learner: Learner,
        samples: Samples,
        every: int,
        durations: Mapping[str, float],
        memory: ModelMemory | None = None,
    ) -> None:
        self.learner, self.samples, self._memory = learner, samples, memory
        count, outputs = samples.y.shape
        self.used = used_samples(count, every, samples.gaps)
        self.horizons = plan_horizons(durations, samples.time, self.used, samples.gaps)
        self.windows: dict[str, list[tuple[int, Array]]] = {h.label: [] for h in self.horizons}
        self.prediction = np.full((count, outputs), np.nan)
        self.innovation = np.full((len(self.used), outputs), np.nan)
        self.std = np.full_like(self.innovation, np.nan)
        self.nis, self.weights_norm, self.largest_variance = np.full((3, len(self.used)), np.nan)
        self.paths: list[tuple[Estimate, ...]] = []
        self.checks: list[Check] = []
        self.updates, self.reached = 0, 0
        self.outcome, self.message = Outcome.COMPLETED, ""
        intervals = list(holds(self.used, count))
        chosen = zip(intervals, check_samples(intervals), strict=True)
        self._checked = {hold.begin: indices for hold, indices in chosen}
        self._starts = {h.label: set(h.begins.tolist()) for h in self.horizons}
        most = int(MOST_ENTRIES / learner.network.size**2)
        looks = thin(np.arange(len(self.used)), min(MOST_VARIANCES, max(10, most)))
        self._looks = set(looks.tolist())

    def go(self, progress: Progress | None = None) -> None:
        """Take all samples in order, or those up to where the learner diverged.

        Args:
            progress: Called now and then with samples done and samples in all.
        """
        total = len(self.samples.time)
        often = max(1, len(self._checked) // 200)
        loop = prequential(self.learner, self.samples, self.used, self, self._memory)
        try:
            for number, (hold, update) in enumerate(loop):
                if update is not None:
                    self._learned(update)
                if progress is not None and (number % often == 0 or hold.end == total):
                    progress(hold.end, total)
        except FilterDiverged as problem:
            self._stop(problem)

    def before(self, hold: Hold, memory: ModelMemory) -> None:
        """Predict the horizons that begin with an interval, with frozen weights.

        Args:
            hold: The interval.
            memory: It stands at the interval's first sample, and stays there.
        """
        self._hold, weights = hold, self.learner.weights
        for horizon in self.horizons:
            if hold.begin in self._starts[horizon.label]:
                rows = memory.ahead(hold.begin + horizon.length, weights)
                ahead = self.learner.network.evaluate(rows, weights)
                self.windows[horizon.label].append((hold.begin, ahead))

    def predicted(self, hold: Hold, rows: Array) -> None:
        """Predict an interval, and check its predicted standard deviation at a few samples.

        Args:
            hold: The interval.
            rows: The network's inputs, (k, n_x) [units of x].

        Raises:
            FilterDiverged: If the prediction is not finite.
        """
        guess = self.learner.network.evaluate(rows, self.learner.weights)
        if not np.isfinite(guess).all():
            raise FilterDiverged(f"the prediction is not finite; {REMEDY}", Outcome.NOT_FINITE)
        self.prediction[hold.begin : hold.end] = guess
        self.reached = hold.end
        for k in self._checked[hold.begin]:
            row, y = rows[k - hold.begin], self.samples.y[k]
            self.checks.append(check(self.learner, k, row, y, self.samples.std_at(k)))

    def score(self, scorer: Scorer, held: Array, begin: int = 0, half: int | None = None) -> None:
        """Count the samples so far.

        Args:
            scorer: What counts.
            held: Persistence, (N, n_y) [unit of y].
            begin: Number of samples in the blocks before.
            half: First sample of the second half, counted over all blocks; None where this
                block is the whole log: half of what was reached, and half of each horizon.
        """
        y, span, told = self.samples.y, slice(0, self.reached), slice(0, self.updates)
        late = begin + np.arange(len(y)) >= (self.reached // 2 if half is None else half)
        scorer.add_predictions(y[span], self.prediction[span], held[span], late[span])
        for horizon in self.horizons:
            windows, length = self.windows[horizon.label], horizon.length
            begins = np.array([k for k, _ in windows], int)
            rows = (begins[:, None] + np.arange(length)).ravel()
            ahead = np.concatenate([np.empty((0, y.shape[1])), *(guess for _, guess in windows)])
            arrays = y[rows], ahead, np.repeat(held[begins], length, axis=0)
            second = np.arange(len(rows)) >= len(rows) // 2 if half is None else late[rows]
            scorer.add_windows(horizon.label, length, arrays, second)
        if self.checks:
            checked = [one.sample for one in self.checks]
            error, std = (np.array([one[k] for one in self.checks]) for k in (1, 2))
            scorer.add_checks(error, std, late[checked])
        scorer.add_updates(self.innovation[told], self.std[told], self.nis[told])

    def record(self, names: Sequence[str], units: Sequence[str], held: Array) -> xr.Dataset:
        """Measurements, predictions and updates as one Dataset.

        Args:
            names: Names of the outputs, n_y.
            units: Their units.
            held: Persistence, (N, n_y) [unit of y].
        """
        told = slice(0, self.updates)
        parts = self.innovation, self.std, self.nis, self.weights_norm, self.largest_variance
        updates = Updates(self.used[told], *(part[told] for part in parts))
        y, guess = self.samples.y, self.prediction
        arrays = Arrays(self.samples.time, y, guess, held, self.checks, updates)
        return record_of(arrays, names, units).assign(parameter_paths(self.paths))

    def facts(self) -> dict[str, Any]:
        """State of the learner after the last sample, by the names of its scores."""
        variance = self.largest_variance[np.isfinite(self.largest_variance)]
        return {
            "events": {name: count for name, count in self.learner.events.items() if count},
            "outcome": self.outcome.name,
            "message": self.message,
            "largest_variance": float(variance[-1]) if len(variance) else float("nan"),
            "time_per_update": float(self.learner.time_per_update),
            **parameter_scores(estimates_of(self.learner)),
        }

    def _learned(self, update: Update) -> None:
        k, weights = self.updates, self.learner.weights
        self.innovation[k], self.std[k], self.nis[k] = update
        self.weights_norm[k] = np.linalg.norm(weights)
        if k in self._looks:
            variances = self.learner.variances
            self.largest_variance[k] = np.nan if variances is None else variances.max()
        self.paths.append(estimates_of(self.learner))
        self.updates += 1

    def _stop(self, problem: FilterDiverged) -> None:
        k, count = self._hold.end - 1, len(self.samples.time)
        self.outcome = problem.outcome
        self.message = (
            f"the learner diverged at t = {self.samples.time[k]:.6g} s (sample {k} of {count}): "
            f"{problem}"
        )
