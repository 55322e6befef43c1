"""Run of the reproduction: the paper's whole experiment, as published and corrected.

Two flights are flown and their forces are learned by every network, learner and rate of samples.
The learned models are frozen and tried on gaits that were not learned. Each error of the published
experiment is put in and taken away. Overheads are measured, and a measured wing is learned.
Neglected: hardware, closed loops.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import xarray as xr

from patagium.learning.result import Identification
from patagium.report import PageSection
from patagium.robot import load_robot
from patagium.simulation import save_flight
from patagium.viewer import replay
from patagium_lab.bench import overhead
from patagium_lab.conditions import conditions
from patagium_lab.gallery import Gallery
from patagium_lab.jobs import Job, run_jobs
from patagium_lab.measured import yeo
from patagium_lab.measured.crazyflie import crazyflie_sections, crazyflie_study
from patagium_lab.reproduction import cases, figures, flights
from patagium_lab.reproduction.claims import claims
from patagium_lab.reproduction.errors import fly_case
from patagium_lab.reproduction.page import early_page
from patagium_lab.reproduction.plan import ReproductionPlan
from patagium_lab.reproduction.tables import start_spans
from patagium_lab.reproduction.targets import targets
from patagium_lab.reproduction.trials import Trial, TrialResult, fly_known, run_trial
from patagium_lab.reproduction.unsteady_flights import MOUNTS
from patagium_lab.reproduction.unsteady_page import draw_unsteady, unsteady_metrics
from patagium_lab.reproduction.unsteady_trials import (
    UnsteadyResult,
    fly_unsteady,
    run_unsteady_trial,
    unsteady_trials,
)
from patagium_lab.study import Results, Stages

OPENING = "corrected"
"""Flight of the first screen."""
ERROR_COST = 0.5
"""Expected duration of the flight of one error [s]."""
WING_COST = 3.0
"""Expected duration of learning the measured wing [s]."""
FLIGHT_COST = {"published": 4.0, "corrected": 5.0, "unsteady": 7.0}
"""Expected duration of a flight and of those that are not learned, compiling included [s]."""


def run(plan: ReproductionPlan, out: Path, stages: Stages) -> Results:
    """Figures, drawings and flights of the whole reproduction.

    Learners run in worker processes: a script that calls this needs the usual guard
    `if __name__ == "__main__":`.

    Args:
        plan: What is run.
        out: Folder of the flights (*.nc, *.html) and of figures/.
        stages: Receives progress.
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        stages.stage("flying, learning, and errors one by one", 0.0, 0.8) as tell,
    ):
        early = partial(_show_early, plan, Gallery(out / "figures"), stages)
        work = _work(plan, Path(folder), tell, early)
        for key, flight in work.flights.items():
            save_flight(flight, out / f"{key}.nc")
    with stages.stage("overheads", 0.8, 0.85):
        overheads = {
            "dynamics": overhead.dynamics_overhead(load_robot("aerobat"), plan.rivals),
            "aerodynamics": overhead.aerodynamics_overhead(plan.air_models, plan.air_networks),
        }
    with stages.stage("measured data", 0.85, 0.9):
        measured, sections = _measured(plan, work.wing)
    metrics = _metrics(plan, work) | {"overhead": overheads, **measured}
    gallery = Gallery(out / "figures")
    with stages.stage("drawing", 0.9, 0.99):
        _draw(gallery, metrics, work)
        draw_unsteady(gallery, metrics, work.unsteady)
        metrics["replays"] = {name: _replay(out, name, work) for name in work.flights}
    metrics["stages"] = stages.seconds
    metrics["targets"] = targets(metrics)
    metrics["claims"] = claims(metrics)
    return Results(metrics, gallery, sections)


@dataclass(frozen=True)
class _Work:
    """Results of the worker processes.

    Attributes:
        flights: Flights that are learned.
        unseen: Flights that are not learned, by the flight that is.
        unsteady_flights: Figures of the flights through air with memory, by mount.
        results: Results of trials in air without memory.
        unsteady: Results of trials in air with memory.
        errors: Rows of flights with errors, by table.
        wing: Study of the measured wing.
    """

    flights: dict[str, xr.Dataset]
    unseen: dict[str, dict[str, xr.Dataset]]
    unsteady_flights: dict[str, Any]
    results: list[TrialResult]
    unsteady: list[UnsteadyResult]
    errors: dict[str, list[dict[str, Any]]]
    wing: yeo.YeoStudy


