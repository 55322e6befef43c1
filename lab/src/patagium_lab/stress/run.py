"""How much a learner takes: faults by the hundred, a broken wing, ten million updates.

Neglected: faults of more than one kind at a time, but for the storm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from patagium.errors import ParameterError
from patagium_lab.jobs import WORKERS, Job, run_jobs
from patagium_lab.stress.calibration import NOISES, flight_calibration, log_calibration
from patagium_lab.stress.campaign import FAULT_NAMES, campaign
from patagium_lab.stress.damage import damage_row, learner_names
from patagium_lab.stress.endurance import GLIDE, UPDATES, single_precision, steady_glide

RUNS = 1000
CHUNK = 25
"""Runs of the campaign that a worker takes at a time."""


@dataclass(frozen=True)
class StressStudy:
    """What was found; rows are JSON-able.

    Attributes:
        seed: Of the campaign.
        runs: One row a run of the campaign; see `stress_campaign.run_fault`.
        damage: One row a learner; see `stress_damage.Recovery.row`.
        calibration: One row a flight or log; see `stress_calibration.log_calibration`.
        glide: See `stress_endurance.steady_glide`.
        precision: See `stress_endurance.single_precision`.
    """

    seed: int
    runs: list[dict[str, Any]]
    damage: list[dict[str, Any]]
    calibration: list[dict[str, Any]]
    glide: dict[str, Any]
    precision: dict[str, Any]

    def faults(self) -> list[dict[str, Any]]:
        """The campaign by fault: counts of what must not happen, and of what was counted."""
        names = [name for name in FAULT_NAMES if any(r["fault"] == name for r in self.runs)]
        return [_fault_row(name, [r for r in self.runs if r["fault"] == name]) for name in names]

    def rows(self) -> dict[str, Any]:
        """All of it for a JSON file, runs summed up by fault."""
        return {
            "seed": self.seed,
            "runs": len(self.runs),
            "faults": self.faults(),
            "worst_runs": sorted(self.runs, key=lambda r: -r["ratio"])[:10],
            "damage": self.damage,
            "calibration": self.calibration,
            "glide": self.glide,
            "single_precision": self.precision,
        }


def stress(
    runs: int = RUNS,
    seed: int = 0,
    *,
    workers: int = WORKERS,
    log: str | Path | None = None,
    glide: int = GLIDE,
    updates: int = UPDATES,
    progress: Callable[[float], None] | None = None,
) -> StressStudy:
    """The whole study.

    Args:
        runs: Of the campaign.
        seed: Of the campaign.
        workers: Number of processes.
        log: The quadrotor's log for the calibration; None: without it.
        glide: Samples of the steady glide.
        updates: Of the comparison of precisions.
        progress: Told the part of the work done.

    Raises:
        ParameterError: If there are no runs or no workers.
    """
    for name, value in (("runs", runs), ("jobs", workers)):
        if value < 1:
            raise ParameterError(name, "a positive integer", value)
    starts = range(0, runs, CHUNK)
    parts = [
        [Job(campaign, (seed, first, min(first + CHUNK, runs)), 10.0) for first in starts],
        [Job(damage_row, (name,), 20.0) for name in learner_names()],
        [Job(flight_calibration, (noise,), 5.0) for noise in NOISES],
        [] if log is None else [Job(log_calibration, (str(log),), 10.0)],
        [Job(steady_glide, (glide,), 2e-5 * glide)],
        [Job(single_precision, (updates,), 1e-5 * updates)],
    ]
    found = iter(run_jobs([job for part in parts for job in part], progress, workers))
    chunks, damage, flights, logs, (glided,), (precise,) = (
        [next(found) for _ in part] for part in parts
    )
    every = [row for chunk in chunks for row in chunk]
    return StressStudy(seed, every, damage, [*flights, *logs], glided, precise)


def _fault_row(name: str, runs: list[dict[str, Any]]) -> dict[str, Any]:
    ratios = sorted(run["ratio"] for run in runs)
    counted: dict[str, int] = {}
    for run in runs:
        for event, count in run["events"].items():
            counted[event] = counted.get(event, 0) + count
    return {
        "fault": name,
        "runs": len(runs),
        "crashes": sum(bool(run["crash"]) for run in runs),
        "not_finite": sum(not run["finite"] for run in runs),
        "indefinite": sum(not run["definite"] for run in runs),
        "miscounted": sum(not run["counted"] for run in runs),
        "lost_states": sum(run.get("lost", False) for run in runs),
        "interrupted_saves": sum(run.get("interrupted", False) for run in runs),
        "not_recovered": sum(not run["recovered"] for run in runs),
        "ratio_median": ratios[len(ratios) // 2],
        "ratio_largest": ratios[-1],
        "events": counted,
    }
