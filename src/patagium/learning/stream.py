"""Prequential loop: predict each sample, then learn it, with scores of each prediction.

Flights, tables, blocks of long logs and trials of `tune` go through `prequential`; packets in
Python share its step, `learn`. Sample k is predicted before it is used, by weights that saw
earlier samples only. With one sample in `every` used, the weights hold for the `every` samples
that follow, and all of them count; they are compared with the last used sample, held. These
predictions see the measured inputs of their own sample and are no forecast, however few samples
are used; a forecast sees samples up to its own time alone (`forecast`). A gap in time ends a hold
interval, and no forecast reaches across one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from patagium.arguments import Progress, checked
from patagium.arrays import Array, Indices, median_step, real_array, rising, thin
from patagium.errors import FilterDiverged, LogError, Outcome, ParameterError, ShapeError
from patagium.learning.forecast import Forecaster, ForecastSums, Horizons, Motion, named_horizons
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.models.memory import ModelMemory, measured_inputs
from patagium.learning.models.network import Network
from patagium.learning.models.physical import Estimate
from patagium.learning.parameter_paths import estimates_of, parameter_paths, parameter_scores
from patagium.learning.result import UPDATED, Check, Identification, check, record_of
from patagium.learning.scores import Scorer, persistence
from patagium.learning.verdict import frozen_scores, with_verdict

MOST_CHECKS = 500
"""The predicted interval is checked in at most this many hold intervals, spread evenly."""
REMEDY = "scale inputs and outputs, or lower the prior standard deviation"
MOST_VARIANCES = 100
"""The covariance of the weights is looked at after at most this many updates, ..."""
MOST_ENTRIES = 2e7
"""... and fewer (ten at least) where that would make it more numbers than this."""


class Hold(NamedTuple):
    """Interval of samples `begin` to `end - 1`, predicted by the same weights.

    Attributes:
        begin: First sample.
        end: One past the last sample.
        learns: Whether the last sample is then used for an update.
    """

    begin: int
    end: int
    learns: bool


def used_samples(y: Array, every: int, gaps: ArrayLike = ()) -> Indices:
    """Samples that are used for an update: one in `every`, counted anew after each gap.

    It is the first of them, or the one that measures what was learned least often: a torque that
    is sent every tenth sample would else be missed by one sample in ten.

    Args:
        y: What was measured, (N, n_y) [unit of y]; NaN where it was not.
        every: 1 for each sample, 100 for one in 100.
        gaps: First sample after each gap.

    Raises:
        ParameterError: If `every` is below one.
    """
    if every < 1:
        raise ParameterError("every", "a whole number of at least 1", every)
    starts = [0, *np.asarray(gaps, int).tolist(), len(y)]
    spans = [np.arange(a, b, every) for a, b in zip(starts[:-1], starts[1:], strict=True)]
    used = np.concatenate(spans).astype(np.int64)
    measured = np.isfinite(y)
    measured = measured[:, measured.any(axis=0)]
    if every > 1 and not measured.all():
        learned = np.zeros(measured.shape[1])
        for k, (begin, end) in enumerate(zip(used, [*used[1:], len(y)], strict=True)):
            worth = measured[begin:end] @ (1.0 / (1.0 + learned))
            used[k] += worth.argmax()
            learned += measured[used[k]]
    return used


def holds(used: Indices, count: int) -> Iterator[Hold]:
    """Hold intervals in order; together they hold each sample once.

    Args:
        used: Samples used for an update, increasing.
        count: Number of samples N.
    """
    begin = 0
    for index in used.tolist():
        yield Hold(begin, index + 1, learns=True)
        begin = index + 1
    if begin < count:
        yield Hold(begin, count, learns=False)


def check_samples(intervals: list[Hold]) -> list[tuple[int, ...]]:
    """Samples at which the predicted interval is checked, for each hold interval.

    Its last sample (farthest from the last update), and one inside it that wanders
    from interval to interval, so that every distance to the update is seen.
    """
    chosen = set(thin(np.arange(len(intervals)), MOST_CHECKS).tolist())
    golden = 0.6180339887498949
    checks: list[tuple[int, ...]] = []
    for number, hold in enumerate(intervals):
        inside = hold.begin + int((number * golden) % 1.0 * (hold.end - hold.begin))
        checks.append(tuple(sorted({inside, hold.end - 1})) if number in chosen else ())
    return checks


def late_samples(count: int) -> Indices:
    """Samples of the second half, thinned, on which physics alone is scored."""
    return thin(np.arange(count // 2, count), MOST_CHECKS)


@dataclass(frozen=True)
class Samples:
    """A block of samples in order.

    Attributes:
        time: Increasing, (N,) [s].
        x: Measured inputs of the network, (N, n_measured) [units of x].
        y: What the network predicts, (N, n_y) [unit of y]; NaN where a channel was not measured.
        gaps: First sample after each gap in time.
        std: Noise of each measurement in addition to the learner's own, (N, n_y) [unit of y],
            or None.
    """

    time: Array
    x: Array
    y: Array
    gaps: Indices
    std: Array | None = None

    def std_at(self, index: int) -> Array | None:
        """Standard deviation of one sample's measurement, (n_y,); None for none."""
        return None if self.std is None else self.std[index]


