"""A gait whose frequency, amplitudes, offsets and phases are commanded on the way.

With phase P(t) [s of the gait's own time], rate r = P', and of each joint an amplitude A over the
gait's own, an offset o and a lead l [s], the joint is at q = m + o + A (g(P + l) - m), where g is
the gait and m its mean. Rate, amplitude, offset and lead answer a command as three equal lags in a
row, (s/k + 1)^-3: without overshoot, so that each stays between what it was and what was
commanded, and twice differentiable, so that q has a continuous acceleration. All is in closed
form, velocities and accelerations are the derivatives to rounding, and a gait that nobody steers
is g to the last bit. Neglected: torque and speed limits of motors.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.errors import ParameterError
from patagium.robot import Robot
from patagium.simulation.gait_models import Gait, PrescribedMotion

Array = NDArray[np.float64]

SHARPNESS = 8.0
"""Each lag k times the response time: 99 % is there within about one response time."""
OFFSET_SHARE = 0.25
"""Response time of an offset over the wingbeat, where none is given."""
STILL_RESPONSE = 0.05
"""Response time of an offset of a gait that stands still, where none is given [s]."""
KINDS = ("amplitude", "offset", "phase")
"""What is commanded of a joint; `frequency` is commanded of all together."""
_SAMPLES = 2000  # of a period, for mean and extremes


@dataclass(frozen=True)
class _Responses:
    """Quantities that go to their targets: x = target + exp(-k t) (c0 + c1 t + c2 t^2).

    Attributes:
        target: Where they go, (n,) [s of the gait a s, 1, rad or m, s].
        sharpness: Of each lag k, (n,) [1/s].
        c: Coefficients c0, c1, c2, (3, n) [unit of the target, over s, over s^2].
    """

    target: Array
    sharpness: Array
    c: Array

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Values and their first two rates, (N, n) each, t after the answer began, (N,)."""
        k, (c0, c1, c2), t = self.sharpness, self.c, time[:, None]
        fading = np.exp(-k * t)
        p0 = c0 + (c1 + c2 * t) * t
        p1 = (c1 - k * c0) + (2 * c2 - k * c1) * t - k * c2 * t**2
        p2 = (2 * c2 - 2 * k * c1 + k**2 * c0) + (k**2 * c1 - 4 * k * c2) * t + k**2 * c2 * t**2
        return self.target + fading * p0, fading * p1, fading * p2

    def integral(self, time: Array, place: int) -> Array:
        """Integral of one response from its beginning to t, (N,)."""
        k, (c0, c1, c2) = self.sharpness[place], self.c[:, place]
        whole = c0 / k + c1 / k**2 + 2 * c2 / k**3
        left = whole + (c1 / k + 2 * c2 / k**2) * time + c2 / k * time**2
        return np.asarray(self.target[place] * time + whole - np.exp(-k * time) * left)

    def toward(self, target: Array, time: float) -> _Responses:
        """The answer to other targets, from where this one is t after it began."""
        value, rate, bend = (part[0] for part in self.at(np.array([time])))
        k, gap = self.sharpness, value - target
        c1 = rate + k * gap
        return _Responses(target, k, np.array([gap, c1, (bend + 2 * k * c1 - k**2 * gap) / 2]))


@dataclass(frozen=True)
class _Piece:
    """Responses that hold from a time on, and the gait's own time then."""

    time: float
    phase: float
    responses: _Responses


