"""The learner runs of the reproduction: one trial a learner, network and rate of samples.

A trial streams a flight (each sample predicted before it may be learned), then freezes the
weights and predicts gaits it never saw. Trials are independent and run in worker processes,
one thread each. Neglected: the luck of the draw, but for the strip network's several seeds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.learning.identify import compare
from patagium.learning.model_file import Model
from patagium.learning.result import Identification
from patagium.learning.stream import stream
from patagium.sensing.force.training_data import training_data
from patagium_lab.reproduction.subjects import (
    AS_RUN,
    SUBJECTS,
    Setting,
    inputs_of,
    make_learner,
)

Array = NDArray[np.float64]

THINNED = 10
"""Frozen models are scored on one sample in so many of a gait they never saw."""
WINDOWS = 40
"""Points of a learning curve."""


@dataclass(frozen=True)
class Trial:
    """One run of one learner.

    Attributes:
        flight: Key of the flight.
        network: Key of the network; empty for least squares.
        learner: Key of the learner.
        every: One sample in so many is used.
        seed: Of the weights to start from.
        setting: Of a dense network.
        kind: Table it stands in: "table", "start" (one of several starts) or "limit".
        label: What it is called in the table of what limits; empty elsewhere.
        keep: Whether predictions come back for the figures.
    """

    flight: str
    network: str
    learner: str
    every: int
    seed: int = 0
    setting: Setting = AS_RUN
    kind: str = "table"
    label: str = ""
    keep: bool = False

    @property
    def starts(self) -> bool:
        """Whether it is one of the starts of a strip network."""
        strip = self.network.startswith("strip") and self.learner == "cubature"
        return strip and self.every > 1

    @property
    def cost(self) -> float:
        """About how long it takes, for order and progress [s]."""
        dense = {"cubature": 7e-4, "extended": 4e-3, "gradient": 1.2e-4, "replay": 2e-3}
        strip = {"cubature": 8e-5, "extended": 2.5e-4, "gradient": 1.2e-4, "replay": 1.6e-3}
        each = (strip if self.network.startswith("strip") else dense).get(self.learner, 8e-5)
        each *= 0.35 if self.network == "dense_velocity" else 1.0
        return 0.3 + 20_000 / self.every * (each + 5e-5)


@dataclass(frozen=True)
class Run:
    """What a trial gave.

    Attributes:
        trial: The trial.
        scores: Its scores, JSON-able.
        record: Predictions, where they were kept.
        model: What was learned, where predictions were kept.
    """

    trial: Trial
    scores: dict[str, Any]
    record: xr.Dataset | None
    model: Model | None = None


def write_samples(
    folder: Path, name: str, flight: xr.Dataset, unseen: dict[str, xr.Dataset], beat: float
) -> Path:
    """States and forces of a flight and of gaits never learned, for the workers.

    Args:
        folder: Where to.
        name: Key of the flight.
        flight: The flight.
        unseen: Flights of gaits that are not learned.
        beat: One wingbeat [s].
    """
    time, x, y = training_data(flight)
    arrays = {"time": time, "x": x, "y": y, "beat": np.array(beat)}
    for number, other in enumerate(unseen.values()):
        for key, values in zip(("time", "x", "y"), training_data(other), strict=True):
            arrays[f"{key}_{number}"] = values[::THINNED]
    arrays["unseen"] = np.array(list(unseen))
    path = folder / f"{name}.npz"
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return path


def run_trial(trial: Trial, folder: Path) -> Run:
    """One trial, in this process.

    Args:
        trial: What to run.
        folder: Where `write_samples` wrote.
    """
    started = process_time()
    subject, samples = SUBJECTS[trial.flight], _samples(folder / f"{trial.flight}.npz")
    columns = _columns(trial)
    step = float(np.median(np.diff(samples["time"])))
    learner = make_learner(
        subject, trial.network, trial.learner, trial.every * step, trial.seed, trial.setting
    )
    prior = _largest_variance(learner)
    result = stream(
        learner,
        samples["time"],
        samples["x"][:, columns],
        samples["y"],
        every=trial.every,
        horizons={"10ms": 0.01, "beat": float(samples["beat"])},
    )
    scores = {
        **_named(trial),
        "weights": learner.network.size,
        **{key: value for key, value in result.scores.items() if key not in _LEFT_OUT},
        "prior_variance": prior,
        "microseconds_per_update": 1e6 * result.scores["time_per_update"],
        "curve": learning_curve(result, trial.every),
        "unseen": _unseen(learner, trial, samples, columns),
        "seconds": process_time() - started,
    }
    if not trial.keep:
        return Run(trial, scores, None)
    seen = inputs_of(subject, trial.network)
    learned = Model(learner.network, np.array(learner.weights, float), inputs=seen)
    return Run(trial, scores, result.prediction, learned)


_LEFT_OUT = ("samples", "samples_predicted", "median_step", "gaps", "coverage_by_output")


def learning_curve(result: Identification, every: int) -> dict[str, Any]:
    """Error against samples used: NMSE within windows of time, mean over the outputs.

    Args:
        result: What `stream` gave.
        every: One sample in so many was used.
    """
    truth = result.prediction["measurement"].to_numpy()
    guess = result.prediction["prediction"].to_numpy()
    variance = truth.var(axis=0)
    heard = variance > 1e-12 * variance.max()
    error = ((truth - guess)[:, heard] ** 2 / variance[heard]).mean(axis=1)
    updates = -(-len(error) // every)
    used = np.unique(np.geomspace(1, updates, WINDOWS).astype(int))
    edges = np.minimum(used * every, len(error))
    spans = list(zip([0, *edges[:-1]], edges, strict=True))
    return {
        "samples_used": [int(count) for count in used],
        "nmse": [float(error[begin:end].mean()) for begin, end in spans],
    }


def _unseen(
    learner: Any, trial: Trial, samples: dict[str, Array], columns: Array
) -> dict[str, Any]:
    """Scores of the frozen weights on each gait they never saw."""
    if trial.kind == "limit" or not np.isfinite(learner.weights).all():
        return {}
    strip = trial.network.startswith("strip") and trial.learner in ("cubature", "extended")
    model = learner if strip else _Frozen(learner.network, learner.weights)
    rows: dict[str, Any] = {}
    for number, gait in enumerate(samples["unseen"].tolist()):
        time, x, y = (samples[f"{key}_{number}"] for key in ("time", "x", "y"))
        scores = compare(model, time, x[:, columns], y, every=100 // THINNED).scores
        rows[gait] = {
            "mean": scores["nmse_mean"],
            "worst": scores["nmse_worst"],
            "coverage": scores["coverage"],
            "persistence_worst": scores["persistence_worst"],
        }
    return rows


@dataclass(frozen=True)
class _Frozen:
    """A network and weights: all that a frozen model is."""

    network: Any
    weights: Array


def _named(trial: Trial) -> dict[str, Any]:
    return {
        "flight": trial.flight,
        "network": trial.network,
        "learner": trial.learner,
        "every": trial.every,
        "seed": trial.seed,
        "label": trial.label,
    }


def _columns(trial: Trial) -> Array:
    """Where the network's inputs are in [q, v]."""
    subject = SUBJECTS[trial.flight]
    every = inputs_of(subject, "dense")
    return np.array([every.index(name) for name in inputs_of(subject, trial.network)])


def _largest_variance(learner: Any) -> float:
    covariance = learner.covariance
    return float("nan") if covariance is None else float(np.diagonal(covariance).max())


@cache
def _samples(path: Path) -> dict[str, Any]:
    with np.load(path) as file:
        return {key: file[key] for key in file.files}
