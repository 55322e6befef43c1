"""Does a learner know how wrong it is? Intervals, normalized innovations, and their color.

A filter that is right has innovations that are white, with e' P_yy^-1 e chi-square distributed.
Neglected: correlation between outputs, beyond lag one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincinv, ndtri

Array = NDArray[np.float64]

NOMINAL = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Probabilities of the predicted intervals that are held against what happened."""


def reliability(error: ArrayLike, std: ArrayLike) -> Array:
    """Share of errors inside the predicted central interval of each nominal probability.

    |y - yhat| <= sigma Phi^-1((1 + p) / 2) for p in `NOMINAL`; a calibrated Gaussian gives p.

    Args:
        error: y - yhat, (M, n_y); NaN where y was not measured.
        std: Predicted standard deviation sigma, (M, n_y).

    Returns:
        Share over all samples and outputs, (len(NOMINAL),); NaN where there is no error.
    """
    reach = np.abs(np.asarray(error, float)) / np.asarray(std, float)
    known = reach[np.isfinite(reach)]
    if not known.size:
        return np.full(len(NOMINAL), np.nan)
    return np.array([np.mean(known <= ndtri((1 + p) / 2)) for p in NOMINAL])


def calibration_scores(
    innovation: Array, std: Array, nis: Array, names: Sequence[str]
) -> dict[str, Any]:
    """What the innovations say of the filter that predicted them.

    Args:
        innovation: e, (U, n_y); NaN where a channel was left out.
        std: Predicted standard deviation of it, (U, n_y).
        nis: e' P_yy^-1 e, (U,).
        names: Names of the outputs.

    Returns:
        nis_per_channel: mean of the normalized innovation squared, over the number of channels;
        1 if right, larger if too sure. nis_inside: share of updates in its central 95 %
        interval. innovation_correlation: of normalized innovations one update apart, by output;
        0 if white, NaN for outputs that never err.
    """
    channels = np.isfinite(innovation).sum(axis=1)
    heard = np.isfinite(nis) & (channels > 0)
    counts, values = channels[heard], nis[heard]
    scaled = innovation / np.where(std > 0, std, np.nan)
    color = [_lag_one(column) for column in scaled.T]
    scores: dict[str, Any] = {"innovation_correlation": dict(zip(names, color, strict=True))}
    if not len(values):
        return {"nis_per_channel": np.nan, "nis_inside": np.nan, **scores}
    low, high = (2 * gammaincinv(counts / 2, p) for p in (0.025, 0.975))  # of chi-square
    return {
        "nis_per_channel": float(np.mean(values / counts)),
        "nis_inside": float(np.mean((values >= low) & (values <= high))),
        **scores,
    }


def _lag_one(values: Array) -> float:
    pairs = np.isfinite(values[1:]) & np.isfinite(values[:-1])
    before, after = values[:-1][pairs], values[1:][pairs]
    power = float(np.sqrt(np.sum(before**2) * np.sum(after**2)))
    return float(before @ after) / power if power > 0 else float("nan")
