"""Base of all sensors: a clock, errors that can be scaled, and a reading.

A sensor samples at equal steps of its own clock. A sample with the stamp s shows the truth at the
time t = (s - offset) / (1 + drift) - delay. The delay is the time from an event to its stamp;
offset and drift are those of the sensor's clock against the world's. Neglected: jitter of stamps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np

from patagium.arguments import check_fields
from patagium.arrays import Array, Bools, real_array
from patagium.errors import ParameterError, ShapeError, finite, not_negative, positive

if TYPE_CHECKING:
    from patagium.robot import Robot
    from patagium.sensing.sensors.scene import FrameMotion, Scene

Axes: TypeAlias = tuple[tuple[float, ...], ...]

UPRIGHT: Axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Orientation of a sensor whose axes are those of its body."""

_NOISE, _SIGNED, _BOUND = {"noise": True}, {"signed": True}, {"bound": True}
_NEAR = 1.0 - 1e-3
"""Share of a range from which a reading may be cut off: a converter of 12 bits ends there."""
HIDDEN = ("clock_offset", "clock_drift", "delay")
"""Properties that a laboratory has to find out; the description of a sensor leaves them out."""


def noise(default: Any = 0.0, *, signed: bool = False) -> Any:
    """Field of a sensor with an error that `scaled` multiplies, not negative unless signed."""
    return field(default=default, metadata=_SIGNED if signed else _NOISE)


def bound() -> Any:
    """Field of a sensor with a size at which it saturates, or a bandwidth; None without one."""
    return field(default=None, metadata=_BOUND)


@dataclass(frozen=True)
class Signal:
    """A quantity over time.

    Attributes:
        dims: Names of the axes after time.
        units: SI unit.
        values: Samples, (N, ...), in the unit `units`; NaN where a sample was lost.
    """

    dims: tuple[str, ...]
    units: str
    values: Array


@dataclass(frozen=True)
class Reading:
    """Signals of a sensor with and without errors.

    Attributes:
        measured: Measured signals by name.
        true: Signals without any error by name, and slow errors such as biases.
        labels: Names along the axes after time.
    """

    measured: Mapping[str, Signal]
    true: Mapping[str, Signal]
    labels: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """Sensor with its own clock.

    Args:
        name: Key of the sensor in a log; "" for the name of its kind.
        rate: Samples a second by its own clock [Hz].
        delay: Time from an event to its stamp, by the world's clock [s].
        clock_offset: Reading of its clock at the world's time zero [s].
        clock_drift: Gain of its clock per second [s/s].

    Raises:
        ParameterError: If a number is out of its range.
        ShapeError: If a vector or matrix has another shape.
    """

    name: str = ""
    rate: float
    delay: float = 0.0
    clock_offset: float = 0.0
    clock_drift: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        positive("rate", self.rate)
        not_negative(self, "delay")
        if abs(self.clock_drift) >= 0.1:
            raise ParameterError("clock_drift", "less than 0.1 s/s", self.clock_drift)
        for entry in fields(self):
            name, value = entry.name, getattr(self, entry.name)
            if name == "body" and value == "":
                raise ParameterError(name, "the name of a body", value)
            if value is None:
                continue
            if "tuple[float" in str(entry.type):
                value = vector(name, value)
                object.__setattr__(self, name, value)
            if entry.metadata == _NOISE and not np.min(value) >= 0:
                raise ParameterError(name, "zero or more", value)
            if entry.metadata == _BOUND:
                positive(name, float(np.min(value)))
        if not self.name:
            object.__setattr__(self, "name", type(self).__name__.lower())

    @property
    def limit(self) -> Array:
        """Size at which the values of a sample saturate, (k,) or one for all; inf for no limit."""
        return np.asarray(np.inf)

    @property
    def saturates(self) -> Array:
        """Size from which a reading counts as saturated, slightly below the limit."""
        return np.asarray(_NEAR * self.limit)

    @property
    def lag(self) -> float:
        """Time constant of the low-pass that its `bandwidth` states [s]; 0 without one."""
        width = getattr(self, "bandwidth", None)
        return 0.0 if width is None else 1.0 / (2.0 * np.pi * width)

    def saturated(self, rows: Array) -> Bools:
        """Whether values of samples, (N, k) or (k,), are at or beyond the range, and tell nothing.

        Every sample that enters an estimate passes here, from a log or from a robot in flight.
        """
        return np.abs(rows) >= self.saturates

    def in_range(self, rows: Array) -> Array:
        """Samples, (N, k) or (k,), in the units of the sensor; NaN where they are saturated."""
        return np.where(self.saturated(rows), np.nan, rows)

    def scaled(self, factor: float) -> Self:
        """Sensor with every error multiplied by a factor.

        Noise, biases, walks, steps of resolution and cross-talk are scaled; rate, delay,
        clock, range, bandwidth and lost samples are not. A sensor with factor 0 shows the truth.

        Args:
            factor: Zero or more.

        Raises:
            ParameterError: If the factor is negative.
        """
        finite("factor", factor)
        if factor < 0:
            raise ParameterError("factor", "zero or more", factor)
        errors = [entry.name for entry in fields(self) if entry.metadata in (_NOISE, _SIGNED)]
        known = {name: value for name in errors if (value := getattr(self, name)) is not None}
        return replace(self, **{name: np.multiply(factor, k).tolist() for name, k in known.items()})

    def clock(self, begin: float, end: float) -> tuple[Array, Array]:
        """Stamps of all samples of a span of time, and their times by the world's clock.

        Args:
            begin: Begin of the span by the world's clock [s].
            end: End of the span by the world's clock [s].

        Returns:
            Stamps by the sensor's clock, whole multiples of 1 / rate, and the world's times,
            (N,) each [s].
        """
        pace = 1.0 + self.clock_drift
        first, last = ((t + self.delay) * pace + self.clock_offset for t in (begin, end))
        slack = 1e-9 * self.rate * max(1.0, abs(first), abs(last))  # rounding of the stamps
        counts = np.arange(
            math.ceil(first * self.rate - slack), math.floor(last * self.rate + slack) + 1
        )
        stamps = counts / self.rate
        times = (stamps - self.clock_offset) / pace - self.delay
        return stamps, np.clip(times, begin, end)

    def measure(self, scene: Scene, times: Array, rng: np.random.Generator) -> Reading:
        """Reading of a scene.

        Args:
            scene: True motion and forces of a flight.
            times: Times by the world's clock, (N,) [s].
            rng: Generator of the errors.

        Raises:
            FlightError: If the flight lacks a quantity that the sensor measures.
            ParameterError: If the robot has no such body, joint or load cell.
        """
        return self.shown(scene, times, self.errors(scene.robot, len(times), rng))

    def errors(self, robot: Robot, count: int, rng: np.random.Generator) -> tuple[Array, ...]:
        """Errors of samples, drawn beforehand, so that they can be shown one after the other.

        Args:
            robot: The machine.
            count: Number of samples N.
            rng: Generator of the errors.

        Returns:
            Arrays of any kind for `shown`, (N, ...) each [units of the signals].
        """
        raise NotImplementedError

    def shown(self, scene: Scene, times: Array, errors: tuple[Array, ...]) -> Reading:
        """Reading of a scene with given errors.

        Args:
            scene: True motion and forces of a flight.
            times: Times by the world's clock, (N,) [s].
            errors: Those of the samples, from `errors`, (N, ...) each [units of the signals].
        """
        raise NotImplementedError

    def describe(self) -> dict[str, Any]:
        """Description for a file, JSON-able: all fields but delay and clock."""
        known = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {"kind": type(self).__name__} | {k: v for k, v in known.items() if k not in HIDDEN}


