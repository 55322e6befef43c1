"""Score of a trial: what weights that stay predict of samples that were left out.

Trials are compared by the continuous ranked probability score (CRPS) of the predicted normal
distributions on samples that were left out (`left_out`), over the standard deviation of each
output; errors count in proportion to their size, and so do intervals that are too wide or too
narrow. With z = (y - mean) / s and the normal density phi and distribution Phi,

    CRPS = s (z (2 Phi(z) - 1) + 2 phi(z) - 1 / sqrt(pi)).

The score is -log CRPS. Where other flights or other kinematics were left out, the CRPS is the mean
of two: that of what was left out, and that of known kinematics, each sample predicted before it
was learned, second half; so a setting that learns nothing does not win by its wide intervals. A
trial is then refused where its mean square error on anything left out is larger than that of
predicting zero, or of the weights before any sample (the physics that a network begins with).

An output that stands still, which any small standard deviation predicts, is left out (`moving`).
Neglected: correlation of the outputs (docs/decisions.md says why); samples between those used.

References:
    Gneiting & Raftery (2007), Strictly proper scoring rules, prediction, and estimation, J. Am.
    Stat. Assoc. 102.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from math import inf, log, nan, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import uniform_filter1d
from scipy.special import ndtr

from patagium.arrays import Array, Bools, Indices, thin
from patagium.errors import FilterDiverged, Outcome
from patagium.learning.filters.root import MatrixLost
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.models.memory import network_inputs
from patagium.learning.scores import INTERVAL, ErrorSums, mean_heard
from patagium.learning.stream import Samples, prequential
from patagium.reading import json_ready

SPANS = 50
"""Number of spans of the samples in which an output is looked at."""
STILL = 0.02
"""An output stands still where its standard deviation over a span is at most this share of that
over all samples."""
MOST_JUDGED = 400
"""Samples of a left-out stretch that are predicted at most, spread evenly."""
BLOCKS = 10
"""Blocks in a left-out stretch, between which the standard error of a score is found."""


@dataclass(frozen=True)
class Flown:
    """Used samples of a flight, or of several as one log.

    Attributes:
        samples: All samples; the network's memory runs through those between the used ones.
        used: Samples used, increasing, (U,).
        scored: Measurements that count, (U, n_y); see `moving`.
        name: Name of the flight.
    """

    samples: Samples
    used: Indices
    scored: Bools
    name: str

    @property
    def y(self) -> Array:
        """Measurements of the used samples, (U, n_y) [unit of y]."""
        return self.samples.y[self.used]


class Fold(NamedTuple):
    """Samples that a trial learns, and samples that it then predicts with frozen weights.

    Attributes:
        learned: Used samples of the flights learned that it learns, (U,) of bool.
        flown: Flight that is predicted.
        judged: Used samples of it that are predicted, increasing.
        elsewhere: Whether it is another flight or of other kinematics.
    """

    learned: Bools
    flown: Flown
    judged: Indices
    elsewhere: bool = True


@dataclass(frozen=True)
class PredictionScore:
    """Score of a trial on what was left out, and of its predictions of known kinematics.

    Attributes:
        samples: Number of samples that were learned.
        nmse_second_half: Mean square innovation over the variance of the output, mean over the
            outputs, second half.
        coverage_second_half: Share of outputs inside the predicted 95 % interval, second half.
        outcome: COMPLETED, or why the learner stopped.
        reason: Why the trial is refused; empty if it is not.
        crps: CRPS that trials are compared by, over the standard deviation of the output.
        crps_second_half: CRPS of known kinematics, second half, mean over the outputs.
        left_out_crps: CRPS of what was left out, mean over the outputs.
        left_out_error: Standard error of `left_out_crps`, between blocks of samples.
        left_out_nmse: Mean square error over the variance of the output, mean over the outputs,
            the largest of what was left out.
        left_out_coverage: Share of outputs inside the predicted 95 % interval there.
        moved: Norm of the change of the weights by all samples [1].
    """

    samples: int
    nmse_second_half: float = nan
    coverage_second_half: float = nan
    outcome: Outcome = Outcome.COMPLETED
    reason: str = ""
    crps: float = nan
    crps_second_half: float = nan
    left_out_crps: float = nan
    left_out_error: float = nan
    left_out_nmse: float = nan
    left_out_coverage: float = nan
    moved: float = nan

    @property
    def score(self) -> float:
        """Number that trials are compared by: larger is better, minus infinity is refused."""
        lost = self.reason or not self.crps >= 0
        return -inf if lost else -log(max(self.crps, 1e-300))

    def describe(self) -> dict[str, Any]:
        """Score as JSON-able values; numbers that are not finite are None."""
        values: dict[str, Any] = json_ready(asdict(self))
        return values | {"outcome": self.outcome.name}

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> PredictionScore:
        """Inverse of `describe`."""
        found: dict[str, Any] = {k: nan if v is None else v for k, v in description.items()}
        return cls(**{**found, "outcome": Outcome[found["outcome"]]})


def moving(y: Array, scale: ArrayLike = 1.0) -> Bools:
    """Samples at which outputs move, (N, n_y): constant outputs never do.

    Args:
        y: Measurements, (N, n_y) [unit of y]; NaN where one is missing.
        scale: Scale of each output, in which outputs are compared, (n_y,) or () [unit of y].
    """
    measured = np.isfinite(y)
    sums = ErrorSums(y.shape[1], scale)
    sums.add(y, y)
    (count, center, square, *_), alive = sums.sums, ~sums.silent
    std = np.sqrt(square / np.maximum(count, 1))
    truth = np.where(measured, y - center, 0.0) / np.where(alive, std, 1.0)
    span = max(len(y) // SPANS, 2)
    share, mean, square = (
        uniform_filter1d(values, span, axis=0)
        for values in (measured.astype(float), truth, truth**2)
    )
    share = np.maximum(share, 1e-9)
    local = square / share - (mean / share) ** 2
    return np.asarray(alive & measured & (local > STILL**2))


def judged_trial(
    make: Callable[[], FilterLearner], flown: Flown, folds: tuple[Fold, ...]
) -> PredictionScore:
    """Score of the settings of a learner.

    Args:
        make: New learner with the settings.
        flown: Flights that are learned.
        folds: What is learned of them, and what is then predicted.
    """
    learner = make()
    prior = learner.weights
    known = score_predictions(learner, flown)
    known = replace(known, moved=float(np.linalg.norm(learner.weights - prior)))
    parts: list[PredictionScore] = []
    for fold in folds:
        taught, reason = learner, known.reason
        if not (reason or fold.learned.all()):
            taught = make()
            reason = score_predictions(taught, flown, np.flatnonzero(fold.learned)).reason
        if not reason:
            parts.append(_frozen(taught, prior, fold))
            reason = parts[-1].reason
        if reason:
            return replace(known, reason=reason)
    crps = float(np.mean([one.left_out_crps for one in parts]))
    elsewhere = all(fold.elsewhere for fold in folds)
    return replace(
        known,
        crps=(crps + known.crps_second_half) / 2 if elsewhere else crps,
        left_out_crps=crps,
        left_out_error=sqrt(sum(one.left_out_error**2 for one in parts)) / len(parts),
        left_out_nmse=max(one.left_out_nmse for one in parts),
        left_out_coverage=float(np.mean([one.left_out_coverage for one in parts])),
    )


def _frozen(learner: FilterLearner, prior: Array, fold: Fold) -> PredictionScore:
    """Score of what was left out in one fold, predicted with weights that stay."""
    flown, network = fold.flown, learner.network
    heard = flown.scored.any(axis=0)
    rows = thin(fold.judged[flown.scored[fold.judged].any(axis=1)], MOST_JUDGED)
    log, places = flown.samples, flown.used[rows]
    x, x_prior = (
        network_inputs(network, weights, log.time, log.x, log.gaps)[places]
        for weights in (learner.weights, prior)
    )
    try:
        mean, covariance = learner.predict(x)
    except (FilterDiverged, MatrixLost) as problem:
        return PredictionScore(learner.count, reason=f"{flown.name}: {problem}")
    truth = np.where(flown.scored, flown.y, nan)[:, heard]
    spread = np.nanstd(truth, axis=0)
    counted = truth[rows] / spread
    error = counted - mean[:, heard] / spread
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))[:, heard] / spread
    with np.errstate(over="ignore", invalid="ignore"):
        at_prior = counted - network.evaluate(x_prior, prior)[:, heard] / spread
        nmse, zero, physics = (_mean(part**2) for part in (error, counted, at_prior))
    rival = ("the weights before any sample", physics) if physics < zero else ("zero", zero)
    if not (nmse <= rival[1] if fold.elsewhere else np.isfinite(nmse)):
        return PredictionScore(
            learner.count,
            reason=f"{flown.name}, left out: the mean square error, {nmse:.3g} times the "
            f"variance, is larger than that of {rival[0]}, {rival[1]:.3g}",
        )
    crps = _crps(error, std)
    inside = np.abs(error) <= INTERVAL * std
    blocks = np.array([_mean(part) for part in np.array_split(crps, min(BLOCKS, len(crps)))])
    blocks = blocks[np.isfinite(blocks)]
    return PredictionScore(
        learner.count,
        left_out_crps=_mean(crps),
        left_out_error=float(blocks.std(ddof=1) / sqrt(len(blocks))) if len(blocks) > 1 else nan,
        left_out_nmse=nmse,
        left_out_coverage=float(inside[np.isfinite(error)].mean()),
    )


def _crps(error: Array, std: Array) -> Array:
    """CRPS of normal distributions, as `error` [its unit]."""
    z = error / std
    return np.asarray(
        std * (z * (2 * ndtr(z) - 1) + (sqrt(2) * np.exp(-(z**2) / 2) - 1) / sqrt(pi))
    )


def _mean(values: Array) -> float:
    """Mean over the samples that count, then over the outputs."""
    return mean_heard(np.array([mean_heard(column) for column in values.T]))


def score_predictions(
    learner: FilterLearner, flown: Flown, learned: Indices | None = None
) -> PredictionScore:
    """Score of the predictions of a learner that learns samples one by one.

    An output that was measured, and that the learner left out, is scored as if it had been
    predicted by its mean and variance alone, so that leaving out does not improve the score.

    Args:
        learner: Learner, which learns the samples.
        flown: Flights that are learned.
        learned: Used samples that it learns, increasing; None: all.
    """
    rows = np.arange(len(flown.used)) if learned is None else learned
    try:
        loop = prequential(learner, flown.samples, flown.used[rows])
        updates = [one for _, one in loop if one]
    except (FilterDiverged, MatrixLost) as problem:
        return PredictionScore(learner.count, outcome=problem.outcome, reason=str(problem))
    heard = flown.scored.any(axis=0)
    error, std = (np.array([one[k] for one in updates])[:, heard] for k in (0, 1))
    truth, scored = flown.y[rows][:, heard], flown.scored[rows][:, heard]
    counted = np.where(scored, truth, nan)
    mean = np.nanmean(counted, axis=0)
    spread = np.nanvar(counted, axis=0)
    used = np.isfinite(error)
    miss = np.where(used, error, truth - mean)
    allowed = np.where(used, std**2, spread)
    with np.errstate(over="ignore"):
        ratio = miss**2 / allowed
    late = slice(len(truth) // 2, None)
    chosen = scored[late]
    crps = np.where(scored, _crps(miss, np.sqrt(allowed)), nan) / np.sqrt(spread)
    inside = (ratio[late] <= INTERVAL**2)[chosen]
    square = (miss**2 / spread)[late][chosen]
    return PredictionScore(
        samples=len(truth),
        nmse_second_half=float(square.mean()) if len(square) else nan,
        coverage_second_half=float(inside.mean()) if len(inside) else nan,
        crps_second_half=_mean(crps[late]),
    )
