"""Run of the stress study: faults and logs by the hundred, a broken wing, ten million updates.

Neglected: faults of more than one kind at a time, except for the storm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from patagium_lab.jobs import Job, run_jobs
from patagium_lab.stress.calibration import NOISES, flight_calibration, log_calibration
from patagium_lab.stress.campaign import FAULT_NAMES, campaign
from patagium_lab.stress.damage import damage_row, learner_names
from patagium_lab.stress.endurance import single_precision, steady_glide
from patagium_lab.stress.motion_capture import capture_rows, summary
from patagium_lab.stress.plan import StressPlan
from patagium_lab.study import Stages

CHUNK = 25
"""Runs of the campaign that a worker takes at a time."""


@dataclass(frozen=True)
class StressResults:
    """Results of the stress study; rows are JSON-able.

    Attributes:
        seed: Seed of the campaign.
        runs: Row of each run of the campaign; see `campaign.run_fault`.
        damage: Row of each learner; see `damage.Recovery.row`.
        calibration: Row of each flight or log; see `calibration.log_calibration`.
        glide: See `endurance.steady_glide`.
        precision: See `endurance.single_precision`.
        captures: Row of each log of motion capture; see `motion_capture.capture_row`.
    """

    seed: int
    runs: list[dict[str, Any]]
    damage: list[dict[str, Any]]
    calibration: list[dict[str, Any]]
    glide: dict[str, Any]
    precision: dict[str, Any]
    captures: list[dict[str, Any]]

    def faults(self) -> list[dict[str, Any]]:
        """Rows of the campaign by fault: counts of failures and of counted events."""
        names = [name for name in FAULT_NAMES if any(r["fault"] == name for r in self.runs)]
        return [_fault_row(name, [r for r in self.runs if r["fault"] == name]) for name in names]

    def metrics(self) -> dict[str, Any]:
        """All results for a JSON file, with the runs summed up by fault."""
        return {
            "seed": self.seed,
            "runs": len(self.runs),
            "faults": self.faults(),
            "worst_runs": sorted(self.runs, key=lambda r: -r["ratio"])[:10],
            "damage": self.damage,
            "calibration": self.calibration,
            "glide": self.glide,
            "single_precision": self.precision,
            "motion_capture": summary(self.captures),
        }


def run(plan: StressPlan, stages: Stages) -> StressResults:
    """Results of the whole study.

    Args:
        plan: What is run.
        stages: Receives progress.
    """
    starts = range(0, plan.runs, CHUNK)
    parts = [
        [Job(campaign, (plan.seed, k, min(k + CHUNK, plan.runs)), 10.0) for k in starts],
        [Job(damage_row, (name,), 20.0) for name in learner_names()],
        [Job(flight_calibration, (noise,), 5.0) for noise in NOISES],
        [] if plan.log is None else [Job(log_calibration, (str(plan.log),), 10.0)],
        [Job(steady_glide, (plan.glide,), 2e-5 * plan.glide)],
        [Job(single_precision, (plan.updates,), 1e-5 * plan.updates)],
        [
            Job(capture_rows, (k, min(k + CHUNK, plan.captures)), 30.0)
            for k in range(0, plan.captures, CHUNK)
        ],
    ]
    with stages.stage("faults, damage, calibration and long runs", 0.0, 1.0) as tell:
        found = iter(run_jobs([job for part in parts for job in part], tell, plan.workers))
    chunks, damage, flights, logs, (glide,), (precision,), captured = (
        [next(found) for _ in part] for part in parts
    )
    runs = [row for chunk in chunks for row in chunk]
    captures = [row for rows in captured for row in rows]
    return StressResults(plan.seed, runs, damage, [*flights, *logs], glide, precision, captures)


def _fault_row(name: str, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts of failures over the runs of one fault."""
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
