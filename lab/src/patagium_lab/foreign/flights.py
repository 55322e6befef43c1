"""Foreign flights as files that are made once and kept.

A file lies at <folder>/<side>/<air>/<robot>/<gait>.nc. What was kept apart lies in a folder of its
own, so that nobody who chooses settings reads it by accident. A wingbeat near a drawn one has the
name of that one, its distance in per cent and the number of its direction: 00-near-20-1.nc.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import xarray as xr

from patagium.arrays import Array
from patagium.simulation import load_flight, save_flight
from patagium_lab.foreign.kinematics import Wingbeat, draw_wingbeats, near_wingbeat
from patagium_lab.foreign.mujoco_air import free_flight, mounted_flight
from patagium_lab.foreign.record import foreign_record
from patagium_lab.foreign.subjects import DRAG, LATTICE, MOUNTED, SUBJECTS, subject_robot
from patagium_lab.foreign.vortex_lattice import lattice_flight, lattice_wrench
from patagium_lab.foreign.wings import WINGS

STEP = 1e-3
"""Time between two samples [s]."""
DURATION = 2.0
"""Longest duration of a flight by MuJoCo [s]."""
STORED = Path(__file__).with_name("stored") / "lattice.npz"
"""File of the forces of a few wings, for machines without PteraSoftware."""
GAITS = 12
"""Number of wingbeats that are drawn for each robot."""
DISTANCES = (0.1, 0.2, 0.4)
"""Distances of the wingbeats near a drawn one [1]; see `near_wingbeat`."""


@dataclass(frozen=True)
class Case:
    """A foreign flight.

    Attributes:
        air: Kind of air, a key of `SUBJECTS`.
        robot: Name of the robot or wing.
        gait: Number of the wingbeat among those drawn.
        seed: Seed of the set of wingbeats.
        apart: Whether it is kept apart: no setting was chosen on it.
        distance: Largest change of a number of the drawn wingbeat, as `near_wingbeat` makes it
            [1]; 0: the drawn wingbeat itself.
        direction: Number of the direction in which the numbers change.
    """

    air: str
    robot: str
    gait: int
    seed: int
    apart: bool
    distance: float = 0.0
    direction: int = 0

    def path(self, folder: Path) -> Path:
        """File of the flight.

        Args:
            folder: Folder of all flights.
        """
        side = "apart" if self.apart else "choosing"
        return folder / side / self.air / self.robot / f"{self.name}.nc"

    @property
    def name(self) -> str:
        """Name of the file of the flight, without its ending."""
        near = f"-near-{100 * self.distance:.0f}-{self.direction}" if self.distance else ""
        return f"{self.gait:02d}{near}"

    @property
    def key(self) -> str:
        """Name of the case in a file of several."""
        return f"{self.seed}/{self.robot}/{self.name.removeprefix('0')}"

    def wingbeat(self) -> Wingbeat:
        """Wingbeat of the flight."""
        number = sorted(SUBJECTS[self.air]).index(self.robot)
        ranges = SUBJECTS[self.air][self.robot]
        drawn = draw_wingbeats(ranges, GAITS, 100 * self.seed + number)[self.gait]
        if not self.distance:
            return drawn
        seed = (self.seed, number, self.gait, self.direction)
        return near_wingbeat(drawn, self.distance, seed, subject_robot(self.robot))


def cases(air: str, seed: int, *, gaits_apart: int, robots_apart: int) -> list[Case]:
    """Cases of a kind of air, each for choosing or kept apart, by the seed alone.

    Args:
        air: Kind of air, a key of `SUBJECTS`.
        seed: Seed of the wingbeats and of the split.
        gaits_apart: Number of wingbeats of each robot that are kept apart.
        robots_apart: Number of robots that are kept apart, with all their wingbeats.
    """
    draw, robots = np.random.default_rng(seed), sorted(SUBJECTS[air])
    whole = set(draw.choice(robots, robots_apart, replace=False).tolist())
    found = []
    for robot in robots:
        apart = set(draw.choice(GAITS, gaits_apart, replace=False).tolist())
        found += [Case(air, robot, k, seed, robot in whole or k in apart) for k in range(GAITS)]
    return found


def near_cases(case: Case, directions: int) -> list[Case]:
    """Cases near a drawn one, each direction at all `DISTANCES`.

    Args:
        case: Case of a drawn wingbeat.
        directions: Number of directions.
    """
    return [replace(case, distance=d, direction=k) for d in DISTANCES for k in range(directions)]


@cache
def stored_wrenches() -> dict[str, Array]:
    """Forces of the vortex lattice that the laboratory carries, by `Case.key`.

    They are those of the first wingbeats of each wing, as `lattice_wrench` gave them, rounded to
    single precision: (K, 6) [N, N m] each.
    """
    with np.load(STORED) as file:
        return {key: file[key].astype(float) for key in file.files}


def make_flight(case: Case) -> xr.Dataset:
    """Flight of a case, flown by the other program.

    Args:
        case: The case.

    Raises:
        ParameterError: If PteraSoftware is needed and not installed.
    """
    wingbeat = case.wingbeat()
    time: Array = np.arange(round(DURATION / STEP) + 1).astype(float) * STEP
    if case.air == LATTICE:
        wing, stored = WINGS[case.robot], stored_wrenches().get(case.key)
        wrench = lattice_wrench(wing, wingbeat) if stored is None else stored
        return foreign_record(*lattice_flight(wing, wingbeat, STEP, wrench))
    robot = subject_robot(case.robot)
    if case.air == MOUNTED:
        return foreign_record(*mounted_flight(robot, wingbeat, time))
    return foreign_record(*free_flight(robot, wingbeat, time, body_drag=case.air == DRAG))


def kept_flight(case: Case, folder: Path) -> xr.Dataset:
    """Flight of a case from its file, which is made where it is missing.

    Args:
        case: The case.
        folder: Folder of all flights.
    """
    path = case.path(folder)
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        save_flight(make_flight(case), path)
    return load_flight(path)
