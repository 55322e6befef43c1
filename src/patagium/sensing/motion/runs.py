"""The passes over a log: filter and smoother of coupled coordinates, chains of the others.

Neglected: logs longer than memory; a filtered covariance is kept for each sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from patagium.errors import LogError
from patagium.robot import Robot
from patagium.sensing.motion.chains import smooth_chain
from patagium.sensing.motion.filter import Belief, MotionFilter, Step
from patagium.sensing.motion.model import FrameModel, Motion, base_of
from patagium.sensing.motion.sensors import (
    CaptureChannel,
    EncoderChannel,
    ImuChannel,
    Observation,
)
from patagium.sensing.motion.smoothers import Smoother, merged
from patagium.sensing.motion.streams import Stream, camera_of, encoded
from patagium.sensing.sensors import from_quaternion

Array = NDArray[np.float64]

UNKNOWN = (1e-1, 3e1, 3e2)
"""Deviation of position, rate, acceleration before any sample at least [m or rad, per s, s^2]."""
_MEMORY = 0.5  # s of driving noise that the start may owe itself to


@dataclass(frozen=True)
class Found:
    """A motion at times, attitude apart.

    Attributes:
        levels: Position, velocity, acceleration of each coordinate, (M, 3, n); for attitude
            zero, angular velocity and its derivative in body axes.
        attitude: Body axes to world axes, M rotations; the identity without a floating body.
        covariance: Of the levels one after the other, small rotations for attitude, (M, 3 n, 3 n).
    """

    levels: Array
    attitude: Rotation
    covariance: Array


def by_kalman(
    robot: Robot,
    streams: Sequence[Stream],
    times: Array,
    density: Array,
    *,
    order: int,
    filtered: bool,
) -> Found:
    """Motion by Kalman filter and, unless `filtered`, smoother.

    Args:
        robot: The machine.
        streams: What was measured.
        times: Where the motion is wanted, (M,) [s].
        density: Of the noise that drives each coordinate, (n,).
        order: Levels of each coordinate.
        filtered: Whether to stop before the smoother.
    """
    n = robot.dof
    columns = coupled(robot, streams)
    levels, covariance = np.zeros((len(times), 3, n)), np.zeros((len(times), 3 * n, 3 * n))
    _smooth_alone(robot, streams, times, density, order, filtered, columns, levels, covariance)
    attitude = Rotation.identity(len(times))
    if columns:
        among = [s for s in streams if not _alone(s, columns)]
        run = _Run(robot, among, times, columns, density[columns], order)
        beliefs = run.forwards(filtered) if filtered else run.both_ways()
        attitude = Rotation.from_matrix(np.array([belief.motion.attitude for belief in beliefs]))
        places = np.concatenate([np.array(columns) + level * n for level in range(3)])
        kept = 3 * len(columns)
        for k, belief in enumerate(beliefs):
            levels[k][:, columns] = belief.motion.levels[:3][:, columns]
            covariance[k][np.ix_(places, places)] = belief.covariance[:kept, :kept]
    return Found(levels, attitude, covariance)


def coupled(robot: Robot, streams: Sequence[Stream]) -> list[int]:
    """Coordinates that must be estimated together: all but those one encoder alone sees."""
    base = base_of(robot)
    found = set() if base is None else {*base.place, *base.turn}
    rng = np.random.default_rng(0)
    motion = Motion(rng.uniform(0.1, 1.0, (3, robot.dof)), np.eye(3))
    seen: list[int] = []
    for s in streams:
        if isinstance(s.channel, EncoderChannel):
            seen += s.channel.columns
            continue
        frame: FrameModel = s.channel.frame  # type: ignore[attr-defined]
        if isinstance(s.channel, ImuChannel):
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
    """Whether a stream sees nothing of the coupled coordinates."""
    channel = stream.channel
    return isinstance(channel, EncoderChannel) and not set(channel.columns) & set(columns)


def _smooth_alone(
    robot: Robot,
    streams: Sequence[Stream],
    times: Array,
    density: Array,
    order: int,
    filtered: bool,
    columns: Sequence[int],
    levels: Array,
    covariance: Array,
) -> None:
    n = robot.dof
    for s in streams:
        if not isinstance(s.channel, EncoderChannel):
            continue
        alone = [(k, i) for k, i in enumerate(s.channel.columns) if i not in columns]
        if not alone:
            continue
        picked, place = [k for k, _ in alone], np.array([i for _, i in alone])
        grid, rows = merged(s.time, times)
        values = np.full((len(grid), len(alone)), np.nan)
        values[np.searchsorted(grid, s.time)] = s.rows[:, picked]
        std = s.channel.std
        found = smooth_chain(grid, values, std, density[place], order=order, filtered=filtered)
        for i in range(3):
            levels[:, i, place] = found.state[rows, :, i]
            for j in range(3):
                covariance[:, i * n + place, j * n + place] = found.covariance[rows, :, i, j]


class _Run:
    """Filter and smoother over the events of a log."""

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
        channels = {s.name: s.channel for s in streams}
        self.filter = MotionFilter(robot, columns, density, order, channels)
        grid, wanted = merged(np.concatenate([s.time for s in streams]), times)
        self.time, self.wanted = grid, wanted
        self.events: list[list[Observation]] = [[] for _ in grid]
        for s in streams:
            whole = not isinstance(s.channel, EncoderChannel)
            seen = np.isfinite(s.rows)
            usable = seen.all(axis=1) if whole else seen.any(axis=1)
            places = np.searchsorted(grid, s.time - 1e-9)
            for k in np.flatnonzero(usable).tolist():
                self.events[places[k]].append(Observation(s.name, s.rows[k]))

    def forwards(self, only_wanted: bool = False) -> list[Belief]:
        """Beliefs after each event, or at the times wanted."""
        belief = start(self.filter, self.streams)
        kept: list[Belief] = []
        self.steps: list[Step] = []
        asked = set(self.wanted.tolist()) if only_wanted else set()
        found: dict[int, Belief] = {}
        for k, observations in enumerate(self.events):
            if k:
                belief, step = self.filter.predict(belief, float(self.time[k] - self.time[k - 1]))
                self.steps.append(step)
            if observations:
                belief, _ = self.filter.update(belief, observations)
            if not only_wanted:
                kept.append(belief)
            elif k in asked:
                found[k] = belief
        return [found[k] for k in self.wanted.tolist()] if only_wanted else kept

    def both_ways(self) -> list[Belief]:
        """Beliefs at the times wanted, given everything."""
        beliefs = self.forwards()
        asked = set(self.wanted.tolist())
        after = beliefs[-1]
        found = {len(beliefs) - 1: after}
        for k in range(len(beliefs) - 2, -1, -1):
            after = self.filter.retrace(beliefs[k], self.steps[k], after)
            beliefs.pop()
            if k in asked:
                found[k] = after
        return [found[k] for k in self.wanted.tolist()]


def start(motion_filter: MotionFilter, streams: Sequence[Stream]) -> Belief:
    """What is known before the first event: first samples, and otherwise next to nothing."""
    robot, order = motion_filter.robot, motion_filter.order
    levels, attitude = np.zeros((order, robot.dof)), np.eye(3)
    for column, (s, k) in encoded(streams).items():
        seen = s.rows[np.isfinite(s.rows[:, k]), k]
        if len(seen) and column in motion_filter.columns:
            levels[0, column] = seen[0]
    camera, base = camera_of(streams), base_of(robot)
    if camera is not None and base is not None and isinstance(camera.channel, CaptureChannel):
        row = camera.rows[np.isfinite(camera.rows).all(axis=1)][0]
        _, guessed, _ = camera.channel.frame.pose(Motion(levels, attitude))
        attitude = from_quaternion(row[3:]).as_matrix() @ guessed.T
        place, _, _ = camera.channel.frame.pose(Motion(levels, attitude))
        levels[0, list(base.place)] += row[:3] - place
    biases = [s.channel.bias_std for s in streams if s.channel.biases]
    owed = [
        np.sqrt(motion_filter.density * _MEMORY ** (2 * (order - 1 - k) + 1)) for k in range(order)
    ]
    least = np.zeros((order, 1))
    least[:3, 0] = UNKNOWN
    std = np.concatenate([np.maximum(owed, least).ravel(), *biases])
    return Belief(Motion(levels, attitude), np.zeros(6 * len(biases)), np.diag(std))


def by_smoother(robot: Robot, streams: Sequence[Stream], times: Array, smoother: Smoother) -> Found:
    """Motion through encoders and cameras alone, each coordinate for itself.

    Attitude is smoothed as a quaternion, whose noise is half that of the angles.

    Args:
        robot: The machine.
        streams: What was measured.
        times: Where the motion is wanted, (M,) [s].
        smoother: How.

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
    return Found(levels, attitude, covariance)


