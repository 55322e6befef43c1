"""Plan of the stress study: how many faults and logs, and how long the runs are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from patagium.errors import ParameterError
from patagium_lab.jobs import WORKERS
from patagium_lab.stress.endurance import GLIDE, UPDATES


@dataclass(frozen=True)
class StressPlan:
    """Plan of the stress study.

    Attributes:
        runs: Number of runs of the fault campaign.
        seed: Seed of the campaign.
        log: Log of a quadrotor for the calibration; None: the calibration goes without it.
        glide: Samples of the steady glide.
        updates: Updates in each precision.
        captures: Number of made-up logs of motion capture.
        workers: Number of processes.

    Raises:
        ParameterError: If there are no runs or no workers.
    """

    runs: int = 1000
    seed: int = 0
    log: Path | None = None
    glide: int = GLIDE
    updates: int = UPDATES
    workers: int = WORKERS
    captures: int = 200

    def __post_init__(self) -> None:
        for name, value in (
            ("runs", self.runs),
            ("jobs", self.workers),
            ("captures", self.captures),
        ):
            if value < 1:
                raise ParameterError(name, "a positive integer", value)
