"""Motion capture: position and attitude of a set of markers on a body.

Frames are lost in runs, as when markers hide behind a wing; a lost frame is NaN. Neglected:
errors that depend on the place in the room, swapped markers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from patagium.arrays import Array, Bools
from patagium.errors import ParameterError, finite, not_negative
from patagium.robot import Robot
from patagium.sensing.sensors.scene import Scene
from patagium.sensing.sensors.sensor import FramedSensor, Reading, Signal, noise
from patagium.simulation.flight import AXES

QUATERNION = ("w", "x", "y", "z")
"""Order of a quaternion's components."""


@dataclass(frozen=True, kw_only=True)
class MotionCapture(FramedSensor):
    """Camera system that measures position and attitude of a frame on a body.

    The quaternion maps the frame's components to the world's; w is never negative, so that its
    sign jumps where a turn passes 180 degrees.

    Args:
        name: Key of the sensor in a log; "motioncapture" by default.
        rate: Frames a second by its own clock [Hz].
        delay: Time from an event to its stamp, the latency [s].
        clock_offset: Reading of its clock at the world's time zero [s].
        clock_drift: Gain of its clock per second [s/s].
        body: Name of the body that carries the markers.
        position: Position of the frame from the body's origin, body axes, (3,) [m].
        orientation: Rotation from the frame's axes to body axes, (3, 3) [-].
        position_std: Standard deviation of the position, (3,) or one for all world axes [m].
        attitude_std: Standard deviation of the attitude, (3,) or one for all of the frame's axes
            [rad].
        dropout: Share of frames that are lost, below 1.
        dropout_length: Mean length of a run of lost frames [s]; 0 if frames are lost one by one.

    Raises:
        ParameterError: If a number is out of its range, or `orientation` is no rotation.
        ShapeError: If a vector or matrix has another shape.
    """

    body: str
    position_std: float | tuple[float, ...] = noise()
    attitude_std: float | tuple[float, ...] = noise()
    dropout: float = 0.0
    dropout_length: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= finite("dropout", self.dropout) < 1:
            raise ParameterError("dropout", "at least 0 and below 1", self.dropout)
        finite("dropout_length", self.dropout_length)
        not_negative(self, "dropout_length")
        super().__post_init__()

    def errors(self, robot: Robot, count: int, rng: np.random.Generator) -> tuple[Array, ...]:
        """Errors of position and attitude, and whether a frame is lost; see `Sensor.errors`."""
        moved = rng.standard_normal((count, 3)) * self.position_std
        turned = rng.standard_normal((count, 3)) * self.attitude_std
        return moved, turned, self._lost(count, rng).astype(float)

    def shown(self, scene: Scene, times: Array, errors: tuple[Array, ...]) -> Reading:
        """Reading of a scene at given times, (N,) [s]; see `Sensor.shown`."""
        moved, turned, missing = errors
        motion = self._motion(scene, self.body, times)
        attitude = Rotation.from_matrix(motion.rotation)
        shown = attitude * Rotation.from_rotvec(turned)
        lost = missing[:, None].astype(bool)
        place, turn = partial(Signal, ("axis",), "m"), partial(Signal, ("part",), "1")
        seen = np.where(lost, np.nan, motion.position + moved)
        turned = np.where(lost, np.nan, as_quaternion(shown))
        return Reading(
            {"position": place(seen), "quaternion": turn(turned)},
            {"position": place(motion.position), "quaternion": turn(as_quaternion(attitude))},
            {"axis": AXES, "part": QUATERNION},
        )

    def _lost(self, count: int, rng: np.random.Generator) -> Bools:
        """Whether each frame is lost, (N,), by a Markov chain of two states."""
        run = max(1.0, self.dropout_length * self.rate)
        leave = min(1.0 / run, 1.0 - self.dropout)
        enter = leave * self.dropout / (1.0 - self.dropout)
        lost, limit = np.zeros(count, bool), self.dropout
        for k, chance in enumerate(rng.random(count)):
            lost[k] = chance < limit
            limit = 1.0 - leave if lost[k] else enter
        return lost


def as_quaternion(rotation: Rotation) -> Array:
    """Quaternions w, x, y, z of rotations with w not negative, (N, 4) [-]."""
    parts = np.roll(rotation.as_quat(), 1, axis=1)
    return np.asarray(np.where(parts[:, :1] < 0, -parts, parts))


def from_quaternion(parts: Array) -> Rotation:
    """Rotations of quaternions w, x, y, z, (N, 4) [-], of either sign and any length but zero."""
    return Rotation.from_quat(np.roll(parts, -1, axis=-1))
