"""Sensors of joints: encoders of the coordinates, amplifiers that measure motor currents.

Neglected: angles that wrap around, play and friction of gears, inductance of motors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from patagium.arrays import Array
from patagium.errors import ParameterError, positive
from patagium.robot import Robot
from patagium.sensing.sensors.scene import Scene
from patagium.sensing.sensors.sensor import Reading, Sensor, Signal, bound, noise, stepped


@dataclass(frozen=True, kw_only=True)
class JointSensor(Sensor):
    """Sensor of the coordinates of joints.

    Args:
        joints: Names of the coordinates; () for all actuated ones.

    Raises:
        ParameterError: If an entry is no name.
    """

    joints: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names = tuple(self.joints) if isinstance(self.joints, list | tuple) else (self.joints,)
        if not all(isinstance(part, str) and part for part in names):
            raise ParameterError("joints", "names of coordinates", self.joints)
        object.__setattr__(self, "joints", names)
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class Encoder(JointSensor):
    """Encoder of the coordinates of joints.

    Args:
        name: Key of the sensor in a log; "encoder" by default.
        rate: Samples a second by its own clock [Hz].
        delay: Time from an event to its stamp [s].
        clock_offset: Reading of its clock at the world's time zero [s].
        clock_drift: Gain of its clock per second [s/s].
        joints: Names of the coordinates; () for all actuated ones.
        resolution: One count [rad, m]; 0 for none.
        std: Standard deviation of the noise before counting [rad, m].
        zero_std: Standard deviation of the error of each zero, constant in a log [rad, m].
    """

    resolution: float = noise()
    std: float = noise()
    zero_std: float = noise()

    @property
    def sample_std(self) -> float:
        """Standard deviation of a sample by noise and rounding, without the zero [rad, m]."""
        return float(np.hypot(self.std, self.resolution / np.sqrt(12.0)))

    def errors(self, robot: Robot, count: int, rng: np.random.Generator) -> tuple[Array, ...]:
        """Error of each zero, and noise of each sample; see `Sensor.errors`."""
        width = len(joint_names(self.joints, robot))
        zero = self.zero_std * rng.standard_normal(width)
        white = self.std * rng.standard_normal((count, width))
        return np.broadcast_to(zero, white.shape), white

    def shown(self, scene: Scene, times: Array, errors: tuple[Array, ...]) -> Reading:
        """Reading of a scene at given times, (N,) [s]; see `Sensor.shown`.

        Raises:
            ParameterError: If a coordinate is a part of a quaternion.
        """
        joints, (zero, white) = joint_names(self.joints, scene.robot), errors
        places, units = scene.robot.coordinate_indices, scene.robot.coordinate_units
        columns = [places[scene.robot.index(name)] for name in joints]
        if any(units[k] == "1" for k in columns):
            raise ParameterError("joints", "coordinates that are no part of a quaternion", joints)
        truth = scene.coordinates(times)[0][:, columns]
        shown = stepped(truth + zero + white, self.resolution)
        signal = partial(Signal, ("joint",), "m or rad")
        true = {"position": signal(truth), "zero": signal(zero)}
        return Reading({"position": signal(shown)}, true, {"joint": joints})


@dataclass(frozen=True, kw_only=True)
class MotorCurrent(JointSensor):
    """Sensor of motor currents, i = u1 / (ratio k), from which the joint torques follow.

    Args:
        name: Key of the sensor in a log; "motorcurrent" by default.
        rate: Samples a second by its own clock [Hz].
        delay: Time from an event to its stamp [s].
        clock_offset: Reading of its clock at the world's time zero [s].
        clock_drift: Gain of its clock per second [s/s].
        joints: Names of the coordinates; () for all actuated ones.
        torque_constant: Torque k of the motor per current [N m/A].
        gear_ratio: Turns of the motor for one turn of the joint.
        std: Standard deviation of the noise of the current [A].
        resolution: One count [A]; 0 for none.
        offset_std: Standard deviation of the error at no current, constant in a log [A].
        torque_constant_std: Standard deviation of the true constants, relative to the stated one.
        range: Current at which it saturates [A]; None if it does not.
        bandwidth: Bandwidth of a first-order low-pass [Hz]; None without one.
    """

    torque_constant: float
    gear_ratio: float = 1.0
    std: float = noise()
    resolution: float = noise()
    offset_std: float = noise()
    torque_constant_std: float = noise()
    range: float | None = bound()
    bandwidth: float | None = bound()

    def __post_init__(self) -> None:
        positive("torque_constant", self.torque_constant)
        positive("gear_ratio", self.gear_ratio)
        super().__post_init__()

    @property
    def limit(self) -> Array:
        """Current at which it saturates [A]; see `Sensor.limit`."""
        return np.asarray(np.inf if self.range is None else self.range)

    @property
    def force_per_current(self) -> float:
        """Stated torque of a joint per current of its motor [N m/A]."""
        return self.gear_ratio * self.torque_constant

    @property
    def sample_std(self) -> float:
        """Standard deviation of a joint torque from one sample, by noise and rounding [N m]."""
        current = np.hypot(self.std, self.resolution / np.sqrt(12.0))
        return float(self.force_per_current * current)

    def measure(self, scene: Scene, times: Array, rng: np.random.Generator) -> Reading:
        """Reading of a scene at given times, (N,) [s]; see `Sensor.measure`."""
        joints = joint_names(self.joints, scene.robot)
        columns = [scene.robot.index(name) for name in joints]
        held = scene.values("u1", "motor currents")[:, columns]
        sharp, force = (scene.through(held, times, width) for width in (None, self.bandwidth))
        error = self.torque_constant_std * rng.standard_normal(len(joints))
        offset = self.offset_std * rng.standard_normal(len(joints))
        white = self.std * rng.standard_normal(force.shape)
        true = sharp / self.force_per_current
        flows = force / (self.force_per_current * (1.0 + error))
        shown = stepped(np.clip(flows + offset + white, -self.limit, self.limit), self.resolution)
        current, torque = (partial(Signal, ("joint",), units) for units in ("A", "N or N m"))
        truth = {"current": current(true), "joint_force": torque(sharp)}
        return Reading({"current": current(shown)}, truth, {"joint": joints})


def joint_names(chosen: tuple[str, ...], robot: Robot) -> tuple[str, ...]:
    """Names of the chosen coordinates, or of all actuated ones if none is chosen.

    Raises:
        ParameterError: If the robot has no such coordinate, or none is actuated.
    """
    chosen = chosen or robot.actuated_names
    if not chosen:
        raise ParameterError("joints", f"coordinates of {robot.name!r}: none is actuated", ())
    for name in chosen:
        robot.index(name)
    return chosen
