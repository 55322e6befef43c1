"""Errors of predictions, coverage of intervals and calibration of filters, from sums.

Normalized mean square error (NMSE) = mean square error / variance of the output over the same
span, for each output. A filter that is right has innovations e that are white, with e' P_yy^-1 e
chi-square distributed. Neglected: correlation between outputs, and in time beyond one update.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaincinv, ndtri

from patagium.arrays import Array, Bools
from patagium.errors import ShapeError

SILENT_RATIO = 1e-9
"""An output is silent when its std is at most this share of the largest rms, both scaled."""

INTERVAL = 1.959963985
"""Half width of the 95 % interval of a normal distribution, in standard deviations."""
NOMINAL = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Probabilities of the predicted intervals that are compared with the errors."""
_REACH = np.append(ndtri((1 + np.array(NOMINAL)) / 2), np.inf)
_WHOLE, _LATE = "", "_second_half"
_HALVES = (_WHOLE, _LATE)


class ErrorSums:
    """Sums over samples from which the NMSE of a prediction and of persistence follow.

    Blocks are merged by their means and their squares about them, so that no block cancels.

    Args:
        outputs: Number of outputs n_y.
        scale: Scale of each output, in which outputs are compared, (n_y,) or () [unit of y].

    Attributes:
        sums: Number of samples, their mean, squares about it, squared errors of the prediction
            and of persistence, (5, n_y).

    References:
        Chan, Golub & LeVeque (1983), Algorithms for computing the sample variance.
    """

    def __init__(self, outputs: int, scale: ArrayLike = 1.0) -> None:
        self.sums, self._scale = np.zeros((5, outputs)), np.asarray(scale)

    def add(
        self,
        measurement: Array,
        prediction: Array,
        held: Array | None = None,
        keep: float = 1.0,
    ) -> None:
        """Count a block of samples.

        Args:
            measurement: y, (N, n_y) [unit of y]; NaN where it does not count.
            prediction: yhat, (N, n_y) [unit of y].
            held: Persistence, (N, n_y) [unit of y]; None for none.
            keep: Factor on all that was counted from each sample to the next: 1 to forget nothing.
        """
        known = np.isfinite(measurement)
        share = known * keep ** np.arange(len(measurement) - 1, -1, -1.0)[:, None]
        count = share.sum(axis=0)
        some = np.where(count > 0, count, 1.0)
        values = np.where(known, measurement, 0.0)
        mean = (share * values).sum(axis=0) / some
        guesses = mean, prediction, values if held is None else held
        fresh = [(share * np.where(known, values - one, 0.0) ** 2).sum(axis=0) for one in guesses]
        forgotten = keep ** len(measurement)
        old, past = self.sums[0] * forgotten, self.sums[1]
        total = np.where(old + count > 0, old + count, 1.0)
        apart = mean - past
        squares = self.sums[2:] * forgotten + np.array(fresh)
        squares[0] += apart**2 * old * count / total
        self.sums = np.array([old + count, past + apart * count / total, *squares])

    @property
    def silent(self) -> Bools:
        """Outputs that never move: std_i / scale_i <= 1e-9 max_j rms_j / scale_j, (n_y,)."""
        count, mean, square = self.sums[:3]
        variance = square / np.where(count > 0, count, 1.0)
        largest = np.sqrt(((variance + mean**2) / self._scale**2).max(initial=0.0))
        return np.asarray(np.sqrt(variance) / self._scale <= SILENT_RATIO * largest)

    @property
    def nmse(self) -> Array:
        """NMSE of the prediction, (n_y,); NaN for silent outputs."""
        return self._ratio(self.sums[3])

    @property
    def persistence(self) -> Array:
        """NMSE of persistence, (n_y,); NaN for silent outputs."""
        return self._ratio(self.sums[4])

    def _ratio(self, error: Array) -> Array:
        silent, square = self.silent, self.sums[2]
        return np.where(silent, np.nan, error / np.where(silent, 1.0, square))


