"""Gusts: velocity of the air as a function of time, the same everywhere.

A discrete gust (one minus cosine) and continuous turbulence (Dryden). Both are
functions of time alone: the same answer whatever the time step that asks.
Neglected: the time a gust takes to sweep over the robot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from math import ceil, exp, isfinite, sqrt
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ParameterError, ShapeError

STEPS_PER_LENGTH = 50
"""Samples of Dryden turbulence in the time the shortest length scale takes to pass."""


class Gust(Protocol):
    """Velocity of the air added to the steady wind."""

    def velocity_at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocity, world axes, (N, 3) [m/s], at times (N,) [s]."""
        ...

    def describe(self) -> dict[str, Any]:
        """Everything needed to make it again, as JSON-able values."""
        ...


@dataclass(frozen=True)
class OneMinusCosineGust:
    """One smooth gust, w(t) = W/2 (1 - cos(2 pi (t - start)/T)) for 0 <= t - start <= T.

    Args:
        velocity: Largest velocity W, world axes, (3,) [m/s].
        start: When it begins [s].
        length_time: How long it lasts, T [s].

    Raises:
        ParameterError: If a number is not finite or T not positive.
        ShapeError: If `velocity` is not (3,).

    References:
        MIL-F-8785C, section 3.7.1.3.
    """

    velocity: tuple[float, float, float]
    start: float
    length_time: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "velocity", _triple("velocity", self.velocity))
        if not isfinite(self.start):
            raise ParameterError("start", "a finite time [s]", self.start)
        _require_positive("length_time", self.length_time)

    def velocity_at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocity of the gust, world axes, (N, 3) [m/s], at times (N,) [s]."""
        phase = np.clip((time - self.start) / self.length_time, 0.0, 1.0)
        return np.outer(0.5 * (1.0 - np.cos(2 * np.pi * phase)), self.velocity)

    def describe(self) -> dict[str, Any]:
        """Everything needed to make it again, as JSON-able values."""
        return {"name": "one_minus_cosine", **_listed(asdict(self))}


@dataclass(frozen=True)
class DrydenGust:
    """Continuous turbulence: white noise through the Dryden shaping filters.

    Along x   H = s sqrt(2 T) / (1 + T iw),            T = L/U,
    along y, z H = s sqrt(T) (1 + sqrt(3) T iw) / (1 + T iw)^2,
    driven by noise of unit two-sided density, so that each variance is s^2. The
    filters are discretized exactly on a fixed grid of `STEPS_PER_LENGTH` steps in the
    shortest T and read off linearly in between; motion faster than a step is missing.

    Args:
        intensity: Standard deviation s along world x, y, z, (3,) [m/s].
        length_scale: Length scale L along x, y, z, (3,) [m].
        airspeed: Speed U at which the robot meets the frozen turbulence [m/s].
        seed: Seed of the noise.

    Raises:
        ParameterError: If a number is negative (intensity) or not positive (the others).
        ShapeError: If a triple is not (3,).

    References:
        MIL-F-8785C, section 3.7.2.
    """

    intensity: tuple[float, float, float]
    length_scale: tuple[float, float, float]
    airspeed: float
    seed: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "intensity", _triple("intensity", self.intensity))
        object.__setattr__(self, "length_scale", _triple("length_scale", self.length_scale))
        if min(self.intensity) < 0:
            raise ParameterError("intensity", "three numbers >= 0 [m/s]", self.intensity)
        _require_positive("length_scale", min(self.length_scale))
        _require_positive("airspeed", self.airspeed)
        if self.seed != int(self.seed) or self.seed < 0:
            raise ParameterError("seed", "a whole number >= 0", self.seed)

    @property
    def step(self) -> float:
        """Time between two samples of the turbulence [s]."""
        return min(self.length_scale) / self.airspeed / STEPS_PER_LENGTH

    def velocity_at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocity of the turbulence, world axes, (N, 3) [m/s], at times (N,) >= 0 [s].

        Raises:
            ParameterError: If a time is negative: the turbulence begins at zero.
        """
        if time.size and time.min() < 0:
            raise ParameterError("time", "times >= 0 [s]", float(time.min()))
        count = ceil((time.max() if time.size else 0.0) / self.step) + 2
        noise = np.random.default_rng(self.seed).standard_normal((count, 3, 2))
        grid = self.step * np.arange(count)
        columns = [
            np.interp(time, grid, self.intensity[axis] * self._unit(axis, noise[:, axis]))
            for axis in range(3)
        ]
        return np.stack(columns, axis=-1)

    def describe(self) -> dict[str, Any]:
        """Everything needed to make it again, as JSON-able values."""
        return {"name": "dryden", **_listed(asdict(self))}

    def _unit(self, axis: int, noise: NDArray[np.float64]) -> NDArray[np.float64]:
        """Stationary turbulence of unit variance from normal noise (count, 2), (count,)."""
        step = self.step * self.airspeed / self.length_scale[axis]
        decay = exp(-step)
        if axis == 0:
            drive = sqrt(1.0 - decay**2) * noise[:, 0]
            drive[0] = noise[0, 0]
            return _recursion(decay, drive)
        return _transverse(step, decay, noise)


