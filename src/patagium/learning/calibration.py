"""Calibration of a learner: intervals, normalized innovations, and their correlation in time.

A filter that is right has innovations that are white, with e' P_yy^-1 e chi-square distributed.
All scores follow from sums that can go on. Neglected: correlation between outputs, beyond lag
one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincinv, ndtri

from patagium.errors import ShapeError
from patagium.learning.scores import INTERVAL

Array = NDArray[np.float64]
Chosen = NDArray[np.bool_]

NOMINAL = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Probabilities of the predicted intervals that are held against what happened."""
_REACH = np.append(ndtri((1 + np.array(NOMINAL)) / 2), np.inf)


class IntervalSums:
    """Counts of errors inside predicted intervals.

    Args:
        outputs: Number of outputs n_y.

    Attributes:
        counts: Errors, those in the 95 % interval, then those in the interval of each of
            `NOMINAL` and in any, (3 + len(NOMINAL), n_y).
        unknown: Number of standard deviations that are not finite.
    """

    def __init__(self, outputs: int) -> None:
        self.counts = np.zeros((2 + len(_REACH), outputs))
        self.unknown = 0

    def add(self, error: Array, std: Array, keep: float = 1.0) -> None:
        """Count errors.

        Args:
            error: y - yhat, (M, n_y) [unit of y]; NaN where it does not count.
            std: Predicted standard deviation, (M, n_y) [unit of y].
            keep: Factor on all that was counted from each error to the next: 1 to forget
                nothing.
        """
        size, weight = np.abs(error), keep ** np.arange(len(error) - 1, -1, -1.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = size / std
        reach = np.where(np.isfinite(reach), reach, np.nan)
        inside = [np.isfinite(error), size <= INTERVAL * std, *(reach <= z for z in _REACH)]
        self.counts *= keep ** len(error)
        self.counts += [weight @ part for part in inside]
        self.unknown += int((~np.isfinite(std)).sum())

    def coverage(self, heard: ArrayLike | None = None) -> Array:
        """Share of errors in the 95 % interval, (n_y,); NaN where there is none.

        Args:
            heard: Outputs to score, (n_y,) of bool; the others are NaN. None: all.
        """
        count, inside = self.counts[:2]
        chosen = (count > 0) & (True if heard is None else np.asarray(heard, bool))
        if self.unknown:
            chosen[:] = False
        return np.where(chosen, inside / np.where(count > 0, count, 1.0), np.nan)

    @property
    def coverage_in_all(self) -> float:
        """Share of errors of all outputs in their 95 % interval; NaN before any."""
        count, inside = self.counts[:2].sum(axis=1)
        return float(inside / count) if count else float("nan")

    def reliability(self, heard: ArrayLike | None = None) -> Array:
        """Share of errors in the interval of each of `NOMINAL`, (len(NOMINAL),); NaN before any.

        Args:
            heard: Outputs that count, (n_y,) of bool; None: all.
        """
        chosen = slice(None) if heard is None else np.asarray(heard, bool)
        *inside, count = self.counts[2:, chosen].sum(axis=1)
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

    def add(self, innovation: Array, std: Array, nis: Array, heard: Chosen) -> None:
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
        before, after = np.where(pairs, scaled[:-1], 0.0), np.where(pairs, scaled[1:], 0.0)
        self.products += [(before * after).sum(0), (before**2).sum(0), (after**2).sum(0)]
        self.last = scaled[-1]

    def scores(self, names: Sequence[str], heard: Chosen) -> dict[str, Any]:
        """Calibration in numbers; see `calibration_scores`.

        Args:
            names: Names of the outputs, n_y.
            heard: Outputs that are not silent, (n_y,) of bool.
        """
        count, ratio, inside = self.totals.tolist()
        product, power = self.products[0], np.sqrt(self.products[1] * self.products[2])
        color = np.where(power > 0, product / np.where(power > 0, power, 1.0), np.nan)
        chosen = np.flatnonzero(heard).tolist()
        return {
            "nis_per_channel": ratio / count if count else np.nan,
            "nis_inside": inside / count if count else np.nan,
            "innovation_correlation": {names[k]: float(color[k]) for k in chosen},
        }


def coverage(error: ArrayLike, std: ArrayLike, heard: ArrayLike | None = None) -> Array:
    """Share of errors inside the predicted 95 % interval, for each output.

    |y - yhat| <= 1.96 sigma; a calibrated Gaussian prediction gives 0.95.

    Args:
        error: y - yhat, (M, n_y) [unit of y]; NaN where y was not measured.
        std: Predicted standard deviation, (M, n_y) [unit of y], same unit.
        heard: Outputs to score, (n_y,) of bool; the others are nan. None: all.

    Returns:
        Share, (n_y,) [-].

    Raises:
        ShapeError: If the arrays are not (M, n_y).
    """
    return _intervals(error, std).coverage(heard)


def reliability(error: ArrayLike, std: ArrayLike) -> Array:
    """Share of errors inside the predicted central interval of each nominal probability.

    |y - yhat| <= sigma Phi^-1((1 + p) / 2) for p in `NOMINAL`; a calibrated Gaussian gives p.

    Args:
        error: y - yhat, (M, n_y) [unit of y]; NaN where y was not measured.
        std: Predicted standard deviation sigma, (M, n_y) [unit of y].

    Returns:
        Share over all samples and outputs, (len(NOMINAL),); NaN where there is no error.

    Raises:
        ShapeError: If the arrays are not (M, n_y).
    """
    return _intervals(error, std).reliability()


def calibration_scores(
    innovation: Array, std: Array, nis: Array, names: Sequence[str]
) -> dict[str, Any]:
    """Calibration of a filter by its innovations.

    Args:
        innovation: e, (U, n_y) [unit of y]; NaN where a channel was left out.
        std: Predicted standard deviation of it, (U, n_y) [unit of y].
        nis: e' P_yy^-1 e, (U,).
        names: Names of the outputs.

    Returns:
        nis_per_channel: mean of the normalized innovation squared, over the number of channels;
        1 if right, larger if too sure. nis_inside: share of updates in its central 95 %
        interval. innovation_correlation: of normalized innovations one update apart, by output;
        0 if white, NaN for outputs that never err.
    """
    sums, heard = InnovationSums(len(names)), np.ones(len(names), bool)
    sums.add(innovation, std, nis, heard)
    return sums.scores(names, heard)


def interval_scores(
    whole: IntervalSums, late: IntervalSums, names: Sequence[str], heard: Chosen
) -> Mapping[str, Any]:
    """Coverage and reliability of predicted intervals by name.

    Args:
        whole: Counts over all samples.
        late: Counts over the second half.
        names: Names of the outputs, n_y.
        heard: Outputs that are not silent, (n_y,) of bool.
    """
    each = whole.coverage(heard)
    return {
        "coverage": _mean(each),
        "coverage_second_half": _mean(late.coverage(heard)),
        "coverage_by_output": dict(zip(names, each.tolist(), strict=True)),
        "reliability": dict(zip(map(str, NOMINAL), whole.reliability(heard), strict=True)),
    }


def _intervals(error: ArrayLike, std: ArrayLike) -> IntervalSums:
    miss, sigma = np.asarray(error, float), np.asarray(std, float)
    for name, array in (("error", miss), ("std", sigma)):
        if array.ndim != 2:
            raise ShapeError(name, "(N, n_y)", array.shape)
    sums = IntervalSums(miss.shape[1])
    sums.add(miss, sigma)
    return sums


def _mean(values: Array) -> float:
    heard = values[~np.isnan(values)]
    return float(heard.mean()) if heard.size else float("nan")
