"""The bench of learners: everybody tuned alike, raced alike, timed in turns.

First every entry with something to choose has its setting searched on the first part of a
course and then runs along it; those that take a twin's setting follow. Both go on in worker
processes. Last, in one process on one core with nothing else of ours running, updates of all
are timed in turns. Neglected: several starts of the weights.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from time import perf_counter_ns
from typing import Any

import numpy as np

from patagium.errors import ParameterError
from patagium_lab.bench.result import Progress
from patagium_lab.conditions import conditions, load_average
from patagium_lab.jobs import WORKERS, Job, run_jobs
from patagium_lab.learners.data_sets import Course, load_course
from patagium_lab.learners.entries import ENTRIES, Entry, entries_of, entry
from patagium_lab.learners.race import RacePlan, race, search
from patagium_lab.timing import one_core

ROUNDS = 7
"""Times everybody's turn comes."""
TURN = 0.05
"""A turn lasts about so long, one update at least [s]."""
WARM = 5
"""Updates before the first turn."""
_COST = {"extended": 200.0, "low_rank": 100.0, "replay": 50.0, "rebayes": 40.0}
_PARTS = {"tuned": 0.6, "twins": 0.9, "timed": 1.0}
Keyed = dict[tuple[str, str], dict[str, Any]]


def run_learners(
    courses: Sequence[Course],
    plan: RacePlan,
    only: Sequence[str] | None = None,
    progress: Progress | None = None,
    workers: int = WORKERS,
) -> dict[str, Any]:
    """Everybody on every course.

    Args:
        courses: Where.
        plan: How much.
        only: Keys of entries; all by default.
        progress: Told the stage and the part of all done.
        workers: Number of processes; 0: all in this one.

    Returns:
        `conditions`: what the figures depend on; `courses`: of each its key, title, note,
        horizons and rows, one row an entry: key, title, program, weights, setting,
        microseconds, errors, factor, coverage, scaled, samples, outcome.

    Raises:
        ParameterError: If there is no entry of a key.
    """
    known = [one.key for one in ENTRIES]
    for key in only or ():
        if key not in known:
            raise ParameterError("entry", f"one of {', '.join(known)}", key)
    tell, before = progress or (lambda stage, part: None), load_average()
    chosen = {c.name: [e for e in entries_of(c) if not only or e.key in only] for c in courses}
    with tempfile.TemporaryDirectory() as folder:
        paths = {course.name: course.save(Path(folder)) for course in courses}
        found = _first(paths, chosen, plan, workers, tell)
        found |= _twins(paths, chosen, plan, workers, tell, found)
        _time(paths, chosen, plan, min(workers, 1), tell, found)
    tell("done", 1.0)
    return {
        "conditions": {
            "load average at the start": before,
            **conditions(),
        },
        "plan": {"after": plan.after, "tuning": plan.tuning, "draws": plan.draws,
                 "limit": plan.limit, "twin_limit": plan.twin_limit},
        "courses": [_course(c, chosen[c.name], found) for c in courses],
    }  # fmt: skip


def _first(
    paths: dict[str, Path],
    chosen: dict[str, list[Entry]],
    plan: RacePlan,
    workers: int,
    tell: Progress,
) -> Keyed:
    """Those with a setting of their own, and twins whose sibling is not there."""
    keys = [(n, e.key) for n, all_ in chosen.items() for e in all_ if e.installed and not e.twin]
    missing = {
        (name, one.twin)
        for name, all_ in chosen.items()
        for one in all_
        if one.installed and one.twin and (name, one.twin) not in keys
    }
    return _run(sorted(missing) + keys, tuned, paths, plan, workers, tell, "tuned", {})


def _twins(
    paths: dict[str, Path],
    chosen: dict[str, list[Entry]],
    plan: RacePlan,
    workers: int,
    tell: Progress,
    found: Keyed,
) -> Keyed:
    keys = [(n, e.key) for n, all_ in chosen.items() for e in all_ if e.installed and e.twin]
    settings = {(n, k): _chosen(found[n, entry(k).twin]) for n, k in keys}
    return _run(keys, raced, paths, plan, workers, tell, "twins", settings)


def _run(
    keys: list[tuple[str, str]],
    function: Any,
    paths: dict[str, Path],
    plan: RacePlan,
    workers: int,
    tell: Progress,
    stage: str,
    settings: dict[tuple[str, str], Any],
) -> Keyed:
    stages = list(_PARTS)
    begin = 0.0 if stage == stages[0] else _PARTS[stages[stages.index(stage) - 1]]
    tell(stage, begin)
    jobs = [
        Job(function, (paths[n], k, plan, settings.get((n, k))), _COST.get(k, 10.0))
        for n, k in keys
    ]
    along = partial(_between, tell, stage, begin, _PARTS[stage])
    return dict(zip(keys, _done(jobs, along, workers), strict=True))


