"""Trials of the study: a contestant learns a flight and is scored on others with frozen weights.

The search for settings is that of `patagium tune`, for each flight anew: its pick is scored like
a contestant, and so is the best of its trials on the half that is scored, which nobody can know
beforehand.

Results are kept as JSON files, so that a study that is run again goes on where it stopped, and a
new contestant alone is computed. Neglected: chance; each trial runs once.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from patagium.errors import FilterDiverged, LogError, Outcome, PatagiumError
from patagium.learning.default_learner import default_network
from patagium.learning.identify import evaluate, identify
from patagium.learning.learners.learner import Learner
from patagium.learning.learners.registry import make_learner
from patagium.learning.result import Identification
from patagium.learning.tuning.tune import tune
from patagium.reading import json_ready
from patagium.whole_file import write_whole
from patagium_lab.foreign.contestants import CONTESTANTS, physics
from patagium_lab.foreign.flights import Case, kept_flight

PHYSICS = "physics"
"""Name of the contestant that learns nothing."""
SEARCH = "search"
"""Name of the contestant whose settings are searched."""
BEST = "best"
"""Key of the best of the trials of a search in its row."""
REFITTED = 8
"""Trials of a search, those with the least mean error on the scored half, that are scored by the
worst output."""
_LOST = {"worst": math.inf, "mean": math.inf, "coverage": 0.0, "held": None}
_WORST = "nmse_second_half_worst"
_SEARCHED = "extended"  # kind of the learner that is searched, the default's


@dataclass(frozen=True)
class Trial:
    """A contestant, a flight that it learns, and flights that it never sees.

    Attributes:
        contestant: Key of `CONTESTANTS`, `PHYSICS` or `SEARCH`.
        learned: Flight that is learned.
        unseen: Flights of the same robot, on which the frozen weights are scored.
        every: One sample in so many is used.
        search: Number of trials of the search, of `SEARCH` alone.
    """

    contestant: str
    learned: Case
    unseen: tuple[Case, ...]
    every: int
    search: int = 0

    def path(self, folder: Path) -> Path:
        """File of the result.

        Args:
            folder: Folder of the study.
        """
        case = self.learned
        others = "-".join(one.name for one in self.unseen)
        name = f"{case.robot}_{case.name}_{others}_{case.seed}_{self.every}.json"
        kind = f"{self.contestant}-{self.search}" if self.search else self.contestant
        return folder / "trials" / kind / case.air / name


def run_trial(trial: Trial, flights: Path, folder: Path) -> dict[str, Any]:
    """Row of a trial, from its file where it was run before.

    Args:
        trial: The trial.
        flights: Folder of the flights.
        folder: Folder of the study.

    Returns:
        Row with the trial, `known` (second half, predicted before use) and `unseen` (a list): the
        keys worst, mean, coverage and held; `outcome`, and `update`, the seconds of an update;
        `distances`, those of the unseen flights. The row of a search has a row `BEST` besides.
    """
    path = trial.path(folder)
    if path.is_file():
        kept: dict[str, Any] = json.loads(path.read_text("utf-8"))
        return kept
    flight = kept_flight(trial.learned, flights)
    unseen = [kept_flight(one, flights) for one in trial.unseen]
    row = {"contestant": trial.contestant, **asdict(trial.learned)}
    row["distances"] = [one.distance for one in trial.unseen]
    score = {PHYSICS: _physics, SEARCH: _searched}.get(trial.contestant, _learned)
    row |= score(trial, flight, unseen)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps(json_ready(row), indent=1) + "\n")
    found: dict[str, Any] = json_ready(row)
    return found


def _physics(trial: Trial, flight: xr.Dataset, unseen: list[xr.Dataset]) -> dict[str, Any]:
    """Scores of physics alone, and of the held sample."""
    scores = [evaluate(one, physics(one), every=trial.every).scores for one in (flight, *unseen)]
    return {
        "known": _row(scores[0], "_second_half"),
        "unseen": [_row(one, "") for one in scores[1:]],
        "outcome": Outcome.COMPLETED.name,
        "update": None,
    }


def _learned(trial: Trial, flight: xr.Dataset, unseen: list[xr.Dataset]) -> dict[str, Any]:
    learner = CONTESTANTS[trial.contestant].make(flight)
    return _scored(trial, identify(flight, learner, every=trial.every), unseen)


def _searched(trial: Trial, flight: xr.Dataset, unseen: list[xr.Dataset]) -> dict[str, Any]:
    """Scores of the settings that a search picks, and of the best of its trials."""
    network = default_network(flight)
    try:
        found = tune(
            flight, network, every=trial.every, trials=trial.search, learner=_SEARCHED, jobs=1
        )
    except LogError as problem:  # all trials were refused
        lost = {"known": _LOST, "unseen": [_LOST] * len(unseen), "update": None}
        return lost | {BEST: {**lost, "settings": {}}, "outcome": str(problem)}
    best, settings = _identified(trial, flight, found.learner()), found.trials[0].values
    picked = _scored(trial, best, unseen) | {"settings": settings, "rule": found.rule}
    finished = [one for one in found.trials if not one.prediction.reason]
    for one in sorted(finished, key=lambda one: one.prediction.nmse_second_half)[:REFITTED]:
        learner = make_learner(_SEARCHED, network, one.values, found.best.learner.seed)
        result = _identified(trial, flight, learner)
        if result.scores[_WORST] < best.scores[_WORST]:
            best, settings = result, one.values
    return picked | {BEST: _scored(trial, best, unseen) | {"settings": settings}}


def _identified(trial: Trial, flight: xr.Dataset, learner: Learner) -> Identification:
    return identify(flight, learner, every=trial.every)


def _scored(trial: Trial, result: Identification, unseen: list[xr.Dataset]) -> dict[str, Any]:
    """Scores of what was learned, and of its frozen weights on unseen flights."""
    rows = []
    for one in unseen:
        try:
            rows.append(_row(evaluate(one, result.learner, every=trial.every).scores, ""))
        except (FilterDiverged, PatagiumError, ArithmeticError):
            rows.append(_LOST)
    return {
        "known": _row(result.scores, "_second_half"),
        "unseen": rows,
        "outcome": result.outcome.name,
        "update": result.scores.get("time_per_update"),
    }


def _row(scores: Mapping[str, Any], half: str) -> dict[str, Any]:
    return {
        "worst": scores[f"nmse{half}_worst"],
        "mean": scores[f"nmse{half}_mean"],
        "coverage": scores.get(f"coverage{half}", math.nan),
        "held": scores[f"persistence{half}_worst"],
    }
