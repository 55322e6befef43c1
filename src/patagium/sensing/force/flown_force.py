"""Motion and force of the air from a sensor log in one call, and their file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from patagium.arrays import Array
from patagium.netcdf_file import write_netcdf
from patagium.sensing.force.measured_force import (
    ForceSamples,
    cell_wrench,
    inverse_dynamics_force,
    motor_forces,
)
from patagium.sensing.motion.estimate_motion import estimate_motion
from patagium.sensing.motion.frame_model import floating_base
from patagium.sensing.sensors import LoadCell, MotorCurrent, SensorLog
from patagium.sensing.sensors.joints import joint_names

_WHITE = {"correlation": 0.0, "jitter": 0.0, "doubted": 0.0, "nis": 1.0, "shown": None}

_HELD_DOWN = 1.5
"""Mean lift over weight from which the sign of a load cell is asked for."""

_DRIVEN = 0.3
"""Correlation of the force of the air with the momentum of the robot from which the sign is asked
for: air brakes what moves in it."""


def motion_and_force(
    log: SensorLog, *, shifts: Mapping[str, float] | None = None
) -> tuple[xr.Dataset, ForceSamples]:
    """Motion, and force of the air by inverse dynamics from it.

    Joint forces by motor currents and the wrench of a load cell are used where the log has them.

    Args:
        log: The log.
        shifts: Shift of late stamps by name of the sensor [s]; see `estimate_shifts`.

    Returns:
        The motion, and the force, which is NaN where the motion is not known.

    Raises:
        LogError: If the sensors do not see the motion.
    """
    late = dict(shifts or {})
    motion = estimate_motion(log, shifts=late)
    joints = mount = None
    facts = json.loads(motion.attrs["findings"])
    for name, sensor in log.sensors.items():
        if isinstance(sensor, MotorCurrent):
            joints = motor_forces(log, motion, name, shift=late.get(name, 0.0), robot=log.robot)
            parts = joint_names(sensor.joints, log.robot)
            units = [log.robot.force_units[log.robot.index(part)] for part in parts]
            white = zip(parts, units, joints.noise.tolist(), strict=True)
        elif isinstance(sensor, LoadCell):
            mount = cell_wrench(log, motion, name, shift=late.get(name, 0.0))
            noise = np.sqrt((mount.measured.noise.reshape(2, 3) ** 2).mean(axis=1))
            white = zip(("force", "moment"), ("N", "N m"), noise.tolist(), strict=True)
        else:
            continue
        for part, unit, std in white:
            told = {"sensor": name, "part": part, "unit": unit, "std": std}
            facts["noise"].append(told | _WHITE)
    found = inverse_dynamics_force(motion, joints=joints, mount=mount)
    unknown = ~motion["known"].values
    found.force[unknown] = np.nan
    found.covariance[unknown] = np.nan
    base = floating_base(found.robot)
    if mount is not None and base is not None and not unknown.all():
        weight = found.robot.mass * found.robot.gravity
        lift = float(np.nanmean(found.force[:, base.place[2]])) / weight
        turned = replace(mount.measured, values=-mount.measured.values)
        other = inverse_dynamics_force(motion, joints=joints, mount=replace(mount, measured=turned))
        along = _drag(motion["time"].values, found, other, list(base.place))
        if lift > _HELD_DOWN or along > _DRIVEN:
            facts["notes"].append(
                f"Warning: load cell: the air lifts {lift:.2g} times the weight and "
                f"{'drives' if along > 0 else 'brakes'} the motion, or, if the cell shows what the "
                f"robot does to it, lifts {2 - lift:.2g} times the weight and "
                f"{'brakes' if along > 0 else 'drives'} it: then it lacks `negated: true` in the "
                "mapping"
            )
    motion.attrs["findings"] = json.dumps(facts)
    return motion, found


def _drag(time: Array, found: ForceSamples, other: ForceSamples, place: list[int]) -> float:
    """Correlation of the force of the air with the momentum of the robot in the world [1].

    Args:
        time: Times of the samples, (N,) [s].
        found: Force of the air.
        other: Force of the air if the cell has the other sign; the mean of both is all force, which
            changes the momentum.
        place: Places of x, y, z in q.
    """
    known = np.isfinite(found.force[:, place]).all(axis=1)
    line = np.polynomial.polynomial.polyvander(time[known] - time[known][0], 1)
    whole = 0.5 * (found.force + other.force)[known][:, place]
    pushed = np.cumsum((whole - whole.mean(axis=0)) * np.gradient(time[known])[:, None], axis=0)
    force, momentum = (
        one - line @ np.linalg.lstsq(line, one)[0] for one in (found.force[known][:, place], pushed)
    )
    size = float(np.linalg.norm(force) * np.linalg.norm(momentum))
    return float((force * momentum).sum()) / size if size > 0 else 0.0


def write_motion(motion: xr.Dataset, forces: ForceSamples, path: str | Path) -> Path:
    """Write motion and forces as netCDF4, whole or not at all.

    Args:
        motion: From `estimate_motion`.
        forces: Of the air along it.
        path: The file, replaced if it exists.

    Raises:
        OutputError: If the file cannot be written.
    """
    units = {"units": "N or N m", "source": forces.source}
    whole = motion.assign(
        force=(("time", "dof"), forces.force, units),
        force_std=(("time", "dof"), forces.std, units),
        force_covariance=(("time", "dof", "other_dof"), forces.covariance),
    )
    return write_netcdf(path, whole.assign(known=whole["known"].astype("i1")))
