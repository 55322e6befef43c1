"""The kinds of gait: what each computes, and what it says of itself.

`patagium.simulation.gaits` builds them for a robot and checks them. All are
periodic, with exact derivatives (of the spline, in a table's case).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import reduce
from operator import add
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.robot.linkage import Linkage

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class PrescribedMotion:
    """Motion of prescribed coordinates, (N, n) each: actuated joints, or a path's coordinates.

    Attributes:
        position: Joint positions [rad, m].
        velocity: Joint velocities [rad/s, m/s].
        acceleration: Joint accelerations [rad/s^2, m/s^2].
    """

    position: Array
    velocity: Array
    acceleration: Array

    def __add__(self, other: PrescribedMotion) -> PrescribedMotion:
        return PrescribedMotion(
            self.position + other.position,
            self.velocity + other.velocity,
            self.acceleration + other.acceleration,
        )


class Gait(Protocol):
    """Protocol of a gait."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints it moves: all actuated ones of a robot, in order."""

    @property
    def period(self) -> float | None:
        """Time after which it repeats [s]; None if it does not move."""

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s]."""

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values; it travels with every flight."""


@dataclass(frozen=True)
class FourierGait:
    """Fourier series of every joint, exact derivatives.

    Attributes:
        joints: Names of the actuated joints.
        frequency: Beats a second [Hz]; 0 if nothing moves.
        mean: Mean positions, (n_a,) [rad, m].
        cosine: Cosine coefficients, (order, n_a).
        sine: Sine coefficients, (order, n_a).
    """

    joints: tuple[str, ...]
    frequency: float
    mean: Array
    cosine: Array
    sine: Array

    @property
    def period(self) -> float | None:
        """Time after which it repeats [s]; None if nothing moves."""
        return 1.0 / self.frequency if self.frequency else None

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s]."""
        rate = 2.0 * np.pi * self.frequency * np.arange(1, len(self.sine) + 1)
        angle = np.asarray(time, float)[:, None] * rate
        c, s = np.cos(angle), np.sin(angle)
        return PrescribedMotion(
            self.mean + c @ self.cosine + s @ self.sine,
            (c * rate) @ self.sine - (s * rate) @ self.cosine,
            -(c * rate**2) @ self.cosine - (s * rate**2) @ self.sine,
        )

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        return {
            "kind": "fourier",
            "joints": list(self.joints),
            "frequency": self.frequency,
            "mean": self.mean.tolist(),
            "cosine": self.cosine.tolist(),
            "sine": self.sine.tolist(),
        }


@dataclass(frozen=True)
class LinkageGait:
    """Crank linkage driving plunge and elbow.

    Attributes:
        joints: Names of the actuated joints.
        frequency: Turns of the crank a second [Hz].
        linkage: The bars.
        offset: Added to every joint, (n_a,) [rad].
        plunge: Which joints follow the humerus, (n_a,) bool.
        elbow: Which joints follow the radius relative to the humerus, (n_a,) bool.
    """

    joints: tuple[str, ...]
    frequency: float
    linkage: Linkage
    offset: Array
    plunge: NDArray[np.bool_]
    elbow: NDArray[np.bool_]

    @property
    def period(self) -> float | None:
        """Time of one turn of the crank [s]."""
        return 1.0 / self.frequency

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s]."""
        rate = 2.0 * np.pi * self.frequency
        wing = self.linkage.solve(rate * np.asarray(time, float))
        return PrescribedMotion(
            self.offset + self._spread(wing.humerus, wing.radius),
            rate * self._spread(wing.humerus_rate, wing.radius_rate),
            rate**2 * self._spread(wing.humerus_acceleration, wing.radius_acceleration),
        )

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        return {
            "kind": "linkage",
            "joints": list(self.joints),
            "frequency": self.frequency,
            "linkage": asdict(self.linkage),
            "offset": self.offset.tolist(),
        }

    def _spread(self, humerus: Array, radius: Array) -> Array:
        """Humerus to the plunge joints, radius relative to it to the elbows, (N, n_a)."""
        return np.outer(humerus, self.plunge) + np.outer(radius - humerus, self.elbow)


@dataclass(frozen=True)
class TableGait:
    """Periodic cubic spline through a table of positions.

    Attributes:
        joints: Names of the actuated joints.
        source: Name of the file.
        time: Times of one period, both ends included, (M,) [s].
        position: Joint positions, the last row as the first, (M, n_a) [rad, m].
    """

    joints: tuple[str, ...]
    source: str
    time: Array
    position: Array

    @property
    def period(self) -> float | None:
        """Time after which it repeats [s]."""
        return float(self.time[-1] - self.time[0])

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s]."""
        from scipy.interpolate import CubicSpline  # slow to import, rarely needed

        start = self.time[0]
        spline = CubicSpline(self.time - start, self.position, bc_type="periodic")
        phase = np.mod(np.asarray(time, float) - start, self.time[-1] - start)
        return PrescribedMotion(spline(phase), spline(phase, 1), spline(phase, 2))

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        return {
            "kind": "table",
            "joints": list(self.joints),
            "source": self.source,
            "time": self.time.tolist(),
            "position": self.position.tolist(),
        }


@dataclass(frozen=True)
class SuperposedGait:
    """Sum of gaits of one robot.

    Attributes:
        parts: The gaits.
    """

    parts: tuple[Gait, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the actuated joints."""
        return self.parts[0].joints

    @property
    def period(self) -> float | None:
        """Time after which all parts repeat: the longest of theirs [s]; None if none moves."""
        return max((p for p in (part.period for part in self.parts) if p), default=None)

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s]."""
        return reduce(add, [part.motion(time) for part in self.parts])

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        return {"kind": "superposed", "parts": [part.describe() for part in self.parts]}