def _done(jobs: list[Job], along: Any, workers: int) -> list[Any]:
    if workers and jobs:
        return run_jobs(jobs, along, workers)
    return [job.function(*job.arguments) for job in jobs]


def _between(tell: Progress, stage: str, begin: float, end: float, part: float) -> None:
    tell(stage, begin + part * (end - begin))


def tuned(path: Path, key: str, plan: RacePlan, _: None = None) -> dict[str, Any]:
    """An entry's setting searched, and its race with it.

    Args:
        path: Of the course.
        key: Of the entry.
        plan: How much.
    """
    return raced(path, key, plan, search(entry(key), load_course(path), plan))


def _chosen(result: dict[str, Any]) -> tuple[dict[str, float], float]:
    return result["setting"], result["factor"]


def raced(
    path: Path, key: str, plan: RacePlan, chosen: tuple[dict[str, float], float]
) -> dict[str, Any]:
    """An entry's race with a setting.

    Args:
        path: Of the course.
        key: Of the entry.
        plan: How much.
        chosen: The setting, and the factor on its deviations.
    """
    setting, factor = chosen
    found = race(entry(key), load_course(path), setting, factor, plan)
    return {"setting": setting, "factor": factor, **found}


def _time(
    paths: dict[str, Path],
    chosen: dict[str, list[Entry]],
    plan: RacePlan,
    workers: int,
    tell: Progress,
    found: Keyed,
) -> None:
    tell("timed", _PARTS["twins"])
    jobs = []
    for name, entries in chosen.items():
        own = [e.key for e in entries if e.installed and e.key != "persistence"]
        settings = {key: found[name, key]["setting"] for key in own}
        jobs.append(Job(timed, (paths[name], settings, plan.seed), 10.0))
    for name, times in zip(chosen, _done(jobs, None, workers), strict=True):
        for key, microseconds in times.items():
            found[name, key]["microseconds"] = microseconds


def timed(path: Path, settings: dict[str, dict[str, float]], seed: int) -> dict[str, float]:
    """Median time of an update of each, in turns, on one core [us].

    Args:
        path: Of the course.
        settings: Entry to what was chosen for it.
        seed: Of the weights to start from.
    """
    course, durations = load_course(path), {key: [] for key in settings}  # type: ignore[var-annotated]
    with one_core(), np.errstate(all="ignore"):
        entrants = {key: entry(key).build(course, one, seed) for key, one in settings.items()}
        clocks = {key: _Turn(course, entrant) for key, entrant in entrants.items()}
        for _ in range(ROUNDS):
            for key, turn in clocks.items():
                durations[key] += turn.take()
    return {key: float(np.median(all_)) * 1e-3 for key, all_ in durations.items()}


class _Turn:
    """Updates of one entry along the start of a course, again and again."""

    def __init__(self, course: Course, entrant: Any) -> None:
        self._course, self._entrant, self._next = course, entrant, 0
        for _ in range(2):
            self._update()
        self._count = int(np.clip(TURN / (self._update() * 1e-9), 1, 300))
        for _ in range(min(WARM, self._count)):
            self._update()

    def take(self) -> list[int]:
        """Durations of the updates of a turn [ns]."""
        return [self._update() for _ in range(self._count)]

    def _update(self) -> int:
        course = self._course
        index = self._next = (self._next + course.every) % min(len(course.clock), 5_000)
        x, y = course.x[index], course.y[index]
        started = perf_counter_ns()
        self._entrant.update(x, y)
        return perf_counter_ns() - started


def _course(course: Course, entries: Sequence[Entry], found: Keyed) -> dict[str, Any]:
    return {
        "key": course.name,
        "title": course.title,
        "note": course.note,
        "beat_name": course.beat_name,
        "beat": course.beat,
        "hold": course.every * course.step,
        "rows": [_row(course, one, found.get((course.name, one.key))) for one in entries],
    }


def _row(course: Course, one: Entry, result: dict[str, Any] | None) -> dict[str, Any]:
    row: dict[str, Any] = {
        "key": one.key,
        "title": one.title,
        "program": one.program if one.package != "patagium" else "patagium",
        "weights": one.weights(course),
        "twin": one.twin,
        "setting": {},
        "microseconds": None,
        "errors": {},
        "factor": None,
        "coverage": None,
        "scaled": None,
        "samples": 0,
        "outcome": "not installed",
    }
    return {**row, **(result or {})}
