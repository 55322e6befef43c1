"""Plan of the attack: areas, cases, and how long the runs of learners are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from patagium.errors import ParameterError
from patagium_lab.attack.endurance import GLIDE, UPDATES
from patagium_lab.jobs import WORKERS

HOSTILE = ("files", "packets", "loops", "calls", "options", "signals", "writes", "cache")
"""Areas of hostile cases, which are tallied."""
LEARNERS = ("poison", "faults", "damage", "calibration", "endurance", "captures")
"""Areas of learners and estimates under faults, which are scored."""
AREAS = HOSTILE + LEARNERS


@dataclass(frozen=True)
class AttackPlan:
    """Plan of the attack.

    Attributes:
        cases: Number of hostile cases, shared by the targets of all areas.
        runs: Number of runs of the fault campaign.
        seed: Seed of the cases and runs.
        areas: Areas to attack.
        log: Log of a quadrotor for the calibration; None: the calibration goes without it.
        glide: Samples of the steady glide.
        updates: Updates in each precision.
        workers: Number of processes.
        captures: Number of made-up logs of motion capture.
        poisoned: Samples with bursts of poison through each learner.

    Raises:
        ParameterError: If there are no cases, runs or workers, or an area is unknown.
    """

    cases: int = 100_000
    runs: int = 1000
    seed: int = 0
    areas: tuple[str, ...] = AREAS
    log: Path | None = None
    glide: int = GLIDE
    updates: int = UPDATES
    workers: int = WORKERS
    captures: int = 200
    poisoned: int = 1_000_000

    def __post_init__(self) -> None:
        for name, value in (
            ("cases", self.cases),
            ("runs", self.runs),
            ("jobs", self.workers),
            ("captures", self.captures),
        ):
            if value < 1:
                raise ParameterError(name, "a positive integer", value)
        for area in self.areas:
            if area not in AREAS:
                raise ParameterError("area", f"one of {', '.join(AREAS)}", area)
