"""Record of an identification: its arrays as one Dataset, and checks of predicted intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.schedule import Indices

Array = NDArray[np.float64]


class Check(NamedTuple):
    """Error of a prediction at one sample, and its predicted standard deviation.

    Attributes:
        sample: Number of the sample.
        error: y - yhat, (n_y,) [unit of y].
        std: Predicted standard deviation of it, (n_y,) [unit of y].
    """

    sample: int
    error: Array
    std: Array


class Updates(NamedTuple):
    """Updates of a learner: innovations, weights and their variances.

    Attributes:
        samples: Used for an update, (U,).
        innovation: (U, n_y) [unit of y].
        std: Predicted standard deviation of it, (U, n_y) [unit of y]; nan of learners without.
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
    """Updates of a learner that was not taught: none.

    Args:
        outputs: Number of outputs n_y.
    """
    nothing = np.empty(0)
    none = np.empty((0, outputs))
    return Updates(np.empty(0, np.int64), none, none, nothing, nothing, nothing)


def check(learner: Learner, sample: int, x: Array, y: Array, std: Array | None = None) -> Check:
    """Check of the predicted mean and standard deviation at one sample.

    Args:
        learner: What predicts.
        sample: Its number.
        x: Its input, (n_x,) [units of x].
        y: What was measured, (n_y,) [unit of y].
        std: Of its noise on top of the learner's, (n_y,) [unit of y]; None for none.
    """
    if std is not None and isinstance(learner, FilterLearner):
        mean, covariance = learner.predict(x, std)
    else:
        mean, covariance = learner.predict(x)
    return Check(sample, y - mean, np.sqrt(np.diagonal(np.atleast_2d(covariance))))


class Arrays(NamedTuple):
    """Arrays that an identification keeps.

    Attributes:
        time: (N,) [s].
        measurement: (N, n_y) [unit of y].
        prediction: (N, n_y) [unit of y]; NaN where there is none.
        held: Persistence, (N, n_y) [unit of y].
        checks: Predictions with their standard deviations.
        updates: Updates of the learner.
    """

    time: Array
    measurement: Array
    prediction: Array
    held: Array
    checks: Sequence[Check]
    updates: Updates


def record_of(arrays: Arrays, names: Sequence[str], units: Sequence[str]) -> xr.Dataset:
    """Measured, predicted and held samples, updates and checks as one Dataset.

    Args:
        arrays: What it holds.
        names: Names of the outputs, n_y.
        units: Units of the outputs, n_y.
    """
    time, updates = arrays.time, arrays.updates
    checked = [one.sample for one in arrays.checks]
    std = np.array([one.std for one in arrays.checks]).reshape(-1, len(names))
    samples, learned, seconds = ("time", "output"), ("update_time", "output"), {"units": "s"}
    return xr.Dataset(
        {
            "measurement": (samples, arrays.measurement),
            "prediction": (samples, arrays.prediction),
            "persistence": (samples, arrays.held),
            "innovation": (learned, updates.innovation),
            "innovation_std": (learned, updates.std),
            "nis": (learned[:1], updates.nis),
            "weights_norm": (learned[:1], updates.weights_norm),
            "largest_variance": (learned[:1], updates.largest_variance),
            "predicted_std": (("check_time", "output"), std),
        },
        coords={
            "time": ("time", time, seconds),
            "output": list(names),
            "unit": ("output", list(units)),
            "update_time": ("update_time", time[updates.samples], seconds),
            "check_time": ("check_time", time[checked], seconds),
        },
    )
