"""Result of an identification: scores, predictions and the learner.

An `Identification` saves itself as one netCDF file and draws itself as one page.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import xarray as xr

from patagium.errors import LogError, Outcome
from patagium.learning.scores import json_ready
from patagium.whole_file import whole_file


@dataclass(frozen=True)
class Identification:
    """Model of the air as learned from a flight or a log, with its scores.

    Attributes:
        scores: NMSE and the rest by name; see `stream`. Nested once: score by output name.
        prediction: Dataset over time, output, update_time and check_time: measurement,
            prediction, persistence, innovation, weights_norm, largest_variance,
            predicted_std.
        learner: What learned, with its last weights; None when loaded from a file.
        outcome: COMPLETED, or why the learner stopped.
        message: When and why it stopped; empty if it did not.
    """

    scores: dict[str, Any]
    prediction: xr.Dataset
    learner: Any = field(default=None, repr=False)
    outcome: Outcome = Outcome.COMPLETED
    message: str = ""

    def save(self, path: str | Path) -> None:
        """Write scores and predictions as one netCDF file, whole or not at all.

        Args:
            path: The file.
        """
        record = self.prediction.copy()
        record.attrs = {**record.attrs, "scores": json.dumps(json_ready(self.scores))}
        record.attrs["format"] = "patagium identification 1"
        with whole_file(path) as draft:
            record.to_netcdf(draft, engine="netcdf4")

    def report(
        self, path: str | Path, title: str = "Identification", replay: str | None = None
    ) -> None:
        """Write a self-contained HTML page: the scores, and predictions against measurements.

        Args:
            path: The file.
            title: Its heading.
            replay: Address of the flight's replay, relative to the page, to be linked.
        """
        from patagium.learning.page import write_identification

        write_identification(self.scores, self.prediction, path, title, replay)


def load_identification(path: str | Path) -> Identification:
    """Scores and predictions from a file that `Identification.save` wrote.

    Raises:
        LogError: If the file is not one.
    """
    file = Path(path)
    try:
        with xr.open_dataset(file, engine="netcdf4", decode_times=False) as opened:
            record = opened.load()
    except (OSError, ValueError) as problem:
        raise LogError(f"{file}: expected an identification, found: {problem}") from problem
    if "scores" not in record.attrs:
        raise LogError(f"{file}: expected an identification, found a file without scores")
    scores = json.loads(record.attrs.pop("scores"))
    outcome = Outcome[scores.get("outcome", "COMPLETED")]
    return Identification(scores, record, None, outcome, scores.get("message", ""))
