"""The paper's whole experiment, as published and corrected, in one run and one report.

Two flights are flown, their forces learned by every network, learner and rate of samples;
the learned models are frozen and tried on gaits they never saw; each error of the published
experiment is put in and taken away; overheads are measured; a measured wing is learned.
Neglected: hardware, closed loops.
"""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr

from patagium.learning.result import Identification
from patagium.learning.scores import json_ready
from patagium.report import Section, write_page
from patagium.robot import load_robot
from patagium.simulation import save_flight
from patagium.viewer import replay
from patagium.whole_file import write_whole
from patagium_lab.bench import overhead
from patagium_lab.conditions import conditions
from patagium_lab.measured import yeo
from patagium_lab.reproduction import figures, flights, subjects
from patagium_lab.reproduction.claims import claims
from patagium_lab.reproduction.errors import fly_case
from patagium_lab.reproduction.learning import Run, run_trial, write_samples
from patagium_lab.reproduction.plan import Plan
from patagium_lab.reproduction.report import TITLE, facts, results, sections, summary
from patagium_lab.reproduction.tables import start_spans
from patagium_lab.reproduction.targets import targets
from patagium_lab.reproduction.unsteady import (
    UnsteadyRun,
    fly_unsteady,
    run_unsteady_trial,
    unsteady_trials,
)
from patagium_lab.reproduction.unsteady_flights import MOUNTS
from patagium_lab.reproduction.unsteady_report import draw_unsteady, unsteady_scores
from patagium_lab.workers import Job, run_jobs

Stages = Callable[[str, float], None]
"""Told the stage and the part of all done, 0 to 1."""
ERROR_COST = 1.5
"""About how long a variant takes, most of it compiling the first time [s]."""
FLIGHT_COST = {"published": 4.0, "corrected": 5.0, "unsteady": 20.0}
"""The same of a flight and those that are not learned."""
Flown = dict[str, xr.Dataset]


@dataclass
class _Course:
    """Stages as they pass: their share of the whole, and the time they took."""

    progress: Stages | None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str, begin: float, end: float) -> Iterator[Callable[[float], None]]:
        def tell(part: float) -> None:
            if self.progress is not None:
                self.progress(name, begin + part * (end - begin))

        started = time.perf_counter()
        tell(0.0)
        yield tell
        self.seconds[name] = time.perf_counter() - started


def reproduce(
    out: Path,
    *,
    progress: Stages | None = None,
    quick: bool = False,
    crazyflie: Path | None = None,
    page: Path | None = None,
) -> Path:
    """Run everything and write the report.

    Learners run in two worker processes: a script that calls this needs the usual guard
    `if __name__ == "__main__":`.

    Args:
        out: Folder of the results, made if need be.
        progress: Told the stage and the part of all done.
        quick: Short flights and fewer runs: the same pages, rougher numbers.
        crazyflie: The log of a quadrotor, `log16.csv.gz`, for a section on it.
        page: A page of the results to write too, Markdown or HTML.

    Returns:
        Path of report.html; beside it metrics.json, the flights (*.nc, *.html) and figures/.
    """
    out.mkdir(parents=True, exist_ok=True)
    plan, course = Plan.of(quick), _Course(progress)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with course.stage("flying, learning, and errors one by one", 0.0, 0.8) as tell:
            work = _work(plan, folder, tell)
        flown, unseen, words, runs, unsteady, errors = work
        for key, flight in flown.items():
            save_flight(flight, out / f"{key}.nc")
    with course.stage("overheads", 0.8, 0.85):
        overheads = {
            "dynamics": overhead.dynamics_overhead(load_robot("aerobat"), plan.published_overhead),
            "aerodynamics": overhead.aerodynamics_overhead(plan.short_overhead),
        }
    with course.stage("measured data", 0.85, 0.9):
        studied, measured = _measured(plan, crazyflie)
    summaries = _summaries(flown, unseen)
    starts = [_brief(run, summaries["unseen_within"]) for run in runs if run.trial.starts]
    metrics: dict[str, Any] = {
        "environment": conditions(),
        "plan": plan.describe(),
        "choices": _choices(),
        "flights": summaries,
        "errors": errors,
        "learning": [run.scores for run in runs if run.trial.kind == "table"],
        "starts": starts,
        "start_spans": start_spans(starts),
        "limits": [_brief(run) for run in runs if run.trial.kind == "limit"],
        "unsteady": unsteady_scores(unsteady, words),
        "overhead": overheads,
        **studied,
        "left_out": plan.left_out,
    }
    with course.stage("drawing", 0.9, 0.99):
        gallery = _draw(out, metrics, flown, runs)
        draw_unsteady(gallery, metrics, unsteady)
        metrics["replays"] = {name: _replay(out, name, flown[name], runs) for name in flown}
    metrics["stages"] = course.seconds
    metrics["targets"] = targets(metrics)
    metrics["claims"] = claims(metrics)
    text = json.dumps(json_ready(metrics), indent=1, ensure_ascii=False)
    write_whole(out / "metrics.json", text + "\n")
    found, origin = summary(metrics), facts(metrics)
    whole = sections(metrics, gallery.pictures, measured)
    report = write_page(out / "report.html", TITLE, whole, summary=found, facts=origin)
    if page is not None:
        write_page(page, TITLE, results(metrics, gallery.vectors()), summary=found, facts=origin)
    if progress is not None:
        progress("done", 1.0)
    return report