def _transverse(step: float, decay: float, noise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit turbulence across the flow, (count,): two lags in a row, stationary from the start.

    In time units of T: dx = -x + n, dy = -y + x, output sqrt(3) x + (1 - sqrt(3)) y,
    n of unit density. Stationary covariance of (x, y): [[1/2, 1/4], [1/4, 1/4]].
    """
    transition = decay * np.array([[1.0, 0.0], [step, 1.0]])
    stationary = np.array([[0.5, 0.25], [0.25, 0.25]])
    added = np.linalg.cholesky(stationary - transition @ stationary @ transition.T)
    drive = noise @ added.T
    drive[0] = np.linalg.cholesky(stationary) @ noise[0]
    first = _recursion(decay, drive[:, 0])
    second_drive = drive[:, 1].copy()
    second_drive[1:] += decay * step * first[:-1]
    second = _recursion(decay, second_drive)
    return np.asarray(sqrt(3.0) * first + (1.0 - sqrt(3.0)) * second)


def _recursion(decay: float, drive: NDArray[np.float64]) -> NDArray[np.float64]:
    """State s_k = decay s_(k-1) + drive_k, (N,)."""
    from scipy.signal import lfilter  # half of the time it takes to import patagium

    return np.asarray(lfilter([1.0], [1.0, -decay], drive))


def gust_from_description(description: Mapping[str, Any]) -> Gust:
    """The gust of `describe()`.

    Raises:
        ParameterError: If the name is unknown, or a key is missing or unknown.
    """
    kinds: dict[str, type[OneMinusCosineGust] | type[DrydenGust]] = {
        "one_minus_cosine": OneMinusCosineGust,
        "dryden": DrydenGust,
    }
    values = dict(description)
    name = values.pop("name", None)
    if name not in kinds:
        raise ParameterError("gust", f"one of {', '.join(kinds)}", name)
    kind = kinds[name]
    names = {field.name for field in fields(kind)}
    if set(values) != names:
        raise ParameterError(f"gust {name}", f"the keys {sorted(names)}", sorted(values))
    return kind(**values)


def _triple(name: str, value: ArrayLike) -> tuple[float, ...]:
    array = np.asarray(value, float)
    if array.shape != (3,):
        raise ShapeError(name, (3,), array.shape)
    if not np.isfinite(array).all():
        raise ParameterError(name, "three finite numbers", value)
    return tuple(array.tolist())


def _require_positive(name: str, value: float) -> None:
    if not (isfinite(value) and value > 0):
        raise ParameterError(name, "a positive number", value)


def _listed(values: dict[str, Any]) -> dict[str, Any]:
    return {key: list(v) if isinstance(v, tuple) else v for key, v in values.items()}
