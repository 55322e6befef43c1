"""Trials of the study: a contestant learns a flight and is scored on others with frozen weights.

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

from patagium.errors import FilterDiverged, Outcome, PatagiumError
from patagium.learning.identify import evaluate, identify
from patagium.learning.scores import json_ready
from patagium.whole_file import write_whole
from patagium_lab.foreign.contestants import CONTESTANTS, physics
from patagium_lab.foreign.flights import Case, kept_flight

PHYSICS = "physics"
"""Name of the contestant that learns nothing."""


@dataclass(frozen=True)
class Trial:
    """A contestant, a flight that it learns, and flights that it never sees.

    Attributes:
        contestant: Key of `CONTESTANTS`, or `PHYSICS`.
        learned: Flight that is learned.
        unseen: Flights of the same robot, on which the frozen weights are scored.
        every: One sample in so many is used.
    """

    contestant: str
    learned: Case
    unseen: tuple[Case, ...]
    every: int

    def path(self, folder: Path) -> Path:
        """File of the result.

        Args:
            folder: Folder of the study.
        """
        case = self.learned
        others = "-".join(f"{one.gait:02d}" for one in self.unseen)
        name = f"{case.robot}_{case.gait:02d}_{others}_{case.seed}_{self.every}.json"
        return folder / "trials" / self.contestant / case.air / name


def run_trial(trial: Trial, flights: Path, folder: Path) -> dict[str, Any]:
    """Row of a trial, from its file where it was run before.

    Args:
        trial: The trial.
        flights: Folder of the flights.
        folder: Folder of the study.

    Returns:
        Row with the trial, `known` (second half, predicted before use) and `unseen` (a list): the
        keys worst, mean, coverage and held; `outcome`, and `update`, the seconds of an update.
    """
    path = trial.path(folder)
    if path.is_file():
        kept: dict[str, Any] = json.loads(path.read_text("utf-8"))
        return kept
    flight = kept_flight(trial.learned, flights)
    unseen = [kept_flight(one, flights) for one in trial.unseen]
    row = {"contestant": trial.contestant, **asdict(trial.learned)}
    score = _physics if trial.contestant == PHYSICS else _learned
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
    result = identify(flight, learner, every=trial.every)
    rows = []
    for one in unseen:
        try:
            rows.append(_row(evaluate(one, result.learner, every=trial.every).scores, ""))
        except (FilterDiverged, PatagiumError, ArithmeticError):
            rows.append({"worst": math.inf, "mean": math.inf, "coverage": 0.0, "held": None})
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
