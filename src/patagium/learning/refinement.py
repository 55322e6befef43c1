"""Weights by least squares over a whole log, begun where a learner stands.

A filter takes slopes where its weights are at the time: what it learned far from the truth
counts as if it had been learned there, and memory it recalled at early weights is only moved
along its slopes. For few weights with a meaning that matters; here all samples are taken with
slopes at the same weights, again and again (Gauss-Newton), outliers weighed as `Screening` does.
Neglected: weights that wander, errors that are correlated, channels that are stuck.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve

from patagium.arguments import checked
from patagium.arrays import Array, Bools, find_gaps
from patagium.errors import FilterDiverged, Outcome, ParameterError
from patagium.learning.filters.weight_covariance import block_covariance
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.model_file import Model, model_of
from patagium.learning.models.memory import network_inputs
from patagium.learning.samples import samples, stds
from patagium.learning.stream import Samples, checked_samples, used_samples
from patagium.native.structs import header_numbers
from patagium.sensing.force.measured_force import ForceSamples

_CLOSE = 0.01  # smaller steps, in deviations, and smaller changes of variances are the last
_MOST_ROUNDS, _HALVINGS = 20, 8
_COLOR = 0.5  # correlation of errors from which deviations are told to be too small
_LEAST = header_numbers("screening.h").LEAST_NOISE  # as for the filter


@checked
def refine(
    learner: FilterLearner,
    time: ArrayLike | xr.Dataset | ForceSamples,
    x: ArrayLike | None = None,
    y: ArrayLike | None = None,
    *,
    every: int = 1,
    before: Model | None = None,
) -> Model:
    """Most probable weights of a log, with their covariance.

    Minimal over W: |y - y(W)|^2 / variance over the used samples + (W - W0)' P0^-1 (W - W0). To
    the variance of the learner that of each measured force is added. A learner that estimates its
    noise (`noise_estimation`) takes that of the errors that remain, of independent samples.
    If the learner has `screening`, an error e beyond c standard deviations has its noise raised
    until e is c of them.

    Args:
        learner: What has learned the log; it is not changed.
        time: Increasing, (N,) [s]; or a flight or measured forces, which give x and y too.
        x: Measured inputs of the network, (N, n_measured) [units of x].
        y: What was measured, (N, n_y) [unit of y]; NaN where it was not.
        every: 1 to use each sample, 100 to use one in 100.
        before: Model of earlier logs, from `refine` or of the learner before this log: its
            weights and covariance are W0 and P0. None: those of the learner before any log, so
            that logs it learned before this one do not count.

    Returns:
        A model with the covariance; `estimates` of its network reads it.

    Raises:
        ShapeError: If the arrays do not fit each other or the network.
        LogError: If an input is not finite or time does not advance.
        ParameterError: If the model of earlier logs is of another network, or has no covariance.
        FilterDiverged: If nothing finite comes of the learner's weights.
    """
    network = learner.network
    table: Any = time, x, y
    noise = None
    if isinstance(time, xr.Dataset | ForceSamples):
        table, noise = samples(time, network)[:3], stds(time, network)
    log = checked_samples(network, table, (), noise)
    gaps = find_gaps(log.time)
    used = np.isin(np.arange(len(log.time)), used_samples(log.y, every, gaps))
    log = replace(log, gaps=gaps, y=np.where(used[:, None], log.y, np.nan))
    fit = _Fit(learner, log, *_prior(learner, before), learner.measurement_std**2)
    begins = [(one, _errors(fit, one)) for one in (learner.weights, fit.first)]
    weights, errors = min(begins, key=lambda begin: _cost(fit, *begin))  # a filter may diverge
    if not np.isfinite(_cost(fit, weights, errors)):
        raise FilterDiverged("the weights to begin with give nothing finite", Outcome.NOT_FINITE)
    covariance, told = np.zeros_like(fit.precision), 0.0
    for _ in range(_MOST_ROUNDS):
        variance = _noise(fit, errors, told)
        settled = np.allclose(variance, fit.variance, rtol=_CLOSE, atol=0.0, equal_nan=True)
        fit = fit._replace(variance=variance)
        gradient, seen = _slopes(fit, weights)
        information = seen + fit.precision
        covariance = cho_solve(cho_factor(information), np.eye(len(weights)))
        told = float((covariance * seen).sum())
        step = covariance @ (gradient - fit.precision @ (weights - fit.first))
        length = float(np.sqrt(step @ information @ step))
        (weights, errors), moved = _moved(fit, (weights, errors), step)
        if settled and (length < _CLOSE or not moved):
            break
    kept = block_covariance(network, "full", [(covariance + covariance.T) / 2])
    found, std = model_of(learner), np.sqrt(np.nan_to_num(fit.variance))
    words = found.learner | {"parameter_fit": _words(fit, errors, anew=before is None)}
    return Model(network, weights, kept, std, found.inputs, words)


class _Fit(NamedTuple):
    """Least-squares problem of a log: samples, prior of the weights and variances of the noise.

    Attributes:
        learner: What has learned it.
        log: Samples; the measurements of those that are not used are NaN.
        first: Weights before the log, (n,) [1].
        precision: Inverse of their covariance, (n, n) [1].
        variance: Variances of the measurement, (n_y,) [y^2].
    """

    learner: FilterLearner
    log: Samples
    first: Array
    precision: Array
    variance: Array

    @property
    def deviations(self) -> Array:
        """Standard deviations of the measurements, the fit's and their own, (N, n_y) [y]."""
        own = np.zeros(self.log.y.shape) if self.log.std is None else np.nan_to_num(self.log.std)
        return np.hypot(np.sqrt(self.variance), own)

    def raised(self, error: Array, std: Array) -> Array:
        """Standard deviations, larger for outliers by the rule of the screening, (N,) [y].

        A cost of c^2 (1 + 2 log(e / c)) beyond c has the slope of that.
        """
        screening = self.learner.settings.screening
        limit = np.inf if screening is None else screening.outlier_std
        return np.fmax(std, np.abs(error) / limit)

    def rows(self, weights: Array) -> tuple[Array, Bools]:
        """Inputs of the network, (N, n_x), and whether a sample is used, (N,)."""
        log = self.log
        rows = network_inputs(self.learner.network, weights, log.time, log.x, log.gaps)
        return rows, np.asarray(np.isfinite(log.y).any(axis=1))


