"""Trim: gait parameters and a state that repeats after a wingbeat, by Newton's method.

A beat is cut into segments whose beginnings are unknowns too (multiple shooting), so that an
unstable flight is no obstacle; all are eliminated but the first. Unknowns are then the state
without position and heading, and the free gait parameters; conditions are its return, the turn of
the heading, the climb and the speed. Steps are the smallest in the least-squares sense, in scaled
unknowns: where there are more free parameters than conditions the gait stays near. A search that
fails begins anew from the free flight of the gait and goes to the conditions in parts. Neglected:
wind (an orbit is relative to the air), stops of joints but as limits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import casadi as ca
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from patagium.aerodynamics import AddedMass, Aerodynamics, QuasiSteady
from patagium.arguments import Progress, checked
from patagium.arrays import Array
from patagium.control.gait_family import (
    DIFFERENCE,
    MOST_STEPS,
    GaitFamily,
    gait_family,
    symmetric_parameters,
)
from patagium.control.orbit import NEUTRAL, Frame, NoOrbit, Orbit, check_attitude
from patagium.control.wingbeat import FlightMap, PrescribedRows, Segments
from patagium.dynamics.equations import mass_matrix
from patagium.errors import ParameterError, check_names, positive
from patagium.robot import Robot
from patagium.robot.model import COMMANDS, FLOATING_COORDINATES
from patagium.robot.units import as_read
from patagium.simulation import gaits
from patagium.simulation.gait_models import Gait
from patagium.simulation.simulator import check_robots
from patagium.simulation.state_limits import tightest_limit
from patagium.simulation.steered_gait import MARGIN, SteeredGait

TOLERANCE = 1e-12
"""Residual of an orbit: rounding of some thousand operations, over sizes of more than 1 [SI]."""
SEGMENTS = 40
STEPS = 240
"""Time steps of a beat, where none are given; of a beat beyond .6 s one every 2.5 ms."""
_BEARABLE = 20_000  # steps of a beat that stiff springs may ask for by themselves
_NEWTON = 40  # steps at most
_POINTS = 250  # flights of a search, at most
_BEYOND = 1e-7  # rad or m, that a joint may be beyond its limit: what its phase changes of peaks
_BETWEEN = 12  # samples of a segment, of the motion of passive joints
_PARTS = 0.5 ** np.arange(9)  # of a Newton step
_RANK = 1e-9  # of singular values that count
_SURE = 0.05  # size of misfits from which on Newton steps no longer bring a gait back in its limits
_PROJECTIONS, _SETTLED = 10, 1e-2  # ways back to where a search began, and the last one's length
_SOUND = 340.0  # m/s, beyond which no model of the air holds
STEEPEST = 1.5
"""Pitch beyond which no orbit is sought: Euler angles are singular at a right angle [rad]."""


@dataclass(frozen=True)
class Conditions:
    """Conditions of an orbit in addition to periodicity.

    Attributes:
        turn_rate: Mean rate of the heading [rad/s].
        climb: Mean speed upward [m/s], or None.
        speed: Mean speed forward [m/s], or None.

    Raises:
        ParameterError: If a speed is beyond that of sound.
    """

    turn_rate: float = 0.0
    climb: float | None = None
    speed: float | None = None

    def __post_init__(self) -> None:
        for name in ("climb", "speed"):
            value = getattr(self, name)
            if abs(value or 0.0) > _SOUND:
                raise ParameterError(name, f"up to {_SOUND:g} m/s", value)

    def beside(self, frame: Frame, end: Array, period: float) -> tuple[Array, Array, Array]:
        """Misfits of all but the return, their slopes by the end and by the period.

        Args:
            frame: Frame of the state.
            end: State at the end of a beat that began at the origin with zero yaw, (n,) [SI].
            period: Time of the beat [s].

        Returns:
            Misfits, (c,) [rad, m]; slopes, (c, n) [SI], and (c,) [rad/s, m/s].
        """
        x, y, z, *yaw = frame.neutral
        each, forward = np.eye(frame.size), np.zeros(frame.size)
        forward[[x, y]] = _along_arc(self.turn_rate * period)
        asked = [*((each[k], self.turn_rate) for k in yaw), (each[z], self.climb)]
        asked = [(way, rate) for way, rate in (*asked, (forward, self.speed)) if rate is not None]
        slope = np.array([way for way, _ in asked]).reshape(-1, frame.size)
        rates = np.array([rate for _, rate in asked], float)
        return slope @ end - rates * period, slope, -rates


def _along_arc(turned: float) -> Array:
    """Factors of a chord's x and y, (2,) [1], that make its arc, which turns by an angle [rad]."""
    half = 0.5 * turned
    longer = half / np.sin(half) if half else 1.0
    return np.array([longer * np.cos(half), longer * np.sin(half)])


