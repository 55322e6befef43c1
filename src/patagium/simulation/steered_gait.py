"""A gait whose frequency, amplitudes, offsets and phases are commanded on the way.

With phase P(t) [s of the gait's own time], rate r = P', and of each joint an amplitude A over the
gait's own, an offset o and a lead l [s], the joint is at q = m + o + A (g(P + l) - m), where g is
the gait and m its mean. Rate, amplitude, offset and lead answer a command as three equal lags in a
row, (s/k + 1)^-3: without overshoot, so that each stays between what it was and what was
commanded, and twice differentiable, so that q has a continuous acceleration. All is in closed
form, velocities and accelerations are the derivatives to rounding, and a gait that nobody steers
is g to the last bit. What the robot's file says in `actuators` holds: a command is cut to its
range, and a command whose rate is limited goes there as a ramp ahead of the lags, so that no
response is faster. Neglected: torque and power limits of motors, which a flight's summary tells.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from patagium.arguments import checked, of_kind
from patagium.arrays import Array
from patagium.errors import ParameterError, finite
from patagium.robot import Robot
from patagium.robot.model import COMMANDS, Actuator
from patagium.robot.units import spoken
from patagium.simulation.gait_models import Gait, PrescribedMotion, asked_times

SHARPNESS = 8.0
"""Each lag k times the response time: 99 % is there within about one response time."""
OFFSET_SHARE = 0.25
"""Response time of an offset over the wingbeat, where none is given."""
STILL_RESPONSE = 0.05
"""Response time of an offset of a gait that stands still, where none is given [s]."""
_SAMPLES = 2000  # of a period, for mean and extremes
_ROUNDING = 1e-8  # of a command, which a controller's program keeps to this
_LOWEST = {
    "frequency": (1e-9, "a positive number"),
    "amplitude": (0.0, "zero or more"),
}
MARGIN = 1e-5
"""Allowed excess over a range, as extremes are sampled [actuator's unit]."""


@dataclass(frozen=True)
class Responses:
    """Quantities that go to their targets, x = u(t - 3/k) + exp(-k t) (c0 + c1 t + c2 t^2).

    Three lags follow a ramp u(t) = target + slope t in the end 3/k later.

    Attributes:
        target: First target, (n,) [s of the gait a s, 1, rad or m, s].
        slope: Rate of the target, (n,) [unit of the target, over s].
        sharpness: Rate k of each lag, (n,) [1/s].
        c: Coefficients c0, c1, c2, (3, n) [unit of the target, over s, over s^2].
    """

    target: Array
    slope: Array
    sharpness: Array
    c: Array

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Values and their first two rates, (N, n) each, at times since the start, (N, 1 or n)."""
        k, (c0, c1, c2), t = self.sharpness, self.c, time
        fading = np.exp(-k * t)
        p0 = c0 + (c1 + c2 * t) * t
        p1 = (c1 - k * c0) + (2 * c2 - k * c1) * t - k * c2 * t**2
        p2 = (2 * c2 - 2 * k * c1 + k**2 * c0) + (k**2 * c1 - 4 * k * c2) * t + k**2 * c2 * t**2
        ahead = self.target + self.slope * (t - 3 / k)
        return ahead + fading * p0, self.slope + fading * p1, fading * p2

    def integral(self, time: Array, place: int) -> Array:
        """Integral of one response from its beginning to t, (N,)."""
        k, (c0, c1, c2) = self.sharpness[place], self.c[:, place]
        whole = c0 / k + c1 / k**2 + 2 * c2 / k**3
        left = whole + (c1 / k + 2 * c2 / k**2) * time + c2 / k * time**2
        ahead = (self.target[place] + self.slope[place] * (time / 2 - 3 / k)) * time
        return np.asarray(ahead + whole - np.exp(-k * time) * left)

    @staticmethod
    def from_state(state: Array, target: Array, slope: Array, sharpness: Array) -> Responses:
        """Responses that begin with given values and first two rates, (3, n); the rest as above."""
        (value, rate, bend), k = state, sharpness
        gap = value - target + 3 * slope / k
        c1 = rate - slope + k * gap
        c = np.array([gap, c1, (bend + 2 * k * c1 - k**2 * gap) / 2])
        return Responses(target, slope, k, c)


@dataclass(frozen=True)
class _Answer:
    """Responses to a command, each along a ramp at first, and from its end on to a fixed target.

    Attributes:
        time: Time of the command [s].
        phase: The gait's own time then [s].
        lasting: Duration of each ramp, (n,) [s].
        ramp: Responses along the ramps.
        fixed: Responses from the end of each ramp on.
    """

    time: float
    phase: float
    lasting: Array
    ramp: Responses
    fixed: Responses

    def at(self, since: Array) -> tuple[Array, Array, Array]:
        """Values and their first two rates, (N, n) each, at times since the command, (N,) [s]."""
        there, first, then = since[:, None] >= self.lasting, self.ramp, self.fixed
        c = np.where(there, then.c[:, None], first.c[:, None])
        target = np.where(there, then.target, first.target)
        now = Responses(target, np.where(there, 0.0, first.slope), first.sharpness, c)
        return now.at(since[:, None] - there * self.lasting)

    def own(self, since: Array) -> Array:
        """Time in the gait, (N,) [s], at times since the command, (N,) [s]."""
        on_ramp = np.minimum(since, self.lasting[0])
        found = self.ramp.integral(on_ramp, 0) + self.fixed.integral(since - on_ramp, 0)
        return self.phase + found


class SteeredGait:
    """Steered gait: `command` changes frequency, amplitudes, offsets and phases from a time on.

    Names of commands are `frequency` [Hz], `amplitude` (excursions of all joints from their means
    over the gait's own) [1], and of a joint or of the pair of a name `plunge_amplitude` (over the
    gait's own) [1], `plunge_offset` (added to the mean) [rad, m] and `plunge_phase` (lead) [rad].

    Args:
        robot: The machine; no command takes a joint beyond its limits, nor beyond the range and
            the rate of its actuators. A response that they do not give takes one wingbeat, that
            of an offset a quarter of it.
        gait: The gait as it is until a command is given.

    Raises:
        ParameterError: If the range of an actuator excludes the gait.

    Attributes:
        stuck: Places among the responses that no command moves, whatever it is called.
    """

    def __init__(self, robot: Robot, gait: Gait) -> None:
        self.gait, self._robot, self._count = gait, robot, len(gait.joints)
        self._known: dict[str, tuple[str, list[int]]] = {}
        motion = gait.motion((gait.period or 0.0) * np.arange(_SAMPLES) / _SAMPLES).position
        self.mean = motion.mean(axis=0)
        away = motion - self.mean
        self.reach = np.array([away.min(axis=0), away.max(axis=0)])
        self._moves = np.ptp(self.reach, axis=0) > 0
        places = list(robot.actuated)
        self.room = np.array([robot.lower, robot.upper])[:, places] - self.mean
        beat, n = gait.period, self._count
        offset = OFFSET_SHARE * beat if beat else STILL_RESPONSE
        times = np.r_[np.full(1 + n, beat or 1.0), np.full(n, offset), np.full(n, beat or 1.0)]
        self.neutral = self.target = np.r_[np.ones(1 + n), np.zeros(2 * n)]
        none = np.zeros_like(self.target)
        self.rates, self.costs = none + np.inf, none + 1.0
        self.range = np.array([none - np.inf, none + np.inf])
        for name, actuator in robot.actuators.items():
            kind, places = self._places(name)
            bounds, rate = self._limits_of(name, kind, places, actuator)
            self.range[:, places], self.rates[places] = bounds, rate
            self.costs[places] = actuator.cost
            if actuator.response_time is not None:
                times[places] = actuator.response_time
        first = Responses(self.target, none, SHARPNESS / times, np.zeros((3, len(none))))
        self.sharpness = first.sharpness
        self.answers = [_Answer(0.0, 0.0, none, first, first)]
        self._starts = [-np.inf]
        self._since = 0.0
        self.limited, self.stuck = 0, set[int]()

    def copied(self) -> SteeredGait:
        """Steered gait with the same commands so far, which no other object commands."""
        return deepcopy(self, {id(one): one for one in (self.gait, self._robot)})

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints it moves."""
        return self.gait.joints

    @property
    def period(self) -> float | None:
        """Time of a wingbeat as it was commanded last [s]."""
        own = self.gait.period
        return own / float(self.target[0]) if own else None

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s].

        Raises:
            ShapeError: If the times are not (N,).
        """
        times = asked_times(time)
        first = max(0, bisect_right(self._starts, np.fmin.reduce(times, initial=np.inf)) - 1)
        last = bisect_right(self._starts, np.fmax.reduce(times, initial=-np.inf))
        places = first + np.searchsorted(self._starts[first:last], times, side="right") - 1
        parts = np.full((3, len(times), self._count), np.nan)
        for place in np.unique(places[places >= 0]):
            inside = places == place
            parts[:, inside] = tuple(self._answered(self.answers[place], times[inside]))
        return PrescribedMotion(*parts)

    @checked
    def command(self, time: float, commands: Mapping[str, float]) -> None:
        """Go to other values from a time on; what is not named stays as it was commanded.

        A command keeps the range of its actuator, and a joint its limits: first its amplitude is
        lowered as far as that takes, then its offset. `limited` counts the commands to which
        this was done. What is commanded of a joint counts before what is of its pair or of all.

        Args:
            time: Time of the command, not before the last one [s].
            commands: Values by the names of the class.

        Raises:
            ParameterError: If a name is no command, or a number is not possible.
        """
        if not (np.isfinite(time) and time >= self._since):
            raise ParameterError("time", f"at {self._since:g} s or later", time)
        target = self.target.copy()
        for name in sorted(commands, key=lambda one: -len(self.places(one))):  # a joint's own last
            value, (kind, places) = commands[name], self._commanded_places(name)
            lowest, wanted = _LOWEST.get(kind, (-np.inf, ""))
            if finite(f"command {name}", value) < lowest:
                raise ParameterError(f"command {name}", wanted, value)
            target[[k for k in places if k not in self.stuck]] = value * self._scale(kind)
        self._since, self.target = time, self._within_limits(target)
        last = self.answers[-1]
        since = np.array([time - last.time])
        state = np.concatenate(last.at(since))
        aim = last.fixed.target - last.ramp.slope * np.maximum(last.lasting - since, 0.0)
        gap = self.target - aim
        lasting = np.abs(gap) / self.rates
        slope = np.sign(gap) * np.where(lasting > 0, self.rates, 0.0)
        ramp = Responses.from_state(state, aim, slope, self.sharpness)
        there = np.concatenate(ramp.at(lasting[None]))
        fixed = Responses.from_state(there, self.target, 0.0 * slope, self.sharpness)
        own = float(last.own(since)[0])
        self.answers.append(_Answer(time, own, lasting, ramp, fixed))
        self._starts.append(time)

    def forget(self, time: float) -> None:
        """Forget all before the command in force at a time [s]: motion before it is nan."""
        place = max(0, bisect_right(self._starts, time) - 1)
        del self.answers[:place], self._starts[:place]

    def commanded(self, name: str) -> float:
        """Value of a command as it was given last, in its own unit; that of the first joint."""
        kind, places = self._commanded_places(name)
        return float(self.target[places[0]] / self._scale(kind))

    def command_at(self, time: float) -> tuple[float, float]:
        """Frequency [Hz] and amplitude over the gait's own, mean of joints, at a time [s]."""
        values = self.responses_at(time)[1][0]
        amplitude = values[1 : 1 + self._count][self._moves] if self._moves.any() else np.ones(1)
        return float(values[0]) / (self.gait.period or 1.0), float(amplitude.mean())

    def responses_at(self, time: float) -> tuple[float, Array]:
        """The gait's own time [s], and values and first two rates of all responses, at a time.

        Args:
            time: The time [s].

        Returns:
            Own time, and (3, 1 + 3 n_a): rate of it, then amplitudes, offsets and leads [s] of all
            joints; `neutral` where no command was given.
        """
        answer = self.answers[bisect_right(self._starts, time) - 1]
        since = np.array([time - answer.time])
        return float(answer.own(since)[0]), np.concatenate(answer.at(since))

    def wingbeats(self, time: Array) -> Array:
        """Wingbeats since the start, (N,) [1], at times that rise, (N,) [s]."""
        firsts = [*np.searchsorted(time, self._starts), len(time)]
        parts = [
            answer.own(time[first:last] - answer.time)
            for answer, (first, last) in zip(self.answers, pairwise(firsts), strict=True)
        ]
        return np.concatenate(parts) / (self.gait.period or np.inf)

    def limits(self, name: str) -> tuple[float, float, float]:
        """Least and greatest value of a command's responses that all its joints allow, and rate."""
        kind, places = self._commanded_places(name)
        low, high = self.range[:, places]
        if kind == "amplitude":
            high = self.largest_amplitudes[np.array(places) - 1]
        return float(low.max()), float(high.min()), float(self.rates[places].min())

    def places(self, name: str) -> list[int]:
        """Places among the responses of all joints that answer a command."""
        return self._commanded_places(name)[1]

    def scale(self, name: str) -> float:
        """Factor from the unit of a command to that of its response."""
        return self._scale(self._commanded_places(name)[0])

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        beat = self.period
        return {
            "kind": "steered",
            "frequency": 1.0 / beat if beat else 0.0,
            "parts": [self.gait.describe()],
            "response_time": (SHARPNESS / self.sharpness).tolist(),
        }

    def _places(self, name: str) -> tuple[str, list[int]]:
        """Kind of a command, and its places among the responses; none where no joint moves."""
        kind, named = self._robot.command(name)
        if kind == "frequency":
            return kind, [0] if self.gait.period and self._moves.any() else []
        joints = zip(self.joints, self._moves | (kind == "offset"), strict=True)
        found = [k for k, (joint, able) in enumerate(joints) if joint in named and able]
        return kind, [1 + COMMANDS.index(kind) * self._count + k for k in found]

    def _commanded_places(self, name: str) -> tuple[str, list[int]]:
        """Kind of a command that a joint follows, and its places among the responses."""
        of_kind("name", name, str)
        if name not in self._known:
            self._known[name] = self._places(name)
        kind, places = self._known[name]
        if places:
            return kind, places
        expected = f"<joint>_offset of {', '.join(self.joints)}"
        if self.gait.period:
            flapping = ", ".join(self.joints[k] for k in np.flatnonzero(self._moves))
            expected = (
                f"frequency, amplitude, {expected}, <joint>_amplitude or _phase of {flapping}"
            )
        raise ParameterError("command", expected, name)

    def _limits_of(
        self, name: str, kind: str, places: list[int], actuator: Actuator
    ) -> tuple[Array, Array]:
        """Range, (2, places), and rate, (places,), of an actuator in the unit of the responses."""
        joints = [(place - 1) % self._count for place in places]
        factor: Array = np.full(len(places), self._scale(kind))
        middle: Array = np.zeros(len(places))
        if kind == "amplitude":
            factor = 2.0 / np.ptp(self.reach[:, joints], axis=0)
        elif kind == "offset":
            middle = self.mean[joints]
        low, high = actuator.range
        gait = self.target[places] / factor + middle
        beyond = np.maximum(low - gait, gait - high)
        if not beyond.max(initial=0.0) <= MARGIN:
            expected = "a range that holds the gait's " + spoken(
                actuator.unit, gait[beyond.argmax()]
            )
            found = spoken(actuator.unit, low, high)
            raise ParameterError(f"actuators.{name}.range", expected, found)
        held = np.array([np.minimum(low, gait), np.maximum(high, gait)])
        return (held - middle) * factor, actuator.rate_limit * factor

    def _scale(self, kind: str) -> float:
        """Factor from the unit of a command to that of its response."""
        beat = self.gait.period or 1.0
        return {"frequency": beat, "phase": beat / (2 * np.pi)}.get(kind, 1.0)

    @cached_property
    def largest_amplitudes(self) -> Array:
        """Largest amplitude of each joint about its own mean, (n_a,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(self._moves, self.room / self.reach, np.inf)
        within = np.maximum(ratio, 0.0).min(axis=0)
        return np.asarray(np.minimum(within, self.range[1, 1 : 1 + self._count]))

    def _within_limits(self, target: Array) -> Array:
        """Targets at which every joint keeps its limits, (1 + 3 n_a,)."""
        n = self._count
        kept: Array = np.clip(target, *self.range)
        amplitude, offset = kept[1 : 1 + n], kept[1 + n : 1 + 2 * n]  # views
        np.minimum(amplitude, self.largest_amplitudes, out=amplitude)
        room = self.room - amplitude * self.reach
        np.clip(offset, np.minimum(room[0], 0.0), np.maximum(room[1], 0.0), out=offset)
        self.limited += bool(np.abs(kept - target).max() > _ROUNDING)
        return kept

    def _answered(self, answer: _Answer, times: Array) -> PrescribedMotion:
        n, since = self._count, times - answer.time
        ends = [0, 1, 1 + n, 1 + 2 * n, 1 + 3 * n]
        parts = [[part[:, i:j] for i, j in pairwise(ends)] for part in answer.at(since)]
        (rate, size, offset, lead), (bend, growth, drift, lead_rate) = parts[0], parts[1]
        _, spurt, push, lead_bend = parts[2]
        own = answer.own(since)[:, None] + lead
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
        if (own == own[:, :1]).all():
            return self.gait.motion(own[:, 0])
        found = self.gait.motion(own.T.ravel())
        each, shape = np.arange(self._count), (self._count, -1, self._count)
        return PrescribedMotion(*(part.reshape(shape)[each, :, each].T for part in found))
