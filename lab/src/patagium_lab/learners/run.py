"""Run of the comparison of learners: settings searched alike, errors and times measured alike.

First the settings of every entry are searched on the first part of a data set, and the entry learns
the whole data set with the best of them. Entries that take a twin's settings follow. Both run in
worker processes. Last, in one process on one core with none of our other processes, updates of all
entries are timed in turns. Neglected: several starts of the weights.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from time import perf_counter_ns
from typing import Any

import numpy as np

from patagium_lab.conditions import conditions, load_average
from patagium_lab.jobs import Job, run_jobs
from patagium_lab.learners.data_sets import DataSet, flight_data, load_data, log_data
from patagium_lab.learners.entries import Entry, entry
from patagium_lab.learners.plan import LearnersPlan
from patagium_lab.learners.trial import run_trial, search_settings
from patagium_lab.study import Stages
from patagium_lab.timing import one_core

ROUNDS = 7
"""Number of turns of each entry when updates are timed."""
TURN = 0.05
"""Duration of a turn, which has one update at least [s]."""
WARM = 5
"""Updates before the first turn."""
_COST = {"extended": 200.0, "replay": 50.0, "rebayes": 40.0}
Key = tuple[str, str]
"""Name of a data set and key of an entry."""
Chosen = tuple[dict[str, float], float]
"""Settings of an entry, and the factor on its standard deviations."""


def run(plan: LearnersPlan, stages: Stages) -> dict[str, Any]:
    """Results of every entry on both flights and on the log, if there is one.

    Args:
        plan: What is compared.
        stages: Receives progress.

    Returns:
        See `compare`.
    """
    with stages.stage("flown", 0.0, 0.0):
        data = [flight_data(name, plan.after[-1]) for name in ("published", "corrected")]
        data += [] if plan.log is None else [log_data(plan.log)]
    return compare(data, plan, stages)


def compare(data: Sequence[DataSet], plan: LearnersPlan, stages: Stages) -> dict[str, Any]:
    """Results of every entry on every data set.

    Args:
        data: Data sets.
        plan: What is compared.
        stages: Receives progress.

    Returns:
        `conditions` that the figures depend on; `plan`; and `courses`, for each data set its
        key, title, note, horizons and rows. The row of an entry has the keys key, title, program,
        weights, setting, microseconds, errors, factor, coverage, scaled, samples, outcome.
    """
    before = load_average()
    entries = {one.name: plan.entries(one) for one in data}
    there = [(name, e) for name, all_ in entries.items() for e in all_ if e.installed]
    own = [(name, e.key) for name, e in there if not e.twin]
    own = sorted({(name, e.twin) for name, e in there if e.twin} - set(own)) + own
    twins = [(name, e.key) for name, e in there if e.twin]
    with tempfile.TemporaryDirectory() as folder:
        paths = {one.name: one.save(Path(folder)) for one in data}
        with stages.stage("tuned", 0.0, 0.6) as tell:
            found = _learn(own, paths, plan, tell, {})
        with stages.stage("twins", 0.6, 0.9) as tell:
            chosen = {(n, k): _chosen(found[n, entry(k).twin]) for n, k in twins}
            found |= _learn(twins, paths, plan, tell, chosen)
        with stages.stage("timed", 0.9, 1.0):
            _time(paths, entries, plan, found)
    stages.tell("done", 1.0)
    return {
        "conditions": {"load average at the start": before, **conditions()},
        "plan": plan.describe(),
        "courses": [_data_set(one, entries[one.name], found) for one in data],
    }


def _learn(
    keys: Sequence[Key],
    paths: Mapping[str, Path],
    plan: LearnersPlan,
    tell: Callable[[float], None],
    chosen: Mapping[Key, Chosen],
) -> dict[Key, dict[str, Any]]:
    """Result of each entry on its data set."""
    jobs = [
        Job(learn, (paths[name], key, plan, chosen.get((name, key))), _COST.get(key, 10.0))
        for name, key in keys
    ]
    return dict(zip(keys, run_jobs(jobs, tell, plan.workers), strict=True))


def learn(path: Path, key: str, plan: LearnersPlan, chosen: Chosen | None = None) -> dict[str, Any]:
    """Result of an entry on a data set, with the best of many settings or with those given.

    Args:
        path: File of the data set.
        key: Key of the entry.
        plan: What is compared.
        chosen: Settings, and the factor on the standard deviations; None: they are searched.
    """
    data = load_data(path)
    settings, factor = chosen or search_settings(entry(key), data, plan)
    found = run_trial(entry(key), data, settings, factor, plan)
    return {"setting": settings, "factor": factor, **found}


def _chosen(result: Mapping[str, Any]) -> Chosen:
    return result["setting"], result["factor"]


def _time(
    paths: Mapping[str, Path],
    entries: Mapping[str, Sequence[Entry]],
    plan: LearnersPlan,
    found: dict[Key, dict[str, Any]],
) -> None:
    """Write the time of an update into the results."""
    jobs = []
    for name, all_ in entries.items():
        keys = [e.key for e in all_ if e.installed and e.key != "persistence"]
        settings = {key: found[name, key]["setting"] for key in keys}
        jobs.append(Job(update_times, (paths[name], settings, plan.seed), 10.0))
    times = run_jobs(jobs, None, min(plan.workers, 1))
    for name, of_entries in zip(entries, times, strict=True):
        for key, microseconds in of_entries.items():
            found[name, key]["microseconds"] = microseconds


def update_times(
    path: Path, settings: Mapping[str, Mapping[str, float]], seed: int
) -> dict[str, float]:
    """Median time of an update of each entry, in turns, on one core [us].

    Args:
        path: File of the data set.
        settings: Settings of each entry.
        seed: Seed of the first weights.
    """
    data = load_data(path)
    durations: dict[str, list[int]] = {key: [] for key in settings}
    with one_core(), np.errstate(all="ignore"):
        turns = {
            key: _Turn(data, entry(key).build(data, one, seed)) for key, one in settings.items()
        }
        for _ in range(ROUNDS):
            for key, turn in turns.items():
                durations[key] += turn.take()
    return {key: float(np.median(all_)) * 1e-3 for key, all_ in durations.items()}


class _Turn:
    """Updates of one learner along the start of a data set, again and again."""

    def __init__(self, data: DataSet, learner: Any) -> None:
        self._data, self._learner, self._next = data, learner, 0
        for _ in range(2):
            self._update()
        self._count = int(np.clip(TURN / (self._update() * 1e-9), 1, 300))
        for _ in range(min(WARM, self._count)):
            self._update()

    def take(self) -> list[int]:
        """Durations of the updates of a turn [ns]."""
        return [self._update() for _ in range(self._count)]

    def _update(self) -> int:
        data = self._data
        index = self._next = (self._next + data.every) % min(len(data.clock), 5_000)
        x, y = data.x[index], data.y[index]
        started = perf_counter_ns()
        self._learner.update(x, y)
        return perf_counter_ns() - started


def _data_set(
    data: DataSet, entries: Sequence[Entry], found: Mapping[Key, Mapping[str, Any]]
) -> dict[str, Any]:
    return {
        "key": data.name,
        "title": data.title,
        "note": data.note,
        "beat_name": data.beat_name,
        "beat": data.beat,
        "hold": data.every * data.step,
        "rows": [_row(data, one, found.get((data.name, one.key))) for one in entries],
    }


def _row(data: DataSet, one: Entry, result: Mapping[str, Any] | None) -> dict[str, Any]:
    row: dict[str, Any] = {
        "key": one.key,
        "title": one.title,
        "program": one.program if one.package != "patagium" else "patagium",
        "weights": one.weights(data),
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