class Point(NamedTuple):
    """Iterate of the search: unknowns, the flight of all segments, and residuals."""

    states: Array
    values: Array
    flown: Segments
    rows: PrescribedRows
    gaps: Array
    misfit: Array
    slope: Array
    by_period: Array
    scales: tuple[Array, Array]
    size: float

    @property
    def period(self) -> float:
        """Time of the beat [s]."""
        return self.rows.steps * self.rows.time_step

    @property
    def residual(self) -> float:
        """Largest misfit, over its size where that is more than 1 [SI]."""
        parts = zip((self.gaps, self.misfit), self.scales, strict=True)
        return max(float(np.abs(x / np.maximum(1.0, size)).max(initial=0.0)) for x, size in parts)


class PassiveLimits:
    """Limits of passive joints, by the names of the entries of a state.

    Attributes:
        dofs: Degrees of freedom that have limits, (l,).
        places: Places of their coordinates in a state, (l,).
        limits: Lower and upper limits, (2, l) [rad, m].
    """

    def __init__(self, robot: Robot, names: Sequence[str]) -> None:
        limits = np.array([robot.lower, robot.upper])
        joints = [i for i in robot.passive if robot.dof_names[i] not in NEUTRAL]
        self.dofs = [i for i in joints if np.isfinite(limits[:, i]).any()]
        self.places = [names.index(robot.dof_names[i]) for i in self.dofs]
        self._rates = [k + len(robot.passive) for k in self.places]
        self.limits = limits[:, self.dofs]

    def ends(self, nodes: Array, period: float) -> Array:
        """Least and greatest coordinates of a beat by its nodes, (m + 1, n) [SI], (2, l) [rad, m].

        Those of cubics between nodes, widened by what they err: an eighth of the change with nodes
        twice as far apart (a sixteenth for a smooth motion).
        """
        time = np.linspace(0.0, period, len(nodes))
        between = np.linspace(0.0, period, _BETWEEN * (len(nodes) - 1) + 1)
        motion, coarse = (
            CubicHermiteSpline(time[::k], own[:, self.places], own[:, self._rates])(between)
            for k, own in ((1, nodes), (2, nodes[::2]))
        )
        error = np.abs(coarse - motion).max(axis=0) / 8
        return np.array([motion.min(axis=0) - error, motion.max(axis=0) + error])


