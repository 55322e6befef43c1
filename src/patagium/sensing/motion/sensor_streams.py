"""Samples of sensors on one time axis, and the noise density of the motion that they show.

The density of the noise that drives each coordinate is the one for which encoders and cameras are
most likely, one coordinate at a time. Neglected: drift of clocks within a log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import LogError, ParameterError, ShapeError
from patagium.robot import Robot
from patagium.sensing.motion.frame_model import floating_base
from patagium.sensing.motion.kalman_smoother import likely_density
from patagium.sensing.motion.measurement_models import (
    CaptureModel,
    EncoderModel,
    ImuModel,
    MeasurementModel,
    measurement_models,
)
from patagium.sensing.sensors import SensorLog, from_quaternion

Array = NDArray[np.float64]

_MOST_FOR_LIKELIHOOD = 1500


@dataclass(frozen=True)
class Stream:
    """Samples of one sensor on the common time axis.

    Attributes:
        name: Name of the sensor.
        model: Its measurement model.
        time: Times of the samples, (N,) [s].
        rows: Samples, (N, k) [m, rad, m/s^2, rad/s or 1]; NaN where a sample was lost.
    """

    name: str
    model: MeasurementModel
    time: Array
    rows: Array


def streams_of(log: SensorLog, robot: Robot, shifts: Mapping[str, float]) -> list[Stream]:
    """Streams of the sensors of a log that see motion.

    Args:
        log: The log.
        robot: The machine.
        shifts: Shift of late stamps by name of the sensor [s].

    Raises:
        ParameterError: If a shift is that of no sensor of the log.
        LogError: If stamps do not advance, or no sensor sees motion.
    """
    for name in shifts:
        if name not in log.readings:
            raise ParameterError("shifts", f"sensors among {', '.join(log.readings)}", name)
    found = []
    for name, model in measurement_models(log.sensors, robot).items():
        reading = log[name]
        stamps = np.asarray(reading["time"].values, float)
        if not (np.diff(stamps) > 0).all():
            raise LogError(f"{name}: expected stamps that advance")
        found.append(Stream(name, model, stamps - shifts.get(name, 0.0), model.rows(reading)))
    if not found:
        held = ", ".join(log.readings)
        raise LogError(f"log: expected encoders, inertial units or cameras, found {held}")
    return found


def common_times(streams: Sequence[Stream]) -> Array:
    """Times of the fastest sensor within the span of all others, (M,) [s].

    Raises:
        LogError: If the sensors have no time in common.
    """
    begin, end = max(s.time[0] for s in streams), min(s.time[-1] for s in streams)
    fastest = min(streams, key=lambda s: float(np.median(np.diff(s.time))))
    chosen = fastest.time[(fastest.time >= begin - 1e-9) & (fastest.time <= end + 1e-9)]
    if len(chosen) < 2:
        raise LogError(f"log: expected sensors with time in common, found {begin:g} to {end:g} s")
    return np.asarray(chosen)


def first_camera(streams: Sequence[Stream]) -> Stream | None:
    """First stream of motion capture; None without one."""
    cameras = [s for s in streams if isinstance(s.model, CaptureModel)]
    return cameras[0] if cameras else None


def encoded_coordinates(streams: Sequence[Stream]) -> dict[int, tuple[Stream, int]]:
    """Stream and place in it of each coordinate that an encoder sees."""
    return {
        column: (s, k)
        for s in streams
        if isinstance(s.model, EncoderModel)
        for k, column in enumerate(s.model.columns)
    }


def noise_density(
    robot: Robot, streams: Sequence[Stream], given: ArrayLike | None, order: int
) -> Array:
    """Density of the noise that drives each coordinate, (n,) [unit^2/s^(2 order - 1)].

    Args:
        robot: The machine.
        streams: Measurements.
        given: Density of each, (n,) [unit^2/s^(2 order - 1)]; None takes the most likely one.
        order: Number of levels of each coordinate.

    Raises:
        ShapeError: If `given` is not (n,).
        ParameterError: If `given` is not positive.
        LogError: If a coordinate is seen by no encoder and no camera.
    """
    n = robot.dof
    if given is not None:
        drive = np.array(given, float)
        if drive.shape != (n,):
            raise ShapeError("density", (n,), drive.shape)
        if not (np.isfinite(drive).all() and (drive > 0).all()):
            raise ParameterError("density", "positive numbers", drive.tolist())
        return drive
    drive = np.full(n, np.nan)
    seen = encoded_coordinates(streams)
    by_stream: dict[str, list[int]] = {}
    for column, (s, _) in seen.items():
        by_stream.setdefault(s.name, []).append(column)
    for columns in by_stream.values():
        stream = seen[columns[0]][0]
        values = stream.rows[:, [seen[i][1] for i in columns]]
        drive[columns] = _likely(stream, values, _std(stream), order)
    base = floating_base(robot)
    if base is not None:
        drive[[*base.place, *base.turn]] = _density_of_base(streams, order)
    silent = [robot.dof_names[i] for i in np.flatnonzero(np.isnan(drive))]
    if silent:
        raise LogError(
            f"log: expected encoders or cameras that see {', '.join(silent)}, found none "
            "(with inertial units alone give `density`)"
        )
    return drive


def _density_of_base(streams: Sequence[Stream], order: int) -> Array:
    """Density of position and rotation, (6,): the larger of cameras and an inertial unit."""
    camera, found = first_camera(streams), np.full((2, 6), np.nan)
    if camera is None:
        return np.full(6, np.nan)
    place, turn = captured_motion(camera)
    std = np.sqrt(getattr(camera.model, "variance", np.full(6, np.nan)))
    found[0, :3] = _likely(camera, place, std[:3], order)
    found[0, 3:] = _likely(camera, turn, np.full(3, std[3:].mean()), order)
    for s in streams:
        if isinstance(s.model, ImuModel) and s.model.frame.on_base:
            std = np.sqrt(s.model.variance)
            to_body = s.model.frame.mount**2
            attitude = from_quaternion(camera.rows[np.isfinite(camera.rows).all(axis=1), 3:])
            mount = getattr(camera.model, "frame").mount  # noqa: B009
            to_world = np.mean((attitude.as_matrix() @ mount.T) ** 2, axis=0)
            forces = _likely(s, s.rows[:, :3], std[:3], order - 2)
            found[1, :3] = to_world @ to_body @ forces
            found[1, 3:] = to_body @ _likely(s, s.rows[:, 3:], std[3:], order - 1)
    return np.asarray(np.nanmax(found, axis=0))


def _likely(stream: Stream, values: Array, std: ArrayLike, order: int) -> Array:
    kept = slice(0, _MOST_FOR_LIKELIHOOD)
    return likely_density(stream.time[kept], values[kept], std, order=order)


def _std(stream: Stream) -> float:
    return float(getattr(stream.model, "std", np.nan))


def captured_motion(camera: Stream) -> tuple[Array, Array]:
    """Positions [m] and summed small rotations in the frame's axes [rad], (N, 3) each."""
    seen = np.asarray(np.isfinite(camera.rows).all(axis=1))
    turn = np.full((len(camera.rows), 3), np.nan)
    attitude = from_quaternion(camera.rows[seen, 3:])
    small = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
    turn[seen] = np.vstack([np.zeros(3), np.cumsum(small, axis=0)])
    place = np.where(seen[:, None], camera.rows[:, :3], np.nan)
    return place, turn