class IntervalSums:
    """Counts of errors inside predicted intervals.

    Args:
        outputs: Number of outputs n_y.

    Attributes:
        counts: Errors, those in the 95 % interval, then those in the interval of each of
            `NOMINAL` and in any, and the sum of the squares of errors over standard deviations,
            (4 + len(NOMINAL), n_y).
        unknown: Number of standard deviations that are not finite.
    """

    def __init__(self, outputs: int) -> None:
        self.counts = np.zeros((3 + len(_REACH), outputs))
        self.unknown = 0

    def add(self, error: Array, std: Array, keep: float = 1.0) -> None:
        """Count errors.

        Args:
            error: y - yhat, (M, n_y) [unit of y]; NaN where it does not count.
            std: Predicted standard deviation, (M, n_y) [unit of y].
            keep: Factor on all that was counted from each error to the next: 1 to forget nothing.
        """
        size, weight = np.abs(error), keep ** np.arange(len(error) - 1, -1, -1.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = size / std
        reach = np.where(np.isfinite(reach), reach, np.nan)
        inside = [np.isfinite(error), size <= INTERVAL * std, *(reach <= z for z in _REACH)]
        inside.append(np.where(np.isfinite(reach), reach, 0.0) ** 2)
        self.counts *= keep ** len(error)
        self.counts += [weight @ part for part in inside]
        self.unknown += int((~np.isfinite(std)).sum())

    def coverage(self, heard: ArrayLike | None = None) -> Array:
        """Share of errors in the 95 % interval, (n_y,); NaN where there is none.

        Args:
            heard: Outputs to score, (n_y,) of bool; the others are NaN. None: all.
        """
        count, inside = self.counts[:2]
        chosen = not self.unknown and (True if heard is None else np.asarray(heard, bool))
        return np.where(chosen, _per(inside, count), np.nan)

    @property
    def coverage_in_all(self) -> float:
        """Share of errors of all outputs in their 95 % interval; NaN before any."""
        count, inside = self.counts[:2].sum(axis=1)
        return float(inside / count) if count else float("nan")

    @property
    def nis(self) -> Array:
        """Mean square of errors over their standard deviations, (n_y,); NaN before any."""
        count, squares = self.counts[-2:]
        return _per(squares, count)

    def reliability(self, heard: ArrayLike | None = None) -> Array:
        """Share of errors in the interval of each of `NOMINAL`, (len(NOMINAL),); NaN before any.

        Args:
            heard: Outputs that count, (n_y,) of bool; None: all.
        """
        chosen = slice(None) if heard is None else np.asarray(heard, bool)
        *inside, count = self.counts[2:-1, chosen].sum(axis=1)
        return np.array(inside) / count if count else np.full(len(NOMINAL), np.nan)


class InnovationSums:
    """Sums over updates from which the calibration of a filter follows.

    Args:
        outputs: Number of outputs n_y.

    Attributes:
        totals: Number of updates, sum of NIS per channel, number inside its interval, (3,).
        products: Sums of products of normalized innovations e_k e_k+1, e_k^2 and e_k+1^2,
            (3, n_y) [-].
        last: Normalized innovation of the last update, (n_y,) [-].
    """

    def __init__(self, outputs: int) -> None:
        self.totals, self.products = np.zeros(3), np.zeros((3, outputs))
        self.last = np.full(outputs, np.nan)

    def add(self, innovation: Array, std: Array, nis: Array, heard: Bools) -> None:
        """Count updates.

        Args:
            innovation: e, (U, n_y) [unit of y]; NaN where a channel was left out.
            std: Predicted standard deviation of it, (U, n_y) [unit of y].
            nis: e' P_yy^-1 e, (U,).
            heard: Outputs that are not silent, (n_y,) of bool.
        """
        channels = np.isfinite(innovation[:, heard]).sum(axis=1)
        counted = np.isfinite(nis) & (channels > 0)
        counts, values = channels[counted], nis[counted]
        low, high = (2 * gammaincinv(counts / 2, p) for p in (0.025, 0.975))  # of chi-square
        inside = ((values >= low) & (values <= high)).sum()
        self.totals += [len(values), (values / counts).sum(), inside]
        scaled = np.vstack([self.last, innovation / np.where(std > 0, std, np.nan)])
        pairs = np.isfinite(scaled[1:]) & np.isfinite(scaled[:-1])
        before = np.where(pairs, scaled[:-1], 0.0)
        after = np.where(pairs, scaled[1:], 0.0)
        self.products += [(before * after).sum(0), (before**2).sum(0), (after**2).sum(0)]
        self.last = scaled[-1]

    def scores(self, names: Sequence[str], heard: Bools) -> dict[str, Any]:
        """Calibration of the filter in numbers.

        Args:
            names: Names of the outputs, n_y.
            heard: Outputs that are not silent, (n_y,) of bool.

        Returns:
            nis_per_channel: mean of the normalized innovation squared, over the number of
            channels; 1 if right, larger if too sure. nis_inside: share of updates in its central
            95 % interval. updates_learned: those with a NIS. innovation_correlation: of normalized
            innovations one update apart; 0 if white, NaN for outputs that never err.
        """
        count, ratio, inside = self.totals.tolist()
        product, power = self.products[0], np.sqrt(self.products[1] * self.products[2])
        color = _per(product, power)
        chosen = np.flatnonzero(heard).tolist()
        return {
            "nis_per_channel": ratio / count if count else np.nan,
            "nis_inside": inside / count if count else np.nan,
            "updates_learned": int(count),
            "innovation_correlation": {names[k]: float(color[k]) for k in chosen},
        }


class Scorer:
    """Scorer of predictions made before their samples were used.

    Args:
        names: Names of the outputs, n_y.
        scale: Scale of each output, in which outputs are compared, (n_y,) or () [unit of y].

    Attributes:
        samples: Number of samples predicted.
        checks: Number of samples at which the predicted interval was checked.
    """

    def __init__(self, names: Sequence[str], scale: ArrayLike = 1.0) -> None:
        self.names = tuple(names)
        outputs = len(self.names)
        self.samples, self.checks = 0, 0
        self._errors = {half: ErrorSums(outputs, scale) for half in _HALVES}
        self._intervals = {half: IntervalSums(outputs) for half in _HALVES}
        self._innovations = InnovationSums(outputs)

    @property
    def silent(self) -> Bools:
        """Outputs that have not moved so far, (n_y,); none before a sample."""
        if not self.samples:
            return np.zeros(len(self.names), bool)
        return self._errors[_WHOLE].silent

    def add_predictions(self, y: Array, prediction: Array, held: Array, late: Bools) -> None:
        """Count samples.

        Args:
            y: Measurement, (N, n_y) [unit of y]; NaN where it was not measured.
            prediction: yhat, (N, n_y) [unit of y].
            held: Persistence, (N, n_y) [unit of y].
            late: Samples of the second half, (N,) of bool.
        """
        self._errors[_WHOLE].add(y, prediction, held)
        self._errors[_LATE].add(y[late], prediction[late], held[late])
        self.samples += len(y)

    def add_checks(self, error: Array, std: Array, late: Bools) -> None:
        """Count checks of the predicted interval.

        Args:
            error: y - yhat, (M, n_y) [unit of y].
            std: Predicted standard deviation, (M, n_y) [unit of y].
            late: Checks in the second half, (M,) of bool.
        """
        self._intervals[_WHOLE].add(error, std)
        self._intervals[_LATE].add(error[late], std[late])
        self.checks += len(error)

    def add_updates(self, innovation: Array, std: Array, nis: Array) -> None:
        """Count updates; outputs silent so far are no channels.

        Args:
            innovation: (U, n_y) [unit of y].
            std: Predicted standard deviation of it, (U, n_y) [unit of y].
            nis: Normalized innovation squared, (U,).
        """
        self._innovations.add(innovation, std, nis, ~self.silent)

    def error_scores(self) -> dict[str, Any]:
        """Silent outputs, and NMSE of prediction and persistence, whole and second half."""
        found = {"silent": self.silent, "not_measured": self._errors[_WHOLE].sums[0] == 0}
        scores: dict[str, Any] = {
            key: [name for name, one in zip(self.names, chosen, strict=True) if one]
            for key, chosen in found.items()
        }
        if self.samples < 2:
            return scores
        for part in ("nmse", "persistence"):
            for half, errors in self._errors.items():
                scores |= span_scores(getattr(errors, part), self.names, f"{part}{half}")
        return scores

    def interval_scores(self) -> dict[str, Any]:
        """Coverage and reliability of the predicted intervals."""
        heard = ~self.silent
        each, late = (sums.coverage(heard) for sums in self._intervals.values())
        within = self._intervals[_WHOLE].reliability(heard)
        nis = np.where(heard, self._intervals[_LATE].nis, np.nan)
        return {
            "coverage": mean_heard(each),
            "coverage_second_half": mean_heard(late),
            "coverage_second_half_by_output": dict(zip(self.names, late.tolist(), strict=True)),
            "nis_second_half": mean_heard(nis),
            "nis_second_half_by_output": dict(zip(self.names, nis.tolist(), strict=True)),
            "coverage_by_output": dict(zip(self.names, each.tolist(), strict=True)),
            "coverage_checks": self.checks,
            "reliability": dict(zip(map(str, NOMINAL), within, strict=True)),
        }

    def scores(self) -> dict[str, Any]:
        """All scores by name."""
        return {
            **self.error_scores(),
            **self.interval_scores(),
            **self._innovations.scores(self.names, ~self.silent),
        }

    def state(self) -> dict[str, Array]:
        """All sums as arrays by name."""
        counts = [self.samples, self.checks]
        return {
            "counts": np.array([*counts, *(sums.unknown for sums in self._intervals.values())]),
            **{f"errors {name}": sums.sums for name, sums in self._errors.items()},
            **{f"intervals {name}": sums.counts for name, sums in self._intervals.items()},
            **{f"innovations {name}": value for name, value in vars(self._innovations).items()},
        }

    def resume(self, state: Mapping[str, Array]) -> None:
        """Continue from the sums that `state` returned, for the same outputs.

        Raises:
            KeyError: If a sum is missing.
        """
        counts = iter(state["counts"].tolist())
        self.samples, self.checks = next(counts), next(counts)
        for name, intervals in self._intervals.items():
            intervals.unknown, intervals.counts = next(counts), state[f"intervals {name}"].copy()
        for name, errors in self._errors.items():
            errors.sums = state[f"errors {name}"].copy()
        for name in vars(self._innovations):
            setattr(self._innovations, name, state[f"innovations {name}"].copy())


def normalized_error(measurement: ArrayLike, prediction: ArrayLike) -> Array:
    """Mean square error of each output over its variance.

    NMSE_i = mean_k (y_ki - yhat_ki)^2 / var_k y_ki over the samples that were measured;
    predicting the mean scores 1.

    Args:
        measurement: y, (N, n_y) [unit of y]; NaN where it was not measured.
        prediction: yhat, (N, n_y) [unit of y].

    Returns:
        NMSE, (n_y,); nan for silent outputs.

    Raises:
        ShapeError: If the two differ in shape.
    """
    truth, guess = _table("measurement", measurement), _table("prediction", prediction)
    if truth.shape != guess.shape:
        raise ShapeError("prediction", truth.shape, guess.shape)
    sums = ErrorSums(truth.shape[1])
    sums.add(truth, guess)
    return sums.nmse


def persistence(measurement: ArrayLike, used: ArrayLike, before: ArrayLike | None = None) -> Array:
    """Persistence, the rival without a model: the last used sample, held.

    yhat_k = y_u, u the largest used index below k at which the output was measured.

    Args:
        measurement: y, (N, n_y) [unit of y]; NaN where it was not measured.
        used: Indices of the samples that were used, increasing.
        before: What is held until then, (n_y,) [unit of y]; None for zero.

    Returns:
        yhat, (N, n_y).

    Raises:
        ShapeError: If the measurement is not (N, n_y).
    """
    truth = _table("measurement", measurement)
    indices = np.asarray(used, int)
    held = np.zeros_like(truth) if before is None else np.tile(before, (len(truth), 1))
    for k in range(truth.shape[1]):
        measured = indices[np.isfinite(truth[indices, k])]
        last = np.searchsorted(measured, np.arange(len(truth)), side="left") - 1
        held[last >= 0, k] = truth[measured[last[last >= 0]], k]
    return held


def span_scores(values: ArrayLike, names: Sequence[str], prefix: str) -> dict[str, Any]:
    """Score by output name, with its mean and worst over the outputs that are not silent.

    Args:
        values: Score of each output, (n_y,) [unit of y]; nan where silent.
        names: Names of the outputs, n_y.
        prefix: First word of the keys.
    """
    each = np.asarray(values, float)
    heard = each[~np.isnan(each)]
    return {
        prefix: {name: float(value) for name, value in zip(names, each, strict=True)},
        f"{prefix}_mean": mean_heard(each),
        f"{prefix}_worst": float(heard.max()) if heard.size else math.nan,
    }


def mean_heard(values: Array) -> float:
    """Mean score of the outputs that are not silent; NaN without one.

    Args:
        values: Score of each output, (n_y,) [-].
    """
    heard = values[~np.isnan(values)]
    return float(heard.mean()) if heard.size else math.nan


def _per(values: Array, counts: Array) -> Array:
    """Values over counts, NaN where nothing was counted."""
    return np.where(counts > 0, values / np.where(counts > 0, counts, 1.0), np.nan)


def _table(name: str, values: ArrayLike) -> Array:
    array = np.asarray(values, float)
    if array.ndim != 2:
        raise ShapeError(name, "(N, n_y)", array.shape)
    return array
