"""Learning air with memory: each candidate, mount and rate of samples, then frozen weights.

A trial streams the flight, each sample predicted before it may be learned, then predicts
gaits, a speed and a gust it never saw. Trials are independent and run in worker processes.
Neglected: sensors; states relative to the air and forces are taken as they stand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import xarray as xr

from patagium.learning.identify import compare
from patagium.learning.stream import stream
from patagium.robot import load_robot
from patagium_lab.reproduction.flights import TIME_STEP, summary, unseen_gaits
from patagium_lab.reproduction.unsteady_flights import (
    MOUNTS,
    unseen_flights,
    unsteady_flight,
    write_unsteady_samples,
)
from patagium_lab.reproduction.unsteady_subjects import CANDIDATES


@dataclass(frozen=True)
class UnsteadyTrial:
    """One candidate on one flight.

    Attributes:
        mount: Key of `MOUNTS`.
        candidate: Key of `CANDIDATES`.
        every: One sample in so many is used.
        seed: Of the weights to start from.
        keep: Whether predictions come back for the figures.
    """

    mount: str
    candidate: str
    every: int
    seed: int = 0
    keep: bool = False

    @property
    def cost(self) -> float:
        """About how long it takes, for order and progress [s]."""
        each = {"dense": 6e-4, "grey": 8e-4, "hidden": 4e-4}.get(self.candidate, 2.5e-4)
        return 2.0 + 20_000 / self.every * each


@dataclass(frozen=True)
class UnsteadyRun:
    """What a trial gave.

    Attributes:
        trial: The trial.
        scores: Its scores, JSON-able.
        record: Predictions, where they were kept.
    """

    trial: UnsteadyTrial
    scores: dict[str, Any]
    record: xr.Dataset | None


def unsteady_trials(every: Sequence[int], starts: int) -> list[UnsteadyTrial]:
    """Every candidate on every flight; in free flight from several starts.

    Args:
        every: Rates of samples, one in so many.
        starts: How many starts of those that targets are set for, at the lowest rate.
    """
    most = max(every)
    table = [
        UnsteadyTrial(mount, key, rate, keep=rate == most)
        for mount in MOUNTS
        for key, candidate in CANDIDATES.items()
        for rate in every
        if rate >= candidate.most
    ]
    again = [
        UnsteadyTrial("free", key, most, seed)
        for key in ("strip", "hidden")
        for seed in range(1, starts)
    ]
    return table + again


def fly_unsteady(
    mount: str, duration: float, unseen_duration: float, folder: Path
) -> tuple[xr.Dataset, dict[str, Any]]:
    """The flight to learn and those to be tried on, their samples written for the trials.

    Args:
        mount: Key of `MOUNTS`.
        duration: Of the flight that is learned [s].
        unseen_duration: Of each other [s].
        folder: Where the samples go.

    Returns:
        The flight that is learned; summaries of it and of the others, and which of those
        stay within its incidences.
    """
    flight, unseen = unsteady_flight(mount, duration), unseen_flights(mount, unseen_duration)
    write_unsteady_samples(folder, mount, flight, unseen)
    learned = summary(flight)
    others = {name: summary(one) for name, one in unseen.items()}
    words = {
        "learned": learned,
        "unseen": others,
        "within": unseen_gaits(learned, others, "within"),
        "beyond": unseen_gaits(learned, others, "beyond"),
    }
    return flight, words


def run_unsteady_trial(trial: UnsteadyTrial, folder: Path) -> UnsteadyRun:
    """One trial, in this process.

    Args:
        trial: What to run.
        folder: Where `fly_unsteady` wrote.
    """
    started = process_time()
    samples = _samples(folder / f"unsteady_{trial.mount}.npz")
    learner = CANDIDATES[trial.candidate].make(
        load_robot("aerobat"), trial.every * TIME_STEP, trial.seed
    )
    result = stream(
        learner,
        *(samples[key] for key in ("time", "x", "y")),
        every=trial.every,
        horizons={"10ms": 0.01},
    )
    unseen = {}
    for number, name in enumerate(samples["unseen"].tolist()):
        arrays = (samples[f"{key}_{number}"] for key in ("time", "x", "y"))
        scores = compare(learner, *arrays, every=100).scores
        unseen[name] = {
            "mean": scores["nmse_mean"],
            "worst": scores["nmse_worst"],
            "persistence_worst": scores["persistence_worst"],
        }
    scores = {
        "mount": trial.mount,
        "candidate": trial.candidate,
        "every": trial.every,
        "seed": trial.seed,
        "weights": learner.network.size,
        **{key: value for key, value in result.scores.items() if key in _KEPT},
        "microseconds_per_update": 1e6 * result.scores["time_per_update"],
        "unseen": unseen,
        "seconds": process_time() - started,
    }
    return UnsteadyRun(trial, scores, result.prediction if trial.keep else None)


_KEPT = (
    *("outcome", "nmse_second_half_mean", "nmse_second_half_worst", "coverage_second_half"),
    *("persistence_second_half_mean", "persistence_second_half_worst"),
    *("horizon_10ms_nmse_second_half_worst", "largest_variance"),
)


@cache
def _samples(path: Path) -> dict[str, Any]:
    with np.load(path) as file:
        return {key: file[key] for key in file.files}
