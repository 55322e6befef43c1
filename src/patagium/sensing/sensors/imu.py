"""Inertial measurement unit anywhere on the robot: specific force and angular rate.

Noise densities are one-sided, as data sheets state them: a sample at a rate f has the standard
deviation density sqrt(f / 2), that of a unit whose low-pass ends at half its rate. Neglected: that
low-pass itself, errors of scale, misalignment, and the effect of vibration on a bias.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from patagium.arrays import Array
from patagium.robot import Robot
from patagium.sensing.sensors.scene import Scene
from patagium.sensing.sensors.sensor import FramedSensor, Reading, Signal, bound, noise, stepped
from patagium.simulation.flight import AXES

WEIGHTLESS = (
    "gravity is 0 in the robot file: with it an accelerometer at rest shows 0, and in real water "
    "9.81 m/s^2; a file with gravity has it so, and buoyancy is then a force of the air"
)
"""What is wrong with inertial units on a robot without gravity."""


@dataclass(frozen=True, kw_only=True)
class Imu(FramedSensor):
    """Sensor of specific force R^T (a - g) and angular rate at a point of a body.

    Args:
        name: Key of the sensor in a log; "imu" by default.
        rate: Samples a second by its own clock [Hz].
        delay: Time from an event to its stamp [s].
        clock_offset: Reading of its clock at the world's time zero [s].
        clock_drift: Gain of its clock per second [s/s].
        body: Name of the body that carries the sensor.
        position: Position from the body's origin, body axes, (3,) [m].
        orientation: Rotation from the unit's axes to body axes, (3, 3) [-].
        accelerometer_density: Noise density of the specific force, (3,) or one for all
            [m/s^2/sqrt(Hz)].
        gyroscope_density: Noise density of the angular rate, (3,) or one for all [rad/s/sqrt(Hz)].
        accelerometer_bias: Standard deviation of the initial bias [m/s^2].
        gyroscope_bias: Standard deviation of the initial bias [rad/s].
        accelerometer_walk: Random walk of the bias [m/s^2/sqrt(s)].
        gyroscope_walk: Random walk of the bias [rad/s/sqrt(s)].
        accelerometer_step: One count of the converter [m/s^2]; 0 for none.
        gyroscope_step: One count of the converter [rad/s]; 0 for none.
        accelerometer_range: Specific force at which it saturates [m/s^2]; None for no limit.
        gyroscope_range: Angular rate at which it saturates [rad/s]; None for no limit.

    Raises:
        ParameterError: If a number is out of its range, or `orientation` is no rotation.
        ShapeError: If a vector or matrix has another shape.
    """

    body: str
    accelerometer_density: float | tuple[float, ...] = noise()
    gyroscope_density: float | tuple[float, ...] = noise()
    accelerometer_bias: float = noise()
    gyroscope_bias: float = noise()
    accelerometer_walk: float = noise()
    gyroscope_walk: float = noise()
    accelerometer_step: float = noise()
    gyroscope_step: float = noise()
    accelerometer_range: float | None = bound()
    gyroscope_range: float | None = bound()

    @property
    def accelerometer_std(self) -> Array:
        """Standard deviation of a sample of the specific force, (3,) [m/s^2]."""
        return np.asarray(np.sqrt(self.rate / 2) * np.array(self.accelerometer_density, float))

    @property
    def gyroscope_std(self) -> Array:
        """Standard deviation of a sample of the angular rate, (3,) [rad/s]."""
        return np.asarray(np.sqrt(self.rate / 2) * np.array(self.gyroscope_density, float))

    @property
    def limit(self) -> Array:
        """Size at which each value saturates, (6,) [m/s^2, rad/s]; see `Sensor.limit`."""
        ranges = self.accelerometer_range or np.inf, self.gyroscope_range or np.inf
        return np.repeat(ranges, 3)

    def errors(self, robot: Robot, count: int, rng: np.random.Generator) -> tuple[Array, ...]:
        """Bias and noise of the specific force, then of the angular rate; see `Sensor.errors`."""
        found = []
        for part in ("accelerometer", "gyroscope"):
            start = getattr(self, f"{part}_bias") * rng.standard_normal(3)
            steps = rng.standard_normal((count, 3)) * getattr(self, f"{part}_walk")
            steps[:1] = 0.0
            found.append(start + np.cumsum(steps / np.sqrt(self.rate), axis=0))
            found.append(getattr(self, f"{part}_std") * rng.standard_normal((count, 3)))
        return tuple(found)

    def shown(self, scene: Scene, times: Array, errors: tuple[Array, ...]) -> Reading:
        """Reading of a scene at given times, (N,) [s]; see `Sensor.shown`."""
        motion = self._motion(scene, self.body, times)
        (most, fastest), measured, true = np.split(self.limit, 2), {}, {}
        for part, quantity, units, truth, (bias, white), limit in (
            ("accelerometer", "specific_force", "m/s^2", motion.specific_force, errors[:2], most),
            ("gyroscope", "angular_rate", "rad/s", motion.angular_velocity, errors[2:], fastest),
        ):
            signal = partial(Signal, ("axis",), units)
            shown = np.clip(truth + bias + white, -limit, limit)
            measured[quantity] = signal(stepped(shown, getattr(self, f"{part}_step")))
            true[quantity], true[f"{part}_bias"] = signal(truth), signal(bias)
        return Reading(measured, true, {"axis": AXES})
