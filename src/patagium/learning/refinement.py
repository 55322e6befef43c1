"""Weights by least squares over a whole log, begun where a learner stands.

A filter takes slopes where its weights are at the time: what it learned far from the truth
counts as if it had been learned there, and memory it recalled at early weights is only moved
along its slopes. For few weights with a meaning that matters; here all samples are taken with
slopes at the same weights, again and again (Gauss-Newton), outliers weighed as `Screening` does.
Neglected: weights that wander, errors that are correlated, channels that are stuck.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve

from patagium.arguments import checked
from patagium.arrays import Array, find_gaps
from patagium.errors import FilterDiverged, Outcome
from patagium.learning.filters.weight_covariance import block_covariance
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.model_file import Model, model_of
from patagium.learning.models.memory import network_inputs
from patagium.learning.samples import samples, stds
from patagium.learning.stream import Samples, checked_samples, used_samples
from patagium.sensing.force.measured_force import ForceSamples

_CLOSE = 0.01  # steps shorter than that, in deviations, are the last
_MOST_ROUNDS, _HALVINGS = 20, 8


@checked
def refine(
    learner: FilterLearner,
    time: ArrayLike | xr.Dataset | ForceSamples,
    x: ArrayLike | None = None,
    y: ArrayLike | None = None,
    *,
    every: int = 1,
) -> Model:
    """Most probable weights of a log, with their covariance.

    Minimal over W: |y - y(W)|^2 / variance over the used samples + (W - W0)^2 / P0, with W0 and P0
    those of the learner, and its variance (as estimated by now) with that of each measured force.
    If the learner has `screening`, an error e beyond c standard deviations has its noise raised
    until e is c of them.

    Args:
        learner: What has learned the log; it is not changed.
        time: Increasing, (N,) [s]; or a flight or measured forces, which give x and y too.
        x: Measured inputs of the network, (N, n_measured) [units of x].
        y: What was measured, (N, n_y) [unit of y]; NaN where it was not.
        every: 1 to use each sample, 100 to use one in 100.

    Returns:
        A model with the covariance; `estimates` of its network reads it.

    Raises:
        ShapeError: If the arrays do not fit each other or the network.
        LogError: If an input is not finite or time does not advance.
        FilterDiverged: If nothing finite comes of the learner's weights.
    """
    network = learner.network
    table: Any = time, x, y
    noise = None
    if isinstance(time, xr.Dataset | ForceSamples):
        table, noise = samples(time, network)[:3], stds(time, network)
    log = checked_samples(network, table, (), noise)
    log = replace(log, gaps=find_gaps(log.time))
    used = np.isin(np.arange(len(log.time)), used_samples(log.y, every, log.gaps))
    log = replace(log, y=np.where(used[:, None], log.y, np.nan))
    first, prior = learner.prior
    begins = [(_cost(learner, log, one), one) for one in (learner.weights, first)]
    cost, weights = min(begins, key=lambda begin: begin[0])  # the filter may have diverged
    if not np.isfinite(cost):
        raise FilterDiverged("the weights to begin with give nothing finite", Outcome.NOT_FINITE)
    for _ in range(_MOST_ROUNDS):
        gradient, information = _slopes(learner, log, weights)
        information[np.diag_indices_from(information)] += 1.0 / prior
        factor = cho_factor(information)
        step = cho_solve(factor, gradient - (weights - first) / prior)
        length = float(np.sqrt(step @ information @ step))
        weights, cost, moved = _moved(learner, log, (weights, cost), step)
        if length < _CLOSE or not moved:
            break
    covariance = cho_solve(factor, np.eye(len(weights)))
    kept = block_covariance(network, "full", [(covariance + covariance.T) / 2])
    found = model_of(learner)
    fit = {"parameter_fit": "a least-squares fit of the whole log that was learned"}
    return Model(network, weights, kept, found.measurement_std, found.inputs, found.learner | fit)


def _moved(
    learner: FilterLearner, log: Samples, here: tuple[Array, float], step: Array
) -> tuple[Array, float, bool]:
    """Weights and cost after a step, halved until it lowers the cost."""
    weights, cost = here
    for halvings in range(_HALVINGS):
        tried = weights + step / 2**halvings
        found = _cost(learner, log, tried)
        if found <= cost:
            return tried, found, True
    return weights, cost, False


def _deviations(learner: FilterLearner, log: Samples) -> Array:
    """Standard deviations of the measurements, the learner's and their own, (N, n_y) [y]."""
    own = np.zeros(log.y.shape) if log.std is None else np.nan_to_num(log.std)
    return np.asarray(np.hypot(learner.measurement_std, own))


def _raised(learner: FilterLearner, error: Array, std: Array) -> Array:
    """Standard deviations, larger for outliers by the rule of the screening, (N,) [y].

    A cost of c^2 (1 + 2 log(e / c)) beyond c has the slope of that.
    """
    screening = learner.settings.screening
    limit = np.inf if screening is None else screening.outlier_std
    return np.asarray(np.fmax(std, np.abs(error) / limit))


def _cost(learner: FilterLearner, log: Samples, weights: Array) -> float:
    """Squares of errors and of departures from the prior, in standard deviations."""
    (first, prior), network = learner.prior, learner.network
    rows = network_inputs(network, weights, log.time, log.x, log.gaps)
    seen = np.isfinite(log.y)
    used = seen.any(axis=1)
    error = np.zeros(log.y.shape)
    error[used] = log.y[used] - network.evaluate(rows[used], weights)
    std = _deviations(learner, log)[seen]
    with np.errstate(invalid="ignore"):
        raised = _raised(learner, error[seen], std)
        cost = ((error[seen] / raised) ** 2 * (1.0 + 2.0 * np.log(raised / std))).sum()
    cost += ((weights - first) ** 2 / prior).sum()
    return float(cost) if np.isfinite(cost) else float("inf")


def _slopes(learner: FilterLearner, log: Samples, weights: Array) -> tuple[Array, Array]:
    """Sums of H'e and of H'H over the used samples, in standard deviations of the measurement."""
    network, deviations = learner.network, _deviations(learner, log)
    rows = network_inputs(network, weights, log.time, log.x, log.gaps)
    gradient, information = np.zeros(len(weights)), np.zeros((len(weights), len(weights)))
    for k in np.flatnonzero(np.isfinite(log.y).any(axis=1)).tolist():
        value, slope = network.linearized(network.encode_one(rows[k]), weights)
        seen = np.isfinite(log.y[k])
        error = (log.y[k] - value)[seen]
        std = _raised(learner, error, deviations[k, seen])
        slope = slope[seen] / std[:, None]
        gradient += slope.T @ (error / std)
        information += slope.T @ slope
    return gradient, information
