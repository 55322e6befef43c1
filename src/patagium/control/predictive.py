"""Nonlinear model predictive control by real-time iteration.

Multiple shooting over N intervals of time: states and inputs of all are unknowns, a model gives the
ends of the intervals and their derivatives at the last prediction, and each sample of the state
takes one quadratic program (`quadratic_program`), the prediction before shifted by an interval as
its warm start. Ranges and rates of inputs are hard limits, limits of states soft. Repeated at one
sample it converges to the minimum of the nonlinear problem, quadratic costs being their own
Gauss-Newton approximation. Neglected: errors of the model, but for the feedback.

References:
    Diehl, Bock & Schloder (2005), A real-time iteration scheme for nonlinear optimization in
    optimal feedback control.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import reduce
from types import MappingProxyType
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from patagium.arguments import checked
from patagium.arrays import Array
from patagium.control.course import Course
from patagium.control.gait_family import fourier_series, gait_family
from patagium.control.orbit import check_attitude
from patagium.control.quadratic_program import ProgramStatus, QuadraticProgram
from patagium.control.wingbeat import FlightMap, PrescribedRows
from patagium.errors import ParameterError, ShapeError, check_names, positive
from patagium.robot import Robot
from patagium.simulation.gait_models import Gait
from patagium.simulation.mounts import Mount
from patagium.simulation.simulator import FlightState
from patagium.simulation.steered_gait import Responses, SteeredGait


@dataclass(frozen=True)
class Intervals:
    """Intervals of time as a model sees them: ends and their derivatives.

    Attributes:
        ends: State at the end of each, (N, n) [SI].
        by_state: Derivative by the state at its beginning, (N, n, n) [SI].
        by_input: Derivative by the input, (N, n, n_u) [SI].
        phase: Number by which the same derivatives come again; None where they do not.
    """

    ends: Array
    by_state: Array
    by_input: Array
    phase: int | None = None


Predict = Callable[[int, Array, Array], Intervals]
"""Function from the number of the first interval, states at the beginning of each, (N, n), and
inputs, (N, n_u), to the intervals."""


class RealTimeIteration:
    """Optimal control problem over N intervals that is warm-started from its last solution.

    min sum_k |x_k - x_ref|^2_Q + |u_k - u_ref|^2_R + |x_N - x_ref|^2_P, halved, with the limits of
    `program`, which the caller fills: `lower`, `upper`, `fall`, `rise`, `least`, `most`, `weight`.

    Args:
        predict: The model.
        horizon: Number of intervals N.
        state_cost: Q, (n, n) [1/SI^2].
        input_cost: R, (n_u, n_u) [1/SI^2].

    Raises:
        ShapeError: If a cost is no square matrix.
        ParameterError: If the horizon is below one.

    Attributes:
        program: Quadratic program of the last iteration.
        states: Prediction, (N + 1, n) [SI].
        inputs: Inputs that lead there, (N, n_u) [SI].
        final_cost: P, (n, n) [1/SI^2]; Q to begin with.
        state_reference: x_ref, (N + 1, n) [SI]; zero to begin with.
        input_reference: u_ref, (N, n_u) [SI]; zero to begin with.
        inverses: `QuadraticProgram.inverse` by phase, where derivatives come again; to be cleared
            where they or the costs become others.
    """

    @checked
    def __init__(
        self, predict: Predict, horizon: int, state_cost: Array, input_cost: Array
    ) -> None:
        if horizon < 1:
            raise ParameterError("horizon", "one interval at least", horizon)
        for name, cost in {"state_cost": state_cost, "input_cost": input_cost}.items():
            if cost.ndim != 2 or np.ptp(cost.shape):
                raise ShapeError(name, "(n, n)", cost.shape)
        size, count = len(state_cost), len(input_cost)
        self.predict = predict
        self.program = QuadraticProgram(horizon, size, count)
        self.states, self.inputs = np.zeros((horizon + 1, size)), np.zeros((horizon, count))
        self.state_reference, self.input_reference = 0 * self.states, 0 * self.inputs
        self.final_cost = state_cost.copy()
        self.inverses: dict[int, Array] = {}
        self.program["Q"][...], self.program["R"][...] = state_cost, input_cost

    @property
    def cost(self) -> float:
        """Cost of the last solution, its soft limits included."""
        program, wanted = self.program, {"Q": self.state_reference, "R": self.input_reference}
        constant = sum(np.einsum("ki,kij,kj", x, program[cost], x) for cost, x in wanted.items())
        return float(program["cost"] + constant / 2)

    def iterate(self, first: int, start: Array, before: Array) -> ProgramStatus:
        """One iteration: the model at the last prediction, then one quadratic program.

        Args:
            first: Number of the first interval.
            start: State now, (n,) [SI].
            before: Input of the interval before, (n_u,) [SI].

        Returns:
            Status; the prediction is renewed only where it is SOLVED.
        """
        program = self.program
        found = self.predict(first, self.states[:-1], self.inputs)
        program["A"][...], program["B"][...] = found.by_state, found.by_input
        moved = np.einsum("kij,kj->ki", found.by_state, self.states[:-1])
        moved += np.einsum("kij,kj->ki", found.by_input, self.inputs)
        program["c"][...] = found.ends - moved
        program["Q"][-1] = self.final_cost
        program["q"][...] = -np.einsum("kij,kj->ki", program["Q"], self.state_reference)
        program["r"][...] = -np.einsum("kij,kj->ki", program["R"], self.input_reference)
        program["start"][...], program["before"][...] = start, before
        phase, inverses = found.phase, self.inverses
        if phase is not None and phase not in inverses and not program["weight"].any():
            inverses[phase] = program.inverse()
        status = program.solve(None if phase is None else inverses.get(phase))
        if status is ProgramStatus.SOLVED:
            self.states, self.inputs = program["x"].copy(), program["u"].copy()
        return status

    def shift(self) -> None:
        """Go on by one interval: what was predicted next is predicted now."""
        arrays = [self.program[k] for k in ("u", "range_force", "change_force", "x")]
        for array in (self.states, self.inputs, *arrays):
            array[:-1] = array[1:]


@runtime_checkable
class Reference(Protocol):
    """Protocol of a periodic orbit that a controller follows."""

    @property
    def map(self) -> FlightMap:
        """Map of the flight, with its derivatives."""

    @property
    def gait(self) -> Gait:
        """Gait of the orbit."""

    @property
    def steps(self) -> int:
        """Time steps of a beat."""

    @property
    def states(self) -> Array:
        """States of the orbit, the first at the beginning of a beat, (m, n) [SI]."""


def lagged(sharpness: float, time: Array, integrated: bool) -> tuple[Array, Array]:
    """Response of three equal lags after some times, s(t) = E s(0) + F u.

    Args:
        sharpness: k of each lag [1/s].
        time: The times t, (m,) [s].
        integrated: Whether s begins with the integral of the response, before its value and
            first two rates.

    Returns:
        E, (m, 3 or 4, 3 or 4), and F, (m, 3 or 4).
    """
    *state, target = np.eye(4)
    responses = Responses.from_state(np.array(state), target, 0 * target, 0 * target + sharpness)
    found = np.stack(responses.at(time[:, None]), axis=1)
    if integrated:
        whole = np.stack([responses.integral(time, k) for k in range(4)], axis=1)
        own = np.broadcast_to(np.eye(4)[:, :1], (len(time), 4, 1))
        found = np.concatenate([own, np.concatenate([whole[:, None], found], axis=1)], axis=2)
    return found[:, :, :-1], found[:, :, -1]


class OrbitModel:
    """Flight near a periodic orbit, its commands as they are answered: linear, periodic in time.

    The state is the departure of [passive coordinates, x in hover alone, velocities, lag states of
    the air] from the orbit, then of each command the departure of value, rate and second rate, of
    the frequency before them that of the gait's own time [s]. The input is the departure of the
    commands, in the units of `SteeredGait`'s responses. Derivatives are exact (`FlightMap`) at
    every phase, and seen as `Course` sees departures. Neglected: second order in departures, rate
    limits inside an interval; the way along the course, on which nothing depends.

    Args:
        orbit: The orbit.
        commands: Names of the commands, as `SteeredGait` takes them.
        parts: Intervals of a beat.
        steered: Gait that is flown and that the orbit's is reached from by `parameters`; by
            default one that begins as the orbit's.
        parameters: Values of the commands on the orbit, where the steered gait's own are others.
        kept: Places of the states; by default all in hover, and all but x otherwise.

    Raises:
        ParameterError: If a command is none of the gait, its joints answer it at different
            speeds, or the orbit is none.

    Attributes:
        neutral: Response to the commands on the orbit, (n_u,) [unit of a response].
        period: Length of an interval [s].
        pace: Rate of the gait's own time on the orbit; 1 where its frequency is the gait's own.
        begun: Number of the interval from which it is followed, and when that begins [s].
        course: Where the orbit is at the beginning of each interval.
        lags: Places of the lag states of the air, which nothing measures.
        by_state: Derivative of each interval of a beat by its state, (parts, n_x, n_x).
        by_input: Derivative by the commands, (parts, n_x, n_u).
    """

    def __init__(
        self,
        orbit: Reference,
        commands: Sequence[str],
        parts: int = 10,
        steered: SteeredGait | None = None,
        parameters: Mapping[str, float] = MappingProxyType({}),
        kept: NDArray[np.intp] | None = None,
    ) -> None:
        flight = orbit.map
        robot = flight.robot
        if not 1 <= parts <= orbit.steps:
            raise ParameterError("parts", f"from 1 to the orbit's {orbit.steps} steps", parts)
        if len(commands) == 0:
            raise ParameterError("commands", "one of the robot's at least", commands)
        self.orbit, self.robot, self.commands, self.parts = orbit, robot, tuple(commands), parts
        self.names = flight.names
        self.steered = SteeredGait(robot, orbit.gait) if steered is None else steered
        places = {name: self.steered.places(name) for name in commands}
        every = [place for name in commands for place in places[name]]
        if len(set(every)) < len(every):
            expected = "each once, and not a pair beside one of its joints"
            raise ParameterError("commands", expected, tuple(commands))
        self.places = [first for first, *_ in places.values()]
        for name, own in places.items():
            if np.ptp(self.steered.sharpness[own]):
                expected = "joints that answer equally fast to one; name a command of each"
                raise ParameterError("commands", expected, f"{name!r}, whose joints do not")
        self.period = positive("period of the gait", self.steered.gait.period or 0.0) / parts
        self.chains = [4 if name == "frequency" else 3 for name in commands]
        rows = self._rows(flight, parts * -(-orbit.steps // parts), parameters)
        self.pace, self.begun = 1.0, (0, 0.0)
        if "frequency" in parameters:
            self.pace = float(self.neutral[self.commands.index("frequency")])
            self.period /= self.pace
        n, end = flight.size, flight.size + sum(self.chains)
        states, slopes = [orbit.states[0]], []
        for part in range(parts):
            after, found = self._fly(flight, states[-1], rows.part(part, parts))
            states.append(after)
            slopes.append(found)
        self.course = Course(self.names, np.array(states))
        for part, found in enumerate(slopes):
            found[:n] = self.course.after(part, found[:n])
        if kept is None:
            kept = np.flatnonzero(self.course.stands | (np.array(self.names) != "x"))
        self.kept: NDArray[np.intp] = kept
        known = np.r_[self.kept, n:end]
        self.lags = np.flatnonzero(np.isin(self.names, flight.aero.state_names)[self.kept])
        self.size, whole = len(known), np.array(slopes)[:, known]
        self.by_state, self.by_input = whole[:, :, known], whole[:, :, end:].copy()

    def _rows(
        self, flight: FlightMap, steps: int, parameters: Mapping[str, float]
    ) -> PrescribedRows:
        """Rows of a beat and their slopes by each command; "frequency" moves the gait in time."""
        robot, gait = self.robot, self.steered.gait
        base = fourier_series(gait)
        leads = [f"{name}_phase" for name in base.moving]
        family = gait_family(robot, gait, tuple(dict.fromkeys([*leads, *self.commands])))
        values = family.neutral.copy()
        self.neutral = self.steered.neutral[self.places]
        for name, value in parameters.items():
            place = family.names.index(name)
            scale = self.steered.scale(name)
            self.neutral[self.commands.index(name)] += scale * (value - values[place])
            values[place] = value
        found = family.rows(values, steps, flight.aero.air)
        slopes = []
        for name in self.commands:
            moved = leads if name == "frequency" else [name]
            slope = found.slopes[:, [*map(family.names.index, moved)]].sum(axis=1)
            if name == "frequency" or name.endswith("_phase"):  # in the gait's own time
                slope = slope * 2 * np.pi * base.frequency
            slopes.append(slope)
        return PrescribedRows(found.table, np.stack(slopes, 1), found.time_step, np.zeros(0))

    def _fly(self, flight: FlightMap, begin: Array, rows: PrescribedRows) -> tuple[Array, Array]:
        """End of an interval of the beat, and derivatives of state and lags by both and inputs."""
        given = rows.slopes.reshape(len(rows.table), len(self.commands), 3, -1)
        times: Array = 0.5 * rows.time_step * np.arange(float(len(rows.table)))
        n, firsts = flight.size, np.cumsum([flight.size, *self.chains])
        end, count = firsts[-1], len(self.commands)
        matrix, slopes, forced = np.zeros((end, end + count)), [], []
        for i, (first, size) in enumerate(zip(firsts, self.chains, strict=False)):
            sharpness = float(self.steered.sharpness[self.places[i]])
            free, answer = lagged(sharpness, times, size == 4)
            ways = np.concatenate([free, answer[:, :, None]], axis=2)[:, :3].transpose(1, 0, 2)
            value, rate, bend = ways[..., None]
            shape, moved, bent = given[:, i].transpose(1, 0, 2)[:, :, None]
            motion = [
                shape * value,
                moved * value + shape * rate,
                bent * value + 2 * moved * rate + shape * bend,
            ]
            both = np.concatenate(motion, axis=2)
            slopes.append(both[:, :size])
            forced.append(both[:, size:])
            own = slice(first, first + size)
            matrix[own, own], matrix[own, end + i] = free[-1], answer[-1]
        whole, none = np.concatenate([*slopes, *forced], axis=1), np.zeros(end - n + count)
        task = PrescribedRows(rows.table, whole, rows.time_step, none)
        found = flight.fly(begin[None], task)
        matrix[:n] = np.hstack([found.by_state[0], found.by_parameter[0]])
        return found.ends[0], matrix

    def departure(self, first: int, state: Array, time: float) -> Array:
        """Departure of the flight from the orbit, (n_x,).

        Args:
            first: Number of the interval that begins now.
            state: State of the flight, (n,) [SI].
            time: The time, for what the gait answered so far [s].
        """
        parts = [self.course.apart(first, state)[self.kept]]
        own, responses = self.steered.responses_at(time)
        for place, neutral, size in zip(self.places, self.neutral, self.chains, strict=True):
            if size == 4:
                parts.append(np.array([own - self.pace * (time - self.time(0))]))
            parts.append(responses[:, place] - np.array([neutral, 0.0, 0.0]))
        return np.concatenate(parts)

    def number(self, time: float) -> int:
        """Number of the interval that begins next to a time [s]."""
        first, begun = self.begun
        return first + round((time - begun) / self.period)

    def time(self, first: int) -> float:
        """Time at which an interval begins, by its number [s]."""
        return self.begun[1] + (first - self.begun[0]) * self.period

    def flies(self, gait: Gait) -> bool:
        """Whether a gait moves the joints as the steered one does uncommanded."""
        times = np.arange(16) / 16 * self.parts * self.period
        own, other = (one.motion(times).position for one in (self.steered.gait, gait))
        return own.shape == other.shape and bool(np.abs(own - other).max() <= NEAR)

    def predict(self, first: int, states: Array, inputs: Array) -> Intervals:
        """Intervals of the linear model, of departures as states and inputs; see `Predict`."""
        places = (first + np.arange(len(states))) % self.parts
        by_state, by_input = self.by_state[places], self.by_input[places]
        ends = np.einsum("kij,kj->ki", by_state, states)
        ends += np.einsum("kij,kj->ki", by_input, inputs)
        return Intervals(ends, by_state, by_input, first % self.parts)


@np.errstate(all="ignore")
def periodic_riccati(
    by_state: Array, by_input: Array, state_cost: Array, input_cost: Array
) -> tuple[Array, Array]:
    """Least cost without limits from each phase on, and the gains that reach it.

    Beats ahead double until the gains settle (Chu, Fan, Lin & Wang 2004, structure-preserving
    algorithms for periodic discrete-time algebraic Riccati equations). Where nothing that the
    inputs move is left to a neutral state, its cost grows without end, and gains converge.

    Args:
        by_state: Derivative of each interval of a beat by its state, A, (parts, n_x, n_x).
        by_input: Derivative by the inputs, B, (parts, n_x, n_u).
        state_cost: Q, (n_x, n_x) [1/SI^2].
        input_cost: R, (n_u, n_u) [1/unit^2].

    Returns:
        P at the beginning of each interval, (parts, n_x, n_x), and K of u = -K x,
        (parts, n_u, n_x).

    Raises:
        ParameterError: If the gains do not settle, or a departure grows under them.
    """
    each = zip(by_state, by_input, strict=True)
    ahead = reduce(_joined, [_interval(a, b, state_cost, input_cost) for a, b in each])
    costs, least = np.zeros_like(by_state), np.inf  # least: of the largest multipliers
    gains = np.full_like(by_input.transpose(0, 2, 1), np.inf)
    for _ in range(_DOUBLINGS):
        before, cost = gains.copy(), state_cost + ahead[2]
        for part in reversed(range(len(by_state))):
            a, b = by_state[part], by_input[part]
            gains[part] = np.linalg.solve(input_cost + b.T @ cost @ b, b.T @ cost @ a)
            cost = state_cost + a.T @ cost @ (a - b @ gains[part])
            cost = costs[part] = 0.5 * (cost + cost.T)
        if not np.abs(costs).max() < _HELD * np.abs(state_cost).max():
            break
        grows = np.abs(np.linalg.eigvals(closed_beat(by_state, by_input, gains))).max()
        settled = np.abs(gains - before).max() <= _SETTLED_GAINS * np.abs(gains).max()
        if settled and grows <= GROWS:
            return costs, gains
        ahead, least = _joined(ahead, ahead), min(least, grows)
    expected = "commands that can hold the orbit (add those that move the mode that grows)"
    found = f"a multiplier of {least:.4g} remains"
    if least <= GROWS:
        expected = "commands and tolerable departures whose gains settle"
        found = f"gains that change after {2**_DOUBLINGS} beats"
    raise ParameterError("commands", expected, found)


def _interval(a: Array, b: Array, state_cost: Array, input_cost: Array) -> tuple[Array, ...]:
    """Transition, reach of the inputs and cost of an interval whose end costs, (n_x, n_x) each."""
    reach = b @ np.linalg.solve(input_cost + b.T @ state_cost @ b, b.T)
    moved = a - reach @ state_cost @ a
    return moved, reach, a.T @ state_cost @ moved


def _joined(first: tuple[Array, ...], then: tuple[Array, ...]) -> tuple[Array, ...]:
    """Transition, reach and cost of two parts of the time, one after the other."""
    (a, reach, cost), (later, reach_then, cost_then) = first, then
    way = np.linalg.inv(np.eye(len(a)) + reach @ cost_then)
    reach = reach_then + later @ way @ reach @ later.T
    cost = cost + a.T @ cost_then @ way @ a
    return later @ way @ a, 0.5 * (reach + reach.T), 0.5 * (cost + cost.T)


def closed_beat(by_state: Array, by_input: Array, gains: Array) -> Array:
    """State transition matrix of one beat under feedback with gains K, (n_x, n_x)."""
    return reduce(lambda first, then: then @ first, by_state - by_input @ gains)


_DOUBLINGS, _SETTLED_GAINS = 20, 1e-9
_AT_END, _OFTEN = 1e-6, 0.1  # of half a range, and the share of the answers that is told
_HELD = 1e12  # a cost over the largest of Q; beyond, only rounding moves a mode
NEAR = 1e-3
"""Difference of joints below which two gaits are one; less than that of a table [rad, m]."""
UNEVEN = 0.1
"""Share of its period by which a controller may be called early or late."""
GROWS = 1.001
"""Multiplier from which a departure grows; a neutral one that is double is 1 + sqrt(rounding)."""
TOLERABLE = {"z": 0.1, "yaw": 0.1, "roll": 0.1, "pitch": 0.1}
"""Departures that cost as much as a command over half its range, where none are given [m, rad]."""
TOLERABLE_SPEED, TOLERABLE_TURN = 0.3, 2.0
"""The same of velocities [m/s] and of rates of turn [rad/s]."""
SOFT = 100.0
"""Weight of a soft limit over that of the state's departure."""


