"""Plan of the comparison of learners: how long, how many settings, which learners."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from patagium.errors import ParameterError
from patagium_lab.jobs import WORKERS
from patagium_lab.learners.data_sets import DataSet
from patagium_lab.learners.entries import ENTRIES, Entry, entries_of


@dataclass(frozen=True)
class LearnersPlan:
    """Plan of the comparison.

    Attributes:
        after: Times of flight after which errors are given [s].
        tuning: Duration of the first part of a data set, on which settings are chosen [s].
        draws: Number of settings tried for each entry.
        limit: Processor time of an entry on one data set, after its first sample [s].
        twin_limit: Processor time of an entry that is the same filter as another [s].
        seed: Seed of the settings and of the first weights.
        only: Keys of the entries that take part; empty: all.
        log: Log of a quadrotor, `log16.csv.gz`, as a further data set.
        workers: Number of processes; 0: everything runs in this process.

    Raises:
        ParameterError: If there is no entry of a key.
    """

    after: tuple[float, ...] = (0.1, 0.5, 2.0, 10.0)
    tuning: float = 1.0
    draws: int = 16
    limit: float = 40.0
    twin_limit: float = 10.0
    seed: int = 0
    only: tuple[str, ...] = ()
    log: Path | None = None
    workers: int = WORKERS

    def __post_init__(self) -> None:
        known = [one.key for one in ENTRIES]
        for key in self.only:
            if key not in known:
                raise ParameterError("entry", f"one of {', '.join(known)}", key)

    def quick(self) -> LearnersPlan:
        """Plan of a comparison of about a minute."""
        return replace(self, after=(0.05, 0.1, 0.3), tuning=0.1, draws=4, limit=2.0, twin_limit=2.0)

    def entries(self, data: DataSet) -> list[Entry]:
        """Entries that take part on a data set.

        Args:
            data: The data set.
        """
        return [one for one in entries_of(data) if not self.only or one.key in self.only]

    def describe(self) -> dict[str, Any]:
        """The plan as JSON-able values."""
        names = ("after", "tuning", "draws", "limit", "twin_limit")
        return {name: getattr(self, name) for name in names}
