"""Flights side by side: one robot in one air, many starts or delays, each with its commands.

What `patagium.fly` does for one flight is done here for hundreds in each call of the compiled
equations: the same Runge-Kutta steps, and the same answer of the gait to its commands (range,
rate, three lags). Flights that break, or leave the region that is asked for, stop. Neglected:
events, commands of phases, attitudes by quaternions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from patagium.aerodynamics import Aerodynamics
from patagium.arrays import Array
from patagium.control.predictive import OrbitController
from patagium.errors import ParameterError
from patagium.native import load_functions
from patagium.robot import Robot
from patagium.robot.model import COMMANDS
from patagium.simulation.flight_equations import flight_functions
from patagium.simulation.mounts import mount_of
from patagium.simulation.state_layout import state_layout
from patagium.simulation.steered_gait import Responses, SteeredGait

Numbers = NDArray[np.int64]

_SAMPLES = 2000  # of a period, for the extremes of joints


@dataclass
class Answers:
    """Answers of the steered gaits of many flights to their commands, as of `SteeredGait`.

    Args:
        gait: Gait that they all begin with.
        robot: The machine.
        commands: Names of the commands.
        count: Number of flights.

    Attributes:
        state: Value and first two rates of each response, (3, flights, 1 + 3 n_a) [its unit,
            over s, over s^2].
        aim: Where each goes now, on its ramp, (flights, 1 + 3 n_a) [its unit].
        target: Where the ramp ends, (flights, 1 + 3 n_a) [its unit].
        own: Time of the gait's own, (flights,) [s].
        joints: Position, velocity and acceleration of the joints, (flights, 3 n_a) [SI].
    """

    gait: SteeredGait
    robot: Robot
    commands: tuple[str, ...]
    count: int
    state: Array = field(init=False)
    aim: Array = field(init=False)
    target: Array = field(init=False)
    own: Array = field(init=False)
    joints: Array = field(init=False)

    def __post_init__(self) -> None:
        gait, robot, n = self.gait, self.robot, len(self.gait.joints)
        size = 1 + 3 * n
        self.places: list[list[int]] = []
        times = (gait.gait.period or 0.0) * np.arange(_SAMPLES) / _SAMPLES
        motion = gait.gait.motion(times).position
        self._away = np.array([motion.min(axis=0), motion.max(axis=0)]) - gait.mean
        self._range = np.array([np.full(size, -np.inf), np.full(size, np.inf)])
        self._rates = np.full(size, np.inf)
        for name in self.commands:
            kind, joints = robot.command(name)
            if kind == "phase":
                raise ParameterError("commands", "no phase", name)
            first = 0 if kind == "frequency" else 1 + COMMANDS.index(kind) * n
            moved = [kind == "offset" or low < 0 < high for low, high in self._away.T]
            own = [first + k for k, joint in enumerate(gait.joints) if joint in joints and moved[k]]
            own = [0] if kind == "frequency" else own
            self.places.append(own)
            low, high, self._rates[own] = gait.limits(name)
            self._range[:, own] = [[low], [high]]
        limits = np.array([robot.lower, robot.upper])[:, list(robot.actuated)]
        self._room = limits - gait.mean
        self.state = np.zeros((3, self.count, size))
        self.state[0] = gait.neutral
        self.aim = np.tile(gait.neutral, (self.count, 1))
        self.target = self.aim.copy()
        self.own = np.zeros(self.count)
        self.joints = self._joints()

    def command(self, flights: Numbers, values: Array) -> None:
        """Command some flights.

        Args:
            flights: Their places, (m,) [-].
            values: Responses to go to, (m, commands) [unit of a response].
        """
        target, n = self.target[flights], len(self.gait.joints)
        for own, column in zip(self.places, values.T, strict=True):
            target[:, own] = column[:, None]
        target = np.clip(target, *self._range)
        room = self._room - target[:, None, 1 : 1 + n] * self._away
        low, high = np.minimum(room[:, 0], 0.0), np.maximum(room[:, 1], 0.0)
        target[:, 1 + n : 1 + 2 * n] = np.clip(target[:, 1 + n : 1 + 2 * n], low, high)
        self.target[flights] = target

    def step(self, length: float) -> Array:
        """Joint rows at begin, middle and end of a time step, (3, flights, 3 n_a); go on by it.

        Args:
            length: The step [s].
        """
        rows = [self.joints]
        for _ in range(2):
            self.advance(0.5 * length)
            self.joints = self._joints()
            rows.append(self.joints)
        return np.array(rows)

    def advance(self, length: float) -> None:
        """Go on by some time, in which nobody commands.

        Args:
            length: The time [s].
        """
        end = self._after(length)
        self.own = self.own + _integral(self.state[:, :, 0], end[:, :, 0], length)
        gap = self.target - self.aim
        self.aim = self.aim + np.clip(gap, -self._rates * length, self._rates * length)
        self.state = end

    def _after(self, time: float) -> Array:
        """Responses some time from now, before which nobody commands, as `state`."""
        gap = self.target - self.aim
        lasting = np.abs(gap) / self._rates
        slope = np.where(lasting > 0.0, np.copysign(self._rates, gap), 0.0)
        sharpness = np.broadcast_to(self.gait.sharpness, gap.shape)
        on_ramp = np.minimum(lasting, time)
        aim = np.where(lasting > 0.0, self.aim, self.target)
        there = np.array(Responses.from_state(self.state, aim, slope, sharpness).at(on_ramp))
        rest = Responses.from_state(there, self.target, np.zeros_like(gap), sharpness)
        arrived = np.array(rest.at(time - on_ramp))
        return np.where(lasting > time, there, arrived)

    def _joints(self) -> Array:
        """Joint rows now, (flights, 3 n_a); formula of `SteeredGait` without leads."""
        n = len(self.gait.joints)
        cuts = [1, 1 + n, 1 + 2 * n]
        values, rates, bends = (np.split(part, cuts, axis=1) for part in self.state)
        (pace, size, offset, _), (quickening, growth, drift, _) = values, rates
        _, spurt, push, _ = bends
        found = self.gait.gait.motion(self.own)
        away, more = found.position - self.gait.mean, size - 1.0
        velocity = found.velocity * pace
        acceleration = found.acceleration * pace**2 + found.velocity * quickening
        return np.hstack(
            [
                found.position + more * away + offset,
                velocity + more * velocity + growth * away + drift,
                acceleration + more * acceleration + 2.0 * growth * velocity + spurt * away + push,
            ]
        )


def _integral(begin: Array, end: Array, length: float) -> Array:
    """Integral from values and two rates at both ends, (3, ...) each; of order seven."""
    (f0, g0, h0), (f1, g1, h1) = begin, end
    whole = length / 2 * (f0 + f1) + length**2 / 10 * (g0 - g1) + length**3 / 120 * (h0 + h1)
    return np.asarray(whole)


Law = Callable[[int, Numbers, Array], Array]
"""Function from the number of an interval, the flights, (m,), and their departures from the orbit,
(m, n_x), to departures of the commands, (m, commands)."""


@dataclass
class Flights:
    """Flights side by side, each under feedback along one orbit.

    Args:
        truths: Machines that fly, of one structure, each with the air around it, which has no
            states of its own; flight k is one of machine k modulo their number.
        controller: Controller of all, whose model gives departures.
        law: Its answers.
        states: State at the beginning of each, (N, n) [SI].
        steps: Time steps of an interval.
        delays: Delay after which a command of each is in force, (N,) [time steps].
        every: Intervals from one sample to the next.
        std: Standard deviations of the measured state, (n,) [SI].
        seed: Seed of that noise.
        region: Greatest departure from the orbit, (n,) [SI]; beyond it a flight is over.

    Attributes:
        alive: Which have not broken or left the region, (N,) [-].
        departures: Departure at the last interval's end, (N, n) [SI].
    """

    truths: Sequence[tuple[Robot, Aerodynamics]]
    controller: OrbitController
    law: Law
    states: Array
    steps: int
    delays: Numbers
    every: int = 1
    std: Array | float = 0.0
    seed: int = 0
    region: Array | float = np.inf

    def __post_init__(self) -> None:
        (robot, aero), model = self.truths[0], self.controller.model
        mount = mount_of(robot, None)
        self._rate = load_functions(
            f"rate of flights side by side {aero.key} {robot.structure}",
            lambda: flight_functions(robot, aero, mount)[:1],
            label=f"flights of {robot.name}, side by side",
        )["rate"]
        self._constants = [(robot.parameters, aero.parameters) for robot, aero in self.truths]
        layout = state_layout(robot, aero, mount)
        count, size = self.states.shape
        if size != layout.moving:
            raise ParameterError("aero", "air without states of its own", aero.name)
        self._whole = np.hstack([self.states, np.zeros((count, layout.size - size))])
        steered = SteeredGait(model.robot, model.steered.gait)
        self._true = Answers(steered, model.robot, model.commands, count)
        self._known = Answers(steered, model.robot, model.commands, count)
        self._coming: list[tuple[Numbers, Numbers, Array]] = []  # when due, flights, commands
        self._rng = np.random.default_rng([self.seed, 0xF17])
        self.alive = np.ones(count, bool)
        self.departures = np.zeros((count, size))
        self._where = np.arange(count)

    def fly(self, intervals: int) -> None:
        """Fly all for a number of intervals.

        Args:
            intervals: The number.
        """
        model = self.controller.model
        length = model.period / self.steps
        wind = np.zeros((len(self.states), 3))
        for first in range(intervals):
            moving = np.flatnonzero(self.alive)
            if not len(moving):
                return
            if first % self.every == 0:
                self._control(first, moving)
            for step in range(first * self.steps, (first + 1) * self.steps):
                self._arrive(step)
                self._known.advance(length)
                joints = self._true.step(length)
                rows = [np.hstack([part, wind])[moving] for part in joints]
                self._step(moving, rows, length)
            self._look(first + 1, moving)

    def _step(self, moving: Numbers, rows: Sequence[Array], length: float) -> None:
        """Runge-Kutta step of the flights that are not over, machine by machine."""
        begin, middle, end = rows
        for k, constants in enumerate(self._constants):
            own = moving % len(self._constants) == k
            x = self._whole[moving[own]]

            def rate(state: Array, row: Array, own=own, constants=constants) -> Array:  # type: ignore[no-untyped-def]
                return np.array(self._rate.batch(state, row[own], *constants))

            if not len(x):
                continue
            with np.errstate(all="ignore"):  # a flight that breaks is not finite
                k1 = rate(x, begin)
                k2 = rate(x + 0.5 * length * k1, middle)
                k3 = rate(x + 0.5 * length * k2, middle)
                k4 = rate(x + length * k3, end)
                x = x + length / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            self._whole[moving[own]] = x

    def _look(self, first: int, moving: Numbers) -> None:
        """Find which flights are over at the beginning of an interval."""
        size = self.departures.shape[1]
        away = self.controller.model.course.apart(first, self._whole[moving, :size])
        self.departures[moving] = away
        with np.errstate(invalid="ignore"):
            self.alive[moving] = (np.abs(away) <= self.region).all(axis=1)

    def _control(self, first: int, flights: Numbers) -> None:
        """Measure the state of some flights, and send their commands on the way."""
        model = self.controller.model
        size = self.departures.shape[1]
        noise = self.std * self._rng.standard_normal((len(self.states), size))
        away = model.course.apart(first, self._whole[:, :size] + noise)
        parts, known = [away[flights][:, model.kept]], self._known
        for name, own, neutral in zip(model.commands, known.places, model.neutral, strict=True):
            if name == "frequency":
                parts.append(known.own[flights, None] - first * model.period)
            answer = known.state[:, flights, own[0]].T - np.array([neutral, 0.0, 0.0])
            parts.append(answer)
        values = self.law(first, flights, np.hstack(parts)) + model.neutral
        known.command(flights, values)
        self._coming.append((first * self.steps + self.delays[flights], flights, values))

    def _arrive(self, step: int) -> None:
        """Put commands into force whose time has come."""
        left = []
        for due, flights, values in self._coming:
            now = due <= step
            self._true.command(flights[now], values[now])
            if not now.all():
                left.append((due[~now], flights[~now], values[~now]))
        self._coming = left
