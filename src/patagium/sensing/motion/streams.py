"""Samples of sensors on one time axis, and how lively the motion is that they show.

The density of the noise that drives each coordinate is the one that makes encoders and cameras
most likely, one coordinate at a time. Neglected: drift of clocks within a log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import LogError, ParameterError, ShapeError
from patagium.robot import Robot
from patagium.sensing.motion.chains import likely_density
from patagium.sensing.motion.model import base_of
from patagium.sensing.motion.sensors import (
    CaptureChannel,
    Channel,
    EncoderChannel,
    ImuChannel,
    channels_of,
)
from patagium.sensing.sensors import SensorLog, from_quaternion

Array = NDArray[np.float64]

_MOST_FOR_LIKELIHOOD = 1500


@dataclass(frozen=True)
class Stream:
    """Samples of one sensor on the common time axis.

    Attributes:
        name: Of the sensor.
        channel: How it sees the motion.
        time: (N,) [s].
        rows: (N, k); NaN where a sample was lost.
    """

    name: str
    channel: Channel
    time: Array
    rows: Array


def streams_of(log: SensorLog, robot: Robot, shifts: Mapping[str, float]) -> list[Stream]:
    """The sensors of a log that see motion, on one time axis.

    Args:
        log: The log.
        robot: The machine.
        shifts: What stamps are late, by the name of the sensor [s].

    Raises:
        ParameterError: If a shift is of no sensor of the log.
        LogError: If stamps do not advance, or no sensor sees motion.
    """
    for name in shifts:
        if name not in log.readings:
            raise ParameterError("shifts", f"sensors among {', '.join(log.readings)}", name)
    found = []
    for name, channel in channels_of(log.sensors, robot).items():
        reading = log[name]
        stamps = np.asarray(reading["time"].values, float)
        if not (np.diff(stamps) > 0).all():
            raise LogError(f"{name}: expected stamps that advance")
        found.append(Stream(name, channel, stamps - shifts.get(name, 0.0), channel.rows(reading)))
    if not found:
        held = ", ".join(log.readings)
        raise LogError(f"log: expected encoders, inertial units or cameras, found {held}")
    return found


def common_times(streams: Sequence[Stream]) -> Array:
    """Samples of the fastest sensor that all others surround, (M,) [s].

    Raises:
        LogError: If the sensors have no time in common.
    """
    begin, end = max(s.time[0] for s in streams), min(s.time[-1] for s in streams)
    fastest = min(streams, key=lambda s: float(np.median(np.diff(s.time))))
    chosen = fastest.time[(fastest.time >= begin - 1e-9) & (fastest.time <= end + 1e-9)]
    if len(chosen) < 2:
        raise LogError(f"log: expected sensors with time in common, found {begin:g} to {end:g} s")
    return np.asarray(chosen)


def camera_of(streams: Sequence[Stream]) -> Stream | None:
    """The first stream of motion capture; None where there is none."""
    cameras = [s for s in streams if isinstance(s.channel, CaptureChannel)]
    return cameras[0] if cameras else None


def encoded(streams: Sequence[Stream]) -> dict[int, tuple[Stream, int]]:
    """For each coordinate an encoder sees, the stream and the place in it."""
    return {
        column: (s, k)
        for s in streams
        if isinstance(s.channel, EncoderChannel)
        for k, column in enumerate(s.channel.columns)
    }


def drive_of(robot: Robot, streams: Sequence[Stream], given: ArrayLike | None, order: int) -> Array:
    """Density of the noise that drives each coordinate, (n,) [unit^2/s^(2 order - 1)].

    Args:
        robot: The machine.
        streams: What was measured.
        given: Density of each, (n,); None: the most likely one.
        order: Levels of each coordinate.

    Raises:
        ShapeError: If what is given is not (n,).
        ParameterError: If it is not positive.
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
    seen = encoded(streams)
    by_stream: dict[str, list[int]] = {}
    for column, (s, _) in seen.items():
        by_stream.setdefault(s.name, []).append(column)
    for columns in by_stream.values():
        stream = seen[columns[0]][0]
        values = stream.rows[:, [seen[i][1] for i in columns]]
        drive[columns] = _likely(stream, values, _std(stream), order)
    base = base_of(robot)
    if base is not None:
        drive[[*base.place, *base.turn]] = _drive_of_base(streams, order)
    silent = [robot.dof_names[i] for i in np.flatnonzero(np.isnan(drive))]
    if silent:
        raise LogError(
            f"log: expected encoders or cameras that see {', '.join(silent)}, found none "
            "(with inertial units alone give `density`)"
        )
    return drive


def _drive_of_base(streams: Sequence[Stream], order: int) -> Array:
    """Of place and turn, (6,): the larger of what cameras and an inertial unit on it say."""
    camera, found = camera_of(streams), np.full((2, 6), np.nan)
    if camera is None:
        return np.full(6, np.nan)
    place, turn = captured(camera)
    std = np.sqrt(getattr(camera.channel, "variance", np.full(6, np.nan)))
    found[0, :3] = _likely(camera, place, std[:3], order)
    found[0, 3:] = _likely(camera, turn, np.full(3, std[3:].mean()), order)
    for s in streams:
        if isinstance(s.channel, ImuChannel) and s.channel.frame.on_base:
            std = np.sqrt(s.channel.variance)
            to_body = s.channel.frame.mount**2
            attitude = from_quaternion(camera.rows[np.isfinite(camera.rows).all(axis=1), 3:])
            mount = getattr(camera.channel, "frame").mount  # noqa: B009
            to_world = np.mean((attitude.as_matrix() @ mount.T) ** 2, axis=0)
            forces = _likely(s, s.rows[:, :3], std[:3], order - 2)
            found[1, :3] = to_world @ to_body @ forces
            found[1, 3:] = to_body @ _likely(s, s.rows[:, 3:], std[3:], order - 1)
    return np.asarray(np.nanmax(found, axis=0))


def _likely(stream: Stream, values: Array, std: ArrayLike, order: int) -> Array:
    kept = slice(0, _MOST_FOR_LIKELIHOOD)
    return likely_density(stream.time[kept], values[kept], std, order=order)


def _std(stream: Stream) -> float:
    return float(getattr(stream.channel, "std", np.nan))


def captured(camera: Stream) -> tuple[Array, Array]:
    """Positions, and the sum of small turns in the frame's axes, (N, 3) each; NaN where lost."""
    seen = np.asarray(np.isfinite(camera.rows).all(axis=1))
    turn = np.full((len(camera.rows), 3), np.nan)
    attitude = from_quaternion(camera.rows[seen, 3:])
    small = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
    turn[seen] = np.vstack([np.zeros(3), np.cumsum(small, axis=0)])
    place = np.where(seen[:, None], camera.rows[:, :3], np.nan)
    return place, turn
