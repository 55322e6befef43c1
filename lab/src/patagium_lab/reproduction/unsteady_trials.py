"""Trials of learners in air with memory: one candidate, mount and rate of samples each.

A trial streams the flight, each sample predicted before it may be learned, then predicts gaits, a
speed and a gust that were not learned. Trials are independent of each other and run in worker
processes. Neglected: sensors; states relative to the air and forces are exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time
from typing import Any

import xarray as xr

from patagium.learning.models.memory import measured_inputs
from patagium.learning.stream import stream
from patagium.robot import load_robot
from patagium_lab.frozen_spans import FrozenSpans
from patagium_lab.reproduction.flights import TIME_STEP, beat_frequency, summary, unseen_gaits
from patagium_lab.reproduction.samples import Samples, load_samples, write_samples
from patagium_lab.reproduction.trials import unseen_scores
from patagium_lab.reproduction.unsteady_flights import (
    MOUNTS,
    relative_samples,
    unseen_flights,
    unsteady_flight,
)
from patagium_lab.reproduction.unsteady_models import CANDIDATES


@dataclass(frozen=True)
class UnsteadyTrial:
    """One candidate on one flight.

    Attributes:
        mount: Key of `MOUNTS`.
        candidate: Key of `CANDIDATES`.
        every: One sample in this many is learned.
        seed: Seed of the first weights.
        keep: Whether the predictions are kept for the figures.
    """

    mount: str
    candidate: str
    every: int
    seed: int = 0
    keep: bool = False

    @property
    def cost(self) -> float:
        """Expected duration, for order and progress [s]."""
        each = {"grey": 8e-4, "attached": 8e-4}.get(self.candidate, 2.5e-4)
        return 2.0 + 20_000 / self.every * each


@dataclass(frozen=True)
class UnsteadyResult:
    """Result of a trial.

    Attributes:
        trial: The trial.
        scores: Scores of the trial, JSON-able.
        record: Predictions, where they were kept.
    """

    trial: UnsteadyTrial
    scores: dict[str, Any]
    record: xr.Dataset | None


def unsteady_trials(
    every: Sequence[int],
    starts: int,
    candidates: Sequence[str] = tuple(CANDIDATES),
    slow_every: int = 1,
) -> list[UnsteadyTrial]:
    """Every candidate on every flight, and further starts in free flight of strips without memory.

    Strips with a lag begin with physics, whatever the start.

    Args:
        every: Rates of samples: one in this many is learned.
        starts: Number of starts of the strips without memory, at the lowest rate.
        candidates: Keys of `CANDIDATES`.
        slow_every: What no target asks for learns one sample in this many at most.
    """
    lowest = max(every)
    table = [
        UnsteadyTrial(mount, key, rate, keep=rate == lowest)
        for mount in MOUNTS
        for key in candidates
        for rate in every
        if rate >= (1 if CANDIDATES[key].every_sample else slow_every)
    ]
    again = [UnsteadyTrial("free", "strip", lowest, seed) for seed in range(1, starts)]
    return table + again


def fly_unsteady(
    mount: str, duration: float, unseen_duration: float, folder: Path
) -> tuple[xr.Dataset, dict[str, Any]]:
    """The flight that is learned and those that are not; their samples are written for the trials.

    Args:
        mount: Key of `MOUNTS`.
        duration: Duration of the flight that is learned [s].
        unseen_duration: Duration of each other flight [s].
        folder: Folder for the samples.

    Returns:
        The flight that is learned; figures of it and of the others, and the names of those
        that stay within its incidences and of those that leave them.
    """
    flight, unseen = unsteady_flight(mount, duration), unseen_flights(mount, unseen_duration)
    others = {name: relative_samples(one) for name, one in unseen.items()}
    samples = Samples(relative_samples(flight), others, 1.0 / beat_frequency(flight))
    write_samples(folder / f"unsteady_{mount}.npz", samples)
    learned = summary(flight)
    found = {name: summary(one) for name, one in unseen.items()}
    return flight, {
        "learned": learned,
        "unseen": found,
        "within": unseen_gaits(learned, found, "within"),
        "beyond": unseen_gaits(learned, found, "beyond"),
    }


def run_unsteady_trial(trial: UnsteadyTrial, folder: Path) -> UnsteadyResult:
    """One trial, in this process.

    Args:
        trial: What to run.
        folder: Folder of the samples that `fly_unsteady` wrote.
    """
    started = process_time()
    samples = load_samples(folder / f"unsteady_{trial.mount}.npz")
    candidate = CANDIDATES[trial.candidate]
    learner = candidate.make(load_robot("aerobat"), trial.every * TIME_STEP, trial.seed)
    seen = slice(measured_inputs(learner.network))
    time, x, y = samples.learned
    spans = FrozenSpans({"10ms": 0.01}, learner, time, y, trial.every)
    result = stream(learner, time, x[:, seen], y, every=trial.every, watches=[spans])
    found = result.scores | spans.scores()
    others = {name: (t, x[:, seen], y) for name, (t, x, y) in samples.unseen.items()}
    unseen = unseen_scores(learner, others, 100)
    key = asdict(trial)
    keep = key.pop("keep")
    scores = {
        **key,
        "weights": learner.network.size,
        **{key: value for key, value in found.items() if key in _KEPT},
        "microseconds_per_update": 1e6 * result.scores["time_per_update"],
        "unseen": unseen,
        "seconds": process_time() - started,
    }
    return UnsteadyResult(trial, scores, result.prediction if keep else None)


_KEPT = (
    *("outcome", "nmse_second_half_mean", "nmse_second_half_worst", "coverage_second_half"),
    *("persistence_second_half_mean", "persistence_second_half_worst"),
    *("horizon_10ms_nmse_second_half_worst", "largest_variance"),
)
