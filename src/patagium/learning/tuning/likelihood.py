"""Likelihood of what a learner predicted: the score of a trial.

With e = y - mean the innovation of an output and s^2 its variance, both predicted before the
sample is used,

    log L = sum over samples and outputs of -1/2 (e^2 / s^2 + log s^2 + log 2 pi):

the density that the learner gave beforehand to each number it then measured. It punishes errors,
and standard deviations too small or too large for them. An output that stands still is predicted
by any standard deviation, the smaller the better: where it does (`moving`) it is left out, or a
robot on the ground would decide how the learner learns in flight. Neglected: correlation of the
outputs (with it, on a flight without noise, the likelihood follows directions in which P_yy is
all but singular, and the standard deviations of the outputs come out too large); samples between
those used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import inf, log, nan, pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from patagium.errors import FilterDiverged, Outcome
from patagium.learning.filters.root import MatrixLost
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.scores import INTERVAL, SILENT_RATIO, json_ready
from patagium.learning.stream import Indices, Samples, prequential

Array = NDArray[np.float64]
Chosen = NDArray[np.bool_]

SPANS = 50
"""Number of spans of the samples in which an output is looked at."""
STILL = 0.02
"""An output stands still where its standard deviation over a span is at most this share of that
over all samples."""


class LogSamples(NamedTuple):
    """Measured inputs of a log, and which of its samples are used.

    Attributes:
        time: Increasing, (N,) [s].
        x: Measured inputs of the network, (N, n_measured) [units of x].
        gaps: First sample after each gap.
        used: Samples used, increasing, (U,).
    """

    time: Array
    x: Array
    gaps: Indices
    used: Indices


@dataclass(frozen=True)
class PredictionScore:
    """Likelihood, error and coverage of the predictions of a learner.

    Attributes:
        log_likelihood: Of all samples; minus infinity if the learner diverged.
        log_likelihood_second_half: Of the second half of them; the same.
        samples: Number of samples that were learned.
        nmse_second_half: Mean square innovation over the variance of the output, mean over the
            outputs, second half.
        coverage_second_half: Share of outputs inside the predicted 95 % interval, second half.
        outcome: COMPLETED, or why the learner stopped.
        reason: The outcome in words; empty if it is COMPLETED.
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
        """Number that trials are compared by: larger is better."""
        return self.log_likelihood_second_half

    def describe(self) -> dict[str, Any]:
        """Score as JSON-able values; numbers that are not finite are None."""
        values: dict[str, Any] = json_ready(asdict(self))
        return values | {"outcome": self.outcome.name}

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> PredictionScore:
        """Inverse of `describe`.

        Args:
            description: Plain values by name.
        """
        lost = {"log_likelihood": -inf, "log_likelihood_second_half": -inf}
        found: dict[str, Any] = {
            k: lost.get(k, nan) if v is None else v for k, v in description.items()
        }
        return cls(**{**found, "outcome": Outcome[found["outcome"]]})


def moving(y: Array) -> Chosen:
    """Samples at which outputs move, (N, n_y): constant outputs never do.

    Args:
        y: Measurements, (N, n_y) [unit of y]; NaN where one is missing.
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
    span = max(len(y) // SPANS, 2)
    share, mean, square = (
        uniform_filter1d(values, span, axis=0)
        for values in (measured.astype(float), truth, truth**2)
    )
    local = square / np.maximum(share, 1e-9) - (mean / np.maximum(share, 1e-9)) ** 2
    return np.asarray(alive & measured & (local > STILL**2))


def score_predictions(
    learner: FilterLearner, log: LogSamples, y: Array, scored: Chosen
) -> PredictionScore:
    """Score of the predictions of a learner that learns samples one by one.

    An output that was measured, and that the learner left out, is scored as if it had been
    predicted by its mean and variance alone, so that leaving out does not improve the score.

    Args:
        learner: Learner, which learns the samples.
        log: Log of which N samples are used.
        y: Measurements, (N, n_y) [unit of y].
        scored: Measurements that count, (N, n_y) [unit of y]; see `moving`.
    """
    measured = np.full((len(log.time), y.shape[1]), nan)
    measured[log.used] = y
    samples = Samples(log.time, log.x, measured, log.gaps)
    try:
        updates = [update for _, update in prequential(learner, samples, log.used) if update]
    except (FilterDiverged, MatrixLost) as problem:
        return PredictionScore(
            -inf, -inf, learner.count, outcome=problem.outcome, reason=str(problem)
        )
    error = np.array([update.innovation for update in updates])
    variance = np.array([update.std for update in updates]) ** 2
    heard = scored.any(axis=0)
    return _judged(y[:, heard], error[:, heard], variance[:, heard], scored[:, heard])


def _judged(truth: Array, error: Array, variance: Array, scored: Chosen) -> PredictionScore:
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
    return PredictionScore(
        log_likelihood=float(density.sum()),
        log_likelihood_second_half=float(density[late].sum()),
        samples=len(truth),
        nmse_second_half=float(square.mean()) if len(square) else nan,
        coverage_second_half=float(inside.mean()) if len(inside) else nan,
    )