def fly_known(
    key: str, duration: float, unseen_duration: float, folder: Path
) -> tuple[xr.Dataset, Flown]:
    """A flight through air without memory, and gaits that are not learned, in a worker.

    Args:
        key: "published" or "corrected".
        duration: Of the flight that is learned [s].
        unseen_duration: Of each other [s].
        folder: Where the samples go.
    """
    flight, unseen = flights.FLIGHTS[key](duration, unseen_duration)
    write_samples(folder, key, flight, unseen, 1.0 / flights.beat_frequency(flight))
    return flight, unseen


class _Work(NamedTuple):
    """What the workers gave.

    Attributes:
        flown: Flights that are learned.
        unseen: Gaits that are not.
        words: Unsteady flights in numbers.
        runs: Trials in air without memory.
        unsteady: Trials in air with it.
        errors: Variants of the errors, by table.
    """

    flown: Flown
    unseen: dict[str, Flown]
    words: dict[str, Any]
    runs: list[Run]
    unsteady: list[UnsteadyRun]
    errors: dict[str, list[dict[str, Any]]]


def _work(plan: Plan, folder: Path, tell: Callable[[float], None]) -> _Work:
    """Flights, trials on each as soon as it was flown, errors, rivals of the dynamics compiled."""
    keys, spans = [*flights.FLIGHTS, *MOUNTS], (plan.duration, plan.unseen_duration)
    slow = (plan.unsteady_duration, plan.unsteady_unseen_duration)
    trials, cases = plan.trials(), plan.error_cases()
    others = unsteady_trials(plan.unsteady_every, plan.unsteady_starts)
    jobs = [Job(fly_known, (key, *spans, folder), FLIGHT_COST[key]) for key in flights.FLIGHTS]
    jobs += [Job(fly_unsteady, (key, *slow, folder), FLIGHT_COST["unsteady"]) for key in MOUNTS]
    jobs += [Job(run_trial, (t, folder), t.cost, (keys.index(t.flight),)) for t in trials]
    jobs += [Job(run_unsteady_trial, (t, folder), t.cost, (keys.index(t.mount),)) for t in others]
    jobs += [Job(fly_case, (case, plan.duration), ERROR_COST) for case in cases]
    ahead = overhead.compiled_ahead(plan.published_overhead, plan.short_overhead)
    results = iter(run_jobs([*jobs, *ahead], tell))
    known, unsteady = (list(islice(results, len(part))) for part in (flights.FLIGHTS, MOUNTS))
    runs, unsteady_runs = (list(islice(results, len(part))) for part in (trials, others))
    tables = {case.table: list[dict[str, Any]]() for case in cases}
    for row in islice(results, len(cases)):
        tables[row.pop("table")].append(row)
    flown = {key: flight for key, (flight, _) in zip(flights.FLIGHTS, known, strict=True)}
    flown |= {f"unsteady_{key}": found[0] for key, found in zip(MOUNTS, unsteady, strict=True)}
    unseen = {key: found[1] for key, found in zip(flights.FLIGHTS, known, strict=True)}
    words = {key: found[1] for key, found in zip(MOUNTS, unsteady, strict=True)}
    return _Work(flown, unseen, words, runs, unsteady_runs, tables)


