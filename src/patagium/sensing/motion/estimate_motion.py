"""Estimation of the coordinates, velocities and accelerations of a robot from a sensor log.

Measurements of all rates are put on one time axis, each shifted by its clock and delay.
Coordinates that one encoder alone sees are smoothed by themselves, the others together. A filtered
covariance is kept in memory for each sample. Neglected: faults of sensors; biases of encoders and
cameras.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from patagium.errors import LogError, ParameterError
from patagium.robot import Robot
from patagium.sensing.motion.frame_model import (
    FrameModel,
    Motion,
    euler_function,
    floating_base,
    with_euler_angles,
)
from patagium.sensing.motion.motion_filter import MotionEstimate, MotionFilter, Step
from patagium.sensing.motion.sensor_streams import (
    CaptureModel,
    EncoderModel,
    ImuModel,
    Observation,
    Stream,
    common_times,
    encoded_coordinates,
    first_camera,
    noise_density,
    streams_of,
)
from patagium.sensing.motion.smoothers import MOTION_ORDERS, Smoother, merged_times, smooth_chain
from patagium.sensing.sensors import SensorLog, from_quaternion

Array = NDArray[np.float64]

UNKNOWN = (1e-1, 3e1, 3e2)
"""Least standard deviation of position [m, rad], rate and acceleration before any sample."""
_MEMORY = 0.5
"""Time over which driving noise may have built up the initial motion [s]."""


@dataclass(frozen=True)
class SmoothedMotion:
    """Motion at given times, with the attitude as a rotation.

    Attributes:
        levels: Position, velocity, acceleration of each coordinate, (M, 3, n) [m, rad, per s,
            per s^2]; for attitude zero, angular velocity and its derivative in body axes.
        attitude: Rotations from body to world axes, M; the identity without a floating body.
        covariance: Covariance of the levels one after the other, with small rotations for
            attitude, (M, 3 n, 3 n) [products of their units].
    """

    levels: Array
    attitude: Rotation
    covariance: Array


def kalman_motion(
    robot: Robot,
    streams: Sequence[Stream],
    times: Array,
    density: Array,
    *,
    order: int,
    filtered: bool,
) -> SmoothedMotion:
    """Motion by a Kalman filter and, unless `filtered`, a smoother.

    Args:
        robot: The machine.
        streams: Measurements.
        times: Times at which the motion is wanted, (M,) [s].
        density: Density of the noise that drives each coordinate, (n,) [unit^2/s^(2 order - 1)].
        order: Number of levels of each coordinate.
        filtered: Whether to leave out the smoother.

    Raises:
        LogError: If a coordinate is seen by no sensor.
        FilterDiverged: If the estimate or its covariance is lost.
    """
    n = robot.dof
    columns = coupled(robot, streams)
    levels, covariance = _smooth_alone(
        robot, streams, times, density, columns, order=order, filtered=filtered
    )
    attitude = Rotation.identity(len(times))
    if columns:
        among = [s for s in streams if not _alone(s, columns)]
        run = _Run(robot, among, times, columns, density[columns], order)
        estimates = run.forwards(filtered) if filtered else run.smoothed()
        attitude = Rotation.from_matrix(
            np.array([estimate.motion.attitude for estimate in estimates])
        )
        places = np.concatenate([np.array(columns) + level * n for level in range(3)])
        kept = 3 * len(columns)
        for k, estimate in enumerate(estimates):
            levels[k][:, columns] = estimate.motion.levels[:3][:, columns]
            covariance[k][np.ix_(places, places)] = estimate.covariance[:kept, :kept]
    return SmoothedMotion(levels, attitude, covariance)


def coupled(robot: Robot, streams: Sequence[Stream]) -> list[int]:
    """Coordinates that must be estimated together: all that more than one encoder depends on.

    Raises:
        LogError: If a coordinate is seen by no sensor.
    """
    base = floating_base(robot)
    found = set() if base is None else {*base.place, *base.turn}
    rng = np.random.default_rng(0)
    motion = Motion(rng.uniform(0.1, 1.0, (3, robot.dof)), np.eye(3))
    seen: list[int] = []
    for s in streams:
        if isinstance(s.model, EncoderModel):
            seen += s.model.columns
            continue
        frame: FrameModel = s.model.frame  # type: ignore[attr-defined]
        if isinstance(s.model, ImuModel):
            slope = np.abs(frame.inertial(motion)[1]).max(axis=(0, 1))
        else:
            slope = np.abs(frame.pose(motion)[2]).max(axis=0)
        found |= set(np.flatnonzero(slope > 0).tolist())
    alone = {i for i in seen if seen.count(i) == 1} - found
    unseen = set(range(robot.dof)) - set(seen) - found
    if unseen:
        silent = ", ".join(robot.dof_names[i] for i in sorted(unseen))
        raise LogError(f"log: expected sensors that see {silent}, found none")
    return sorted(set(range(robot.dof)) - alone)


def _alone(stream: Stream, columns: Sequence[int]) -> bool:
    """Whether a stream sees none of the coupled coordinates."""
    model = stream.model
    return isinstance(model, EncoderModel) and not set(model.columns) & set(columns)


def _smooth_alone(
    robot: Robot,
    streams: Sequence[Stream],
    times: Array,
    density: Array,
    columns: Sequence[int],
    *,
    order: int,
    filtered: bool,
) -> tuple[Array, Array]:
    """Levels, (M, 3, n), and covariance, (M, 3 n, 3 n), of the coordinates not in `columns`."""
    n = robot.dof
    levels, covariance = np.zeros((len(times), 3, n)), np.zeros((len(times), 3 * n, 3 * n))
    for s in streams:
        if not isinstance(s.model, EncoderModel):
            continue
        alone = [(k, i) for k, i in enumerate(s.model.columns) if i not in columns]
        if not alone:
            continue
        picked, place = [k for k, _ in alone], np.array([i for _, i in alone])
        grid, rows = merged_times(s.time, times)
        values = np.full((len(grid), len(alone)), np.nan)
        values[np.searchsorted(grid, s.time)] = s.rows[:, picked]
        std = s.model.std
        found = smooth_chain(grid, values, std, density[place], order=order, filtered=filtered)
        for i in range(3):
            levels[:, i, place] = found.state[rows, :, i]
            for j in range(3):
                covariance[:, i * n + place, j * n + place] = found.covariance[rows, :, i, j]
    return levels, covariance


class _Run:
    """Filter and smoother over all measurements of a log in order of time."""

    def __init__(
        self,
        robot: Robot,
        streams: Sequence[Stream],
        times: Array,
        columns: Sequence[int],
        density: Array,
        order: int,
    ) -> None:
        self.streams, self.order, self.columns = streams, order, columns
        models = {s.name: s.model for s in streams}
        self.filter = MotionFilter(robot, columns, density, order, models)
        grid, wanted = merged_times(np.concatenate([s.time for s in streams]), times)
        self.time, self.wanted = grid, wanted
        self.events: list[list[Observation]] = [[] for _ in grid]
        for s in streams:
            whole = not isinstance(s.model, EncoderModel)
            seen = np.isfinite(s.rows)
            usable = seen.all(axis=1) if whole else seen.any(axis=1)
            places = np.searchsorted(grid, s.time - 1e-9)
            for k in np.flatnonzero(usable).tolist():
                self.events[places[k]].append(Observation(s.name, s.rows[k]))

    def forwards(self, only_wanted: bool = False) -> list[MotionEstimate]:
        """Estimates after each time of a measurement, or at the wanted times alone."""
        estimate = initial_estimate(self.filter, self.streams)
        kept: list[MotionEstimate] = []
        self.steps: list[Step] = []
        wanted = set(self.wanted.tolist()) if only_wanted else set()
        found: dict[int, MotionEstimate] = {}
        for k, observations in enumerate(self.events):
            if k:
                estimate, step = self.filter.predict(
                    estimate, float(self.time[k] - self.time[k - 1])
                )
                self.steps.append(step)
            if observations:
                estimate, _ = self.filter.update(estimate, observations)
            if not only_wanted:
                kept.append(estimate)
            elif k in wanted:
                found[k] = estimate
        return [found[k] for k in self.wanted.tolist()] if only_wanted else kept

    def smoothed(self) -> list[MotionEstimate]:
        """Estimates at the wanted times, given all measurements."""
        estimates = self.forwards()
        wanted = set(self.wanted.tolist())
        after = estimates[-1]
        found = {len(estimates) - 1: after}
        for k in range(len(estimates) - 2, -1, -1):
            after = self.filter.smooth_back(estimates[k], self.steps[k], after)
            estimates.pop()
            if k in wanted:
                found[k] = after
        return [found[k] for k in self.wanted.tolist()]


def initial_estimate(motion_filter: MotionFilter, streams: Sequence[Stream]) -> MotionEstimate:
    """Estimate before the first measurement: first samples with large standard deviations."""
    robot, order = motion_filter.robot, motion_filter.order
    levels, attitude = np.zeros((order, robot.dof)), np.eye(3)
    for column, (s, k) in encoded_coordinates(streams).items():
        seen = s.rows[np.isfinite(s.rows[:, k]), k]
        if len(seen) and column in motion_filter.columns:
            levels[0, column] = seen[0]
    camera, base = first_camera(streams), floating_base(robot)
    if camera is not None and base is not None and isinstance(camera.model, CaptureModel):
        row = camera.rows[np.isfinite(camera.rows).all(axis=1)][0]
        _, guessed, _ = camera.model.frame.pose(Motion(levels, attitude))
        attitude = from_quaternion(row[3:]).as_matrix() @ guessed.T
        place, _, _ = camera.model.frame.pose(Motion(levels, attitude))
        levels[0, list(base.place)] += row[:3] - place
    biases = [s.model.bias_std for s in streams if s.model.biases]
    owed = [
        np.sqrt(motion_filter.density * _MEMORY ** (2 * (order - 1 - k) + 1)) for k in range(order)
    ]
    least = np.zeros((order, 1))
    least[:3, 0] = UNKNOWN
    std = np.concatenate([np.maximum(owed, least).ravel(), *biases])
    return MotionEstimate(Motion(levels, attitude), np.zeros(6 * len(biases)), np.diag(std))


def smoothed_motion(
    robot: Robot, streams: Sequence[Stream], times: Array, smoother: Smoother
) -> SmoothedMotion:
    """Motion from encoders and cameras alone, each coordinate by itself.

    Attitude is smoothed as a quaternion, whose noise is half that of the angles.

    Args:
        robot: The machine.
        streams: Measurements.
        times: Times at which the motion is wanted, (M,) [s].
        smoother: Smoother of each coordinate.

    Raises:
        LogError: If a coordinate is seen by no encoder, and by no camera on the floating body.
    """
    n = robot.dof
    levels, covariance = np.zeros((len(times), 3, n)), np.zeros((len(times), 3 * n, 3 * n))
    attitude = Rotation.identity(len(times))
    silent = set(range(n))
    for s in streams:
        part = smoothed_stream(robot, s, times, smoother)
        if part is None:
            continue
        place = np.array(part.columns)
        levels[:, :, place] = np.swapaxes(part.state, 1, 2)
        for i in range(3):
            for j in range(3):
                covariance[:, i * n + place, j * n + place] = part.covariance[:, :, i, j]
        attitude = attitude if part.attitude is None else part.attitude
        silent -= set(part.columns)
    if silent:
        names = ", ".join(robot.dof_names[i] for i in sorted(silent))
        raise LogError(f"log: expected encoders or cameras that see {names}, found none")
    return SmoothedMotion(levels, attitude, covariance)


@dataclass(frozen=True)
class SensorMotion:
    """Motion of the coordinates that one sensor sees.

    Attributes:
        columns: Indices of the coordinates.
        state: Position, velocity, acceleration of each, (M, k, 3) [m, rad, per s, per s^2].
        covariance: Covariance of those three, (M, k, 3, 3) [products of their units].
        attitude: Rotations from body to world axes, M; None from an encoder.
    """

    columns: tuple[int, ...]
    state: Array
    covariance: Array
    attitude: Rotation | None


def smoothed_stream(
    robot: Robot, stream: Stream, times: Array, smoother: Smoother
) -> SensorMotion | None:
    """Motion from one encoder or camera system alone; None for other sensors.

    Args:
        robot: The machine.
        stream: Measurements of the sensor.
        times: Times at which the motion is wanted, (M,) [s].
        smoother: Smoother of each coordinate.

    Raises:
        LogError: If cameras do not see the floating body.
    """
    model, base = stream.model, floating_base(robot)
    if isinstance(model, EncoderModel):
        found = smoother.smooth(stream.time, stream.rows, model.std, times)
        return SensorMotion(tuple(model.columns), found.state, found.covariance, None)
    if isinstance(model, CaptureModel) and base is not None:
        place, turn, attitude = _smooth_base(stream, times, smoother)
        state = np.concatenate([place[0], turn[0]], axis=1)
        covariance = np.concatenate([place[1], turn[1]], axis=1)
        return SensorMotion((*base.place, *base.turn), state, covariance, attitude)
    return None


def _smooth_base(
    camera: Stream, times: Array, smoother: Smoother
) -> tuple[tuple[Array, Array], tuple[Array, Array], Rotation]:
    """Position and rotation of a floating body with covariances, and its attitude."""
    model = camera.model
    if not isinstance(model, CaptureModel) or not model.frame.on_base:
        raise LogError(f"{camera.name}: expected cameras that see the floating body itself")
    seen = np.isfinite(camera.rows).all(axis=1)
    std = np.sqrt(model.variance)
    place = smoother.smooth(camera.time[seen], camera.rows[seen, :3], std[:3], times)
    mount = Rotation.from_matrix(model.frame.mount)
    shown = from_quaternion(camera.rows[seen, 3:]) * mount.inv()
    parts = shown.as_quat()
    flips = np.cumprod(np.sign(np.einsum("ij,ij->i", parts[1:], parts[:-1])))
    parts[1:] *= flips[:, None]
    angle = float(std[3:].mean())
    turned = smoother.smooth(camera.time[seen], parts, angle / 2, times)
    length = np.linalg.norm(turned.state[:, :, 0], axis=1)[:, None, None]
    four = turned.state / length
    attitude = Rotation.from_quat(np.array(four[:, :, 0]))
    spin = 2 * _vector_part(four[:, :, 0], four[:, :, 1])
    spin_rate = 2 * _vector_part(four[:, :, 0], four[:, :, 2])
    covariance = 4 * turned.covariance[:, :3]
    offset = model.frame.offset
    lever = np.tile(offset, (len(spin), 1))
    lever_velocity = np.cross(spin, lever)
    lever_acceleration = np.cross(spin_rate, lever) + np.cross(spin, lever_velocity)
    moved = np.stack(
        [attitude.apply(part) for part in (lever, lever_velocity, lever_acceleration)], axis=-1
    )
    state = np.stack([np.zeros_like(spin), spin, spin_rate], axis=-1)
    return (place.state - moved, place.covariance), (state, covariance), attitude


def _vector_part(quaternion: Array, other: Array) -> Array:
    """Vector part of the product of a conjugate quaternion with another, (N, 3) [-]; x, y, z, w."""
    u, w = -quaternion[:, :3], quaternion[:, 3:]
    p, s = other[:, :3], other[:, 3:]
    return np.asarray(w * p + s * u + np.cross(u, p))


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
