"""Periodic orbit of a flight: one wingbeat after which the body moves as before, elsewhere.

Position and heading are left out, since nothing depends on them: what repeats is the state seen
from a frame that goes along with the body and turns with its heading.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, reduce
from typing import Any, ClassVar

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.aerodynamics import AddedMass, Aerodynamics
from patagium.arguments import checked
from patagium.arrays import Array, real_array
from patagium.control.gait_family import GaitFamily
from patagium.control.wingbeat import FlightMap, Segments
from patagium.errors import ParameterError, positive
from patagium.robot import Robot
from patagium.simulation.gait_models import FourierGait
from patagium.simulation.simulator import simulate

NEUTRAL = ("x", "y", "z", "yaw")
"""Coordinates that nothing depends on."""
STILL = 1e-6
"""Distance from 1 that rounding makes of a double multiplier 1, and more."""

_ALONG = "velocity of x"  # in the name of a state: of a horizontal vector in the world


class Frame:
    """Coordinates of a state that goes along with the body and its heading.

    Where the attitude is prescribed there is no yaw, and the heading is that of the world.

    Args:
        names: Names of the entries of the state.

    Attributes:
        vectors: Places of the entries along and across, of each horizontal vector but positions.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self.size = len(names)
        self.neutral = [names.index(name) for name in NEUTRAL if name in names]
        self.kept = [k for k in range(self.size) if k not in self.neutral]
        self.names = tuple(names[k] for k in self.kept)
        self.vectors = [
            [names.index(name), names.index(name.replace(_ALONG, "velocity of y"))]
            for name in names
            if _ALONG in name and "yaw" in names
        ]
        self._yaw = names.index("yaw") if "yaw" in names else 0

    def seen(self, state: Array) -> tuple[Array, Array]:
        """State with velocities along and across the heading, (n,), and its derivative, (n, n)."""
        cosine, sine = np.cos(state[self._yaw]), np.sin(state[self._yaw])
        turn = np.array([[cosine, sine], [-sine, cosine]])
        found, slope = state.copy(), np.eye(self.size)
        for places in self.vectors:
            found[places] = turn @ state[places]
            slope[np.ix_(places, places)] = turn
            along, across = found[places]
            slope[places, self._yaw] = across, -along
        return found, slope

    def seen_rate(self, state: Array, rate: Array, slope: Array) -> Array:
        """Jacobian of the rate of what is kept, as seen along the heading, (n - 4, n - 4) [1/s]."""
        _, turned = self.seen(state)
        found = turned @ slope @ np.linalg.inv(turned)
        for along, across in self.vectors:
            found[along, across] += rate[self._yaw]
            found[across, along] -= rate[self._yaw]
        return found[np.ix_(self.kept, self.kept)]

    def generators(self, state: Array) -> Array:
        """Change of a state with position and heading, (n, 4) or without yaw (n, 3) [SI]."""
        found = np.eye(self.size)[:, self.neutral]
        for places in self.vectors:
            along, across = state[places]
            found[places, 3] = -across, along
        return found


def check_attitude(robot: Robot) -> None:
    """Refuse a robot whose coordinates are not those of orbits and their controllers.

    Raises:
        ParameterError: If its attitude is a quaternion.
    """
    if robot.attitude == "quaternion":
        expected = (
            'one with Euler angles (robot.with_attitude("euler"), or attitude: euler in its file)'
        )
        raise ParameterError("robot", expected, f"{robot.name} with a quaternion")


