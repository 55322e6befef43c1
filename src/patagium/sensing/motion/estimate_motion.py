"""Estimation of the coordinates, velocities and accelerations of a robot from a sensor log.

Measurements of all rates are put on one time axis, each shifted by its clock and delay.
Coordinates that one encoder alone sees are smoothed by themselves, the others together. Neglected:
faults of sensors; biases of encoders and cameras.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from patagium.errors import ParameterError
from patagium.robot import Robot
from patagium.sensing.motion.frame_model import euler_function, floating_base, with_euler_angles
from patagium.sensing.motion.kalman_smoother import MOTION_ORDERS
from patagium.sensing.motion.motion_smoother import SmoothedMotion, kalman_motion, smoothed_motion
from patagium.sensing.motion.sensor_streams import common_times, noise_density, streams_of
from patagium.sensing.motion.smoothers import Smoother
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
    """Coordinates, velocities and accelerations with their covariance, given a whole log.

    Args:
        log: Readings of encoders, inertial units and cameras; other sensors are left out.
        robot: The machine; None for that of the log.
        shifts: Shift of late stamps, delay and clock together, by name of the sensor [s]; see
            `estimate_shifts`. Sensors that are not named have no shift.
        times: Times of the result, (M,) [s]; None for the samples of the fastest sensor within
            the span of all others.
        order: Number of levels of each coordinate: 3 for white jerk, 4 for white snap.
        density: Density of that noise, (n,) [unit^2/s^(2 order - 1)]; None for the most likely.
        smoother: Spline or sliding polynomial through encoders and cameras instead of the Kalman
            smoother; inertial units are then left out.
        filtered: Whether only measurements before a time count for it, as online.

    Returns:
        A dataset over `time` and `dof`: q, v, a [m, rad and their rates], `covariance` of
        [q, v, a], (time, 3 n, 3 n), and the robot as attributes, with roll, pitch and yaw if its
        attitude is a quaternion.

    Raises:
        LogError: If a coordinate is seen by no sensor, or readings cannot be used.
        ParameterError: If an argument is out of its range.
        ShapeError: If `density` is not (n,).
    """
    machine = with_euler_angles(log.robot if robot is None else robot)
    if order not in MOTION_ORDERS:
        raise ParameterError("order", f"one of {MOTION_ORDERS}", order)
    streams = streams_of(log, machine, shifts or {})
    wanted = common_times(streams) if times is None else np.asarray(times, float)
    if smoother is not None:
        found = smoothed_motion(machine, streams, wanted, smoother)
    else:
        drive = noise_density(machine, streams, density, order)
        found = kalman_motion(machine, streams, wanted, drive, filtered=filtered, order=order)
    levels, covariance = in_coordinates(machine, found)
    return _dataset(machine, wanted, levels, covariance, log)


def in_coordinates(robot: Robot, found: SmoothedMotion) -> tuple[Array, Array]:
    """Coordinates q, v, a, (N, 3, n), and their covariance, (N, 3 n, 3 n), with Euler angles.

    Args:
        robot: The machine.
        found: Motion with its attitude as a rotation.
    """
    levels, covariance, base = found.levels.copy(), found.covariance.copy(), floating_base(robot)
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
