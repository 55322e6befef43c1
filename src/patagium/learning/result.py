"""Result of an identification: scores, predictions and the learner.

An `Identification` saves itself as one netCDF file and draws itself as one page; `record_of`
puts its arrays into one Dataset.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from patagium.arguments import checked, of_kind
from patagium.arrays import Array
from patagium.errors import LogError, Outcome
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.model_file import Model, model_of
from patagium.netcdf_file import kind_of, loaded_dataset, write_netcdf
from patagium.reading import json_object, json_ready, made_again

if TYPE_CHECKING:
    from patagium.report import Picture

UPDATED = {"innovation": 2, "innovation_std": 2, "nis": 1, "weights_norm": 1, "largest_variance": 1}
"""Arrays that a record keeps over the updates, with their number of dimensions."""


@dataclass(frozen=True, eq=False)
class Identification:
    """Model of the air as learned from a flight or a log, with its scores.

    Attributes:
        scores: NMSE and the rest by name; see `stream`. Nested once: score by output name.
        prediction: Dataset over time, output, update_time and check_time: measurement,
            prediction, persistence, innovation, weights_norm, largest_variance, predicted_std.
        learner: What learned, with its last weights: `learner.predict(x)` predicts; None when
            loaded from a file.
        outcome: COMPLETED, or why the learner stopped.
        message: When and why it stopped; empty if it did not.
        inputs: Names of what the network saw; None: q, then v.
    """

    scores: dict[str, Any]
    prediction: xr.Dataset
    learner: Any = field(default=None, repr=False)
    outcome: Outcome = Outcome.COMPLETED
    message: str = ""
    inputs: tuple[str, ...] | None = None

    @property
    def model(self) -> Model:
        """Model with the last weights, as `save_model` writes it.

        Raises:
            ParameterError: If there is no learner, as after loading from a file.
        """
        known = isinstance(self.learner, Model)
        return self.learner if known else model_of(self.learner, inputs=self.inputs)

    def __repr__(self) -> str:
        return "\n".join([f"<Identification {self.outcome.name}>", *map(": ".join, self._facts())])

    def _repr_html_(self) -> str:
        from patagium.learning.page import result_snippet

        return result_snippet(self.prediction, dict(self._facts()))

    def _facts(self) -> list[tuple[str, str]]:
        """Main scores in words."""
        named = {
            "samples": "samples",
            "nmse_mean": "NMSE, mean of the outputs",
            "nmse_second_half_worst": "NMSE of the second half, worst output",
            "coverage": "share of errors in the 95 % interval",
            "nis_per_channel": "normalized innovation squared, per output",
        }
        found = []
        for name, text in named.items():
            one = self.scores.get(name)
            if isinstance(one, int | float):
                found.append((text, f"{one:.4g}" if isinstance(one, float) else str(one)))
        return found + [("learner", repr(self.learner))] * (self.learner is not None)

    @checked
    def save(self, path: str | Path) -> None:
        """Write scores and predictions as one netCDF file, whole or not at all.

        Args:
            path: The file.

        Raises:
            OutputError: If it cannot be written.
        """
        record = self.prediction.copy()
        words = {"scores": self.scores, "inputs": self.inputs}
        record.attrs |= {name: json.dumps(json_ready(one)) for name, one in words.items()}
        record.attrs["format"] = "patagium identification 1"
        write_netcdf(path, record)

    def report(
        self, path: str | Path, title: str = "Identification", replay: str | Picture | None = None
    ) -> None:
        """Write a self-contained HTML page: the scores, and predictions against measurements.

        Args:
            path: The file.
            title: Its heading.
            replay: Address of the flight's replay, relative to the page, to be linked, or a
                picture that leads there.
        """
        from patagium.learning.page import write_identification

        of_kind("path", path, str | Path)
        write_identification(self.scores, self.prediction, path, title, replay)


@checked
def load_identification(path: str | Path) -> Identification:
    """Scores and predictions from a file that `Identification.save` wrote.

    Raises:
        LogError: If the file is not one.
    """
    file = Path(path)
    record = loaded_dataset(file, LogError, "an identification")
    if "scores" not in record.attrs:
        raise LogError(file, "an identification", kind_of(file) or "a file without scores")
    with made_again(f"{file}: the identification"):
        scores = json_object(record.attrs.pop("scores"), "scores")
        for by_output in (one for one in scores.values() if isinstance(one, dict)):
            if all(isinstance(x, float | int | None) for x in by_output.values()):
                by_output |= {name: np.nan for name, x in by_output.items() if x is None}
        inputs = json.loads(record.attrs.pop("inputs", "null"))  # older files have none
        seen = None if inputs is None else tuple(map(str, inputs))
        outcome = Outcome[scores.get("outcome", "COMPLETED")]
        return Identification(scores, record, None, outcome, scores.get("message", ""), seen)


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


def check(
    learner: Learner,
    number: int,
    sample: tuple[Array, Array],
    std: Array | None = None,
    time: float | None = None,
) -> Check:
    """Check of the predicted mean and standard deviation at one sample.

    Args:
        learner: What predicts.
        number: Number of the sample.
        sample: Its input, (n_x,) [units of x], and what was measured, (n_y,) [unit of y].
        std: Of its noise on top of the learner's, (n_y,) [unit of y]; None for none.
        time: Of a sample of the flow that is being learned [s]; None: of any flow.
    """
    x, y = sample
    if isinstance(learner, FilterLearner):
        mean, covariance = learner.predict(x, std, time)
    else:
        mean, covariance = learner.predict(x)
        if std is not None:
            covariance = np.atleast_2d(covariance) + np.diag(std**2)
    return Check(number, y - mean, np.sqrt(np.diagonal(np.atleast_2d(covariance))))


def record_of(
    names: Sequence[str],
    units: Sequence[str],
    samples: Mapping[str, Array],
    checks: Sequence[Check],
    used: ArrayLike = (),
    updates: Mapping[str, Array] | None = None,
) -> xr.Dataset:
    """Measured, predicted and held samples, updates and checks as one Dataset.

    Args:
        names: Names of the outputs, n_y.
        units: Units of the outputs, n_y.
        samples: `time`, (N,) [s], and `measurement`, `prediction` and `persistence`, (N, n_y)
            [unit of y]; NaN where there is none.
        checks: Predictions with their standard deviations.
        used: Samples used for an update, (U,).
        updates: Names of `UPDATED`: arrays over the updates, (U, n_y) or (U,); None for a
            learner that was not taught.
    """
    none = 0, len(names)
    over = {name: ("update_time", "output")[:n] for name, n in UPDATED.items()}
    given = updates or {name: np.empty(none[:n]) for name, n in UPDATED.items()}
    time, seconds = samples["time"], {"units": "s"}
    std = np.array([one.std for one in checks]).reshape(-1, len(names))
    sampled = ("measurement", "prediction", "persistence")
    return xr.Dataset(
        {
            **{name: (("time", "output"), samples[name]) for name in sampled},
            **{name: (dims, given[name]) for name, dims in over.items()},
            "predicted_std": (("check_time", "output"), std),
        },
        coords={
            "time": ("time", time, seconds),
            "output": list(names),
            "unit": ("output", list(units)),
            "update_time": ("update_time", time[np.asarray(used, int)], seconds),
            "check_time": ("check_time", time[[one.sample for one in checks]], seconds),
        },
    )
