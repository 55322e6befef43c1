"""Second half of the rig: from a log alone to a learned model of the air.

Beside the log it knows the robot (whose description is in the log), the density of the air, the
speed of the fan, and the added mass of the wings by theory. Neglected: errors of these.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.aerodynamics import AddedMass, Air
from patagium.arrays import Array
from patagium.learning import ExtendedLearner, NoiseEstimation, identify
from patagium.robot import Robot
from patagium.sensing import (
    ForceSamples,
    cell_wrench,
    estimate_motion,
    estimate_shifts,
    inverse_dynamics_force,
    load_cell_force,
    motor_forces,
)
from patagium.sensing.sensors import SensorLog, load_sensor_log
from patagium_lab.reproduction.cases import lever_arms
from patagium_lab.reproduction.unsteady_models import lifting_line_box
from patagium_lab.rig.plan import CELL, MOTORS, UNIT, RigPlan

SOURCES = ("inverse dynamics", "load cell")
"""Sources of the force; the first uses motors and load cell, the second the cell alone."""
STRIP_STD, NOISE_MEMORY = 2e-3, 50
"""First std of a strip's force [N]; memory of its estimate [samples]."""


@dataclass(frozen=True)
class SourceResult:
    """Result of learning from one source of forces.

    Attributes:
        samples: Measured forces.
        prediction: Prediction of each sample before it was learned, (N, n) [N, N m].
        checked: Samples whose interval was computed, (C,).
        std: Predicted standard deviation of the force there, without that of its measurement,
            (C, n) [N, N m].
        model: File of the learner.
        scores: Scores of the stream, against the measured forces.
        seconds: Duration of the learning [s].
    """

    samples: ForceSamples
    prediction: Array
    checked: NDArray[np.int64]
    std: Array
    model: Path
    scores: dict[str, float]
    seconds: float


@dataclass(frozen=True)
class LogResult:
    """Result of one log.

    Attributes:
        shifts: Estimated delay of each instrument's stamps [s].
        shift_stds: Standard deviation of each estimated delay [s].
        motion: Estimated motion without its covariance, and u1 of the motors.
        whole_air: Force of the air by the load cell, added mass included.
        runs: Result of each source of forces, by its name.
        seconds: Duration of the alignment and of the estimate of the motion [s].
    """

    shifts: dict[str, float]
    shift_stds: dict[str, float]
    motion: xr.Dataset
    whole_air: ForceSamples
    runs: dict[str, SourceResult]
    seconds: dict[str, float]


def learn_from_log(plan: RigPlan, path: Path, models: Path) -> LogResult:
    """Result of one log: clocks, motion, forces and learned models.

    Args:
        plan: Plan of the rig, for the wind and the settings of the learner.
        path: File of the log.
        models: Folder for the learned models.
    """
    log, air = load_sensor_log(path), plan.air()
    begun = perf_counter()
    shifts = estimate_shifts(log, reference=UNIT)
    aligned = perf_counter()
    motion = estimate_motion(log, shifts=shifts.seconds)
    seconds = {"alignment": aligned - begun, "motion": perf_counter() - aligned}
    mount = cell_wrench(log, motion, CELL)
    forces = forces_of(log, motion, air)
    runs = {
        name: _learned(plan, samples, air, models / f"{path.stem}_{_word(name)}.learner")
        for name, samples in forces.items()
    }
    torque = np.nan_to_num(motor_forces(log, motion, MOTORS).values)
    return LogResult(
        dict(shifts.seconds),
        dict(shifts.std),
        motion.drop_vars("covariance").assign(u1=(("time", "dof"), torque)),
        load_cell_force(motion, mount),
        runs,
        seconds,
    )


def forces_of(
    log: SensorLog, motion: xr.Dataset, air: Air, cell_late: float = 0.0
) -> dict[str, ForceSamples]:
    """Forces of the air, added mass taken off, by all sources.

    Args:
        log: The log.
        motion: Estimated motion.
        air: Air with its density and wind.
        cell_late: Delay of the load cell's stamps [s].
    """
    added = AddedMass(log.robot, air)
    joints = motor_forces(log, motion, MOTORS)
    mount = cell_wrench(log, motion, CELL, shift=cell_late)
    return {
        "inverse dynamics": inverse_dynamics_force(
            motion, joints=joints, mount=mount, added_mass=added
        ),
        "load cell": load_cell_force(motion, mount, added_mass=added),
    }


def new_learner(robot: Robot, air: Air) -> ExtendedLearner:
    """Learner of a lifting line with four unknown numbers that estimates its noise.

    Args:
        robot: The machine.
        air: Air with its density and wind.
    """
    return ExtendedLearner(
        lifting_line_box(robot, air, start="steady"),
        measurement_std=STRIP_STD * lever_arms(robot),
        noise_estimation=NoiseEstimation(NOISE_MEMORY),
    )


def _learned(plan: RigPlan, samples: ForceSamples, air: Air, model: Path) -> SourceResult:
    begun = perf_counter()
    learner = new_learner(samples.robot, air)
    result = identify(samples, learner, every=plan.every)
    record = result.prediction
    checked = np.searchsorted(record["time"].values, record["check_time"].values)
    whole = record["predicted_std"].values ** 2
    stated = np.nan_to_num(samples.std[checked]) ** 2
    return SourceResult(
        samples,
        record["prediction"].values,
        checked,
        np.sqrt(np.maximum(whole - stated, 0.0)),
        learner.save(model),
        {name: float(result.scores[name]) for name in _KEPT},
        perf_counter() - begun,
    )


def _word(name: str) -> str:
    return name.replace(" ", "_")


_KEPT = ("updates", "time_per_update", "nmse_second_half_worst", "coverage_second_half")