class OrbitSearch:
    """Search for orbits of one robot with some free parameters."""

    def __init__(
        self,
        flight_map: FlightMap,
        family: GaitFamily,
        steps: int,
        tolerable: Mapping[str, float] = MappingProxyType({}),
        progress: Progress | None = None,
    ) -> None:
        self.map, self.family, self.steps, names = flight_map, family, steps, flight_map.names
        self.frame = Frame(names)
        self.still = np.zeros(len(family.names), bool)
        self._scale = state_sizes(names, family.base.frequency)
        self._reach = parameter_sizes(family)
        sizes = dict(zip(names, state_sizes(names) if tolerable else self._scale, strict=True))
        for name, value in tolerable.items():
            check_names("tolerable", [name], sizes, near=True)
            sizes[name] = positive(f"tolerable: {name}", value)
        self._size = np.array([sizes[name] for name in self.frame.names])
        self._pitch = [k for k, name in enumerate(names) if name == "pitch"]
        self.iterations = self.points = 0
        self._progress = progress

    @np.errstate(all="ignore")  # a flight that breaks is of infinite size
    def point(self, states: Array, values: Array, conditions: Conditions) -> Point:
        """Flight of all segments and its misfits."""
        self.points += 1
        if self._progress is not None:
            self._progress(min(self.points, _POINTS), _POINTS)
        rows = self.family.rows(values, self.steps, self.map.aero.air)
        flown = self.map.fly(states, rows)
        period, frame = rows.steps * rows.time_step, self.frame
        end, turned = frame.seen(flown.ends[-1])
        others, ways, rates = conditions.beside(frame, flown.ends[-1], period)
        misfit = np.r_[end[frame.kept] - states[0][frame.kept], others]
        gaps = flown.ends[:-1] - states[1:]
        _, _, z, *yaw = frame.neutral
        rest = self._scale[[*frame.kept, *yaw, *[z] * (len(others) - len(yaw))]]
        size = float(np.linalg.norm(np.r_[(gaps / self._scale).ravel(), misfit / rest]))
        slope = np.vstack([turned[frame.kept], ways])
        by_period = np.r_[np.zeros(len(frame.kept)), rates]
        sizes = self._scale, rest
        return Point(states, values, flown, rows, gaps, misfit, slope, by_period, sizes, size)

    @np.errstate(all="ignore")
    def system(self, at: Point, shift: Array | None = None) -> tuple[Array, Array, Array]:
        """Scaled Newton matrix and right-hand side, and how nodes follow the unknowns.

        Args:
            at: The point.
            shift: Changes of the parameters that are given, (p,); the unknowns add to them.

        Returns:
            Matrix, right-hand side, and columns of each node: its derivatives by the first state
            and the parameters, and its own step, (m, n, n + p + 1).
        """
        n, kept = self.frame.size, self.frame.kept
        shift = np.zeros(len(at.values)) if shift is None else shift
        gaps = np.vstack([at.gaps, np.zeros(n)]) + at.flown.by_parameter @ shift
        own = np.dstack([np.zeros_like(at.flown.by_state), at.flown.by_parameter, gaps])
        nodes = np.empty_like(own)
        now = np.eye(n, own.shape[2])
        for node, a, more in zip(nodes, at.flown.by_state, own, strict=True):
            node[:] = now
            now = a @ now + more
        by_state, by_value, gap = now[:, :n], now[:, n:-1], now[:, -1]
        matrix = at.slope @ by_state[:, kept]
        matrix[: len(kept)] -= np.eye(len(kept))
        longer = at.rows.step_slopes * at.rows.steps
        values = at.slope @ by_value + np.outer(at.by_period, longer)
        right = -(at.misfit + at.slope @ gap + at.by_period * (longer @ shift))
        scaled = np.hstack([matrix * self._size, values * self.reach]) / at.scales[1][:, None]
        return scaled, right / at.scales[1], nodes

    def step(self, at: Point, held: Array) -> tuple[Array, Array]:
        """Newton step of all nodes, (m, n), and of the parameters, (p,), some to values held."""
        shift = np.where(self.still, held - at.values, 0.0)
        matrix, right, nodes = self.system(at, shift)
        if not np.isfinite(matrix).all():  # segments that diverge: no step leads on
            return np.full_like(at.states, np.nan), at.values
        found = np.asarray(np.linalg.lstsq(matrix, right, rcond=_RANK)[0], float)
        states, values = self.moved(at, nodes, found)
        return states - at.states, values - at.values + shift

    def moved(self, at: Point, nodes: Array, found: Array) -> tuple[Array, Array]:
        """States of all nodes, (m, n), and parameters, (p,), after a step of scaled unknowns."""
        kept, first = self.frame.kept, np.zeros(self.frame.size)
        first[kept] = found[: len(kept)] * self._size
        values = found[len(kept) :] * self.reach
        return at.states + nodes @ np.r_[first, values, 1.0], at.values + values

    @property
    def reach(self) -> Array:
        """Sizes of the parameters, 0 where one is held, (p,) [Hz, 1, rad or m, rad]."""
        return np.where(self.still, 0.0, self._reach)

    def newton(
        self, at: Point, conditions: Conditions, held: Array | None = None, *, limited: bool = False
    ) -> tuple[Point, str]:
        """Point where Newton's method ended, and why before an orbit; empty if it is one.

        With `limited` it ends early, without a reason, where two gaits exceed the same limit.
        Parameters that are still go to the values held, or stay.
        """
        held = at.values if held is None else held
        if not np.isfinite(at.size):
            return at, "the flight breaks within the first wingbeat"
        for _ in range(_NEWTON):
            if self.points > _POINTS or at.residual <= 0.1 * TOLERANCE:
                break
            states, values = self.step(at, held)
            excess = self.excess(at.values) if limited and at.size < _SURE else ""
            if excess and self._same(excess, at.values + values):
                return at._replace(values=at.values + values), ""
            self.iterations += 1
            for part in _PARTS:
                nodes, trial = at.states + part * states, at.values + part * values
                upright = np.abs(nodes[:, self._pitch]).max(initial=0.0) < STEEPEST
                if upright and self.family.swings(trial)[0] > 0:
                    near = self.point(nodes, trial, conditions)
                    if near.size < (1.0 - 0.1 * part) * at.size:
                        at = near
                        break
            else:
                break
        return at, "" if at.residual <= TOLERANCE else "stalled"

    def nearest(self, at: Point, begin: Point, conditions: Conditions) -> Point:
        """Orbit that is nearest to a point, by the sizes of the unknowns, from an orbit found.

        The smallest Newton steps do not add up to the smallest change; so the way back to the
        point is taken within the kernel of the Newton matrix, and Newton's method from there.
        """
        kept = self.frame.kept
        for _ in range(_PROJECTIONS):
            matrix, _, nodes = self.system(at)
            values = np.where(self.still, 0.0, begin.values - at.values) / self._reach
            back = np.r_[(begin.states[0] - at.states[0])[kept] / self._size, values]
            back -= np.linalg.lstsq(matrix, matrix @ back, rcond=_RANK)[0]
            near = self.point(*self.moved(at, nodes, np.asarray(back, float)), conditions)
            trial, trouble = self.newton(near, conditions)
            if trouble or self.excess(trial.values) or self.strained(trial):
                break
            at = trial
            if np.linalg.norm(back) < _SETTLED:
                break
        return at

    def within(self, at: Point, conditions: Conditions) -> tuple[Point, str]:
        """Orbit whose gait keeps the limits: parameters that would exceed one are held there."""
        begin, held = at, at.values.copy()
        at, trouble = self.newton(at, conditions, limited=True)
        for _ in self.still:
            excess = "" if trouble else self.excess(at.values)
            if not excess:
                return at, trouble
            k = self._moved_by(excess, at.values)
            if k is None:
                return at, excess
            values = at.values.copy()
            low, high = self.family.neutral[k], at.values[k]
            for _ in range(30):
                values[k] = 0.5 * (low + high)
                crosses = self._same(excess, values, 0.0)
                low, high = (low, values[k]) if crosses else (values[k], high)
            held[k], self.still[k] = low, True
            at, trouble = self.newton(begin, conditions, held, limited=True)
            joint, limit = excess.partition(" ")[0], excess.rpartition(", and ")[2]
            trouble = f"none was found with {joint} at a limit: {limit}" if trouble else ""
        return at, trouble or self.excess(at.values)

    def _same(self, excess: str, values: Array, beyond: float = _BEYOND) -> bool:
        """Whether a gait exceeds a limit of the same joint."""
        return self.excess(values, beyond).partition(" ")[0] == excess.partition(" ")[0]

    def _moved_by(self, excess: str, values: Array) -> int | None:
        """Free parameter that moved the joint of an excess most, or None."""
        joint, joints = excess.partition(" ")[0], self.family.base.joints
        n = len(joints)
        kinds = (2,) if "_phase " in excess else (0, 1)
        places = [0] if joint == "frequency" else [1 + joints.index(joint) + n * k for k in kinds]
        moved = np.abs(values - self.family.neutral) / self._reach
        moved[self.still | ~self.family.directions[:, places].any(axis=1)] = -1.0
        return int(np.argmax(moved)) if moved.max() >= 0.0 else None

    def strained(self, at: Point) -> str:
        """Limits that a passive joint exceeds, in words that begin with its name, or ""."""
        limits = PassiveLimits(self.map.robot, self.map.names)
        least, most = limits.ends(np.vstack([at.states, at.flown.ends[-1]]), at.period)
        each = zip(limits.dofs, least, most, strict=True)
        told = (_crossed(self.map.robot, i, low, high) for i, low, high in each)
        return next(filter(None, told), "")

    def excess(self, values: Array, beyond: float = _BEYOND) -> str:
        """Limit that a gait exceeds, in words that begin with its joint; empty if there is none."""
        robot, moved = self.map.robot, self.family.base.joints
        frequency, amplitude, mean, lead, position = self.family.swings(values)
        if not frequency > 0:
            return f"frequency would be {frequency:.3g} Hz"
        least, most = (-_peaks(-position)).tolist(), _peaks(position).tolist()
        for i, low, high in zip(robot.actuated, least, most, strict=True):
            if crossed := _crossed(robot, i, low, high, beyond):
                return crossed
        half = np.subtract(most, least) / 2 * np.copysign(1.0, amplitude)
        known = dict(zip(COMMANDS, (half, mean, lead), strict=True))
        margin = MARGIN / 2 if beyond else 0.0  # samples differ
        for name, actuator, kind, k in self.family.commanded:
            low, high = actuator.range
            value = known[kind][k] if kind in known else frequency
            if (half[k] or kind == "offset") and not low - margin <= value <= high + margin:
                joint = kind if kind == "frequency" else moved[k]
                seen = _apart(actuator.unit, value, value, low, high)
                needed = f"{'' if joint == name else name + ' '}{seen[0]} {seen[4]}"
                given = f"its actuator gives {seen[2]} to {seen[3]} {seen[4]}"
                return f"{joint} would need {needed}, and {given}"
        return ""