@dataclass(frozen=True, kw_only=True)
class FramedSensor(Sensor):
    """Sensor with axes of its own at a point of a body.

    Args:
        position: Position from the body's origin, body axes, (3,) [m].
        orientation: Rotation from the sensor's axes to body axes, (3, 3) [-].
    """

    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    orientation: Axes = UPRIGHT

    def __post_init__(self) -> None:
        object.__setattr__(self, "orientation", axes("orientation", self.orientation))
        super().__post_init__()

    def _motion(self, scene: Scene, body: str, times: Array) -> FrameMotion:
        """Motion of the sensor's axes at given times, (N,) [s]."""
        return scene.frame(body, np.asarray(self.position), np.asarray(self.orientation), times)


def vector(name: str, value: Any) -> tuple[float, ...]:
    """Tuple of three finite numbers from one number for all or (3,).

    Raises:
        ShapeError: If the value has another shape.
        ParameterError: If a number is not finite.
    """
    array = real_array(name, value)
    if array.shape not in ((), (3,)):
        raise ShapeError(name, (3,), array.shape)
    if not np.isfinite(array).all():
        raise ParameterError(name, "finite numbers", value)
    return tuple(np.broadcast_to(array, 3).tolist())


def axes(name: str, value: Any) -> Axes:
    """Rotation matrix, (3, 3) [-], as a tuple of rows; its columns are the axes of a sensor.

    Raises:
        ShapeError: If the value is not (3, 3).
        ParameterError: If the value is no rotation.
    """
    matrix = real_array(name, value, (3, 3))
    tolerance = 1e-9  # rounding of sines and cosines
    turned = np.abs(matrix @ matrix.T - np.eye(3)).max() < tolerance
    if not (turned and np.linalg.det(matrix) > 0):
        raise ParameterError(name, "a rotation", matrix.tolist())
    return tuple(map(tuple, matrix.tolist()))


def saturation(name: str, count: int, total: int) -> str:
    """Sentence on the samples of a sensor that are at or beyond its range."""
    share = f"{count / total:.1%} of the samples ({count} of {total})"
    return f"{name}: {share} reach the end of its range, where it tells nothing: they are missing"


def stepped(values: Array, step: Any) -> Array:
    """Values rounded to whole steps of a converter, or unchanged if the step is zero."""
    width = np.asarray(step, float)
    safe = np.where(width > 0, width, 1.0)
    return np.where(width > 0, np.round(values / safe) * safe, values)