def _show_early(
    plan: ReproductionPlan,
    gallery: Gallery,
    stages: Stages,
    flight: xr.Dataset,
    learned: TrialResult,
) -> None:
    """Show the first page: one flight, and what its best network learned from it."""
    if learned.record is None:
        return
    found = Identification(learned.scores, learned.record, learned.model)
    figures.opening_figures(gallery, OPENING, flight, {"strip network": learned.record}, found)
    stages.show(early_page(plan, learned.scores, gallery))


def _work(
    plan: ReproductionPlan,
    folder: Path,
    tell: Callable[[float], None],
    early: Callable[[xr.Dataset, TrialResult], None],
) -> _Work:
    """Flights, trials on them, errors, a measured wing, and compiling what is timed later."""
    known = list(flights.FLIGHTS)
    keys, spans = [*known, *MOUNTS], (plan.duration, plan.unseen_duration)
    slow = (plan.unsteady_duration, plan.unsteady_unseen_duration)
    trials, errors = plan.trials(), plan.error_cases()
    others = unsteady_trials(
        plan.unsteady_every, plan.unsteady_starts, plan.unsteady_candidates, plan.slow_every
    )
    jobs = [Job(fly_known, (key, *spans, folder), FLIGHT_COST[key]) for key in known]
    jobs += [Job(fly_unsteady, (key, *slow, folder), FLIGHT_COST["unsteady"]) for key in MOUNTS]
    jobs += [
        Job(run_trial, (t, folder), t.cost, (keys.index(t.flight),), urgent=_opens(t))
        for t in trials
    ]
    jobs += [Job(run_unsteady_trial, (t, folder), t.cost, (keys.index(t.mount),)) for t in others]
    jobs += [Job(fly_case, (case, plan.duration), ERROR_COST) for case in errors]
    jobs += [Job(yeo.yeo_study, (plan.yeo_cycles,), WING_COST)]
    jobs += overhead.compile_jobs(plan.rivals, plan.air_models, plan.air_networks)
    begun = dict[int, Any]()

    def done_one(place: int, result: Any) -> None:
        opens = place == keys.index(OPENING) or jobs[place].urgent
        if opens:
            begun[place] = result
        if opens and len(begun) == 2:
            (flight, _), learned = (begun[k] for k in sorted(begun))
            early(flight, learned)

    found = iter(run_jobs(jobs, tell, done_one=done_one))
    flown = dict(zip(known, islice(found, len(known)), strict=True))
    unsteady = dict(zip(MOUNTS, islice(found, len(MOUNTS)), strict=True))
    results, unsteady_results = (list(islice(found, len(part))) for part in (trials, others))
    tables: dict[str, list[dict[str, Any]]] = {case.table: [] for case in errors}
    for case, row in zip(errors, islice(found, len(errors)), strict=True):
        tables[case.table].append(row)
    return _Work(
        {key: flight for key, (flight, _) in flown.items()}
        | {f"unsteady_{key}": flight for key, (flight, _) in unsteady.items()},
        {key: unseen for key, (_, unseen) in flown.items()},
        {key: figures for key, (_, figures) in unsteady.items()},
        results,
        unsteady_results,
        tables,
        next(found),
    )


def _opens(trial: Trial) -> bool:
    """Whether the first page waits for a trial."""
    best = cases.STRIPS[OPENING][0]
    return trial.keep and (trial.flight, trial.network) == (OPENING, best)


def _metrics(plan: ReproductionPlan, work: _Work) -> dict[str, Any]:
    """Figures of flights, errors and trials."""
    summaries = _summaries(work)
    starts = [
        _brief(one) | {"unseen_worst": _worst_unseen(one, summaries["unseen_within"])}
        for one in work.results
        if one.trial.is_start
    ]
    runs = {one.trial.run: one for one in work.results}
    return {
        "environment": conditions(),
        "plan": plan.describe(),
        "choices": _choices(),
        "flights": summaries,
        "errors": work.errors,
        "learning": [one.scores for one in work.results if one.trial.kind == "table"],
        "starts": starts,
        "start_spans": start_spans(starts),
        "limits": [_brief(runs[one.run]) | {"label": one.label} for one in plan.limit_trials()],
        "unsteady": unsteady_metrics(work.unsteady, work.unsteady_flights),
        "left_out": plan.left_out,
    }