def _crossed(robot: Robot, i: int, least: float, most: float, beyond: float = 0.0) -> str:
    """Limits of a joint that a motion exceeds, in words that begin with its name, or ""."""
    low, high = robot.lower[i], robot.upper[i]
    if low - beyond <= least and most <= high + beyond:
        return ""
    seen = _apart(robot.dof_units[i], least, most, low, high)
    way = f"{robot.dof_names[i]} would go from {seen[0]} to {seen[1]} {seen[4]}"
    return f"{way}, and its limits are {seen[2]} to {seen[3]} {seen[4]}"


def _peaks(position: Array) -> Array:
    """Greatest value of each joint in a period of samples, by a parabola there, (n_a,) [rad, m].

    Among samples alone it would change with the phase, and a gait held at a limit exceed it.
    """
    wave, joints = position[:-1], np.arange(position.shape[1])
    top = wave.argmax(axis=0)
    before, peak, after = (wave[(top + k) % len(wave), joints] for k in (-1, 0, 1))
    bend = 8 * (2 * peak - before - after)
    return np.asarray(peak + (after - before) ** 2 / np.where(bend > 0, bend, np.inf))


def _apart(unit: str, *values: float) -> list[str]:
    """Two values and their limits in digits that tell each value from its limit, and the unit."""
    factor, name = as_read(unit)
    told = ([f"{factor * one:.{digits}g}" for one in values] for digits in range(3, 18))
    return [*next(k for k in told if k[0] != k[2] and k[1] != k[3]), name]


