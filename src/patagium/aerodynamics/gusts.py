"""Gusts: velocity of the air as a function of time.

Discrete gusts (one minus cosine, ramp) and continuous turbulence (Dryden). All are
functions of time alone: the same answer whatever the time step that asks. By themselves
they are the same everywhere; `traveling` lets them sweep over the robot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import ceil, exp, floor, isfinite, sqrt
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.named_descriptions import from_named_description
from patagium.errors import ParameterError, ShapeError, positive

STEPS_PER_LENGTH = 50
"""Samples of Dryden turbulence in the time the shortest length scale takes to pass."""

PIECES = 32
"""Cubics that stand for one minus cosine where it travels: to 2e-6 of its velocity."""


class Gust(Protocol):
    """Velocity of the air added to the steady wind."""

    def velocity_at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocity, world axes, (N, 3) [m/s], at times (N,) [s]."""
        ...

    def describe(self) -> dict[str, Any]:
        """Description from which the object can be made again, as JSON-able values."""
        ...


class Profile(Gust, Protocol):
    """A gust that can travel: between its knots a cubic in time."""

    def knots(self, first: float, last: float) -> NDArray[np.float64]:
        """Times between which the velocity is as good as a cubic, (K >= 2,) ascending [s].

        Before the first and after the last one it is constant, at least from `first` to `last`.

        Args:
            first: Earliest time that will be asked for [s].
            last: Latest time that will be asked for [s].
        """
        ...


