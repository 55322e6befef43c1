"""A gait whose frequency and amplitude are asked for on the way, and follow smoothly.

With phase p(t) [s of the gait's own time], rate r = p' and amplitude A over those of a gait g of
mean m, the joints are at q(t) = g(p) + (A - 1)(g(p) - m). Rate and amplitude answer what is asked
for as three equal lags in a row, (s/k + 1)^-3: without overshoot, so that both stay between what
was asked for, and twice differentiable, so that q has a continuous acceleration. All is in closed
form, velocities and accelerations are the derivatives to rounding, and a gait that nobody steers
is g to the last bit. Neglected: what a motor or a crank could follow.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ParameterError
from patagium.robot import Robot
from patagium.simulation.gait_models import Gait, PrescribedMotion

Array = NDArray[np.float64]

SHARPNESS = 8.0
"""Of each lag k, in a wingbeat of the gait as it was made: 99 % is there within about one."""
_SAMPLES = 2000  # of a period, for mean and extremes


@dataclass(frozen=True)
class _Response:
    """A quantity that goes to a target: x = target + exp(-k t) (c0 + c1 t + c2 t^2)."""

    target: float
    sharpness: float
    c: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Value and its first two rates, t after the answer began."""
        k, (c0, c1, c2) = self.sharpness, self.c
        fading = np.exp(-k * time)
        p0 = c0 + (c1 + c2 * time) * time
        p1 = (c1 - k * c0) + (2 * c2 - k * c1) * time - k * c2 * time**2
        p2 = (2 * c2 - 2 * k * c1 + k**2 * c0) + (k**2 * c1 - 4 * k * c2) * time
        p2 = p2 + k**2 * c2 * time**2
        return self.target + fading * p0, fading * p1, fading * p2

    def integral(self, time: Array) -> Array:
        """Integral of the response from its beginning to t."""
        k, (c0, c1, c2) = self.sharpness, self.c
        whole = c0 / k + c1 / k**2 + 2 * c2 / k**3
        left = whole + (c1 / k + 2 * c2 / k**2) * time + c2 / k * time**2
        return np.asarray(self.target * time + whole - np.exp(-k * time) * left)

    def toward(self, target: float, time: float) -> _Response:
        """The answer to another target, from where this one is t after it began."""
        value, rate, bend = (float(x) for x in self.at(np.array(time)))
        k, gap = self.sharpness, value - target
        c1 = rate + k * gap
        return _Response(target, k, (gap, c1, (bend + 2 * k * c1 - k**2 * gap) / 2))


@dataclass(frozen=True)
class _Command:
    """Command that holds from a time on."""

    time: float
    phase: float
    rate: _Response
    amplitude: _Response