def state_sizes(names: Sequence[str], frequency: float = 8.0) -> Array:
    """Sizes that changes of states are measured by, at a frequency of the beat, (n,) [SI]."""
    own = {f"velocity of {k}": 3.0 for k in "xyz"} | dict.fromkeys("xyz", 8.0 / frequency)
    rate = 2.5 * frequency
    return np.array([own.get(k, rate if k.startswith("velocity of ") else 1.0) for k in names])


def parameter_sizes(family: GaitFamily) -> Array:
    """Sizes that changes of gait parameters are measured by, (p,) [Hz, 1, rad or m, rad]."""
    own = zip(family.names, family.neutral, strict=True)
    return np.array([0.3 * abs(value) if name == "frequency" else 0.3 for name, value in own])


@checked
def trim(
    robot: Robot,
    aero: Aerodynamics | None = None,
    gait: Gait | None = None,
    *,
    free: Sequence[str] | None = None,
    speed: float | None = None,
    climb: float | None = 0.0,
    turn_rate: float = 0.0,
    added_mass: AddedMass | None = None,
    start: Orbit | None = None,
    steps: int | None = None,
    tolerable: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> Orbit | NoOrbit:
    """Periodic orbit of a flapping flight, or equilibrium of a glide.

    Args:
        robot: The machine, with a floating body and Euler angles; or one whose attitude is
            prescribed, its body on passive slides x, y and z before its actuated joints.
        aero: Model of the air around it, in air at rest; by default that of `start`, with its added
            mass, where that is an orbit of the same robot, else quasi-steady.
        gait: Gait to begin from; by default that of the robot's section `cruise`.
        free: Gait parameters that may change, by the names of `gait_family`; by default those of
            `free_parameters`.
        speed: Mean speed forward [m/s]; None leaves it free, 0 hovers.
        climb: Mean speed upward [m/s]; None leaves it free.
        turn_rate: Mean rate of the heading, positive to the left [rad/s].
        added_mass: Inertia of the air that moves with the wings, in the same air as the model.
        start: Orbit to begin from; by default the robot's `cruise`.
        steps: Time steps of a beat, a multiple of 40; by default 240 or more, and up to 20,000
            where springs ask for them.
        tolerable: Changes of states by name [SI] that weigh as much as a gait parameter changed
            by 0.3 of its unit, or the frequency by 0.3 of itself, where more than one orbit meets
            the conditions; others by 1 rad, 3 m/s and 20 rad/s. Where given, the orbit is the
            nearest by these sizes to what the search began from; else its rates follow the beat.
        progress: Function that takes the beats flown by the search, and those at most.

    Returns:
        The orbit; or a `NoOrbit` that says what stood in the way and what to do. `found` tells
        them apart.

    Raises:
        ParameterError: If an argument is not what it may be, there are more conditions than free
            parameters, or limits of joints or actuators exclude the gait.
    """
    if aero is None and start is not None and start.robot is robot:
        aero, added_mass = start.aero, added_mass or start.added_mass
    aero = aero or QuasiSteady(robot)
    _check(robot, aero)
    gait = gait or (start.gait if start else gaits.cruise(robot))
    gaits.check_gait(robot, gait)
    conditions = Conditions(turn_rate, climb, speed)
    family, flight = _family(robot, gait, free, conditions), FlightMap(robot, aero, added_mass)
    search = OrbitSearch(flight, family, _steps(family, steps), tolerable or {}, progress)
    if excess := search.excess(family.neutral):
        raise ParameterError("gait", "a gait within the limits of the robot", excess)
    states = _first_states(search, start)
    if steps is None and robot.stiffness:
        needed = stable_steps(search, search.family.neutral, states)
        search.steps = max(search.steps, min(_BEARABLE, needed))
    settles = flight.moving < flight.size and (start is None or states is not start.states)
    first = settles and not robot.stiffness  # on springs that rest, the air would repeat elsewhere
    for settled in dict.fromkeys((first, settles and not first)):
        guess = _settled(search, states) if settled else states
        search.still[:], search.points = False, 0
        at, trouble = _searched(search, guess, conditions, start.turn_rate if start else 0.0)
        if not trouble:
            break
    if trouble:
        return _not_found(search, at, trouble)
    if tolerable:
        at = search.nearest(at, search.point(guess, family.neutral, conditions), conditions)
    orbit, trouble = orbit_of(search, at), search.strained(at)
    return replace(_not_found(search, at, trouble), beyond=orbit) if trouble else orbit


def _family(robot: Robot, gait: Gait, free: Sequence[str] | None, wanted: Conditions) -> GaitFamily:
    """Gaits that the free parameters reach; refused where conditions are more, or impossible."""
    names = tuple(free) if free is not None else free_parameters(robot, gait, wanted.turn_rate)
    given = wanted.speed, wanted.climb
    count = sum(value is not None for value in given) + (wanted.turn_rate != 0)
    if wanted.turn_rate and "yaw" not in robot.dof_names:
        raise ParameterError("turn_rate", "0 where the attitude is prescribed", wanted.turn_rate)
    if len(set(names)) < len(names):
        raise ParameterError("free", "each gait parameter once", names)
    if count > len(names):
        told = f"at least {count} of them, one for each of speed, climb and turn rate asked for"
        raise ParameterError("free", told, ", ".join(names) or "none")
    if gait.period is None and wanted.climb == 0:
        expected = "a speed below 0, such as -0.5 m/s, or None (free), as held joints glide"
        raise ParameterError("climb", expected, wanted.climb)
    if robot.actuators:
        SteeredGait(robot, gait)  # refuses a gait that their ranges exclude
    return gait_family(robot, gait, names)


@checked
def free_parameters(robot: Robot, gait: Gait, turn_rate: float = 0.0) -> tuple[str, ...]:
    """Names of the gait parameters that a trim changes where none are given.

    They are the commands of the robot's `actuators`, else all parameters. Where the flight does not
    turn they keep the gait mirrored.

    Args:
        robot: The machine.
        gait: Gait to begin from.
        turn_rate: Mean rate of the heading [rad/s].
    """
    every = symmetric_parameters(robot, gait)
    own = {name: robot.paired(name) for name in robot.actuators}
    if not turn_rate:
        return tuple(name for name in every if name in own.values()) or every
    pairs = [name for name in every if len(robot.command(name)[1]) == 2 and "_" in name]
    turning = tuple(name for name in own if own[name] in every)
    return turning or (*every, *(name + DIFFERENCE for name in pairs))


def _check(robot: Robot, aero: Aerodynamics) -> None:
    """Refuse a robot or air whose orbits are not those of this module."""
    check_robots(robot, aero)
    if not {"x", "y", "z"} <= {robot.dof_names[i] for i in robot.passive}:
        expected = "a robot with a floating body, or passive slides x, y and z"
        raise ParameterError("robot", expected, robot.name)
    check_attitude(robot)
    if not robot.strips:
        raise ParameterError("robot", "a robot whose file has a section wings", robot.name)
    if aero.air.gust is not None or np.any(aero.air.wind):
        raise ParameterError("aero", "air at rest (an orbit is relative to the air)", aero.air)


def _steps(family: GaitFamily, given: int | None) -> int:
    """Time steps of a beat."""
    if given is not None:
        if not 0 < given <= MOST_STEPS or given % SEGMENTS:
            expected = f"a positive multiple of {SEGMENTS} up to {MOST_STEPS}"
            raise ParameterError("steps", expected, given)
        return int(given)
    return SEGMENTS * int(np.ceil(max(STEPS, 400.0 / family.base.frequency) / SEGMENTS))


def stable_steps(search: OrbitSearch, values: Array, states: Array) -> int:
    """Time steps half as long as is stable, 0 where its own are, of a beat by its unknowns."""
    rows = search.family.rows(values, len(states), search.map.aero.air)
    _, slopes = search.map.slopes(states[::8], rows.table[:-1:16])
    beat = rows.steps * rows.time_step
    found = tightest_limit([k for k in slopes if np.isfinite(k).all()], beat / search.steps)
    return 0 if found is None else SEGMENTS * int(np.ceil(2 * beat / found.longest / SEGMENTS))


def _first_states(search: OrbitSearch, start: Orbit | None) -> Array:
    """States of the nodes to begin from: those of an orbit, or of the cruise, springs at rest."""
    if start is not None and start.names == search.map.names:
        return start.states
    names, robot = search.map.names, search.map.robot
    begin = dict(robot.resting)
    if (cruise := robot.cruise) is not None:
        begin |= {"pitch": cruise.pitch, "velocity of x": cruise.speed}
    states = np.tile([begin.get(name, 0.0) for name in names], (SEGMENTS, 1))
    time = np.arange(SEGMENTS) / SEGMENTS / search.family.base.frequency
    states[:, names.index("x")] = begin.get("velocity of x", 0.0) * time
    return states


def _settled(search: OrbitSearch, states: Array) -> Array:
    """States of the nodes, the air's own as they repeat around the others, or at rest."""
    rows = search.family.rows(search.family.neutral, search.steps, search.map.aero.air)
    found = _repeating(search.map, states, rows)
    if found is None:  # from rest it went too far: a beat is flown first
        own, flown = search.map.moving, states.copy()
        for k in range(len(flown)):
            end = search.map.fly(flown[k : k + 1], rows.part(k, len(flown))).ends[0]
            flown[(k + 1) % len(flown), own:] = end[own:]
        found = _repeating(search.map, flown, rows)
    return states if found is None else found


@np.errstate(all="ignore")  # a flight may break
def _repeating(flight: FlightMap, states: Array, rows: PrescribedRows) -> Array | None:
    """States whose air repeats around the others, by Newton's method; None where it breaks."""
    own, found = slice(flight.moving, None), states.copy()
    for _ in range(_NEWTON):
        flown = flight.fly(found, rows)
        slopes = flown.by_state[:, own, own]
        rest = flown.ends[:, own] - np.einsum("kij,kj->ki", slopes, found[:, own])
        through, end = np.eye(rest.shape[1]), np.zeros(rest.shape[1])
        for slope, more in zip(slopes, rest, strict=True):
            through, end = slope @ through, slope @ end + more
        if not np.isfinite(through).all():
            return None
        now, former = np.linalg.lstsq(np.eye(len(end)) - through, end)[0], found[:, own].copy()
        for k, (slope, more) in enumerate(zip(slopes, rest, strict=True)):
            found[k, own], now = now, slope @ now + more
        if np.abs(found[:, own] - former).max() < _SETTLED:
            break
    return found


def _searched(
    search: OrbitSearch, states: Array, wanted: Conditions, turn: float
) -> tuple[Point, str]:
    """Orbit from a guess with a turn rate, at once or in parts, and what stood in the way."""
    values = search.family.neutral
    at, trouble = search.within(search.point(states, values, wanted), wanted)
    loose = Conditions(turn)
    if not trouble or wanted == loose:
        return at, trouble
    stuck, search.still[:] = search.still.copy(), True  # the gait's own free flight
    begin, failed = search.newton(search.point(states, values, loose), loose)
    search.still[:] = stuck if failed else False
    if failed:
        return at, trouble
    held = search.still.copy()
    x, _, z = search.frame.neutral[:3]
    away = begin.flown.ends[-1] / begin.period
    done, part = 0.0, 0.25
    while done < 1.0 and part >= 1.0 / 64:
        share = min(1.0, done + part)
        now = Conditions(
            turn + share * (wanted.turn_rate - turn),
            None if wanted.climb is None else away[z] + share * (wanted.climb - away[z]),
            None if wanted.speed is None else away[x] + share * (wanted.speed - away[x]),
        )
        search.still[:] = held
        at, trouble = search.within(search.point(begin.states, begin.values, now), now)
        if trouble:
            part /= 2
        else:
            held, begin, done, part = search.still.copy(), at, share, 2 * part
    return at, trouble


def orbit_of(search: OrbitSearch, at: Point) -> Orbit:
    """Orbit of a point whose misfits are rounding."""
    x, y, z, *yaw = search.frame.neutral
    end, period = at.flown.ends[-1], at.period
    turned = float(end[yaw].sum())
    forward = _along_arc(turned) @ end[[x, y]]
    flight = search.map
    return Orbit(
        flight.robot, flight.aero, flight.added_mass, search.family, at.values, at.states,
        at.flown, flight.names, search.steps, float(forward / period), float(end[z] / period),
        turned / period, at.residual, search.iterations,
    )  # fmt: skip


NEARBY = (
    "ask for another speed or climb, free other parameters, begin from another gait (cruise in the "
    "robot's file), or follow orbits from one that is found (trim --along, continue_orbit)"
)
_COMPONENTS = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")


def _not_found(search: OrbitSearch, at: Point, trouble: str) -> NoOrbit:
    """Failure of a search in words: a limit, authority that lacks, or a stall.

    At a limit the wrench that lacks is that of the whole misfit, else of its weakest direction.
    """
    lacking: dict[str, float] = {}
    reason, remedy = f"Newton's method stalled at a misfit of {at.residual:.2g}", NEARBY
    if trouble != "stalled":
        passive = trouble.partition(" ")[0] in search.map.names
        reason, remedy = trouble, f"{'stiffen its spring, ' * passive}widen that limit, {remedy}"
    pitch = at.states[:, [name == "pitch" for name in search.map.names]]
    steep = np.abs(pitch).max(initial=0.0)
    if trouble == "stalled" and steep > STEEPEST - 0.1:
        reason += f"; pitch came to {np.degrees(steep):.0f} degrees from level, and Euler angles "
        reason += "are singular at 90"
        remedy = f"let it fly flatter: {NEARBY}"
    elif not np.isfinite(at.residual) and search.map.robot.stiffness:
        needed = stable_steps(search, at.values, at.states) or 2 * search.steps
        remedy = "take springs of less stiffness and damping, or in Python the time steps that "
        remedy += f"they ask for: steps={needed}, of {MOST_STEPS} at most"
    elif not np.isfinite(at.residual):
        remedy = "begin nearer to a flight that goes on: another gait (cruise in the robot's file)"
    if at.residual > TOLERANCE and np.isfinite((system := search.system(at))[0]).all():
        left, sizes, _ = np.linalg.svd(system[0])
        asked = left.T @ system[1]
        least = np.r_[np.maximum(sizes, _RANK), np.full(len(asked), _RANK)]
        worst = int(np.argmax(np.abs(asked) / least[: len(asked)]))
        weakest = left[:, worst] * asked[worst]
        wrench = _mean_wrench(search, at, weakest if trouble == "stalled" else system[1])
        weights = {name: abs(value) * _LEVER[name[0]] for name, value in wrench.items()}
        most, robot = max(weights, key=weights.__getitem__), search.map.robot
        if abs(wrench[most]) < _CREDIBLE * robot.mass * robot.scale_gravity:
            lacking = wrench
            told = [
                f"{wrench[name]:.2g} {'N m' if name.startswith('moment') else 'N'} of {name}"
                for name, weight in weights.items()
                if weight >= 0.5 * weights[most]
            ]
            reason += f"; what the free parameters hardly reach is {', '.join(told)}"
            if most in ("force_y", "moment_x", "moment_z"):
                either = "if left and right differ, free a command that differs between them or add"
                remedy = f"{either} a fin; else {remedy}"
    nearest = dict(zip(search.family.names, map(float, at.values), strict=True))
    return NoOrbit(reason, remedy, lacking, at.residual, search.iterations, nearest)


_CREDIBLE = 100.0  # force over weight beyond which derivatives overflowed
_LEVER = {"f": 0.1, "m": 1.0}  # m, length by which a force and a moment are compared


def _mean_wrench(search: OrbitSearch, at: Point, left: Array) -> dict[str, float]:
    """Mean force [N] and moment [N m] along x, y, z that would make scaled changes in a beat."""
    robot, names = search.map.robot, search.map.names
    misfit = left * at.scales[1]
    axes = [name for name in FLOATING_COORDINATES if name in names]
    change = dict.fromkeys(axes, 0.0)
    others = [name for name in ("yaw", "z", "x") if name in axes]
    for name, value in zip([*search.frame.names, *others], misfit, strict=False):
        place = name.removeprefix("velocity of ")
        if place in axes:
            change[place] += value / at.period if name == place else value
    q, places = robot.coordinates(), [robot.index(name) for name in axes]
    q[places] = at.states[0][[names.index(name) for name in axes]]
    mass = np.array(ca.DM(mass_matrix(robot, ca.SX(q))))[np.ix_(places, places)]
    wrench = dict(zip(axes, mass @ np.array([*change.values()]) / at.period, strict=True))
    words = zip(_COMPONENTS, FLOATING_COORDINATES, strict=True)
    return {name: float(wrench[axis]) for name, axis in words if axis in axes}
