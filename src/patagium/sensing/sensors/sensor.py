"""What all sensors have in common: a clock, noise that can be scaled, and a reading.

A sensor samples at equal steps of its own clock. What it stamps s shows the truth of
t = (s - offset) / (1 + drift) - delay: the delay is between what happened and the stamp, offset
and drift are those of its clock against the world's. Neglected: jitter of the stamps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from patagium.errors import ParameterError, ShapeError, finite, positive

if TYPE_CHECKING:
    from patagium.sensing.sensors.scene import Scene

Array: TypeAlias = NDArray[np.float64]
Axes: TypeAlias = tuple[tuple[float, ...], ...]

UPRIGHT: Axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Axes of a sensor that are those of the body it sits on."""

_NOISE = {"noise": True}
HIDDEN = ("clock_offset", "clock_drift", "delay")
"""What a laboratory has to find out: no part of a sensor's published description."""


def noise(default: Any = 0.0) -> Any:
    """A field of a sensor that `scaled` multiplies, not negative; of the default given."""
    return field(default=default, metadata=_NOISE)


@dataclass(frozen=True)
class Signal:
    """A quantity over time.

    Attributes:
        dims: Names of the axes after time.
        units: SI.
        values: (N, ...); NaN where a sample was lost.
    """

    dims: tuple[str, ...]
    units: str
    values: Array


@dataclass(frozen=True)
class Reading:
    """What a sensor showed, and what it should have shown.

    Attributes:
        measured: Name to signal.
        true: The same without any error, and errors that vary slowly, such as biases.
        labels: Names along axes.
    """

    measured: Mapping[str, Signal]
    true: Mapping[str, Signal]
    labels: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """An instrument with a clock of its own.

    Args:
        name: Its key in a log; "" for that of its kind.
        rate: Samples a second of its own clock [Hz].
        delay: Between what happens and the stamp it gets, by the world's clock [s].
        clock_offset: What its clock shows at the world's zero [s].
        clock_drift: What it gains in a second [s/s].

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
        positive("rate", self.rate)
        for name in ("delay", "clock_offset", "clock_drift"):
            finite(name, getattr(self, name))
        if self.delay < 0:
            raise ParameterError("delay", "zero or more seconds", self.delay)
        if abs(self.clock_drift) >= 0.1:
            raise ParameterError("clock_drift", "less than 0.1 s/s", self.clock_drift)
        for entry in fields(self):
            if entry.metadata == _NOISE:
                value = getattr(self, entry.name)
                if value is not None and not (np.isfinite(value).all() and np.min(value) >= 0):
                    raise ParameterError(entry.name, "zero or more", value)
        if not self.name:
            object.__setattr__(self, "name", type(self).__name__.lower())

    def scaled(self, factor: float) -> Self:
        """The same instrument with every error `factor` times as large.

        Noise, biases, walks, steps of resolution and cross-talk are scaled; rate, delay,
        clock, range, bandwidth and lost samples are not. 0: it shows the truth.

        Args:
            factor: Zero or more.

        Raises:
            ParameterError: If it is negative.
        """
        finite("factor", factor)
        if factor < 0:
            raise ParameterError("factor", "zero or more", factor)
        errors = [entry.name for entry in fields(self) if entry.metadata == _NOISE]
        return replace(self, **{name: _times(getattr(self, name), factor) for name in errors})

    def clock(self, begin: float, end: float) -> tuple[Array, Array]:
        """Stamps of all samples whose truth lies in a span, and when that truth was.

        Args:
            begin: By the world's clock [s].
            end: By the world's clock [s].

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
        """What it shows of a scene.

        Args:
            scene: The truth.
            times: By the world's clock, (N,) [s].
            rng: Where its errors come from.
        """
        raise NotImplementedError

    def describe(self) -> dict[str, Any]:
        """What a laboratory knows of it, JSON-able: all but delay and clock."""
        known = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {"kind": type(self).__name__} | {k: v for k, v in known.items() if k not in HIDDEN}


def _times(value: Any, factor: float) -> Any:
    if value is None:
        return None
    if isinstance(value, tuple):
        return tuple(_times(part, factor) for part in value)
    return factor * value


def vector(name: str, value: Any, size: int = 3) -> tuple[float, ...]:
    """Finite numbers, one for all or (size,), as a tuple of that size.

    Raises:
        ShapeError: If there are more or fewer.
        ParameterError: If one is not finite.
    """
    array = np.asarray(value, float)
    if array.shape not in ((), (size,)):
        raise ShapeError(name, (size,), array.shape)
    if not np.isfinite(array).all():
        raise ParameterError(name, "finite numbers", value)
    return tuple(float(x) for x in np.broadcast_to(array, (size,)))


def axes(name: str, value: Any) -> Axes:
    """Sensor axes as the columns of a rotation, (3, 3), as tuples of rows.

    Raises:
        ShapeError: If it is not (3, 3).
        ParameterError: If it is no rotation.
    """
    matrix = np.asarray(value, float)
    if matrix.shape != (3, 3):
        raise ShapeError(name, (3, 3), matrix.shape)
    tolerance = 1e-9  # rounding of sines and cosines
    turned = np.abs(matrix @ matrix.T - np.eye(3)).max() < tolerance
    if not (turned and np.linalg.det(matrix) > 0):
        raise ParameterError(name, "a rotation", matrix.tolist())
    return tuple(tuple(float(x) for x in row) for row in matrix)


def stepped(values: Array, step: Any) -> Array:
    """Values rounded to whole steps of a converter; a step of zero leaves them."""
    width = np.broadcast_to(np.asarray(step, float), values.shape)
    safe = np.where(width > 0, width, 1.0)
    return np.where(width > 0, np.round(values / safe) * safe, values)


def limited(values: Array, limit: Any) -> Array:
    """Values held at plus and minus a limit; None leaves them."""
    if limit is None:
        return values
    bound = np.asarray(limit, float)
    return np.clip(values, -bound, bound)