class SteeredGait:
    """Steered gait: `command` changes frequency, amplitudes, offsets and phases from a time on.

    Names of commands are `frequency` [Hz], `amplitude` (excursions of all joints from their means
    over the gait's own), and of a joint or of the pair of a name `plunge_amplitude`,
    `plunge_offset` (added to the mean) [rad, m] and `plunge_phase` (lead) [rad].

    Args:
        robot: The machine; no command takes a joint beyond its limits.
        gait: The gait as it is until somebody steers.
        response_time: Time within which 99 % of a command is there, by its name [s]. Of what
            shapes a wingbeat one wingbeat where not given, of offsets a quarter of it.

    Raises:
        ParameterError: If a name of a response time is no command, or its time not positive.
    """

    def __init__(
        self, robot: Robot, gait: Gait, response_time: Mapping[str, float] | None = None
    ) -> None:
        self.gait, self._count = gait, len(gait.joints)
        motion = gait.motion((gait.period or 0.0) * np.arange(_SAMPLES) / _SAMPLES).position
        self.mean = motion.mean(axis=0)
        away = motion - self.mean
        self._reach = np.array([away.min(axis=0), away.max(axis=0)])
        places = list(robot.actuated)
        self._limits = np.array([robot.lower, robot.upper])[:, places]
        beat, n = gait.period, self._count
        offset = OFFSET_SHARE * beat if beat else STILL_RESPONSE
        times = np.r_[np.full(1 + n, beat or 1.0), np.full(n, offset), np.full(n, beat or 1.0)]
        for name, value in (response_time or {}).items():
            if not (np.isfinite(value) and value > 0):
                raise ParameterError(f"response_time of {name}", "a positive time [s]", value)
            times[self._places(name)[1]] = value
        first = _Responses(
            np.r_[np.ones(1 + n), np.zeros(2 * n)],
            SHARPNESS / times,
            np.zeros((3, 1 + 3 * n)),
        )
        self._pieces = [_Piece(0.0, 0.0, first)]
        self._starts = [0.0]
        self.limited = 0

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints it moves."""
        return self.gait.joints

    @property
    def period(self) -> float | None:
        """Time of a wingbeat as it was commanded last [s]."""
        own = self.gait.period
        return own / float(self._pieces[-1].responses.target[0]) if own else None

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s]."""
        times = np.atleast_1d(np.asarray(time, float))
        places = np.maximum(np.searchsorted(self._starts, times, side="right") - 1, 0)
        parts = np.empty((3, len(times), self._count))
        for place in np.unique(places):
            inside = places == place
            found = self._piece_motion(self._pieces[place], times[inside])
            parts[:, inside] = found.position, found.velocity, found.acceleration
        return PrescribedMotion(*parts)

    def command(self, time: float, commands: Mapping[str, float]) -> None:
        """Go to other values from a time on; what is not named stays as it was commanded.

        A joint keeps its limits: first its amplitude is lowered as far as that takes, then its
        offset, and `limited` counts the commands to which this was done.

        Args:
            time: When it is commanded, not before the last time [s].
            commands: Values by the names of the class.

        Raises:
            ParameterError: If a name is no command, or a number is not possible.
        """
        last = self._pieces[-1]
        if not (np.isfinite(time) and time >= last.time):
            raise ParameterError("time", f"at {last.time:g} s or later", time)
        target = last.responses.target.copy()
        for name, value in commands.items():
            kind, places = self._places(name)
            lowest = {"frequency": 1e-9, "amplitude": 0.0}.get(kind, -np.inf)
            if not (np.isfinite(value) and value >= lowest):
                wanted = {"frequency": "a positive number", "amplitude": "zero or more"}
                raise ParameterError(f"command {name}", wanted.get(kind, "a finite number"), value)
            target[places] = value * self._scale(kind)
        target = self._within_limits(target)
        since = time - last.time
        phase = last.phase + float(last.responses.integral(np.array(since), 0))
        piece = _Piece(time, phase, last.responses.toward(target, since))
        if time == last.time and len(self._pieces) > 1:
            self._pieces[-1] = piece
        else:
            self._pieces.append(piece)
            self._starts.append(time)

    def commanded(self, name: str) -> float:
        """Value of a command as it was given last, in its own unit; that of the first joint."""
        kind, places = self._places(name)
        return float(self._pieces[-1].responses.target[places[0]] / self._scale(kind))

    def command_at(self, time: float) -> tuple[float, float]:
        """Frequency [Hz] and amplitude over the gait's own, mean of joints, at a time [s]."""
        piece = self._pieces[max(bisect_right(self._starts, time) - 1, 0)]
        values = piece.responses.at(np.array([time - piece.time]))[0][0]
        moving = np.ptp(self._reach, axis=0) > 0
        amplitude = values[1 : 1 + self._count][moving] if moving.any() else np.ones(1)
        return float(values[0]) / (self.gait.period or 1.0), float(amplitude.mean())

    def largest_amplitude(self) -> float:
        """Largest amplitude, over the gait's own, at which all joints keep their limits."""
        return float(self._largest_amplitudes().min(initial=np.inf))

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        beat = self.period
        return {
            "kind": "steered",
            "frequency": 1.0 / beat if beat else 0.0,
            "parts": [self.gait.describe()],
            "response_time": (SHARPNESS / self._pieces[0].responses.sharpness).tolist(),
        }

    def _places(self, name: str) -> tuple[str, list[int]]:
        """Kind of a command, and its places among the responses."""
        n, joints = self._count, self.joints
        if name == "frequency" and self.gait.period:
            return name, [0]
        joint, _, kind = name.rpartition("_")
        pair = (joint, f"left_{joint}", f"right_{joint}")
        found = [k for k, one in enumerate(joints) if one in pair or name == "amplitude"]
        moving = [k for k in range(n) if np.ptp(self._reach[:, k]) > 0]
        if kind != "offset":
            found = [k for k in found if k in moving]
        if kind in KINDS and found:
            return kind, [1 + KINDS.index(kind) * n + k for k in found]
        expected = f"<joint>_offset of {', '.join(joints)}"
        if moving:
            flapping = ", ".join(joints[k] for k in moving)
            expected = (
                f"frequency, amplitude, {expected}, <joint>_amplitude or _phase of {flapping}"
            )
        raise ParameterError("command", expected, name)

    def _scale(self, kind: str) -> float:
        """Factor from the unit of a command to that of its response."""
        beat = self.gait.period or 1.0
        return {"frequency": beat, "phase": beat / (2 * np.pi)}.get(kind, 1.0)

    def _largest_amplitudes(self) -> Array:
        """Largest amplitude of each joint about its own mean, (n_a,)."""
        room = self._limits - self.mean
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(self._reach != 0, room / self._reach, np.inf)
        return np.asarray(np.maximum(ratio, 0.0).min(axis=0))

    def _within_limits(self, target: Array) -> Array:
        """Targets at which every joint keeps its limits, (1 + 3 n_a,)."""
        n, kept = self._count, target.copy()
        amplitude, offset = kept[1 : 1 + n], kept[1 + n : 1 + 2 * n]  # views
        np.minimum(amplitude, self._largest_amplitudes(), out=amplitude)
        room = self._limits - self.mean - amplitude * self._reach
        np.clip(offset, np.minimum(room[0], 0.0), np.maximum(room[1], 0.0), out=offset)
        self.limited += not np.array_equal(kept, target)
        return kept

    def _piece_motion(self, piece: _Piece, times: Array) -> PrescribedMotion:
        n, since = self._count, times - piece.time
        parts = [
            np.split(part, [1, 1 + n, 1 + 2 * n], axis=1) for part in piece.responses.at(since)
        ]
        (rate, size, offset, lead), (bend, growth, drift, lead_rate) = parts[0], parts[1]
        _, spurt, push, lead_bend = parts[2]
        own = (piece.phase + piece.responses.integral(since, 0))[:, None] + lead
        found = self._own_motion(own)
        pace, quickening = rate + lead_rate, bend + lead_bend
        away, more = found.position - self.mean, size - 1.0
        velocity = found.velocity * pace
        acceleration = found.acceleration * pace**2 + found.velocity * quickening
        return PrescribedMotion(
            found.position + more * away + offset,
            velocity + more * velocity + growth * away + drift,
            acceleration + more * acceleration + 2.0 * growth * velocity + spurt * away + push,
        )

    def _own_motion(self, own: Array) -> PrescribedMotion:
        """Motion of the gait with each joint at its own time, (N, n_a) [s]."""
        found = self.gait.motion(own[:, 0])
        for k in range(1, self._count):
            if not np.array_equal(own[:, k], own[:, 0]):
                one = self.gait.motion(own[:, k])
                found.position[:, k] = one.position[:, k]
                found.velocity[:, k] = one.velocity[:, k]
                found.acceleration[:, k] = one.acceleration[:, k]
        return found
