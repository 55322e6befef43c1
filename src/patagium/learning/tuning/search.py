"""Where to look for good settings: everywhere at first, then closer and closer to the best.

Half of the trials fill all ranges evenly (Sobol points) and are held against a piece of the
samples; the best quarter of them goes over all samples. The other half comes in rounds, each
in a box around the best so far, half as wide as the round before. All is fixed by the seed;
nothing depends on the order in which trials end. Neglected: a model of the score.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, log2
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from patagium.errors import ParameterError

Array = NDArray[np.float64]

LEAST_TRIALS = 8
ROUNDS = 4
SURVIVORS = 4
"""One in so many of the first trials goes over all samples."""
FIRST_BOX = 0.25
"""Half width of the first box, of the whole range."""
KEPT = 0.75
"""Share of a round that keeps a choice as it is with the best."""


@dataclass(frozen=True)
class Asked:
    """A point to try, and over how much.

    Attributes:
        point: Coordinates between 0 and 1, (d,).
        whole: Whether over all samples, or over the piece.
    """

    point: Array
    whole: bool


Judge = Callable[[Sequence[Asked]], Sequence[float]]


def evaluations(trials: int) -> int:
    """How often a search of so many trials asks for a score."""
    first = trials // 2
    return trials + ceil(first / SURVIVORS)


def search(choosing: Sequence[bool], trials: int, seed: int, judge: Judge) -> list[Any]:
    """Points with their scores over all samples, the best first.

    Args:
        choosing: Of each coordinate, whether it chooses among values; the others are
            magnitudes.
        trials: Points to try.
        seed: Of the draw.
        judge: Scores of several points, larger is better, in their order.

    Raises:
        ParameterError: If the trials are too few.
    """
    if trials < LEAST_TRIALS:
        raise ParameterError("trials", f"at least {LEAST_TRIALS}", trials)
    first = trials // 2
    points = _draw(len(choosing), first, seed)
    scores = judge([Asked(point, whole=False) for point in points])
    order = sorted(range(first), key=lambda k: -scores[k])
    found = _judged([points[k] for k in order[: ceil(first / SURVIVORS)]], judge)
    for number, count in enumerate(_shares(trials - first, ROUNDS)):
        best = max(found, key=lambda pair: pair[1])[0]
        width = FIRST_BOX / 2**number
        near = _near(best, _draw(len(choosing), count, seed + 1 + number), width, choosing)
        found += _judged(list(near), judge)
    return sorted(found, key=lambda pair: -pair[1])


def _judged(points: list[Array], judge: Judge) -> list[tuple[Array, float]]:
    scores = judge([Asked(point, whole=True) for point in points])
    return list(zip(points, scores, strict=True))


def _near(best: Array, draw: Array, width: float, choosing: Sequence[bool]) -> Array:
    """Points around the best: magnitudes within the width, most choices as they are."""
    low, high = np.clip(best - width, 0.0, 1.0), np.clip(best + width, 0.0, 1.0)
    moved = low + (high - low) * draw
    chosen = np.where(draw < KEPT, best, (draw - KEPT) / (1 - KEPT))
    return np.where(np.asarray(choosing, bool), chosen, moved)


def _draw(axes: int, count: int, seed: int) -> Array:
    """Evenly spread points, (count, axes)."""
    whole = qmc.Sobol(axes, seed=seed).random_base2(ceil(log2(max(count, 1))))
    return np.asarray(whole[:count])


def _shares(total: int, parts: int) -> list[int]:
    """A whole number as nearly equal parts, none of them zero."""
    shares = [total // parts + (k < total % parts) for k in range(parts)]
    return [share for share in shares if share]