def _prior(learner: FilterLearner, before: Model | None) -> tuple[Array, Array]:
    """Weights before a log, (n,), and the inverse of their covariance, (n, n)."""
    if before is None:
        first, variances = learner.prior
        return first, np.diag(1.0 / variances)
    if before.covariance is None or before.network.size != learner.network.size:
        raise ParameterError("before", "a model of this network, with a covariance", before)
    return before.weights, np.asarray(np.linalg.inv(before.covariance))


def _moved(fit: _Fit, here: tuple[Array, Array], step: Array) -> tuple[tuple[Array, Array], bool]:
    """Weights and errors after a step, halved until it lowers the cost."""
    cost = _cost(fit, *here)
    for halvings in range(_HALVINGS):
        tried = here[0] + step / 2**halvings
        errors = _errors(fit, tried)
        if _cost(fit, tried, errors) <= cost:
            return (tried, errors), True
    return here, False


def _errors(fit: _Fit, weights: Array) -> Array:
    """Errors of the used samples, (N, n_y) [y]; NaN where nothing was measured."""
    y, (rows, used) = fit.log.y, fit.rows(weights)
    errors = np.full(y.shape, np.nan)
    errors[used] = y[used] - fit.learner.network.evaluate(rows[used], weights)
    return errors


def _cost(fit: _Fit, weights: Array, errors: Array) -> float:
    """Squares of errors and of departures from the prior, in standard deviations."""
    seen, apart = np.isfinite(fit.log.y), weights - fit.first
    error, std = errors[seen], fit.deviations[seen]
    with np.errstate(invalid="ignore"):
        raised = fit.raised(error, std)
        cost = ((error / raised) ** 2 * (1.0 + 2.0 * np.log(raised / std))).sum()
        cost += apart @ fit.precision @ apart
    return float(cost) if np.isfinite(cost) else float("inf")


def _noise(fit: _Fit, errors: Array, told: float) -> Array:
    """Variances of the measurement, (n_y,) [y^2]: as given, or those of the errors that remain.

    What came with the samples is none of it, outliers count as the limit of the screening, and the
    log told as many numbers as the errors have lost degrees of freedom.
    """
    if fit.learner.settings.noise_estimation is None:
        return fit.variance
    seen, std = np.isfinite(fit.log.y), fit.deviations
    squares = (errors * std / fit.raised(errors, std)) ** 2
    squares *= seen.sum() / max(seen.sum() - told, 1.0)
    trust = np.where(seen, (fit.variance / std**2) ** 2, 0.0)
    with np.errstate(invalid="ignore"):  # of outputs that were never measured
        excess = np.nansum(trust * (squares - std**2), axis=0) / trust.sum(axis=0)
        least = _LEAST * np.nansum(fit.log.y**2, axis=0) / seen.sum(axis=0)
    found = np.fmax(fit.variance + excess, least)
    return np.where(found > 0, found, fit.variance)


def _words(fit: _Fit, errors: Array, *, anew: bool) -> str:
    """Description of the fit, with a warning of errors that correlate between used samples."""
    logs = "whole log that was learned" if anew else "last log and of what was learned before it"
    scaled = errors / fit.raised(errors, fit.deviations)
    scaled = scaled[np.isfinite(errors).any(axis=1)]
    power = np.fmax(np.nansum(scaled**2, axis=0), np.isfinite(scaled).sum(axis=0))
    color = np.nansum(scaled[1:] * scaled[:-1], axis=0) / np.fmax(power, 1.0)
    name, most = fit.learner.network.output_names[color.argmax()], color.max()
    sure = f", too sure of them, for errors of {name} correlate by {most:.2f} between samples"
    return f"a least-squares fit of the {logs}" + sure * bool(most > _COLOR)


def _slopes(fit: _Fit, weights: Array) -> tuple[Array, Array]:
    """Sums of H'e and of H'H over the used samples, in standard deviations of the measurement."""
    network, deviations, (rows, used) = fit.learner.network, fit.deviations, fit.rows(weights)
    gradient, information = np.zeros(len(weights)), np.zeros((len(weights), len(weights)))
    for k in np.flatnonzero(used).tolist():
        value, slope = network.linearized(network.encode_one(rows[k]), weights)
        seen = np.isfinite(fit.log.y[k])
        error = (fit.log.y[k] - value)[seen]
        std = fit.raised(error, deviations[k, seen])
        slope = slope[seen] / std[:, None]
        gradient += slope.T @ (error / std)
        information += slope.T @ slope
    return gradient, information
