"""The arrays an identification keeps, named and united, and checks of predicted intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.learning.calibration import NOMINAL, reliability
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.schedule import Indices
from patagium.learning.scores import coverage

Array = NDArray[np.float64]


class Check(NamedTuple):
    """A prediction with its deviation, held against the sample.

    Attributes:
        sample: Which one.
        error: y - yhat, (n_y,).
        std: Predicted standard deviation of it, (n_y,).
    """

    sample: int
    error: Array
    std: Array


class Updates(NamedTuple):
    """What the learner said of itself after each update.

    Attributes:
        samples: Used for an update, (U,).
        innovation: (U, n_y).
        std: Predicted standard deviation of it, (U, n_y); nan of learners without.
        nis: Normalized innovation squared, (U,); nan of learners without.
        weights_norm: Euclidean norm of the weights, (U,).
        largest_variance: Largest diagonal entry of their covariance, (U,); nan where not seen.
    """

    samples: Indices
    innovation: Array
    std: Array
    nis: Array
    weights_norm: Array
    largest_variance: Array


def no_updates(outputs: int) -> Updates:
    """Of a learner that was not taught.

    Args:
        outputs: Number of outputs n_y.
    """
    nothing = np.empty(0)
    none = np.empty((0, outputs))
    return Updates(np.empty(0, np.int64), none, none, nothing, nothing, nothing)


def check(learner: Learner, sample: int, x: Array, y: Array, std: Array | None = None) -> Check:
    """The predicted mean and deviation at one sample, against it.

    Args:
        learner: What predicts.
        sample: Which one.
        x: Its input, (n_x,).
        y: What was measured, (n_y,).
        std: Of its noise on top of the learner's, (n_y,); None for none.
    """
    if std is not None and isinstance(learner, FilterLearner):
        mean, covariance = learner.predict(x, std)
    else:
        mean, covariance = learner.predict(x)
    return Check(sample, y - mean, np.sqrt(np.diagonal(np.atleast_2d(covariance))))


def interval_scores(
    checks: Sequence[Check], names: Sequence[str], heard: NDArray[np.bool_], reached: int
) -> dict[str, Any]:
    """How often the predicted 95 % interval held what was measured.

    Args:
        checks: Predictions with their deviations.
        names: Names of the outputs.
        heard: Outputs that are not silent, (n_y,).
        reached: Number of samples predicted; the second half begins at half of it.
    """
    error = np.array([c.error for c in checks]).reshape(-1, len(names))
    std = np.array([c.std for c in checks]).reshape(-1, len(names))
    late = np.array([c.sample for c in checks], int) >= reached // 2
    each = coverage(error, std, heard)
    return {
        "coverage": _mean(each),
        "coverage_second_half": _mean(coverage(error[late], std[late], heard)),
        "coverage_by_output": dict(zip(names, each.tolist(), strict=True)),
        "coverage_checks": len(checks),
        "reliability": dict(
            zip(map(str, NOMINAL), reliability(error[:, heard], std[:, heard]), strict=True)
        ),
    }


def record_of(
    time: Array,
    measurement: Array,
    prediction: Array,
    held: Array,
    names: Sequence[str],
    checks: Sequence[Check],
    updates: Updates,
) -> xr.Dataset:
    """Measured, predicted and held samples, updates and checks as one Dataset.

    Args:
        time: (N,) [s].
        measurement: (N, n_y).
        prediction: (N, n_y); nan where there is none.
        held: Persistence, (N, n_y).
        names: Names of the outputs.
        checks: Predictions with their deviations.
        updates: What the learner said of itself.
    """
    checked = [c.sample for c in checks]
    std = np.array([c.std for c in checks]).reshape(-1, len(names))
    seconds = {"units": "s"}
    return xr.Dataset(
        {
            "measurement": (("time", "output"), measurement),
            "prediction": (("time", "output"), prediction),
            "persistence": (("time", "output"), held),
            "innovation": (("update_time", "output"), updates.innovation),
            "innovation_std": (("update_time", "output"), updates.std),
            "nis": (("update_time",), updates.nis),
            "weights_norm": (("update_time",), updates.weights_norm),
            "largest_variance": (("update_time",), updates.largest_variance),
            "predicted_std": (("check_time", "output"), std),
        },
        coords={
            "time": ("time", time, seconds),
            "output": list(names),
            "update_time": ("update_time", time[updates.samples], seconds),
            "check_time": ("check_time", time[checked], seconds),
        },
    )


def _mean(values: Array) -> float:
    heard = values[~np.isnan(values)]
    return float(heard.mean()) if heard.size else float("nan")
