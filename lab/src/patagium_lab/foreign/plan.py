"""Plan of the study of foreign air: which air, which contestants, which flights."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from patagium.errors import ParameterError
from patagium.limits import LEAST_TRIALS
from patagium_lab.foreign.contestants import CONTESTANTS
from patagium_lab.foreign.flights import GAITS
from patagium_lab.foreign.subjects import LATTICE, MOUNTED, SUBJECTS
from patagium_lab.jobs import WORKERS

SEED = 13
"""Seed of the wingbeats and of what is kept apart."""


@dataclass(frozen=True)
class ForeignPlan:
    """Plan of the study of foreign air.

    Attributes:
        airs: Kinds of air, keys of `SUBJECTS`.
        robots: Names of robots and wings; empty: all.
        contestants: Names of contestants; physics alone and the held sample are always there.
        learned: Number of flights that are learned, of each robot and side of the split.
        unseen: Number of flights on which each learned model is then scored, frozen.
        near: Number of directions in which wingbeats near a learned one are flown, for one
            learned flight of each robot that is kept apart; 0: none.
        search: Number of trials of the search for settings on each learned flight; 0: none.
        every: One sample in so many is used.
        seed: Seed of the wingbeats and of the split.
        gaits_apart: Number of wingbeats of each robot that are kept apart.
        flights: Folder of the flights; None: a folder of the study's own.
        log: Log of the Crazyflie quadrotor; None: the study goes without it.
        real: Whether the measured wing, and the log if there is one, are learned too.
        workers: Number of processes.

    Raises:
        ParameterError: If a name is unknown or a number cannot be.
    """

    airs: tuple[str, ...] = tuple(SUBJECTS)
    robots: tuple[str, ...] = ()
    contestants: tuple[str, ...] = tuple(CONTESTANTS)
    learned: int = 2
    unseen: int = 2
    near: int = 2
    search: int = 0
    every: int = 10
    seed: int = SEED
    gaits_apart: int = 4
    flights: Path | None = None
    log: Path | None = None
    real: bool = True
    workers: int = WORKERS

    def __post_init__(self) -> None:
        named = {robot for air in SUBJECTS.values() for robot in air}
        for name, found, known in (
            ("air", self.airs, set(SUBJECTS)),
            ("robot", self.robots, named),
            ("contestant", self.contestants, set(CONTESTANTS)),
        ):
            for one in found:
                if one not in known:
                    raise ParameterError(name, f"one of {', '.join(sorted(known))}", one)
        for name, value, least, most in (
            ("learned", self.learned, 1, GAITS),
            ("unseen", self.unseen, 1, GAITS - 1),
            ("near", self.near, 0, 100),
            ("search", self.search or LEAST_TRIALS, LEAST_TRIALS, 10_000),
            ("every", self.every, 1, 1000),
        ):
            if not least <= value <= most:
                raise ParameterError(name, f"a whole number from {least} to {most}", value)
        if not 2 <= self.gaits_apart <= GAITS - 2:
            raise ParameterError("gaits_apart", f"from 2 to {GAITS - 2}", self.gaits_apart)

    def robots_apart(self, air: str) -> int:
        """Number of robots of a kind of air that are kept apart with all their wingbeats."""
        return 2 if len(SUBJECTS[air]) > 4 else 1


QUICK = ForeignPlan(
    airs=(MOUNTED, LATTICE),
    robots=("aerobat", "wing-slender"),
    contestants=("linear", "features", "strip", "turning"),
    learned=1,
    unseen=1,
    near=0,
    real=False,
)
"""Plan of a first look, of about a minute."""