def learn(
    learner: Learner, x: Array, y: Array, time: float | None = None, std: Array | None = None
) -> tuple[Array, Array, float]:
    """Innovation of a learner's update by one sample, its predicted deviation and its NIS.

    Args:
        learner: It is changed.
        x: Input with what is remembered, (n_x,) [units of x].
        y: Measurement, (n_y,) [unit of y].
        time: Of the sample [s]; None for none.
        std: Noise of the measurement in addition to the learner's own, (n_y,) [unit of y];
            None for none.

    Returns:
        Innovation, (n_y,), and its predicted standard deviation, (n_y,) [unit of y], NaN where a
        channel was left out; normalized innovation squared. NaN of learners without.

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
        return innovation, np.full_like(innovation, np.nan), float("nan")
    std = np.sqrt(np.diagonal(covariance))
    return innovation, std, getattr(learner, "nis", float("nan"))


def prequential(
    learner: Learner,
    samples: Samples,
    used: Indices,
    watch: BlockRun | None = None,
    memory: ModelMemory | None = None,
) -> Iterator[tuple[Hold, tuple[Array, Array, float] | None]]:
    """Loop over samples in order: each hold interval is predicted, then its last sample learned.

    Args:
        learner: It is changed.
        samples: A block of them.
        used: Samples to learn from, increasing.
        watch: Run that looks at each interval before it is learned from; None for none.
        memory: Memory of the network after the block before, moved on; None to begin anew.

    Yields:
        Each interval, once it is over, with its update; None for a last one without.

    Raises:
        FilterDiverged: If the learner or its weights are lost.
        ShapeError: If x does not fit the network.
    """
    memory = ModelMemory(learner.network) if memory is None else memory
    memory.follow(samples.time, samples.x, samples.gaps)
    for hold in holds(used, len(samples.time)):
        before = learner.weights
        if watch is None:
            rows = memory.upto(hold.end, before)
        else:
            rows = watch.predicted(hold, memory)
        if not hold.learns:
            yield hold, None
            return
        k = hold.end - 1
        update = learn(learner, rows[-1], samples.y[k], samples.time[k], samples.std_at(k))
        memory.corrected(learner.weights - before)
        yield hold, update


class Watch(Protocol):
    """Observer of a run, which sees the learner before each interval is predicted."""

    def before(self, begin: int, memory: ModelMemory) -> None:
        """Look at the learner, which has seen the samples before an interval.

        Args:
            begin: First sample of the interval.
            memory: Memory of the network at the sample before; it must stay there.
        """


class BlockRun:
    """Run of a block of samples through the loop, with its predictions and updates.

    Args:
        learner: What learns; it is changed.
        samples: The block.
        every: One sample in so many is used.
        watches: Observers, called before each interval is predicted.
        memory: Memory of the network after the block before, moved on; None to begin anew.

    Attributes:
        used: Samples used for an update, (U,).
        prediction: (N, n_y) [unit of y]; NaN where there is none.
        updated: Names of `UPDATED`: arrays over the updates, (U, n_y) or (U,).
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
        watches: Sequence[Watch] = (),
        memory: ModelMemory | None = None,
    ) -> None:
        self.learner, self.samples, self._memory = learner, samples, memory
        self._watches = list(watches)
        count, outputs = samples.y.shape
        self.used = used_samples(samples.y, every, samples.gaps)
        self.prediction = np.full((count, outputs), np.nan)
        shape = len(self.used), outputs
        self.updated = {name: np.full(shape[:n], np.nan) for name, n in UPDATED.items()}
        self.paths: list[tuple[Estimate, ...]] = []
        self.checks: list[Check] = []
        self.updates, self.reached = 0, 0
        self.outcome, self.message = Outcome.COMPLETED, ""
        intervals = list(holds(self.used, count))
        chosen = zip(intervals, check_samples(intervals), strict=True)
        self._checked = {hold.begin: indices for hold, indices in chosen}
        most = int(MOST_ENTRIES / learner.network.size**2)
        looks = thin(np.arange(len(self.used)), min(MOST_VARIANCES, max(10, most)))
        self._looks = set(looks.tolist())

    def forecast(
        self,
        sums: Sequence[ForecastSums],
        half: int,
        motion: Motion | None = None,
        period: float | None = None,
    ) -> None:
        """Have the block forecast by an observer for each horizon.

        Args:
            sums: Errors of each horizon, which they count.
            half: First sample of the second half, counted from the block's first.
            motion: Forecast of the inputs; None: they are held, or their last wingbeat is repeated.
            period: Wingbeat, where it is known beforehand [s].
        """
        log = self.samples.time, self.samples.x, self.samples.y
        known = self.learner, log, self.used, self.samples.gaps, motion, period, half
        self._watches += [Forecaster(one, *known) for one in sums]

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
            k = self._hold.end - 1
            when = f"t = {self.samples.time[k]:.6g} s (sample {k} of {total})"
            self.outcome = problem.outcome
            self.message = f"the learner diverged at {when}: {problem}"

    def predicted(self, hold: Hold, memory: ModelMemory) -> Array:
        """Predict an interval, and check its predicted standard deviation at a few samples.

        The observers look at the learner before.

        Args:
            hold: The interval.
            memory: It stands before the interval's first sample, and moves on to its last.

        Returns:
            The network's inputs, (k, n_x) [units of x].

        Raises:
            FilterDiverged: If the prediction is not finite.
        """
        self._hold = hold
        for watch in self._watches:
            watch.before(hold.begin, memory)
        rows = memory.upto(hold.end, self.learner.weights)
        guess = self.learner.network.evaluate(rows, self.learner.weights)
        times = self.samples.time[hold.begin : hold.end]
        if isinstance(self.learner, FilterLearner):
            guess = guess + self.learner.carried(times)
        if not np.isfinite(guess).all():
            raise FilterDiverged(f"the prediction is not finite; {REMEDY}", Outcome.NOT_FINITE)
        self.prediction[hold.begin : hold.end] = guess
        self.reached = hold.end
        for k in self._checked[hold.begin]:
            row, y = rows[k - hold.begin], self.samples.y[k]
            at = self.samples.time[k]
            self.checks.append(check(self.learner, k, (row, y), self.samples.std_at(k), at))
        return rows

    def score(self, scorer: Scorer, held: Array, begin: int = 0, half: int | None = None) -> None:
        """Count the samples so far.

        Args:
            scorer: What counts.
            held: Persistence, (N, n_y) [unit of y].
            begin: Number of samples in the blocks before.
            half: First sample of the second half, counted over all blocks; None where this
                block is the whole log: half of what was reached.
        """
        y, span = self.samples.y, slice(0, self.reached)
        late = begin + np.arange(len(y)) >= (self.reached // 2 if half is None else half)
        scorer.add_predictions(y[span], self.prediction[span], held[span], late[span])
        if self.checks:
            checked, error, std = map(np.array, zip(*self.checks, strict=True))
            scorer.add_checks(error, std, late[checked])
        told = self._told()
        scorer.add_updates(told["innovation"], told["innovation_std"], told["nis"])

    def record(self, names: Sequence[str], units: Sequence[str], held: Array) -> xr.Dataset:
        """Measurements, predictions and updates as one Dataset.

        Args:
            names: Names of the outputs, n_y.
            units: Their units.
            held: Persistence, (N, n_y) [unit of y].
        """
        samples = {
            "time": self.samples.time,
            "measurement": self.samples.y,
            "prediction": self.prediction,
            "persistence": held,
        }
        used = self.used[: self.updates]
        record = record_of(names, units, samples, self.checks, used, self._told())
        return record.assign(parameter_paths(self.paths))

    def facts(self) -> dict[str, Any]:
        """State of the learner after the last sample, by the names of its scores."""
        s, weights = self.samples, self.learner.weights
        log = s.time, s.x, s.y, s.gaps, late_samples(self.reached)
        variance = self.updated["largest_variance"]
        variance = variance[np.isfinite(variance)]
        return {
            "events": {name: count for name, count in self.learner.events.items() if count},
            "outcome": self.outcome.name,
            "message": self.message,
            "largest_variance": float(variance[-1]) if len(variance) else float("nan"),
            "time_per_update": float(self.learner.time_per_update),
            **parameter_scores(self.learner),
            **frozen_scores(self.learner.network, [log], weights),
        }

    def _told(self) -> dict[str, Array]:
        """Arrays over the updates so far."""
        return {name: values[: self.updates] for name, values in self.updated.items()}

    def _learned(self, update: tuple[Array, Array, float]) -> None:
        k, updated = self.updates, self.updated
        updated["innovation"][k], updated["innovation_std"][k], updated["nis"][k] = update
        updated["weights_norm"][k] = np.linalg.norm(self.learner.weights)
        variances = self.learner.variances if k in self._looks else None
        if variances is not None:
            updated["largest_variance"][k] = variances.max()
        self.paths.append(estimates_of(self.learner))
        self.updates += 1


@checked
def stream(
    learner: Learner,
    time: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    *,
    every: int,
    horizons: Horizons = None,
    gaps: ArrayLike = (),
    std: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    units: Sequence[str] | None = None,
    motion: Motion | None = None,
    period: float | None = None,
    watches: Sequence[Watch] = (),
    progress: Progress | None = None,
) -> Identification:
    """Identification of a log online, with scores of each prediction.

    One sample in `every` is used. Each sample is predicted by the weights known after the
    last used sample before it; the first one by the initial weights.

    Args:
        learner: What learns; its weights go on, wherever and whenever the log before ended.
        time: Increasing, (N,) [s].
        x: Measured inputs of the network, (N, n_measured) [units of x]; it recalls the rest.
        y: What it predicts, (N, n_y) [unit of y]; NaN where a channel was not measured.
        every: 1 to use each sample, 100 to use one in 100.
        horizons: Times ahead of forecasts, as "100ms" or [s], one or more, or by label; `forecast`.
        gaps: First sample after each gap in time; see `find_gaps`.
        std: Noise of each measurement in addition to the learner's own, (N, n_y) [unit of y];
            NaN where y is. Learners without noise of the measurement leave it aside.
        names: Names of the outputs; None: the network's.
        units: Units of the outputs, for axes of figures; None: "1".
        motion: Forecast of the inputs for the horizons; None: they are held, or their last
            wingbeat is repeated.
        period: Wingbeat for the horizons, where it is known beforehand [s].
        watches: Observers of the run.
        progress: Called now and then with samples done and samples in all.

    Returns:
        Scores and predictions, up to where the learner diverged if it did (`outcome`, `message`).

    Raises:
        ShapeError: If the arrays do not fit each other or the network.
        LogError: If an input is not finite or time does not advance.
    """
    samples = checked_samples(learner.network, (time, x, y), gaps, std)
    if isinstance(learner, FilterLearner):
        learner.restart_clock()
    outputs, scale = samples.y.shape[1], getattr(learner.network, "output_scale", 1.0)
    names = tuple(names or learner.network.output_names)
    units = tuple(units or ("1",) * outputs)
    for word, given in (("names", names), ("units", units)):
        if len(given) != outputs:
            raise ShapeError(word, (outputs,), (len(given),))
    sums = [ForecastSums(k, one, names, scale) for k, one in named_horizons(horizons).items()]
    run = BlockRun(learner, samples, every, watches)
    run.forecast(sums, len(samples.time) // 2, motion, period)
    run.go(progress)
    if isinstance(learner, FilterLearner) and run.outcome is Outcome.COMPLETED:
        learner.look_back(samples.time, samples.x, samples.gaps)
    held, scorer = persistence(samples.y, run.used), Scorer(names, scale)
    run.score(scorer, held)
    scores = {
        "samples": len(samples.time),
        "samples_predicted": run.reached,
        "every": every,
        "updates": run.updates,
        "median_step": median_step(samples.time),
        "gaps": len(samples.gaps),
        **scorer.scores(),
        **forecast_scores(sums),
        **run.facts(),
    }
    record, scores = run.record(names, units, held), with_verdict(scores)
    return Identification(scores, record, learner, run.outcome, run.message)


def forecast_scores(sums: Sequence[ForecastSums]) -> dict[str, Any]:
    """Errors of all horizons by name."""
    return {name: value for one in sums for name, value in one.scores().items()}


def checked_samples(
    network: Network,
    arrays: tuple[ArrayLike, ArrayLike, ArrayLike],
    gaps: ArrayLike,
    std: ArrayLike | None,
) -> Samples:
    """Samples of arrays that fit a network.

    Args:
        network: What learns them.
        arrays: Time (N,) [s], x (N, n_measured) and y (N, n_y).
        gaps: First sample after each gap in time.
        std: Of each measurement, (N, n_y) [unit of y]; None for none.

    Raises:
        ShapeError: If the arrays do not fit each other or the network.
        LogError: If an input is not finite or time does not advance.
        ParameterError: If a gap begins at no sample.
    """
    stamps, inputs, outputs = (np.ascontiguousarray(real_array("time, x and y", a)) for a in arrays)
    if stamps.ndim != 1 or len(stamps) < 2:
        raise ShapeError("time", "(N,) with N >= 2", stamps.shape)
    real_array("y", outputs, (len(stamps), network.outputs))
    bad = np.argwhere(~np.isfinite(inputs))
    if len(bad):
        raise LogError(
            "x", "finite numbers", f"{len(bad)} that are not, the first in sample {int(bad[0][0])}"
        )
    rising(stamps)
    known = {(len(stamps), n) for n in (measured_inputs(network), network.inputs)}
    if inputs.shape not in known:
        raise ShapeError("x", (len(stamps), measured_inputs(network)), inputs.shape)
    noise = None if std is None else real_array("std", std, outputs.shape)
    places, count = np.atleast_1d(real_array("gaps", gaps)), len(stamps)
    if places.ndim > 1 or not ((places >= 0) & (places <= count)).all():
        raise ParameterError("gaps", f"numbers of samples, at most {count}", places.tolist())
    return Samples(stamps, inputs, outputs, places.astype(np.int64), noise)