@dataclass(frozen=True, eq=False)
class Orbit:
    """Periodic orbit that was found.

    Attributes:
        robot: The machine.
        aero: Model of the air around it.
        added_mass: Inertia of the air, or None.
        family: Gaits that the free parameters reach.
        values: Values of the free parameters, (p,) [Hz, 1, rad or m, rad].
        states: State at the beginning of each segment of the beat, (m, n) [SI].
        segments: Ends and derivatives of the segments.
        names: Names of the entries of the state.
        steps: Time steps of the beat.
        speed: Mean speed forward [m/s].
        climb: Mean speed upward [m/s].
        turn_rate: Mean rate of the heading [rad/s].
        residual: Largest misfit of segments, return and conditions, over sizes of more than 1 [SI].
        iterations: Newton steps that were taken.
    """

    robot: Robot
    aero: Aerodynamics
    added_mass: AddedMass | None = field(repr=False)
    family: GaitFamily = field(repr=False)
    values: Array
    states: Array = field(repr=False)
    segments: Segments = field(repr=False)
    names: tuple[str, ...] = field(repr=False)
    steps: int
    speed: float
    climb: float
    turn_rate: float
    residual: float
    iterations: int
    found: ClassVar[bool] = True

    @property
    def gait(self) -> FourierGait:
        """Gait of the orbit."""
        return self.family.gait(self.values)

    @property
    def parameters(self) -> Mapping[str, float]:
        """Free parameters by name [Hz, 1, rad or m, rad]."""
        return dict(zip(self.family.names, map(float, self.values), strict=True))

    @property
    def period(self) -> float:
        """Time of a wingbeat [s]."""
        return 1.0 / self.gait.frequency

    @property
    def time_step(self) -> float:
        """Time step of the map, and of `flight` [s]."""
        return self.period / self.steps

    @property
    def map(self) -> FlightMap:
        """Map of the flight, with its derivatives."""
        return FlightMap(self.robot, self.aero, self.added_mass)

    @property
    def monodromy(self) -> Array:
        """Derivative of the state after a beat by that before it, in the world, (n, n) [SI]."""
        return reduce(lambda found, slope: slope @ found, self.segments.by_state)

    @property
    def return_slope(self) -> Array:
        """Derivative of the return map, position and heading left out, (n - 4, n - 4) [SI]."""
        frame = Frame(self.names)
        _, slope = frame.seen(self.segments.ends[-1])
        return (slope @ self.monodromy)[np.ix_(frame.kept, frame.kept)]

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Multipliers, largest first, position and heading left out, (n - 4,) [1]."""
        found = np.linalg.eigvals(self.return_slope)
        return np.asarray(found[np.argsort(-np.abs(found), kind="stable")], complex)

    @property
    def _pitch(self) -> Array:
        """Pitch over the beat, of the state or prescribed, (m,) [rad]."""
        if "pitch" in self.names:
            return self.states[:, self.names.index("pitch")]
        gait, phase = self.gait, np.arange(len(self.states)) / len(self.states)
        if "pitch" not in gait.joints:
            return np.zeros(len(phase))
        return gait.motion(phase * self.period).position[:, gait.joints.index("pitch")]

    def start(self) -> dict[str, Array]:
        """Keywords of `simulate` that begin a flight on the orbit: q, v and states of the air."""
        robot, state = self.robot, self.states[0]
        q, v = robot.coordinates(), np.zeros(robot.dof)
        passive = list(robot.passive)
        q[passive], v[passive] = np.split(state[: 2 * len(passive)], 2)
        q[list(robot.actuated)] = self.gait.motion(np.zeros(1)).position[0]
        return {"q": q, "v": v, "aero_state": state[2 * len(passive) :]}

    @cached_property
    def _beat(self) -> Array:
        """Rows of q, v and a of one beat, (m, n_q + 2 n) [SI]."""
        flight = self.flight(beats=1.0)
        return np.hstack([flight[name].values for name in ("q", "v", "a")])

    @checked
    def along(self, time: Array, heading: float = 0.0) -> Array:
        """Rows of q, v and a, (m, n_q + 2 n) [SI], at times (m,) [s], turned by a heading [rad]."""
        known, size, time = self._beat, self.robot.dof, real_array("time", time, ("N",))
        travel, grid = known[-1] - known[0], np.linspace(0.0, 1.0, len(known))
        beats, phases = np.divmod(time / self.period + 1e-9, 1.0)
        found = np.column_stack([np.interp(phases, grid, column) for column in known.T])
        half = self.turn_rate * self.period / 2
        turns, sine = np.exp(2j * half * beats), np.sin(half)
        done = np.exp(1j * half * (beats - 1)) * (np.sin(half * beats) / sine if sine else beats)
        for shift in (0, size, 2 * size):  # horizontal vectors, as x + iy; Euler angles: n_q = n
            pair = [self.robot.index(name) + shift for name in "xy"]
            way = turns * (found[:, pair] @ (1.0, 1.0j))
            way += 0.0 if shift else done * complex(*travel[pair])
            way *= np.exp(1j * heading)
            found[:, pair], travel[pair] = np.column_stack([way.real, way.imag]), 0.0
        found[:, self.robot.index("yaw")] += heading
        return np.asarray(found + beats[:, None] * travel)

    @checked
    def flight(self, beats: float = 10.0, **options: Any) -> xr.Dataset:
        """Flight that begins on the orbit, as `simulate` makes it.

        Args:
            beats: Its duration in wingbeats, rounded to time steps.
            **options: Keywords of `simulate`, such as `controller`; they override the start.

        Raises:
            ParameterError: If an option is not possible.
            SimulationFailed: If the flight broke.
        """
        given: dict[str, Any] = {**self.start(), "added_mass": self.added_mass, **options}
        step = given.pop("time_step", self.time_step)
        wanted = positive("beats", beats) * self.period / positive("time_step", step)
        duration = given.pop("duration", max(1, round(min(wanted, 1e15))) * step)
        return simulate(
            self.robot, self.aero, self.gait, duration=duration, time_step=step, **given
        )

    @property
    def parameter_facts(self) -> dict[str, float]:
        """Parameters by name and unit; amplitudes over those of the gait that it began from."""
        units = zip(self.family.names, self.family.units, strict=True)
        return {f"{k}_{'over_start' if u == '1' else u}": self.parameters[k] for k, u in units}

    def summary(self) -> dict[str, Any]:
        """Orbit as facts by name, with their units."""
        pitch = self._pitch
        facts: dict[str, Any] = {
            "frequency_Hz": self.gait.frequency,
            "speed_m_s": self.speed,
            "climb_m_s": self.climb,
            "turn_rate_rad_s": self.turn_rate,
            "pitch_least_rad": float(pitch.min()),
            "pitch_most_rad": float(pitch.max()),
        }
        facts = {k: v if abs(v) > 1e-10 else 0.0 for k, v in (facts | self.parameter_facts).items()}
        size = float(np.abs(self.multipliers[0]))
        facts |= {"largest_multiplier": size, "stable": size < 1 - STILL}
        return facts | {"residual_SI": self.residual, "newton_steps": self.iterations}

    def __repr__(self) -> str:
        pitch = np.degrees(self._pitch)
        size = np.abs(self.multipliers)
        word = "unstable" if size[0] > 1 + STILL else "neutral at best"
        family = self.family
        each = zip(family.names, self.values, family.neutral, family.units, strict=True)
        free = [
            f"{name} {said(value)} {unit}".removesuffix(" 1") + f" (was {said(was)})"
            for name, value, was, unit in each
        ]
        lines = [
            f"periodic orbit of {self.robot.name}, one beat of {self.period:.4g} s",
            f"  speed {said(self.speed)} m/s, climb {said(self.climb)} m/s, "
            f"turn {said(np.degrees(self.turn_rate))} deg/s, "
            f"pitch {pitch.min():.3g} to {pitch.max():.3g} deg",
            f"  free: {', '.join(free)}",
            f"  residual {self.residual:.1e} [SI] after {self.iterations} Newton steps, "
            f"{len(Frame(self.names).kept)} states, {self.steps} time steps",
            f"  largest multipliers {', '.join(f'{one:.4f}' for one in size[:4])}: "
            + ("stable" if size[0] < 1 - STILL else f"{word} without feedback"),
        ]
        return "\n".join(lines)


def said(value: float) -> str:
    """Number in four digits; 0 where it is rounding."""
    return f"{value if abs(value) > 1e-10 else 0.0:.4g}"


@dataclass(frozen=True)
class NoOrbit:
    """Search that found no periodic orbit, and why.

    Attributes:
        reason: What stood in the way.
        remedy: What to do.
        lacking: Mean force [N] and moment [N m] along and about x, y, z that the free parameters
            could not give where the search stopped; empty where that was not the reason.
        residual: Misfit that was left [SI].
        iterations: Newton steps that were taken.
        nearest: Where the search stopped: values of the free parameters by name.
        beyond: Orbit that was found, where a passive joint leaves its limits on it.
    """

    reason: str
    remedy: str
    lacking: Mapping[str, float]
    residual: float
    iterations: int
    nearest: Mapping[str, float]
    beyond: Orbit | None = field(default=None, repr=False)
    found: ClassVar[bool] = False

    def summary(self) -> dict[str, Any]:
        """Search as facts by name."""
        return {"found": False} | {k: v for k, v in vars(self).items() if k != "beyond"}

    def __repr__(self) -> str:
        return f"no periodic orbit: {self.reason}\n  remedy: {self.remedy}"
