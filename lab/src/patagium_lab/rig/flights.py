"""First half of the rig: flights on the arm, and the logs of the instruments.

The true air is a lifting line with the lags of its wake, stall, and added mass. Logs and truth go
into folders of their own; the second half reads logs alone. Neglected: forces of the robot on the
arm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from patagium.aerodynamics import AddedMass, LiftingLine
from patagium.errors import ParameterError
from patagium.robot import Robot, load_robot
from patagium.sensing import save_sensor_log, sense
from patagium.sensing.sensors import LoadCell, Sensor
from patagium.sensing.sensors.sense import published
from patagium.simulation import save_flight, simulate
from patagium.whole_file import make_folder
from patagium_lab.rig.plan import (
    CELL,
    UNSEEN,
    Motion,
    RigPlan,
    instruments,
    learned_motion,
    scaled,
    unseen_motion,
)

LEAST_BELIEVED = 0.1
"""Noise over the data sheets' that instruments without noise are assumed to have."""
Part = Callable[[float], None]
"""Receives the part of a stage that is done, 0 to 1."""


@dataclass(frozen=True)
class Flown:
    """Results of the first half.

    Attributes:
        flight: True flight that is learned.
        unseen: True flights that are not learned, by name.
        sensors: Instruments with their true clocks and delays.
        logs: File of the log at each factor of noise.
        truth: File of the flight that is learned.
    """

    flight: xr.Dataset
    unseen: dict[str, xr.Dataset]
    sensors: list[Sensor]
    logs: dict[float, Path]
    truth: Path


def fly(plan: RigPlan, out: Path, tell: Part) -> Flown:
    """Flights on the arm, with logs and truth written to files.

    Args:
        plan: Plan of the rig.
        out: Folder in which `logs` and `truth` are made.
        tell: Receives the part done.

    Raises:
        PathError: If the arm cannot follow.
        ParameterError: If an instrument's range does not hold what the robot does.
    """
    robot = load_robot(plan.robot)
    flight = _flown(plan, robot, learned_motion(plan, robot))
    truth = save_flight(flight, make_folder(out / "truth") / "learned.nc")
    tell(0.4)
    unseen = {name: _flown(plan, robot, unseen_motion(plan, robot, name)) for name in UNSEEN}
    for name, one in unseen.items():
        save_flight(one, out / "truth" / f"unseen_{name.replace(' ', '_')}.nc")
    tell(0.7)
    sensors = instruments(plan, robot, float(np.abs(flight["u1"].values).max()))
    logs = {}
    for factor in plan.noise:
        log = sense(flight, scaled(sensors, factor), seed=plan.seed)
        believed = scaled(sensors, max(factor, LEAST_BELIEVED))
        log = replace(log, sensors={s.name: published(s) for s in believed})
        _check_range(log.truth[CELL], next(s for s in sensors if s.name == CELL), robot)
        logs[factor] = save_sensor_log(log, make_folder(out / "logs") / f"noise_{factor:g}.nc")
    tell(1.0)
    return Flown(flight, unseen, sensors, logs, truth)


def _flown(plan: RigPlan, robot: Robot, motion: Motion) -> xr.Dataset:
    air = plan.air()
    return simulate(
        robot,
        LiftingLine(robot, air),
        motion.gait,
        duration=motion.duration,
        time_step=motion.time_step,
        added_mass=AddedMass(robot, air),
        mount=motion.mount,
    )


def _check_range(true: xr.Dataset, cell: Sensor, robot: Robot) -> None:
    """Refuse a robot that saturates the load cell.

    Raises:
        ParameterError: If it does.
    """
    if not isinstance(cell, LoadCell):
        return
    largest = np.abs(true["wrench"].values).max(axis=0)
    for part, limit, unit in (
        (largest[:3], cell.force_range, "N"),
        (largest[3:], cell.moment_range, "N m"),
    ):
        if limit is not None and (part > np.asarray(limit)).any():
            expected = f"one that a load cell of {np.ravel(limit).tolist()} {unit} holds"
            raise ParameterError("robot", expected, f"{robot.name}, {part.max():.3g} {unit}")