@dataclass(frozen=True)
class DiscreteGust:
    """A gust of one shape in time: a velocity times a share that depends on (t - start)/T.

    Args:
        velocity: Largest velocity W, world axes, (3,) [m/s].
        start: Time when it begins [s].
        length_time: Duration T of the change [s].

    Raises:
        ParameterError: If a number is not finite or T not positive.
        ShapeError: If `velocity` is not (3,).
    """

    velocity: tuple[float, float, float]
    start: float
    length_time: float

    name: ClassVar[str] = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "velocity", triple("velocity", self.velocity))
        if not isfinite(self.start):
            raise ParameterError("start", "a finite time [s]", self.start)
        positive("length_time", self.length_time)

    def share(self, phase: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share of the largest velocity, (N,), at phases (t - start)/T within 0 to 1, (N,)."""
        raise NotImplementedError

    def velocity_at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocity of the gust, world axes, (N, 3) [m/s], at times (N,) [s]."""
        phase = np.clip((time - self.start) / self.length_time, 0.0, 1.0)
        return np.outer(self.share(phase), self.velocity)

    def describe(self) -> dict[str, Any]:
        """Description from which the gust can be made again, as JSON-able values."""
        return {"name": self.name, **_listed(asdict(self))}


@dataclass(frozen=True)
class OneMinusCosineGust(DiscreteGust):
    """One smooth gust, w(t) = W/2 (1 - cos(2 pi (t - start)/T)) for 0 <= t - start <= T.

    Args:
        velocity: Largest velocity W, world axes, (3,) [m/s].
        start: Time when it begins [s].
        length_time: Time it lasts, T [s].

    Raises:
        ParameterError: If a number is not finite or T not positive.
        ShapeError: If `velocity` is not (3,).

    References:
        MIL-F-8785C, section 3.7.1.3.
    """

    name = "one_minus_cosine"

    def share(self, phase: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share of the largest velocity, (N,), at phases (t - start)/T within 0 to 1, (N,)."""
        return np.asarray(0.5 * (1.0 - np.cos(2 * np.pi * phase)))

    def knots(self, first: float, last: float) -> NDArray[np.float64]:
        """Times between which the velocity is as good as a cubic, (K,) [s]."""
        return self.start + self.length_time * np.linspace(0.0, 1.0, PIECES + 1)


@dataclass(frozen=True)
class RampGust(DiscreteGust):
    """An edge: w grows evenly from zero to W while 0 <= t - start <= T, and stays.

    The sharp-edged gust of textbooks is one whose T is short beside the time it takes to
    pass a chord.

    Args:
        velocity: Velocity W behind the edge, world axes, (3,) [m/s].
        start: Time when it begins [s].
        length_time: Time it grows, T [s].

    Raises:
        ParameterError: If a number is not finite or T not positive.
        ShapeError: If `velocity` is not (3,).
    """

    name = "ramp"

    def share(self, phase: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share of the largest velocity, (N,), at phases (t - start)/T within 0 to 1, (N,)."""
        return phase

    def knots(self, first: float, last: float) -> NDArray[np.float64]:
        """Times between which the velocity is as good as a cubic, (K,) [s]."""
        return self.start + np.array([0.0, self.length_time])


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

    name: ClassVar[str] = "dryden"

    def __post_init__(self) -> None:
        object.__setattr__(self, "intensity", triple("intensity", self.intensity))
        object.__setattr__(self, "length_scale", triple("length_scale", self.length_scale))
        if min(self.intensity) < 0:
            raise ParameterError("intensity", "three numbers >= 0 [m/s]", self.intensity)
        positive("length_scale", min(self.length_scale))
        positive("airspeed", self.airspeed)
        if self.seed != int(self.seed) or self.seed < 0:
            raise ParameterError("seed", "a whole number >= 0", self.seed)

    @property
    def step(self) -> float:
        """Time between two samples of the turbulence [s]."""
        return min(self.length_scale) / self.airspeed / STEPS_PER_LENGTH

    def velocity_at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocity of the turbulence, world axes, (N, 3) [m/s], at times (N,) [s].

        What was before time zero is the same process run backward from there.
        """
        latest, earliest = (time.max(), time.min()) if time.size else (0.0, 0.0)
        count, before = (
            ceil(max(latest, 0.0) / self.step) + 2,
            ceil(max(-earliest, 0.0) / self.step),
        )
        noise = np.random.default_rng(self.seed).standard_normal((count, 3, 2))
        past = np.random.default_rng([self.seed, 1]).standard_normal((before, 3, 2))
        grid = self.step * np.arange(-before, count)
        columns = [
            np.interp(
                time, grid, self.intensity[axis] * self._unit(axis, noise[:, axis], past[:, axis])
            )
            for axis in range(3)
        ]
        return np.stack(columns, axis=-1)

    def knots(self, first: float, last: float) -> NDArray[np.float64]:
        """Times between which the velocity is a straight line, (K,) [s]."""
        places = np.arange(floor(first / self.step), ceil(last / self.step) + 2)
        return np.asarray(self.step * places)

    def describe(self) -> dict[str, Any]:
        """Description from which the object can be made again, as JSON-able values."""
        return {"name": self.name, **_listed(asdict(self))}

    def _unit(
        self, axis: int, noise: NDArray[np.float64], past: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Stationary turbulence of unit variance, (before + count,), from normal noise.

        Args:
            axis: Which axis.
            noise: From time zero on, (count, 2).
            past: Before it, backward in time, (before, 2).
        """
        step = self.step * self.airspeed / self.length_scale[axis]
        decay = exp(-step)
        if axis == 0:
            drive = sqrt(1.0 - decay**2) * noise[:, 0]
            drive[0] = noise[0, 0]
            behind = np.append(drive[0], sqrt(1.0 - decay**2) * past[:, 0])
            return np.append(_recursion(decay, behind)[:0:-1], _recursion(decay, drive))
        return _transverse(step, decay, noise, past)


def _transverse(
    step: float, decay: float, noise: NDArray[np.float64], past: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Unit turbulence across the flow: two lags in a row, stationary from the start.

    In time units of T: dx = -x + n, dy = -y + x, output sqrt(3) x + (1 - sqrt(3)) y,
    n of unit density. Stationary covariance C of (x, y): [[1/2, 1/4], [1/4, 1/4]]. Backward
    in time C^-1 (x, y) is two lags in a row too, y first.
    """
    stationary = np.array([[0.5, 0.25], [0.25, 0.25]])
    drive = noise @ _added_root(step, decay, stationary).T
    drive[0] = np.linalg.cholesky(stationary) @ noise[0]
    behind = past @ _added_root(step, decay, np.linalg.inv(stationary)[::-1, ::-1]).T
    behind = np.vstack([np.linalg.solve(stationary, drive[0])[::-1], behind])
    ahead, back = _two_lags(step, decay, drive), _two_lags(step, decay, behind)
    states = np.vstack([back[:0:-1, ::-1] @ stationary, ahead])
    return np.asarray(sqrt(3.0) * states[:, 0] + (1.0 - sqrt(3.0)) * states[:, 1])


def _added_root(step: float, decay: float, stationary: NDArray[np.float64]) -> NDArray[np.float64]:
    """Root of what noise adds in a step to two lags in a row of a stationary covariance, (2, 2)."""
    transition = decay * np.array([[1.0, 0.0], [step, 1.0]])
    added = stationary - transition @ stationary @ transition.T
    return np.asarray(np.linalg.cholesky(added))


def _two_lags(step: float, decay: float, drive: NDArray[np.float64]) -> NDArray[np.float64]:
    """States of two lags in a row, (N, 2), from what drives them, (N, 2)."""
    first = _recursion(decay, drive[:, 0])
    second_drive = drive[:, 1].copy()
    second_drive[1:] += decay * step * first[:-1]
    return np.column_stack([first, _recursion(decay, second_drive)])


def _recursion(decay: float, drive: NDArray[np.float64]) -> NDArray[np.float64]:
    """State s_k = decay s_(k-1) + drive_k, (N,)."""
    from scipy.signal import lfilter  # half of the time it takes to import patagium

    return np.asarray(lfilter([1.0], [1.0, -decay], drive))


def profile_from_description(description: Mapping[str, Any]) -> Profile:
    """The gust of `describe()`, one that can travel.

    Raises:
        ParameterError: If the name is unknown, or a key is missing or unknown.
    """
    kinds: tuple[type[OneMinusCosineGust] | type[RampGust] | type[DrydenGust], ...]
    kinds = OneMinusCosineGust, RampGust, DrydenGust
    made: Profile = from_named_description("gust", kinds, description)
    return made


def triple(name: str, value: ArrayLike) -> tuple[float, ...]:
    """Three finite numbers.

    Args:
        name: Name of the argument, for messages.
        value: Numbers to check, (3,) [any unit].

    Raises:
        ShapeError: If they are not (3,).
        ParameterError: If one is not finite.
    """
    array = np.asarray(value, float)
    if array.shape != (3,):
        raise ShapeError(name, (3,), array.shape)
    if not np.isfinite(array).all():
        raise ParameterError(name, "three finite numbers", value)
    return tuple(array.tolist())


def _listed(values: dict[str, Any]) -> dict[str, Any]:
    return {key: list(v) if isinstance(v, tuple) else v for key, v in values.items()}