@dataclass(frozen=True)
class SteeredGait:
    """Steered gait: `steerable_gait` makes one, `command` changes frequency and amplitude.

    Attributes:
        gait: The gait itself.
        mean: Mean position of each joint, (n_a,) [rad, m].
        pieces: What was asked for, and when.
    """

    gait: Gait
    mean: Array
    pieces: tuple[_Command, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints it moves."""
        return self.gait.joints

    @property
    def period(self) -> float | None:
        """Time of a wingbeat as it was asked for last [s]."""
        own, rate = self.gait.period, self.pieces[-1].rate.target
        return own / rate if own and rate else None

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s]."""
        times = np.atleast_1d(np.asarray(time, float))
        starts = [piece.time for piece in self.pieces]
        places = np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)
        parts = np.empty((3, len(times), len(self.joints)))
        for place in np.unique(places):
            inside = places == place
            found = self._piece(self.pieces[place], times[inside])
            parts[:, inside] = found.position, found.velocity, found.acceleration
        return PrescribedMotion(*parts)

    def command(self, time: float, frequency: float, amplitude: float) -> SteeredGait:
        """Gait that goes to another frequency and amplitude from a time on.

        Args:
            time: When it is asked for, not before the last time [s].
            frequency: Wingbeats a second, positive [Hz].
            amplitude: Excursions from the mean over the gait's own.

        Raises:
            ParameterError: If a number is not possible.
        """
        last = self.pieces[-1]
        if not (np.isfinite(time) and time >= last.time):
            raise ParameterError("time", f"at {last.time:g} s or later", time)
        if not (np.isfinite(frequency) and frequency > 0):
            raise ParameterError("frequency", "a positive number", frequency)
        if not (np.isfinite(amplitude) and amplitude >= 0):
            raise ParameterError("amplitude", "a number that is not negative", amplitude)
        since = time - last.time
        piece = _Command(
            time,
            last.phase + float(last.rate.integral(np.array(since))),
            last.rate.toward(frequency * (self.gait.period or 1.0), since),
            last.amplitude.toward(amplitude, since),
        )
        kept = self.pieces[:-1] if time == last.time and len(self.pieces) > 1 else self.pieces
        return SteeredGait(self.gait, self.mean, (*kept, piece))

    def command_at(self, time: float) -> tuple[float, float]:
        """Frequency [Hz] and amplitude over the gait's own at a time [s]."""
        piece = self.pieces[max(bisect_right([k.time for k in self.pieces], time) - 1, 0)]
        since = np.array(time - piece.time)
        rate, amplitude = (float(k.at(since)[0]) for k in (piece.rate, piece.amplitude))
        return rate / (self.gait.period or 1.0), amplitude

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        own = self.gait.period or 1.0
        asked = [(k.time, k.rate.target / own, k.amplitude.target) for k in self.pieces]
        names = ("time", "frequency", "amplitude")
        return {
            "kind": "steered",
            "frequency": asked[-1][1],
            "parts": [self.gait.describe()],
            "sharpness": self.pieces[0].rate.sharpness,
            "asked": [dict(zip(names, one, strict=True)) for one in asked],
        }

    def _piece(self, piece: _Command, time: Array) -> PrescribedMotion:
        since = time - piece.time
        rate, bend, _ = (k[:, None] for k in piece.rate.at(since))
        size, growth, spurt = (k[:, None] for k in piece.amplitude.at(since))
        found = self.gait.motion(piece.phase + piece.rate.integral(since))
        away, more = found.position - self.mean, size - 1.0
        velocity = found.velocity * rate
        acceleration = found.acceleration * rate**2 + found.velocity * bend
        return PrescribedMotion(
            found.position + more * away,
            velocity + more * velocity + growth * away,
            acceleration + more * acceleration + 2.0 * growth * velocity + spurt * away,
        )


def steerable_gait(gait: Gait) -> SteeredGait:
    """A gait that may be steered, as it is at first.

    Args:
        gait: One that has a period.

    Raises:
        ParameterError: If it does not move.
    """
    if not gait.period:
        raise ParameterError("gait", "one that moves, to be steered", "one that stands still")
    times = gait.period * np.arange(_SAMPLES) / _SAMPLES
    sharpness = SHARPNESS / gait.period
    still = _Response(1.0, sharpness)
    mean = gait.motion(times).position.mean(axis=0)
    return SteeredGait(gait, mean, (_Command(0.0, 0.0, still, still),))


def largest_amplitude(robot: Robot, gait: SteeredGait) -> float:
    """Largest amplitude, over the gait's own, at which all joints keep their limits.

    Args:
        robot: The machine.
        gait: Its gait.
    """
    times = (gait.gait.period or 0.0) * np.arange(_SAMPLES) / _SAMPLES
    away = gait.gait.motion(times).position - gait.mean
    found = float("inf")
    for k, dof in enumerate(robot.actuated):
        for reach, limit in (
            (away[:, k].max(), robot.upper[dof]),
            (away[:, k].min(), robot.lower[dof]),
        ):
            if reach != 0 and np.isfinite(limit):
                found = min(found, (limit - gait.mean[k]) / reach)
    return found
