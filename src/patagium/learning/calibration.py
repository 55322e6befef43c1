"""Calibration of a filter: normalized innovations and their correlation in time.

A filter that is right has innovations that are white, with e' P_yy^-1 e chi-square distributed.
All scores follow from sums that can go on. Neglected: correlation between outputs, beyond lag
one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from patagium.learning.scores import NOMINAL, IntervalSums

Array = NDArray[np.float64]
Chosen = NDArray[np.bool_]


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


def _mean(values: Array) -> float:
    heard = values[~np.isnan(values)]
    return float(heard.mean()) if heard.size else float("nan")