def _measured(
    plan: ReproductionPlan, wing: yeo.YeoStudy
) -> tuple[dict[str, Any], list[PageSection]]:
    """Studies of measured data: the Yeo wing, and the quadrotor where its log is given."""
    metrics: dict[str, Any] = {"yeo": wing.scores}
    sections = yeo.yeo_sections(wing)
    if plan.crazyflie is not None:
        log = crazyflie_study(plan.crazyflie)
        metrics["crazyflie"] = {"rows": log.rows, "samples": log.samples, "gaps": log.gaps}
        sections += crazyflie_sections(log)
    return metrics, sections


def _summaries(work: _Work) -> dict[str, Any]:
    """Figures of each flight, and the gaits within and beyond the incidences of the learned one."""
    learned: dict[str, Any] = {name: flights.summary(work.flights[name]) for name in work.unseen}
    unseen = {
        key: {name: flights.summary(flight) for name, flight in group.items()}
        for key, group in work.unseen.items()
    }
    sides = {
        f"unseen_{side}": {
            name: flights.unseen_gaits(learned[name], unseen[name], side) for name in unseen
        }
        for side in ("within", "beyond")
    }
    return {**learned, "unseen": unseen, **sides}


def _draw(gallery: Gallery, metrics: dict[str, Any], work: _Work) -> None:
    """Figures of the flights through air without memory, and of the overheads."""
    for name in flights.FLIGHTS:
        flight = work.flights[name]
        figures.overview_figure(gallery, name, flight)
        best = cases.STRIPS[name][0]
        mine = [
            one for one in work.results if one.trial.kind == "table" and one.trial.flight == name
        ]
        kept = {one.trial.network: one.record for one in mine if one.record is not None}
        shown = {"strip network": kept[best], "dense network": kept["dense"]}
        if name == OPENING:
            figures.opening_figures(gallery, name, flight, shown, _learned(name, work))
        figures.force_figures(gallery, name, shown, 1.0 / flights.beat_frequency(flight))
        figures.innovation_figure(gallery, name, kept[best])
        figures.curve_figure(gallery, name, mine)
        frozen = {
            cases.NETWORKS.get(one.trial.network, "100 random features"): one
            for one in mine
            if one.trial.every == 100 and one.trial.learner in ("cubature", "features")
        }
        figures.unseen_figure(gallery, name, frozen)
    figures.overhead_figures(gallery, metrics["overhead"])


def _replay(out: Path, name: str, work: _Work) -> str:
    """A flight in three dimensions, with the forces that a strip network predicted, if any."""
    found = _learned(name, work)
    title = f"The {name.replace('_', ' ')} flight" + (", and its forces as predicted" * bool(found))
    path = replay(work.flights[name], out / f"{name}.html", predicted=found, title=title)
    return path.name


def _learned(name: str, work: _Work) -> Identification | None:
    """Identification of a flight by its best strip network; None where there is none."""
    best = cases.STRIPS.get(name, ("",))[0]
    found = (
        Identification(one.scores, one.record, one.model)
        for one in work.results
        if (one.trial.flight, one.trial.network) == (name, best) and one.record is not None
    )
    return next(found, None)


def _brief(one: TrialResult) -> dict[str, Any]:
    """Scores of a trial without its learning curve and its scores on each unseen gait."""
    return {key: value for key, value in one.scores.items() if key not in ("curve", "unseen")}


def _worst_unseen(one: TrialResult, within: Mapping[str, Sequence[str]]) -> float:
    """Worst error on gaits that stay within the incidences of the learned flight."""
    unseen = one.scores["unseen"]
    return max((unseen[gait]["worst"] for gait in within[one.trial.flight]), default=math.nan)


def _choices() -> dict[str, Any]:
    """Every number that a person chose, for the page."""
    known = cases.FLIGHT_CASES
    return {
        "spread": cases.SPREAD,
        "weight_std": cases.WEIGHT_STD,
        "strip_std": {name: case.strip_std for name, case in known.items()},
        "coefficient_scale": {name: case.coefficient_scale for name, case in known.items()},
        "dense_prior": cases.DENSE_PRIOR,
        "dense_noise": cases.DENSE_NOISE,
        "memory": cases.MEMORY,
        "least_memory": cases.LEAST_MEMORY,
        "steps_of_gradient": dict(cases.STEP),
    }
