"""Errors over spans for which the weights are kept, with the true states as inputs.

How long weights stay good once they are learned. It is no forecast: the network sees the states
of the span itself, which nobody knows beforehand.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from patagium.arrays import Array, thin
from patagium.learning.learners.learner import Learner
from patagium.learning.models.memory import ModelMemory
from patagium.learning.scores import ErrorSums, span_scores
from patagium.learning.stream import used_samples

MOST_AHEAD = 40_000
"""A span is scored over windows of about this many samples in all, spread evenly."""


class FrozenSpans:
    """Observer of a run that predicts spans after updates with the weights learned so far.

    Windows begin right after an update, do not cross a gap and end in the log.

    Args:
        durations: Label and length of each span [s].
        learner: Learner at work.
        time: Increasing, (N,) [s].
        y: Measurements, all finite, (N, n_y) [unit of y].
        every: One sample in so many is used.
        gaps: First sample after each gap.
    """

    def __init__(
        self,
        durations: Mapping[str, float],
        learner: Learner,
        time: Array,
        y: Array,
        every: int,
        gaps: Any = (),
    ) -> None:
        self._learner, self._y = learner, y
        self._durations, step = dict(durations), float(np.median(np.diff(time)))
        self._lengths = {name: max(1, round(d / step)) for name, d in durations.items()}
        used, edges = used_samples(y, every, gaps) + 1, np.asarray(gaps, int)
        self._begins: dict[str, set[int]] = {}
        self._windows: dict[str, list[tuple[int, Array]]] = {name: [] for name in durations}
        for name, length in self._lengths.items():
            begins = used[used + length <= len(y)]
            inside = np.searchsorted(edges, begins + length) - np.searchsorted(edges, begins)
            chosen = thin(begins[inside == 0], max(2, MOST_AHEAD // length))
            self._begins[name] = set(chosen.tolist())

    def before(self, begin: int, memory: ModelMemory) -> None:
        """Predict the spans that begin with an interval.

        Args:
            begin: First sample of the interval.
            memory: Memory of the network at the sample before; it stays there.
        """
        for name, length in self._lengths.items():
            if begin in self._begins[name]:
                weights = self._learner.weights
                rows = memory.ahead(begin + length, weights)
                ahead = self._learner.network.evaluate(rows, weights)
                self._windows[name].append((begin, ahead))

    def scores(self) -> dict[str, Any]:
        """Errors of each span, `horizon_<label>_nmse` and so on, whole and second half."""
        found: dict[str, Any] = {}
        names = self._learner.network.output_names
        for label, windows in self._windows.items():
            key, length = f"horizon_{label}", self._lengths[label]
            found |= {
                f"{key}_seconds": self._durations[label],
                f"{key}_samples": length,
                f"{key}_windows": len(windows),
            }
            if not windows:
                continue
            begins = np.array([begin for begin, _ in windows])
            truth = self._y[(begins[:, None] + np.arange(length)).ravel()]
            ahead = np.concatenate([part for _, part in windows])
            held = np.repeat(self._y[begins - 1], length, axis=0)
            for half, first in (("", 0), ("_second_half", len(truth) // 2)):
                sums = ErrorSums(len(names))
                sums.add(truth[first:], ahead[first:], held[first:])
                found |= span_scores(sums.nmse, names, f"{key}_nmse{half}")
                found |= span_scores(sums.persistence, names, f"{key}_persistence{half}")
        return found
