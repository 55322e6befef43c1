"""Figures of the study's rows, and the limits that they are held against."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from patagium.report import cell_text
from patagium_lab.foreign.subjects import DRAG, FREE, LATTICE, MOUNTED
from patagium_lab.foreign.trials import BEST, PHYSICS, SEARCH
from patagium_lab.study import Row

LIMITS = {LATTICE: (0.002, 0.02), MOUNTED: (0.03, 0.05), FREE: (0.1, 0.2), DRAG: (0.1, 0.2)}
"""Largest error of the worst output, known and unseen, that the default learner may have."""
COVERED = ((0.88, 0.99), (0.80, 0.995))
"""Least and largest share of the truth in the 95 % interval, known and unseen."""
HALVES = ("known", "unseen")
"""Parts of a row: the flight that was learned, and others."""
HELD = "held"
"""Name of the held sample among the contestants."""
_MISS = " *"  # behind a figure that misses its limit


def held_rows(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Rows of the held sample, as those of a contestant, from the rows of physics alone.

    Args:
        rows: Rows of `run_trial`.
    """
    found = []
    for row in rows:
        if row["contestant"] == PHYSICS:
            known, *unseen = (
                {"worst": one["held"], "mean": None, "coverage": None, "held": one["held"]}
                for one in (row["known"], *row["unseen"])
            )
            found.append({**row, "contestant": HELD, "known": known, "unseen": unseen})
    return found


def best_rows(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Rows of the best trial of each search, as those of a contestant.

    Args:
        rows: Rows of `run_trial`.
    """
    found = [row for row in rows if row["contestant"] == SEARCH]
    return [{**row, **row[BEST], "contestant": BEST} for row in found]


def figures(rows: Sequence[Row], half: str, key: str) -> Any:
    """A figure of every flight, (k,); an error that is not finite is infinite.

    Args:
        rows: Rows of `run_trial`.
        half: "known" or "unseen".
        key: Such as "worst".
    """
    parts = [one for row in rows for one in ([row[half]] if half == "known" else row[half])]
    lost = np.nan if key == "coverage" else np.inf
    return np.array([lost if one[key] is None else one[key] for one in parts], float)


def marked(value: float, air: str, half: str, key: str) -> str:
    """Text of a number, with a star where it is above its limit.

    Args:
        value: The figure.
        air: Kind of air.
        half: "known" or "unseen".
        key: "worst", "mean" or "coverage".
    """
    if np.isnan(value) or (key == "mean" and np.isinf(value)):
        return "–"
    place = HALVES.index(half)
    low, high = COVERED[place]
    missed = {
        "worst": value > LIMITS[air][place],
        "coverage": not low <= value <= high,
        "mean": False,
    }
    return cell_text(value) + _MISS * missed[key]
