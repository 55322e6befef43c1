"""Run of the study of foreign air: flights, then every contestant on each of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from patagium_lab.conditions import conditions
from patagium_lab.foreign.contestants import DEFAULT
from patagium_lab.foreign.flights import Case, cases, kept_flight, near_cases, stored_wrenches
from patagium_lab.foreign.plan import ForeignPlan
from patagium_lab.foreign.programs import LATTICE_PROGRAM, MUJOCO, installed
from patagium_lab.foreign.subjects import LATTICE
from patagium_lab.foreign.trials import PHYSICS, SEARCH, Trial, run_trial
from patagium_lab.gallery import Gallery
from patagium_lab.jobs import Job, run_jobs
from patagium_lab.measured.crazyflie import crazyflie_sections, crazyflie_study
from patagium_lab.measured.yeo import yeo_sections, yeo_study
from patagium_lab.study import Results, Stages

COSTS = {LATTICE: 20.0, "other": 5.0, "trial": 3.0, "searched": 0.4}
"""Expected durations of flights, of trials, and of each trial of a search, for progress [s]."""


def run(plan: ForeignPlan, out: Path, stages: Stages) -> Results:
    """Results of the study; flights and trials that are in the folder already are taken as kept.

    Args:
        plan: Plan of the study.
        out: Folder of the results.
        stages: Receives progress.
    """
    flights = out / "flights" if plan.flights is None else plan.flights
    trials, absent = planned(plan, flights)
    used = sorted({c for t in trials for c in (t.learned, *t.unseen)}, key=repr)
    with stages.stage("flights and learners", 0.0, 0.9) as tell:
        jobs = [_flight_job(case, flights) for case in used]
        places = {case: k for k, case in enumerate(used)}
        for trial in trials:
            after = tuple(places[case] for case in (trial.learned, *trial.unseen))
            cost = COSTS["trial"] + COSTS["searched"] * trial.search
            jobs.append(Job(run_trial, (trial, flights, out), cost, after))
        rows = run_jobs(jobs, tell, plan.workers)[len(used) :]
    near = [any(one.distance > 0 for one in trial.unseen) for trial in trials]
    sections = []
    with stages.stage("measured sets", 0.9, 1.0):
        if plan.real:
            sections += yeo_sections(yeo_study())
        if plan.real and plan.log is not None:
            sections += crazyflie_sections(crazyflie_study(plan.log, every=(plan.every,)))
    metrics: dict[str, Any] = {
        "environment": conditions(),
        "plan": {
            name: getattr(plan, name) for name in ("seed", "every", "gaits_apart", "near", "search")
        },
        "split": split(plan),
        "absent": len(absent),
        "rows": [row for row, close in zip(rows, near, strict=True) if not close],
        "near": [row for row, close in zip(rows, near, strict=True) if close],
    }
    return Results(metrics, Gallery(out / "figures"), sections)


def planned(plan: ForeignPlan, flights: Path) -> tuple[list[Trial], list[Case]]:
    """Trials of a plan, and cases that cannot be flown because a program is missing.

    Args:
        plan: Plan of the study.
        flights: Folder of the flights.
    """
    trials, absent = list[Trial](), list[Case]()
    for air in plan.airs:
        found = _cases(plan, air)
        absent += [case for case in found if not _available(case, flights)]
        ready = [case for case in found if _available(case, flights)]
        for robot in sorted({case.robot for case in ready}):
            for apart in (False, True):
                side = [c for c in ready if c.robot == robot and c.apart is apart]
                trials += _side(plan, side)
            kept = [case for case in ready if case.robot == robot and case.apart][:1]
            around = [one for case in kept for one in near_cases(case, plan.near)]
            lost = [one for one in around if not _available(one, flights)]
            absent += lost
            if around and not lost:
                names = (PHYSICS, *(name for name in plan.contestants if name == DEFAULT))
                trials += [Trial(name, kept[0], tuple(around), plan.every) for name in names]
    return trials, absent


def split(plan: ForeignPlan) -> dict[str, dict[str, list[int]]]:
    """Numbers of the wingbeats that are kept apart, by kind of air and robot.

    Args:
        plan: Plan of the study.
    """
    found: dict[str, dict[str, list[int]]] = {}
    for air in plan.airs:
        for case in _cases(plan, air):
            robots = found.setdefault(air, {})
            robots.setdefault(case.robot, []).extend([case.gait] if case.apart else [])
    return found


def _cases(plan: ForeignPlan, air: str) -> list[Case]:
    found = cases(air, plan.seed, gaits_apart=plan.gaits_apart, robots_apart=plan.robots_apart(air))
    return [case for case in found if not plan.robots or case.robot in plan.robots]


def _side(plan: ForeignPlan, side: Sequence[Case]) -> list[Trial]:
    """Trials of one robot and one side of the split; each model is scored on the next flights."""
    trials = []
    for k, case in enumerate(side[: plan.learned]):
        others = [side[(k + j) % len(side)] for j in range(1, min(len(side), plan.unseen + 1))]
        for name in (PHYSICS, *plan.contestants):
            trials.append(Trial(name, case, tuple(others), plan.every))
        if plan.search:
            trials.append(Trial(SEARCH, case, tuple(others), plan.every, plan.search))
    return trials


def _available(case: Case, flights: Path) -> bool:
    wing = case.air == LATTICE
    return (
        case.path(flights).is_file()
        or (wing and case.key in stored_wrenches())
        or installed(LATTICE_PROGRAM if wing else MUJOCO)
    )


def _flight_job(case: Case, flights: Path) -> Job:
    cost = COSTS.get(case.air, COSTS["other"])
    return Job(_fly, (case, flights), 0.01 if case.path(flights).is_file() else cost)


def _fly(case: Case, flights: Path) -> None:
    kept_flight(case, flights)
