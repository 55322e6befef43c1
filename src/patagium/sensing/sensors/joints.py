"""Sensors of joints: encoders that see the coordinate, amplifiers that see the current.

Neglected: angles that wrap around, play and friction of gears, inductance of motors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from patagium.deprecation import renamed_fields
from patagium.errors import ParameterError, positive
from patagium.robot import Robot
from patagium.sensing.sensors.scene import Scene
from patagium.sensing.sensors.sensor import (
    Array,
    Reading,
    Sensor,
    Signal,
    limited,
    noise,
    stepped,
)


@renamed_fields(deviation="std", zero_deviation="zero_std")
@dataclass(frozen=True, kw_only=True)
class Encoder(Sensor):
    """Coordinates of joints in steps of a resolution.

    Args:
        name: Its key in a log; "encoder" by default.
        rate: Samples a second of its own clock [Hz].
        delay: Between what happens and the stamp it gets [s].
        clock_offset: What its clock shows at the world's zero [s].
        clock_drift: What it gains in a second [s/s].
        joints: Names of the coordinates; () for all that are actuated.
        resolution: One count [rad, m]; 0 for none.
        std: Of the noise before counting [rad, m].
        zero_std: Of the error of each zero, constant in a log [rad, m].
    """

    joints: tuple[str, ...] = ()
    resolution: float = noise()
    std: float = noise()
    zero_std: float = noise()

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", names("joints", self.joints))
        super().__post_init__()

    @property
    def sample_std(self) -> float:
        """Of a sample: noise and the rounding to counts, not the zero's error [rad, m]."""
        return float(np.hypot(self.std, self.resolution / np.sqrt(12.0)))

    def measure(self, scene: Scene, times: Array, rng: np.random.Generator) -> Reading:
        """What it shows of a scene at given times, (N,) [s]."""
        joints = joint_names(self.joints, scene.robot)
        places = scene.robot.coordinate_indices
        columns = [places[scene.robot.index(name)] for name in joints]
        truth = scene.coordinates(times)[0][:, columns]
        zero = self.zero_std * rng.standard_normal(len(joints))
        white = self.std * rng.standard_normal(truth.shape)
        shown = stepped(truth + zero + white, self.resolution)
        return Reading(
            {"position": Signal(("joint",), "m or rad", shown)},
            {
                "position": Signal(("joint",), "m or rad", truth),
                "zero": Signal(("joint",), "m or rad", np.broadcast_to(zero, truth.shape)),
            },
            {"joint": joints},
        )


@renamed_fields(
    deviation="std",
    offset_deviation="offset_std",
    torque_constant_deviation="torque_constant_std",
)
@dataclass(frozen=True, kw_only=True)
class MotorCurrent(Sensor):
    """Currents of motors, i = u1 / (ratio k), from which the joints' forces are known.

    Args:
        name: Its key in a log; "motorcurrent" by default.
        rate: Samples a second of its own clock [Hz].
        delay: Between what happens and the stamp it gets [s].
        clock_offset: What its clock shows at the world's zero [s].
        clock_drift: What it gains in a second [s/s].
        joints: Names of the coordinates; () for all that are actuated.
        torque_constant: k, torque of the motor for a current [N m/A].
        gear_ratio: Turns of the motor for one of the joint.
        std: Of the noise of the current [A].
        resolution: One count [A]; 0 for none.
        offset_std: Of the error at no current, constant in a log [A].
        torque_constant_std: Of the true constants, relative to the one stated.
        range: Where it saturates [A]; None where it does not.
        bandwidth: Of a low-pass of first order [Hz]; None where there is none.
    """

    joints: tuple[str, ...] = ()
    torque_constant: float
    gear_ratio: float = 1.0
    std: float = noise()
    resolution: float = noise()
    offset_std: float = noise()
    torque_constant_std: float = noise()
    range: float | None = None
    bandwidth: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", names("joints", self.joints))
        positive("torque_constant", self.torque_constant)
        positive("gear_ratio", self.gear_ratio)
        for name in ("range", "bandwidth"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name))
        super().__post_init__()

    @property
    def force_per_current(self) -> float:
        """Force of a joint for the current of its motor, as stated [N m/A]."""
        return self.gear_ratio * self.torque_constant

    @property
    def sample_std(self) -> float:
        """Of the force of a joint by one sample [N m]: noise and the rounding to counts."""
        current = np.hypot(self.std, self.resolution / np.sqrt(12.0))
        return float(self.force_per_current * current)

    def measure(self, scene: Scene, times: Array, rng: np.random.Generator) -> Reading:
        """What it shows of a scene at given times, (N,) [s]."""
        joints = joint_names(self.joints, scene.robot)
        columns = [scene.robot.index(name) for name in joints]
        force = scene.signal("u1", times, self.bandwidth, "motor currents")[:, columns]
        sharp = scene.signal("u1", times, None, "motor currents")[:, columns]
        error = self.torque_constant_std * rng.standard_normal(len(joints))
        offset = self.offset_std * rng.standard_normal(len(joints))
        white = self.std * rng.standard_normal(force.shape)
        true = sharp / self.force_per_current
        current = force / (self.force_per_current * (1.0 + error))
        shown = stepped(limited(current + offset + white, self.range), self.resolution)
        return Reading(
            {"current": Signal(("joint",), "A", shown)},
            {
                "current": Signal(("joint",), "A", true),
                "joint_force": Signal(("joint",), "N or N m", sharp),
            },
            {"joint": joints},
        )


def names(name: str, value: object) -> tuple[str, ...]:
    """Names of coordinates as a tuple.

    Raises:
        ParameterError: If one is no name.
    """
    found = (value,) if isinstance(value, str) else tuple(value)  # type: ignore[arg-type]
    if not all(isinstance(part, str) and part for part in found):
        raise ParameterError(name, "names of coordinates", value)
    return found


def joint_names(asked: tuple[str, ...], robot: Robot) -> tuple[str, ...]:
    """The coordinates asked for, or all that are actuated.

    Raises:
        ParameterError: If the robot has no such coordinate, or none is actuated.
    """
    chosen = asked or tuple(robot.dof_names[i] for i in robot.actuated)
    if not chosen:
        raise ParameterError("joints", f"coordinates of {robot.name!r}: none is actuated", ())
    for name in chosen:
        robot.index(name)
    return chosen
