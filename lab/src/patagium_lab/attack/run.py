"""Run of the attack: hostile cases by target, then learners through faults, damage and long runs.

Neglected: hostile cases of more than one area at a time; faults of learners of more than one kind
at a time, except for the storm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from itertools import product
from math import ceil
from typing import Any

from patagium_lab.attack.calibration import NOISES, flight_calibration, log_calibration
from patagium_lab.attack.calls import call_targets
from patagium_lab.attack.campaign import FAULT_NAMES, campaign
from patagium_lab.attack.damage import damage_row, learner_names
from patagium_lab.attack.endurance import single_precision, steady_glide
from patagium_lab.attack.files import file_targets
from patagium_lab.attack.loops import loop_targets
from patagium_lab.attack.motion_capture import capture_rows, summary
from patagium_lab.attack.oracle import Target
from patagium_lab.attack.packets import packet_targets
from patagium_lab.attack.plan import HOSTILE, AttackPlan
from patagium_lab.attack.poison import LEARNERS, NOISE_MODELS, poison_row
from patagium_lab.attack.programs import program_targets
from patagium_lab.attack.worker import attacked
from patagium_lab.jobs import Job, run_jobs
from patagium_lab.study import Stages

CHUNK = 25
"""Runs of the fault campaign that a worker takes at a time."""


@dataclass(frozen=True)
class AttackResults:
    """Results of the attack.

    Attributes:
        seed: Seed of the cases and runs.
        areas: Results by area, JSON-able. Of a hostile area its tallies (see `worker.Tally`); of
            `faults` the runs (see `campaign.run_fault`); of `damage`, `calibration` and
            `captures` a row for each learner, flight or log; of `endurance` two sets of figures.
    """

    seed: int
    areas: dict[str, Any]

    def tallies(self) -> list[dict[str, Any]]:
        """Tallies of the targets of all hostile areas."""
        return [row for area in HOSTILE for row in self.areas.get(area, [])]

    def faults(self) -> list[dict[str, Any]]:
        """Rows of the fault campaign by fault: counts of failures and of counted events."""
        runs = self.areas.get("faults", [])
        names = [name for name in FAULT_NAMES if any(r["fault"] == name for r in runs)]
        return [_fault_row(name, [r for r in runs if r["fault"] == name]) for name in names]

    def metrics(self) -> dict[str, Any]:
        """All results for a JSON file; with the sums by fault and the summary of the captures."""
        sums: dict[str, Any] = {}
        if "faults" in self.areas:
            sums["faults"] = self.faults()
        if "captures" in self.areas:
            sums["motion_capture"] = summary(self.areas["captures"])
        return {"seed": self.seed, "areas": self.areas, **sums}


def run(plan: AttackPlan, former: Mapping[str, Any], stages: Stages) -> AttackResults:
    """Results of the attack.

    Args:
        plan: What is attacked.
        former: Results by area of a run before, which are kept for areas that are not attacked.
        stages: Receives progress.
    """
    areas = dict(former)
    hostile = [area for area in HOSTILE if area in plan.areas]
    with stages.stage("hostile cases", 0.0, 0.5) as tell:
        for row in _tallied(plan, hostile, tell):
            kept = [old for old in areas.get(row["area"], []) if old["target"] != row["target"]]
            areas[row["area"]] = [*kept, row]
    with stages.stage("learners under faults", 0.5, 1.0) as tell:
        areas |= _learned(plan, tell)
    return AttackResults(plan.seed, areas)


def targets() -> Iterator[Target]:
    """All targets of hostile cases."""
    yield from file_targets()
    yield from packet_targets()
    yield from loop_targets()
    yield from call_targets()
    yield from program_targets()


def drawn(target: Target, share: float) -> int:
    """Number of cases to draw for a target, rounded up.

    Args:
        target: The target, with its weight `cases`.
        share: Number of cases for a weight of one.
    """
    return ceil(share * target.cases)


def _tallied(
    plan: AttackPlan, areas: list[str], tell: Callable[[float], None]
) -> Iterator[dict[str, Any]]:
    """Tally of each target, as they are done."""
    share = plan.cases / sum(target.cases for target in targets())
    chosen = [target for target in targets() if target.area in areas]
    whole, done = sum(target.cases for target in chosen), 0.0
    with ThreadPoolExecutor(plan.workers) as pool:  # each thread watches a process
        waiting = {
            pool.submit(attacked, target, plan.seed, drawn(target, share)): target
            for target in chosen
        }
        for future in as_completed(waiting):
            done += waiting[future].cases
            tell(done / whole)
            yield asdict(future.result())


def _learned(plan: AttackPlan, tell: Callable[[float], None]) -> dict[str, Any]:
    """Results of the areas of learners that are in the plan."""
    starts = range(0, plan.runs, CHUNK)
    kinds = list(product(LEARNERS, NOISE_MODELS, [plan.seed], [plan.poisoned]))
    parts = {
        "poison": [Job(poison_row, kind, 1e-4 * kind[-1]) for kind in kinds],
        "faults": [Job(campaign, (plan.seed, k, min(k + CHUNK, plan.runs)), 10.0) for k in starts],
        "damage": [Job(damage_row, (name,), 20.0) for name in learner_names()],
        "calibration": [Job(flight_calibration, (noise,), 5.0) for noise in NOISES],
        "endurance": [
            Job(steady_glide, (plan.glide,), 2e-5 * plan.glide),
            Job(single_precision, (plan.updates,), 1e-5 * plan.updates),
        ],
        "captures": [
            Job(capture_rows, (k, min(k + CHUNK, plan.captures)), 30.0)
            for k in range(0, plan.captures, CHUNK)
        ],
    }
    if plan.log is not None:
        parts["calibration"].append(Job(log_calibration, (str(plan.log),), 10.0))
    chosen = {area: jobs for area, jobs in parts.items() if area in plan.areas}
    found = iter(run_jobs([job for jobs in chosen.values() for job in jobs], tell, plan.workers))
    results: dict[str, Any] = {area: [next(found) for _ in jobs] for area, jobs in chosen.items()}
    for area in ("faults", "captures"):
        if area in results:
            results[area] = [row for rows in results[area] for row in rows]
    if "endurance" in results:
        results["endurance"] = dict(zip(("glide", "precision"), results["endurance"], strict=True))
    return results


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