def _measured(plan: Plan, crazyflie: Path | None) -> tuple[dict[str, Any], list[Section]]:
    """Studies of measured data: the Yeo wing always, the quadrotor where its log is given."""
    wing = yeo.yeo_study(plan.yeo_cycles)
    metrics: dict[str, Any] = {"yeo": wing.scores}
    pages = yeo.yeo_sections(wing)
    if crazyflie is not None:
        from patagium_lab.measured.crazyflie import crazyflie_sections, crazyflie_study

        log = crazyflie_study(crazyflie)
        metrics["crazyflie"] = {"rows": log.rows, "samples": log.samples, "gaps": log.gaps}
        pages += crazyflie_sections(log)
    return metrics, pages


def _summaries(flown: Flown, unseen: dict[str, Flown]) -> dict[str, Any]:
    summaries: dict[str, Any] = {name: flights.summary(flown[name]) for name in unseen}
    summaries["unseen"] = {
        key: {name: flights.summary(flight) for name, flight in group.items()}
        for key, group in unseen.items()
    }
    for word in ("within", "beyond"):
        summaries[f"unseen_{word}"] = {
            name: flights.unseen_gaits(summaries[name], summaries["unseen"][name], word)
            for name in unseen
        }
    return summaries


def _draw(
    out: Path, metrics: dict[str, Any], flown: dict[str, xr.Dataset], runs: list[Run]
) -> figures.Gallery:
    gallery = figures.Gallery(out / "figures")
    table = [run for run in runs if run.trial.kind == "table"]
    for name in flights.FLIGHTS:
        flight = flown[name]
        figures.overview_figure(gallery, name, flight)
        best = subjects.STRIPS[name][0]
        mine = [run for run in table if run.trial.flight == name]
        kept = {run.trial.network: run.record for run in mine if run.record is not None}
        shown = {"strip network": kept[best], "dense network": kept["dense"]}
        figures.force_figures(gallery, name, shown, 1.0 / flights.beat_frequency(flight))
        figures.innovation_figure(gallery, name, kept[best])
        figures.curve_figure(gallery, name, mine)
        frozen = {
            subjects.NETWORKS.get(run.trial.network, "100 random features"): run
            for run in mine
            if run.trial.every == 100 and run.trial.learner in ("cubature", "features")
        }
        figures.unseen_figure(gallery, name, frozen)
    figures.overhead_figures(gallery, metrics["overhead"])
    return gallery


def _replay(out: Path, name: str, flight: xr.Dataset, runs: list[Run]) -> str:
    """A flight in three dimensions, with the forces that a strip network predicted, if one did."""
    best = subjects.STRIPS.get(name, ("",))[0]
    found = [
        Identification(run.scores, run.record, run.model)
        for run in runs
        if (run.trial.flight, run.trial.network) == (name, best) and run.record is not None
    ]
    title = f"The {name.replace('_', ' ')} flight" + (", and its forces as predicted" * bool(found))
    predicted = found[0] if found else None
    return replay(flight, out / f"{name}.html", predicted=predicted, title=title).name


def _brief(run: Run, within: Mapping[str, Sequence[str]] | None = None) -> dict[str, Any]:
    """Scores of a run that stands in a table as one line.

    Args:
        run: The run.
        within: Flight to the unseen gaits whose worst error is wanted.
    """
    brief = {key: value for key, value in run.scores.items() if key not in ("curve", "unseen")}
    if within is None:
        return brief
    gaits = [run.scores["unseen"][gait]["worst"] for gait in within[run.trial.flight]]
    return brief | {"unseen_worst": max(gaits, default=math.nan)}


def _choices() -> dict[str, Any]:
    """Every number a person chose, for the report."""
    return {
        "spread": subjects.SPREAD,
        "weight_std": subjects.WEIGHT_DEVIATION,
        "strip_std": {name: subject.strip_std for name, subject in subjects.SUBJECTS.items()},
        "coefficient_scale": {
            name: subject.coefficient_scale for name, subject in subjects.SUBJECTS.items()
        },
        "dense_prior": subjects.DENSE_PRIOR,
        "dense_noise": subjects.DENSE_NOISE,
        "memory": subjects.MEMORY,
        "least_memory": subjects.LEAST_MEMORY,
        "steps_of_gradient": dict(subjects.STEP),
    }
