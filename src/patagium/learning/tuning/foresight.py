"""How well a learner predicted the samples it was taught: the likelihood of its innovations.

With e = y - mean the innovation of an output and s^2 its variance, both said before the
sample was used,

    log L = sum over samples and outputs of -1/2 (e^2 / s^2 + log s^2 + log 2 pi):

the density the learner gave beforehand to each number it then saw. It punishes errors, and
deviations too small or too large for them. An output that stands still is predicted by any
deviation, the smaller the better: where it does (`moving`) it is left out, lest a robot on the
ground decide how it is to learn in flight. Neglected: correlation of the outputs (with it, on a
flight without noise, the likelihood goes to directions in which P_yy is all but singular, and
the deviations of the outputs themselves come out too large); samples between those used.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log, nan, pi

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from patagium.errors import FilterDiverged, Outcome
from patagium.learning.filters.root import MatrixLost
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.models.memory import replay
from patagium.learning.schedule import LogSamples
from patagium.learning.scores import INTERVAL, SILENT_RATIO

Array = NDArray[np.float64]
Chosen = NDArray[np.bool_]

STRETCHES = 50
"""An output stands still where, over so long a part of the samples, ..."""
STILL = 0.02
"""... it deviates by so small a share of its deviation over all of them, or less."""


@dataclass(frozen=True)
class Foresight:
    """What a learner predicted of samples.

    Attributes:
        log_likelihood: Of all samples; minus infinity if the learner diverged.
        log_likelihood_second_half: Of the second half of them; the same.
        samples: How many it was taught.
        nmse_second_half: Mean square innovation over the variance of the output, mean over the
            outputs, second half.
        coverage_second_half: Share of outputs inside the predicted 95 % interval, second half.
        outcome: COMPLETED, or why it stopped.
        reason: The same in words; empty if it did not.
    """

    log_likelihood: float
    log_likelihood_second_half: float
    samples: int
    nmse_second_half: float = nan
    coverage_second_half: float = nan
    outcome: Outcome = Outcome.COMPLETED
    reason: str = ""

    @property
    def score(self) -> float:
        """What trials are compared by: larger is better."""
        return self.log_likelihood_second_half


def moving(y: Array) -> Chosen:
    """Where outputs move, (N, n_y): those that are constant never do.

    Args:
        y: What was measured, (N, n_y); some of it may be missing.
    """
    measured = np.isfinite(y)
    truth = np.where(measured, y, 0.0)
    count = measured.sum(axis=0)
    center = truth.sum(axis=0) / np.maximum(count, 1)
    size = np.sqrt((truth**2).sum(axis=0) / np.maximum(count, 1))
    truth = np.where(measured, y - center, 0.0)
    std = np.sqrt((truth**2).sum(axis=0) / np.maximum(count, 1))
    alive = std > SILENT_RATIO * size.max(initial=0.0)
    truth = truth / np.where(alive, std, 1.0)
    span = max(len(y) // STRETCHES, 2)
    share, mean, square = (
        uniform_filter1d(values, span, axis=0)
        for values in (measured.astype(float), truth, truth**2)
    )
    local = square / np.maximum(share, 1e-9) - (mean / np.maximum(share, 1e-9)) ** 2
    return np.asarray(alive & measured & (local > STILL**2))


def predict(learner: FilterLearner, x: Array | LogSamples, y: Array, scored: Chosen) -> Foresight:
    """Teach a learner samples, and see how well it predicted each.

    An output that was measured, and that the learner left out, is taken for predicted by its
    mean and variance alone: leaving out is no way to a better score.

    Args:
        learner: It is changed.
        x: Inputs, (N, n_x), or a log that uses N samples.
        y: Measurements, (N, n_y).
        scored: Which of them count, (N, n_y); see `moving`.
    """
    error, variance = np.empty_like(y), np.empty_like(y)
    log = x if isinstance(x, LogSamples) else _one_by_one(x)
    memory = replay(learner.network, log.time, log.x, log.gaps)
    try:
        for k, (sample, measured) in enumerate(zip(log.used.tolist(), y, strict=True)):
            before = learner.weights
            seen = memory.upto(sample + 1, before)[-1]
            error[k] = learner.update(seen, measured)
            memory.corrected(learner.weights - before)
            variance[k] = np.diagonal(learner.innovation_covariance)
    except (FilterDiverged, MatrixLost) as problem:
        return Foresight(-inf, -inf, learner.count, outcome=problem.outcome, reason=str(problem))
    heard = scored.any(axis=0)
    return _judged(y[:, heard], error[:, heard], variance[:, heard], scored[:, heard])


def _one_by_one(x: Array) -> LogSamples:
    """Samples by themselves, (N, n_x)."""
    numbers = np.arange(len(x))
    return LogSamples(numbers.astype(float), x, numbers[:0], numbers)


def _judged(truth: Array, error: Array, variance: Array, scored: Chosen) -> Foresight:
    """Scores of innovations and their variances, (N, m) each; some may be nan."""
    counted = np.where(scored, truth, nan)
    mean, spread = np.nanmean(counted, axis=0), np.nanvar(counted, axis=0)
    used = np.isfinite(error)
    miss = np.where(used, error, truth - mean)
    allowed = np.where(used, variance, spread)
    with np.errstate(over="ignore"):
        ratio = miss**2 / allowed
    density = np.where(scored, -0.5 * (ratio + np.log(allowed) + log(2 * pi)), 0.0)
    late = slice(len(truth) // 2, None)
    chosen = scored[late]
    inside = (ratio[late] <= INTERVAL**2)[chosen]
    square = (miss**2 / spread)[late][chosen]
    return Foresight(
        log_likelihood=float(density.sum()),
        log_likelihood_second_half=float(density[late].sum()),
        samples=len(truth),
        nmse_second_half=float(square.mean()) if len(square) else nan,
        coverage_second_half=float(inside.mean()) if len(inside) else nan,
    )
