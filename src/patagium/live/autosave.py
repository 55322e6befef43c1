"""Saver of a learner's state from time to time while it learns.

A save takes its time between two samples; nothing is saved while a sample is learned.
"""

from __future__ import annotations

import time
from pathlib import Path

from patagium.errors import OutputError, positive
from patagium.learning.learners.filter_learner import FilterLearner


class AutoSave:
    """Saver of a learner in a file, at most once in so many seconds.

    A disk that is full or gone does not stop a learner: `failures` counts, `problem` says.

    Args:
        learner: Learner, saved in its present state.
        path: The file, replaced whole or not at all.
        seconds: From the end of one save to the beginning of the next, all in [s].

    Raises:
        ParameterError: If `seconds` is not a positive number.
    """

    def __init__(self, learner: FilterLearner, path: str | Path, seconds: float) -> None:
        self.learner, self.path = learner, Path(path)
        self.seconds = positive("seconds", seconds)
        self.saves, self.failures, self.problem = 0, 0, ""
        self._saved_count = learner.count
        self._next = time.monotonic() + self.seconds

    def tick(self) -> bool:
        """Save if it is due; call it between samples, as often as you like.

        Returns:
            Whether it was saved.
        """
        if time.monotonic() < self._next or self.learner.count == self._saved_count:
            return False
        try:
            self.save()
        except OutputError as problem:
            self.failures, self.problem = self.failures + 1, str(problem)
        return not self.problem

    def save(self) -> Path:
        """Save the learner now, as at the end.

        Returns:
            The path.

        Raises:
            OutputError: If it cannot be written; the file is then as it was.
        """
        count = self.learner.count
        try:
            self.learner.save(self.path)
        finally:
            self._next = time.monotonic() + self.seconds
        self.saves, self.problem, self._saved_count = self.saves + 1, "", count
        return self.path