@dataclass(frozen=True)
class Part:
    """What one sensor alone says of the motion.

    Attributes:
        columns: Coordinates it sees.
        state: Position, velocity, acceleration of each, (M, k, 3).
        covariance: Of those, (M, k, 3, 3).
        attitude: M rotations; None from an encoder.
    """

    columns: tuple[int, ...]
    state: Array
    covariance: Array
    attitude: Rotation | None


def smoothed_stream(robot: Robot, stream: Stream, times: Array, smoother: Smoother) -> Part | None:
    """What an encoder or cameras alone say of the motion; None of other sensors.

    Args:
        robot: The machine.
        stream: What was measured.
        times: Where the motion is wanted, (M,) [s].
        smoother: How.

    Raises:
        LogError: If cameras do not see the floating body.
    """
    channel, base = stream.channel, base_of(robot)
    if isinstance(channel, EncoderChannel):
        found = smoother.smooth(stream.time, stream.rows, channel.std, times)
        return Part(tuple(channel.columns), found.state, found.covariance, None)
    if isinstance(channel, CaptureChannel) and base is not None:
        place, turn, attitude = _smooth_base(stream, times, smoother)
        state = np.concatenate([place[0], turn[0]], axis=1)
        spread = np.concatenate([place[1], turn[1]], axis=1)
        return Part((*base.place, *base.turn), state, spread, attitude)
    return None