class OrbitController:
    """Controller that flies along a periodic orbit, but for its law.

    A sample that is missing, late, or not finite, and an answer that is none, leave the last
    command in force; `held` counts them by their cause. A time before the last one begins another
    flight, and the controller starts anew. Called at another period than its own, it warns.
    Arguments are those of its laws.

    Raises:
        ParameterError: If a name is none, a command has no range, or the commands cannot hold
            the orbit.

    Attributes:
        low: Least value of each command's response, (n_u,) [response's unit].
        high: Greatest, (n_u,) [response's unit].
        half: Half the range, (n_u,) [response's unit].
        rates: Fastest change, (n_u,) [response's unit over s].
        costs: Least cost to go without limits from each phase on, (parts, n, n).
        gains: Feedback gain of each interval of a beat that gives it, (parts, n_u, n)
            [unit over SI].
        held: Number of samples at which the last command was held, by cause.
        limited: Number of answers in which a command stood at an end of its range, by command.
        called: Time of the last call [s]; -inf before the first.
    """

    def __init__(
        self,
        orbit: Reference,
        commands: Sequence[str],
        parts: int,
        tolerable: Mapping[str, float] | None,
    ) -> None:
        self.model = model = OrbitModel(orbit, commands, parts)
        self.weights = self._weights(tolerable or {})
        self.ends = [model.steered.limits(name) for name in commands]
        for name, (low, high, _) in zip(commands, self.ends, strict=True):
            if not np.isfinite(high - low):
                raise ParameterError(f"actuators.{name}", "a range of every command", "none")
        self.low, self.high, self.rates = np.array(self.ends).T
        self.half = (self.high - self.low) / 2
        costs = [model.steered.costs[model.steered.places(name)].max() for name in commands]
        self.state_cost = np.diag(self.weights)
        self.input_cost = np.diag(costs / self.half**2)
        self.before, self._followed = np.zeros(len(commands)), False
        self.costs, self.gains = self._law(model)
        self.gains[..., model.lags] = 0.0
        if (grows := np.abs(self.multipliers).max()) > GROWS:
            said = f"{type(self).__name__}: departures grow {grows:.3g} times a beat"
            warnings.warn(f"{said}; tolerate larger ones or take gains of each part", stacklevel=4)
        self.held, self.limited, self._answers = Counter[str](), Counter[str](), 0
        self.called = self._due = -np.inf

    def __repr__(self) -> str:
        commands = ", ".join(self.model.commands)
        name = f"{type(self).__name__} of {self.model.robot.name}"
        return f"<{name}: {commands} each {self.period:.3g} s>"

    def restart(self) -> None:
        """Start anew, as at the beginning of a flight.

        Raises:
            ParameterError: If another orbit was learned, on which no flight begins.
        """
        if self._followed:
            expected = "a new one for each flight in which it learns"
            found = "one that has learned another orbit in the flight before"
            raise ParameterError("controller", expected, found)
        self.model = model = copy(self.model)
        model.steered = SteeredGait(model.robot, model.steered.gait)
        model.course = copy(model.course)
        model.course.lead = 0.0
        self.before, self.called = np.zeros(len(self.ends)), -np.inf
        self.held, self.limited, self._answers = Counter(), Counter(), 0

    def begins(self, time: float) -> bool:
        """Whether a call at a time [s] begins another flight than that of the last call."""
        return time < self.called or time == self.called == 0

    def check_flight(self, robot: Robot, gait: Gait, mount: Mount) -> None:
        """Refuse a flight of another robot or gait than the controller's orbit has, or a held one.

        Raises:
            ParameterError: If coordinates or gaits are others, or a mount holds the body.
        """
        check_attitude(robot)
        if robot.floating and mount.kind != "free":
            raise ParameterError("mount", "free, as on the controller's orbit", mount.kind)
        known, own = self.model.robot, self.model.steered.gait
        if robot.dof_names != known.dof_names:
            raise ParameterError("controller", f"one made for {robot.name}", known.name)
        if not self.model.flies(gait):
            expected = "one made for the orbit whose gait is flown"
            raise ParameterError("controller", expected, own.describe())

    def _law(self, model: OrbitModel) -> tuple[Array, Array]:
        """Costs to go and gains of a model whose states are all known."""
        return periodic_riccati(*self._loop(model), self.state_cost, self.input_cost)

    def _loop(self, model: OrbitModel) -> tuple[Array, Array]:
        """Derivatives of each interval by the states that are fed back, and by what they move."""
        return model.by_state, model.by_input

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Floquet multipliers of the flown loop, but for limits of its commands, (n,) [1]."""
        return np.linalg.eigvals(closed_beat(*self._loop(self.model), self.gains)).astype(complex)

    def follow(self, orbit: Reference, parameters: Mapping[str, float], first: int) -> None:
        """Follow another orbit from an interval on.

        Its mean position and heading go on from those of the orbit before, and so does the phase;
        an interval is a part of its beat, so that `period` changes with its frequency.

        Args:
            orbit: The orbit, and the model of robot and air that it was found with.
            parameters: Values of the commands on it.
            first: Number of the interval.

        Raises:
            ParameterError: If it is no orbit, the commands cannot hold it, or it is nowhere within
                soft limits; the one before is followed on then.
        """
        last = self.model
        beat = range(first, first + last.parts)
        model = OrbitModel(orbit, last.commands, last.parts, last.steered, parameters, last.kept)
        course, model.begun = model.course, (first, last.time(first))
        former, own = (np.mean([one.along(k) for k in beat], axis=0)
                       for one in (last.course, course))  # fmt: skip
        if course.yaw is not None:
            course.heading = float(former[course.yaw] - own[course.yaw])
            own = np.mean([course.along(k) for k in beat], axis=0)
        course.origin = (former - own)[course.places]
        costs, gains = self._law(model)
        gains[..., model.lags] = 0.0
        self._followed = True
        self.before = self.before + last.neutral - model.neutral
        self.model, self.costs, self.gains = model, costs, gains

    @property
    def period(self) -> float:
        """Length of an interval: the `control_period` of a flight [s]."""
        return self.model.period

    @property
    def fastest(self) -> Array:
        """Largest change of each command in an interval, (n_u,) [response's unit]."""
        return np.asarray(self.rates * self.model.period)

    def answer(self, first: int, start: Array, before: Array) -> Array | None:
        """Departures of the commands for the interval that begins now, (n_u,) [response's unit].

        Args:
            first: Number of the interval.
            start: Departure of the flight from the orbit, (n_x,) [SI].
            before: Departures of the commands in force, (n_u,) [response's unit].

        Returns:
            The departures; None where there is no answer.
        """
        raise NotImplementedError

    @checked
    def __call__(self, time: float, state: FlightState | None) -> dict[str, float]:
        """Commands for the interval that begins now.

        Args:
            time: Now, since the beginning of the orbit's first beat [s].
            state: State of the flight now, or None where no sample came.

        Returns:
            Commands by name; none where the last ones are held.

        Raises:
            ParameterError: If it cannot start anew (`restart`).
        """
        last, due = self.called, self._due
        if self.begins(time):
            self.restart()
        elif last >= 0 and abs(time - due) > UNEVEN * self.period:
            said = f"{type(self).__name__}: called after {time - last:.4g} s, not its period of"
            wanted = f"{due - last:.4g} s (control_period of a flight)"
            warnings.warn(f"{said} {wanted}", stacklevel=3)
        self.called, self._due = time, time + self.period
        model, period = self.model, self.period
        if state is None:
            return self._hold("missing")
        if not abs(time - state.time) <= 0.5 * period:
            return self._hold("late")
        first = model.number(time)
        measured = self.measured(state, first)
        model.course.catch_up(first, measured)
        start = model.departure(first, measured, time)
        if not np.isfinite(start).all():
            return self._hold("not finite")
        inputs = self.answer(first, start, self.before)
        if inputs is None:
            return self._hold("not solved")
        values = np.clip(inputs + model.neutral, self.low, self.high)  # a program's, to rounding
        self.before = values - model.neutral
        room = np.minimum(values - self.low, self.high - values) / self.half
        self._answers += 1
        self.limited.update(np.array(model.commands)[room < _AT_END].tolist())
        given = {
            name: float(value / model.steered.scale(name))
            for name, value in zip(model.commands, values, strict=True)
        }
        model.steered.command(time, given)
        model.steered.forget(time - 2 * model.parts * period)  # who learns looks back one beat
        return given

    def _hold(self, cause: str) -> dict[str, float]:
        self.held[cause] += 1
        return {}

    def report(self) -> str:
        """Sentences about samples at which the last command was held, and commands at a limit."""
        told = "Every sample was answered."
        if self.held:
            causes = ", ".join(f"{count} {cause}" for cause, count in sorted(self.held.items()))
            told = f"The last command was held at {self.held.total()} samples: {causes}."
        shares = {name: count / self._answers for name, count in self.limited.most_common()}
        often = [f"{name} in {share:.0%}" for name, share in shares.items() if share >= _OFTEN]
        if often:
            told += f" At an end of its range: {', '.join(often)} of the answers."
        return told

    def _state(self, name: str) -> int:
        names = [self.model.names[k] for k in self.model.kept]
        check_names("state", [name], names)
        return names.index(name)

    def _weights(self, tolerable: Mapping[str, float]) -> Array:
        """Weights of the departures, those of lags and commands zero, (n_x,)."""
        weights = np.zeros(self.model.size)
        given = {name: one for name, one in TOLERABLE.items() if name in self.model.names}
        for name in self.model.names:
            turning = name.rpartition(" ")[2] in ("roll", "pitch", "yaw")
            if name.startswith("velocity of "):
                given[name] = TOLERABLE_TURN if turning else TOLERABLE_SPEED
        for name, value in (given | dict(tolerable)).items():
            weights[self._state(name)] = positive(name, value) ** -2.0
        return weights

    def measured(self, state: FlightState, first: int) -> Array:
        """State of the model, its unmeasured lags as on the orbit at an interval, (n,) [SI]."""
        found = self.model.course.along(first)
        for k, name in enumerate(self.model.names):
            moving = name.removeprefix("velocity of ")
            if moving in self.model.robot.dof_names:
                found[k] = (state.position if moving == name else state.velocity)(moving)
        return found


class OuterController:
    """Controller around one along an orbit, whose orbit it changes in flight.

    Attributes:
        controller: The controller along the orbit.
    """

    controller: OrbitController

    @property
    def held(self) -> Counter[str]:
        """Number of samples at which the last command was held, by cause."""
        return self.controller.held

    @property
    def model(self) -> OrbitModel:
        """Model of the orbit that is followed."""
        return self.controller.model

    @property
    def period(self) -> float:
        """Length of an interval: the `control_period` of a flight [s]."""
        return self.controller.period

    def check_flight(self, robot: Robot, gait: Gait, mount: Mount) -> None:
        """Refuse a flight of another robot or gait, or one that is held; see `OrbitController`."""
        self.controller.check_flight(robot, gait, mount)


class PredictiveController(OrbitController):
    """Model predictive controller that flies along a periodic orbit.

    Args:
        orbit: The orbit, and the model of robot and air that it was found with.
        commands: Names of the commands, with a range each in the robot's `actuators`.
        horizon: Number of intervals. An answer in the first beat takes a time that goes with its
            cube (of four commands: 4 ms at 20, 3 s at 200), later 1 ms at 20 and 5 ms at 200.
        parts: Intervals of a beat; one command each.
        tolerable: Departures by name of a state, such as `z` or `velocity of x`, that cost as much
            as a command over half its range [SI]; by default .1 m, .1 rad, .3 m/s and
            2 rad/s, which are for robots of about a meter: other sizes need their own.
        limits: Soft limits by name of a state, least and most [SI]; None where there is none. Of
            horizontal velocities along and across the heading of the orbit, of y from its line (in
            hover of x and y from its place).

    Raises:
        ParameterError: If a name is none, a command has no range, the commands cannot hold
            the orbit, or it is nowhere within the limits.

    Attributes:
        iteration: The optimal control problem; `states` are departures predicted.
    """

    @checked
    def __init__(
        self,
        orbit: Reference,
        commands: Sequence[str],
        *,
        horizon: int = 20,
        parts: int = 10,
        tolerable: Mapping[str, float] | None = None,
        limits: Mapping[str, tuple[float | None, float | None]] | None = None,
    ) -> None:
        self._limits = {}
        for name, (least, most) in (limits or {}).items():
            low, high = -np.inf if least is None else least, np.inf if most is None else most
            if low >= high:
                raise ParameterError(f"limits: {name}", "the least first", (low, high))
            self._limits[name] = low, high
        super().__init__(orbit, commands, parts, tolerable)
        self._horizon = horizon
        self._begin()

    def _law(self, model: OrbitModel) -> tuple[Array, Array]:
        """Costs to go and gains of a model, whose orbit has to be within the limits."""
        course, (first, _) = model.course, model.begun
        along = self._along(model, range(first, first + model.parts))
        lost = ("x", "y", "yaw") if course.turn else () if course.stands else ("x",)
        for name, (low, high) in self._limits.items():
            own = along[:, self._state(name)]
            if name in lost:
                expected = "a state that the orbit brings back, such as z or velocity of y"
                raise ParameterError("limits", expected, name)
            if own.min() > high or own.max() < low:
                expected = f"limits that hold the orbit's {own.min():.3g} to {own.max():.3g}"
                raise ParameterError(f"limits: {name}", expected, (low, high))
        return super()._law(model)

    def restart(self) -> None:
        """Start anew, without a prediction; see `OrbitController.restart`."""
        super().restart()
        self._begin()

    def _begin(self) -> None:
        costs = self.state_cost, self.input_cost
        self.iteration = RealTimeIteration(self.model.predict, self._horizon, *costs)
        self._place_ranges()
        for place in map(self._state, self._limits):
            self.iteration.program["weight"][:, place] = SOFT * max(self.weights[place], 1.0)
        self._last: int | None = None

    def follow(self, orbit: Reference, parameters: Mapping[str, float], first: int) -> None:
        """Follow another orbit from an interval on; see `OrbitController.follow`."""
        before = self.model.neutral
        super().follow(orbit, parameters, first)
        self.iteration.inputs = self.iteration.inputs + before - self.model.neutral
        self.iteration.predict = self.model.predict
        self.iteration.inverses.clear()
        self._place_ranges()

    def _place_ranges(self) -> None:
        """Ranges of the commands about the orbit."""
        program = self.iteration.program
        program["lower"][...] = self.low - self.model.neutral
        program["upper"][...] = self.high - self.model.neutral
        program["rise"][...], program["fall"][...] = self.fastest, -self.fastest

    def answer(self, first: int, start: Array, before: Array) -> Array | None:
        """Departures of the commands by one iteration; None where the program is not solved."""
        if self._last is not None and first > self._last:
            for _ in range(min(first - self._last, len(self.iteration.inputs))):
                self.iteration.shift()
        self._last = first
        if self._limits:
            program = self.iteration.program
            ahead = self._along(self.model, range(first, first + len(program["x"])))
            for name, (low, high) in self._limits.items():
                k = self._state(name)
                program["least"][:, k] = low - ahead[:, k]
                program["most"][:, k] = high - ahead[:, k]
        self.iteration.final_cost = self.costs[(first + self._horizon) % self.model.parts]
        solved = self.iteration.iterate(first, start, before) is ProgramStatus.SOLVED
        return self.iteration.inputs[0].copy() if solved else None

    @staticmethod
    def _along(model: OrbitModel, intervals: range) -> Array:
        """States that are kept, on the orbit at the beginning of intervals, (N, n) [SI].

        Horizontal vectors are seen along the heading of each beat, y from the line of the orbit.
        """
        course, parts = model.course, np.array(intervals) % model.parts
        own, level = course.states[parts], course.pairs.ravel()
        found = np.array([course.along(k) for k in intervals])
        found[:, level] = own[:, level]
        x, y, _ = course.places
        found[:, y] -= own[:, x] * course.ahead[parts, y]
        return found[:, model.kept]
