"""How good a prediction is, with the scale it is measured on always the same.

Normalized mean square error (NMSE) = mean square error / variance of the output
over the same span, for each output; a share of components inside a predicted
interval. Neglected: correlation of errors in time, weights on outputs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ShapeError

Array = NDArray[np.float64]

SILENT_RATIO = 1e-9
"""An output is silent when its deviation is below this share of the largest rms of all outputs."""

INTERVAL = 1.959963985
"""Half width of the 95 % interval of a normal distribution, in deviations."""


def silent_outputs(measurement: ArrayLike) -> NDArray[np.bool_]:
    """Outputs that never move: their variance is zero up to rounding.

    std_i <= 1e-9 max_j rms_j. Dividing by such a variance would score rounding errors.

    Args:
        measurement: What was measured, (N, n_y); NaN where it was not.

    Returns:
        True for each silent output, (n_y,).
    """
    truth = np.ma.masked_invalid(_table("measurement", measurement))
    scale = np.sqrt((truth**2).mean(axis=0).filled(0.0)).max(initial=0.0)
    return np.asarray(truth.std(axis=0).filled(0.0) <= SILENT_RATIO * scale)


def normalized_error(measurement: ArrayLike, prediction: ArrayLike) -> Array:
    """Mean square error of each output over its variance.

    NMSE_i = mean_k (y_ki - yhat_ki)^2 / var_k y_ki over the samples that were measured;
    predicting the mean scores 1.

    Args:
        measurement: y, (N, n_y); NaN where it was not measured.
        prediction: yhat, (N, n_y).

    Returns:
        NMSE, (n_y,); nan for silent outputs.

    Raises:
        ShapeError: If the two differ in shape.
    """
    truth, guess = _table("measurement", measurement), _table("prediction", prediction)
    if truth.shape != guess.shape:
        raise ShapeError("prediction", truth.shape, guess.shape)
    score = np.full(truth.shape[1], np.nan)
    for k in np.flatnonzero(~silent_outputs(truth)):
        measured = np.isfinite(truth[:, k])
        error = np.mean((truth[measured, k] - guess[measured, k]) ** 2)
        score[k] = error / truth[measured, k].var()
    return score


def persistence(measurement: ArrayLike, used: ArrayLike) -> Array:
    """The rival that needs no model: the last used sample, held.

    yhat_k = y_u, u the largest used index below k at which the output was measured; before
    any sample was used, zero.

    Args:
        measurement: y, (N, n_y); NaN where it was not measured.
        used: Indices of the samples that were used, increasing.

    Returns:
        yhat, (N, n_y).
    """
    truth = _table("measurement", measurement)
    indices = np.asarray(used, int)
    held = np.zeros_like(truth)
    for k in range(truth.shape[1]):
        measured = indices[np.isfinite(truth[indices, k])]
        last = np.searchsorted(measured, np.arange(len(truth)), side="left") - 1
        held[last >= 0, k] = truth[measured[last[last >= 0]], k]
    return held


def coverage(error: ArrayLike, std: ArrayLike, heard: ArrayLike | None = None) -> Array:
    """Share of errors inside the predicted 95 % interval, for each output.

    |y - yhat| <= 1.96 sigma; a calibrated Gaussian prediction gives 0.95.

    Args:
        error: y - yhat, (M, n_y); NaN where y was not measured.
        std: Predicted standard deviation, (M, n_y), same unit.
        heard: Outputs to score, (n_y,) of bool; the others are nan. None: all.

    Returns:
        Share, (n_y,) [-].
    """
    miss, sigma = _table("error", error), _table("std", std)
    share = np.full(miss.shape[1], np.nan)
    chosen = np.ones(miss.shape[1], bool) if heard is None else np.asarray(heard, bool)
    if len(miss) and np.isfinite(sigma).all():
        inside = np.ma.masked_where(np.isnan(miss), np.abs(miss) <= INTERVAL * sigma)
        share[chosen] = inside.mean(axis=0).filled(np.nan)[chosen]
    return share


def error_scores(
    measurement: ArrayLike, prediction: ArrayLike, names: Sequence[str], prefix: str = "nmse"
) -> dict[str, Any]:
    """NMSE by output, mean and worst, over the whole span and over its second half.

    Args:
        measurement: y, (N, n_y).
        prediction: yhat, (N, n_y).
        names: Names of the outputs, n_y.
        prefix: First word of the keys.

    Returns:
        `<prefix>` and `<prefix>_second_half` by output name, each with `_mean` and `_worst`;
        mean and worst leave silent outputs out, and are nan if all are silent.
    """
    truth, guess = _table("measurement", measurement), _table("prediction", prediction)
    half = len(truth) // 2
    return {
        **span_scores(normalized_error(truth, guess), names, prefix),
        **span_scores(normalized_error(truth[half:], guess[half:]), names, f"{prefix}_second_half"),
    }


def span_scores(values: ArrayLike, names: Sequence[str], prefix: str) -> dict[str, Any]:
    """One score by output name, with its mean and worst over the outputs that are heard.

    Args:
        values: Score of each output, (n_y,); nan where silent.
        names: Names of the outputs, n_y.
        prefix: First word of the keys.
    """
    each = np.asarray(values, float)
    heard = each[~np.isnan(each)]
    return {
        prefix: {name: float(value) for name, value in zip(names, each, strict=True)},
        f"{prefix}_mean": float(heard.mean()) if heard.size else math.nan,
        f"{prefix}_worst": float(heard.max()) if heard.size else math.nan,
    }


def json_ready(value: Any) -> Any:
    """The same scores for a JSON file, which knows no nan: those become null."""
    if isinstance(value, Mapping):
        return {str(key): json_ready(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [json_ready(item) for item in value]
    if isinstance(value, (np.bool_, bool)):
        return bool(value)
    if isinstance(value, np.integer):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value


def _table(name: str, values: ArrayLike) -> Array:
    array = np.asarray(values, float)
    if array.ndim != 2:
        raise ShapeError(name, "(N, n_y)", array.shape)
    return array
