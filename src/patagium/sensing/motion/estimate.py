"""Coordinates, velocities and accelerations of a robot from what its sensors showed.

Measurements of all rates meet on one time axis, each moved by what its clock and delay are off.
Coordinates that one encoder alone sees are smoothed for themselves, the others together. Neglected:
sensors that lie; biases of encoders and cameras.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from patagium.errors import ParameterError
from patagium.robot import Robot
from patagium.sensing.motion.chains import MOTION_ORDERS
from patagium.sensing.motion.model import base_of, by_angles, euler_function
from patagium.sensing.motion.runs import Found, by_kalman, by_smoother
from patagium.sensing.motion.smoothers import Smoother
from patagium.sensing.motion.streams import common_times, drive_of, streams_of
from patagium.sensing.sensors import SensorLog

Array = NDArray[np.float64]


def estimate_motion(
    log: SensorLog,
    *,
    robot: Robot | None = None,
    shifts: Mapping[str, float] | None = None,
    times: ArrayLike | None = None,
    order: int = 4,
    density: ArrayLike | None = None,
    smoother: Smoother | None = None,
    filtered: bool = False,
) -> xr.Dataset:
    """Coordinates, velocities and accelerations given all of a log, with their covariance.

    Args:
        log: Readings of encoders, inertial units and cameras; others are left aside.
        robot: The machine; None for the log's.
        shifts: What the stamps of a sensor are late, delay and clock together, by its name [s];
            see `estimate_shifts`. Sensors not named are taken as they are.
        times: Where the motion is wanted, (M,) [s]; None: the samples of the fastest sensor
            that all others surround.
        order: Levels of each coordinate: 3 for white jerk, 4 for white snap.
        density: Of that noise, (n,) [unit^2/s^(2 order - 1)]; None: the most likely one.
        smoother: Instead of the Kalman smoother, a spline or sliding polynomial through encoders
            and cameras, without inertial units.
        filtered: Whether only what was measured before a time counts for it, as online.

    Returns:
        A dataset over `time` and `dof`: q, v, a [m, rad and their rates], `covariance` of
        [q, v, a], (time, 3 n, 3 n), and what it was made with as attributes; it carries the
        robot, as a flight does, with roll, pitch and yaw if its attitude is a quaternion.

    Raises:
        LogError: If a coordinate is seen by no sensor, or readings cannot be used.
        ParameterError: If an argument is out of its range.
        ShapeError: If `density` is not (n,).
    """
    machine = by_angles(log.robot if robot is None else robot)
    if order not in MOTION_ORDERS:
        raise ParameterError("order", f"one of {MOTION_ORDERS}", order)
    streams = streams_of(log, machine, shifts or {})
    wanted = common_times(streams) if times is None else np.asarray(times, float)
    if smoother is not None:
        found = by_smoother(machine, streams, wanted, smoother)
    else:
        drive = drive_of(machine, streams, density, order)
        found = by_kalman(machine, streams, wanted, drive, filtered=filtered, order=order)
    levels, covariance = in_coordinates(machine, found)
    return _dataset(machine, wanted, levels, covariance, log)


def in_coordinates(robot: Robot, found: Found) -> tuple[Array, Array]:
    """q, v, a, (N, 3, n), and their covariance, (N, 3 n, 3 n), with Euler angles for attitude.

    Args:
        robot: The machine.
        found: The motion with its attitude apart.
    """
    levels, covariance, base = found.levels.copy(), found.covariance.copy(), base_of(robot)
    if base is None:
        return levels, covariance
    turn, n = list(base.turn), robot.dof
    angles = euler_angles(found.attitude)
    first, second, slope = (
        np.array(part)
        for part in euler_function().batch(angles, levels[:, 1, turn], levels[:, 2, turn])
    )
    for level, values in enumerate((angles, first, second)):
        levels[:, level, turn] = values
    places = np.concatenate([np.array(turn) + level * n for level in range(3)])
    covariance[:, places] = slope @ covariance[:, places]
    covariance[:, :, places] = covariance[:, :, places] @ np.swapaxes(slope, 1, 2)
    return levels, covariance


def euler_angles(attitude: Rotation) -> Array:
    """Roll, pitch, yaw of rotations in order, without jumps of whole turns, (N, 3) [rad]."""
    angles = np.asarray(attitude.as_euler("ZYX"))[:, ::-1]
    return np.unwrap(angles, axis=0)


def _dataset(
    robot: Robot, times: Array, levels: Array, covariance: Array, log: SensorLog
) -> xr.Dataset:
    parts = [f"{part}.{name}" for part in "qva" for name in robot.dof_names]
    variables: dict[str, object] = {
        name: (("time", "dof"), levels[:, k], {"units": units})
        for k, (name, units) in enumerate(
            (("q", "m or rad"), ("v", "m/s or rad/s"), ("a", "m/s^2 or rad/s^2"))
        )
    }
    variables["covariance"] = (("time", "part", "other_part"), covariance, {})
    return xr.Dataset(
        variables,
        coords={
            "time": ("time", times, {"units": "s"}),
            "dof": list(robot.dof_names),
            "part": parts,
            "other_part": parts,
        },
        attrs={"robot": robot.source, "robot_name": robot.name, "mount": log.mount},
    )