def _smooth_base(
    camera: Stream, times: Array, smoother: Smoother
) -> tuple[tuple[Array, Array], tuple[Array, Array], Rotation]:
    """Place and turn of a floating body with their covariances, and its attitude."""
    channel = camera.channel
    if not isinstance(channel, CaptureChannel) or not channel.frame.on_base:
        raise LogError(f"{camera.name}: expected cameras that see the floating body itself")
    seen = np.isfinite(camera.rows).all(axis=1)
    std = np.sqrt(channel.variance)
    place = smoother.smooth(camera.time[seen], camera.rows[seen, :3], std[:3], times)
    mount = Rotation.from_matrix(channel.frame.mount)
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
    bend = 2 * _vector_part(four[:, :, 0], four[:, :, 2])
    spread = 4 * turned.covariance[:, :3]
    offset = channel.frame.offset
    lever = np.tile(offset, (len(spin), 1))
    swing = np.cross(spin, lever)
    bow = np.cross(bend, lever) + np.cross(spin, swing)
    moved = np.stack([attitude.apply(part) for part in (lever, swing, bow)], axis=-1)
    state = np.stack([np.zeros_like(spin), spin, bend], axis=-1)
    return (place.state - moved, place.covariance), (state, spread), attitude


def _vector_part(quaternion: Array, other: Array) -> Array:
    """Of the product of a conjugate with another, (N, 3); x, y, z, w."""
    u, w = -quaternion[:, :3], quaternion[:, 3:]
    p, s = other[:, :3], other[:, 3:]
    return np.asarray(w * p + s * u + np.cross(u, p))
