"""Trials of learners in air without memory: one learner, network and rate of samples each.

A trial streams a flight (each sample is predicted before it may be learned), then freezes the
weights and predicts gaits that were not learned. Trials are independent of each other and run in
worker processes of one thread. Neglected: chance, except for the starts of the strip networks.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import xarray as xr

from patagium.arrays import Array
from patagium.learning.identify import compare
from patagium.learning.model_file import Model
from patagium.learning.result import Identification
from patagium.learning.stream import stream
from patagium.sensing.force.air_force import training_data
from patagium_lab.frozen_spans import FrozenSpans
from patagium_lab.reproduction import flights
from patagium_lab.reproduction.cases import (
    AS_RUN,
    FLIGHT_CASES,
    DenseSettings,
    inputs_of,
    make_learner,
)
from patagium_lab.reproduction.samples import Samples, Series, load_samples, write_samples

THINNED = 10
"""One sample in this many is kept of a gait that is not learned."""
WINDOWS = 40
"""Points of a learning curve."""


@dataclass(frozen=True)
class Trial:
    """One run of one learner.

    Attributes:
        flight: Key of the flight.
        network: Key of the network; empty for least squares.
        learner: Key of the learner.
        every: One sample in this many is learned.
        seed: Seed of the first weights.
        settings: Settings of a dense network.
        kind: Table of the trial: "table", "start" (one of several starts) or "limit".
        label: Name of the trial in the table of limits; empty elsewhere.
        keep: Whether the predictions are kept for the figures.
    """

    flight: str
    network: str
    learner: str
    every: int
    seed: int = 0
    settings: DenseSettings = AS_RUN
    kind: str = "table"
    label: str = ""
    keep: bool = False

    @property
    def run(self) -> Trial:
        """The trial without its label and table: equal for trials that compute the same."""
        return replace(self, kind="table", label="", keep=False)

    @property
    def is_start(self) -> bool:
        """Whether it is one of several starts of a strip network."""
        strip = self.network.startswith("strip") and self.learner == "cubature"
        return strip and self.every > 1

    @property
    def cost(self) -> float:
        """Expected duration, for order and progress [s]."""
        dense = {"cubature": 7e-4, "extended": 4e-3, "gradient": 1.2e-4, "replay": 2e-3}
        strip = {"cubature": 8e-5, "extended": 2.5e-4, "gradient": 1.2e-4, "replay": 1.6e-3}
        each = (strip if self.network.startswith("strip") else dense).get(self.learner, 8e-5)
        each *= 0.35 if self.network == "dense_velocity" else 1.0
        return 0.3 + 20_000 / self.every * (each + 5e-5)

    def key(self) -> dict[str, Any]:
        """Flight, network, learner, rate, seed and label, as JSON-able values."""
        return {
            name: value
            for name, value in asdict(self).items()
            if name not in ("settings", "kind", "keep")
        }


@dataclass(frozen=True)
class TrialResult:
    """Result of a trial.

    Attributes:
        trial: The trial.
        scores: Scores of the trial, JSON-able.
        record: Predictions, where they were kept.
        model: Learned model, where predictions were kept.
    """

    trial: Trial
    scores: dict[str, Any]
    record: xr.Dataset | None
    model: Model | None = None


def fly_known(
    key: str, duration: float, unseen_duration: float, folder: Path
) -> tuple[xr.Dataset, dict[str, xr.Dataset]]:
    """A flight through air without memory, and flights of gaits that are not learned.

    Args:
        key: "published" or "corrected".
        duration: Duration of the flight that is learned [s].
        unseen_duration: Duration of each other flight [s].
        folder: Folder for the samples.
    """
    flight, unseen = flights.FLIGHTS[key](duration, unseen_duration)
    others: dict[str, Series] = {}
    for name, other in unseen.items():
        time, x, y = training_data(other)
        others[name] = (time[::THINNED], x[::THINNED], y[::THINNED])
    samples = Samples(training_data(flight), others, 1.0 / flights.beat_frequency(flight))
    write_samples(folder / f"{key}.npz", samples)
    return flight, unseen


def run_trial(trial: Trial, folder: Path) -> TrialResult:
    """One trial, in this process.

    Args:
        trial: What to run.
        folder: Folder of the samples that `fly_known` wrote.
    """
    started = process_time()
    case, samples = FLIGHT_CASES[trial.flight], load_samples(folder / f"{trial.flight}.npz")
    names, seen = inputs_of(case, "dense"), inputs_of(case, trial.network)
    columns = np.array([names.index(name) for name in seen])
    time, x, y = samples.learned
    interval = trial.every * float(np.median(np.diff(time)))
    learner = make_learner(case, trial.network, trial.learner, interval, trial.seed, trial.settings)
    prior = _largest_variance(learner)
    spans = FrozenSpans({"10ms": 0.01, "beat": samples.beat}, learner, time, y, trial.every)
    result = stream(learner, time, x[:, columns], y, every=trial.every, watches=[spans])
    found = result.scores | spans.scores()
    scores = {
        **trial.key(),
        "weights": learner.network.size,
        **{key: value for key, value in found.items() if key not in _LEFT_OUT},
        "prior_variance": prior,
        "microseconds_per_update": 1e6 * result.scores["time_per_update"],
        "curve": learning_curve(result, trial.every),
        "unseen": _unseen(learner, trial, samples, columns),
        "seconds": process_time() - started,
    }
    if not trial.keep:
        return TrialResult(trial, scores, None)
    learned = Model(learner.network, np.array(learner.weights, float), inputs=seen)
    return TrialResult(trial, scores, result.prediction, learned)


_LEFT_OUT = ("samples", "samples_predicted", "median_step", "gaps", "coverage_by_output")


def learning_curve(result: Identification, every: int) -> dict[str, Any]:
    """Error against samples used: NMSE within windows of time, mean over the outputs.

    Args:
        result: Result of `stream`.
        every: One sample in this many was used.
    """
    truth = result.prediction["measurement"].to_numpy()
    predicted = result.prediction["prediction"].to_numpy()
    variance = truth.var(axis=0)
    moving = variance > 1e-12 * variance.max()
    error = ((truth - predicted)[:, moving] ** 2 / variance[moving]).mean(axis=1)
    updates = -(-len(error) // every)
    used = np.unique(np.geomspace(1, updates, WINDOWS).astype(int))
    edges = np.minimum(used * every, len(error))
    spans = list(zip([0, *edges[:-1]], edges, strict=True))
    return {
        "samples_used": [int(count) for count in used],
        "nmse": [float(error[begin:end].mean()) for begin, end in spans],
    }


def unseen_scores(
    model: Any, unseen: dict[str, Series], every: int, *more: str
) -> dict[str, dict[str, Any]]:
    """Scores of frozen weights on flights that were not learned, by flight.

    Args:
        model: Learner or model.
        unseen: Series of each flight.
        every: One sample in this many would be used by a held sample.
        more: Further scores that are wanted.
    """
    rows = {}
    for name, series in unseen.items():
        scores = compare(model, *series, every=every).scores
        rows[name] = {
            "mean": scores["nmse_mean"],
            "worst": scores["nmse_worst"],
            "persistence_worst": scores["persistence_worst"],
            **{key: scores[key] for key in more},
        }
    return rows


def _unseen(learner: Any, trial: Trial, samples: Samples, columns: Array) -> dict[str, Any]:
    """Scores of the frozen weights on each gait that was not learned."""
    if trial.kind == "limit" or not np.isfinite(learner.weights).all():
        return {}
    strip = trial.network.startswith("strip") and trial.learner in ("cubature", "extended")
    model = learner if strip else _Frozen(learner.network, learner.weights)
    seen = {name: (time, x[:, columns], y) for name, (time, x, y) in samples.unseen.items()}
    return unseen_scores(model, seen, 100 // THINNED, "coverage")


@dataclass(frozen=True)
class _Frozen:
    """A network and its weights, without a covariance."""

    network: Any
    weights: Array


def _largest_variance(learner: Any) -> float:
    covariance = learner.covariance
    return float("nan") if covariance is None else float(np.diagonal(covariance).max())
