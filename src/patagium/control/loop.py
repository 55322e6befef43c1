"""The loop closed: truth, what is known of it, a learner, a controller, and events.

The truth is flown by `Simulator` at a fixed step of 1e-4 s or just below; once a period of the
controller the estimate of the state becomes commands. Robot and air of the truth are others than
the controller's model, or should be. Everything is one flight, and the same seed gives the same
flight. Neglected: the time that a controller takes to answer.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from typing import Any, Protocol, runtime_checkable

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from patagium.aerodynamics import AddedMass, Aerodynamics
from patagium.arguments import Progress, checked, of_kind
from patagium.arrays import Array
from patagium.control.estimators import Estimate, Estimator, NoisyState, TrackedState, Truth
from patagium.control.events import Event, Machine, StuckEvent, with_gusts
from patagium.control.orbit import Orbit, check_attitude
from patagium.control.predictive import OrbitModel
from patagium.errors import Outcome, ParameterError, SimulationFailed, positive
from patagium.limits import MOST_STEPS
from patagium.reading import json_ready
from patagium.robot import Robot
from patagium.simulation.simulator import FlightState, Simulator, check_robots, period_of
from patagium.simulation.steered_gait import SteeredGait

TIME_STEP = 1e-4
"""Longest time step of the truth where none is given [s]."""


@runtime_checkable
class LoopController(Protocol):
    """Controller of a closed loop; `report()` and `held` of `OrbitController` are told too.

    A method `check_flight(robot, gait, mount)` may refuse a flight for which it was not made.
    """

    @property
    def period(self) -> float:
        """Time between two calls [s]."""

    def __call__(self, time: float, state: FlightState | None) -> dict[str, float] | None:
        """Commands by name from an estimate of the state, None where no sample came."""


@runtime_checkable
class Learner(Protocol):
    """Learner in the loop, or a controller that learns; `period`, if any, is its interval."""

    def learn(self, time: float, state: FlightState, acceleration: Array) -> None:
        """Learn from one estimate: a state, and its accelerations, (n,) [m/s^2, rad/s^2]."""


@checked
def fly(
    robot: Robot,
    aero: Aerodynamics,
    controller: LoopController,
    *,
    orbit: Orbit,
    duration: float,
    sensors: NoisyState | TrackedState | None = None,
    events: Sequence[Event] = (),
    learner: Learner | None = None,
    estimator: Estimator | None = None,
    seed: int = 0,
    time_step: float = TIME_STEP,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    added_mass: AddedMass | None = None,
    throw: bool = True,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Flight in a closed loop: truth, estimate, controller, events.

    Args:
        robot: The machine that truly flies: `off_nominal(robot, 0.02, seed)`.
        aero: Model of the air that truly is around it.
        controller: What answers each estimate of the state with commands, once its `period`.
        orbit: Orbit on which the flight begins, whose gait is steered: the controller's.
        duration: Duration of the flight, rounded to time steps [s].
        sensors: What is known of the state; by default all of it.
        events: What happens at its time (`patagium.control.events`).
        learner: What learns; by default the controller, if it has a method `learn`.
        estimator: Function from all motion so far (`Truth`) to an `Estimate`; by default the one
            of the sensors.
        seed: Seed of all noise.
        time_step: Longest step of the truth [s].
        q: Initial coordinates of the truth, (n_q,) [m, rad, 1]; on the orbit by default.
        v: Initial velocities, (n,) [m/s, rad/s]; on the orbit by default.
        added_mass: Inertia of the air of the truth, in the same air as its model.
        throw: Whether a flight that breaks raises, or is returned as it is.
        progress: Function that takes the steps done and to do; where it raises
            `errors.Interrupted`, the flight ends there.

    Returns:
        The flight, as of `simulate`, with the true motion; over `control_time` also `estimate` and
        `reference`, and among its attributes `events` (JSON), `controller`, `held` (JSON), `seed`.

    Raises:
        ParameterError: If an argument is not what it may be.
        ShapeError: If q or v have another shape.
        SimulationFailed: If the flight broke and `throw` is set; it carries the flight.
    """
    check_robots(robot, aero)
    check_attitude(robot)
    period_of(controller, robot, orbit.gait)
    start = orbit.start() | {k: one for k, one in (("q", q), ("v", v)) if one is not None}
    given = tuple(events), start, added_mass
    loop = _Loop(robot, aero, controller, orbit, *given, duration, time_step)
    learner = learner or (controller if isinstance(controller, Learner) else None)
    known = estimator or (sensors or NoisyState()).estimator(orbit, loop.duration, seed)
    loop.run(known, learner, progress)
    flight = loop.flight()
    flight.attrs |= {"seed": seed, "sensors": repr(sensors), "learner": repr(learner)}
    outcome = loop.simulator.outcome
    if throw and outcome is not Outcome.COMPLETED:
        raise SimulationFailed(flight.attrs["message"], flight, outcome)
    return flight


def _check_stuck(gait: SteeredGait, event: StuckEvent) -> None:
    """Refuse a value that the gait, which it goes to, does not hold."""
    places, limited, value = gait.places(event.command), gait.limited, event.value
    if value is None:
        return
    gait.command(event.time, {event.command: value})
    held = gait.target[places] / gait.scale(event.command)
    if gait.limited > limited:
        end = held[np.abs(held - value).argmax()]
        most = f"at {'most' if value > end else 'least'} {end:.4g}"
        raise ParameterError("value", f"{most}, as its range and its joints allow", value)


@dataclass
class _Loop:
    """Loop of one flight.

    Attributes:
        start: Where the flight begins: `q`, `v` and `aero_state`.
        simulator: The truth, which steers the gait.
        called: Times at which the controller was called [s].
        due: Events that have not happened, by their step, with the machine where they change it.
        estimates: Estimate at each period, (n_q + n,); nan where there was none.
        followed: State of the orbit that the controller followed then, by name [SI].
    """

    robot: Robot
    aero: Aerodynamics
    controller: LoopController
    orbit: Orbit
    events: tuple[Event, ...]
    start: dict[str, Any]
    added_mass: AddedMass | None
    duration: float
    time_step: float
    simulator: Simulator = field(init=False)
    due: list[tuple[int, Event, Machine | None]] = field(init=False)
    called: list[float] = field(default_factory=list)
    estimates: list[Array] = field(default_factory=list)
    followed: list[dict[str, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        period = positive("period of the controller", self.controller.period)
        longest = positive("time_step", self.time_step)
        if not period / longest <= MOST_STEPS:
            expected = f"at most {MOST_STEPS:.0e} time steps of {longest:g} s (shorten it)"
            raise ParameterError("period of the controller", expected, period)
        self.time_step = step = period / ceil(period / longest * (1 - 1e-9))
        steps = max(1, round(min(positive("duration", self.duration) / step, 1e300)))
        self.duration = steps * step
        aero, added = with_gusts(self.aero, self.events), self.added_mass
        lags = self.start.pop("aero_state")
        self.simulator = Simulator(
            self.robot, aero, self.orbit.gait, duration=self.duration, time_step=step, **self.start,
            aero_state=lags if len(lags) == aero.state_size else None,
            added_mass=None if added is None else replace(added, air=aero.air),
        )  # fmt: skip
        self.due, machine = [], self.robot
        for event in sorted(self.events, key=lambda one: one.time):
            with event.named():
                if event.time > self.duration:
                    expected = f"within the flight of {self.duration:g} s"
                    raise ParameterError("time", expected, event.time)
                if isinstance(event, StuckEvent):
                    _check_stuck(self.simulator.steered.copied(), event)
                after = event.changed(machine, aero)
            same = after[0] is machine and after[1] is aero
            machine, aero = after
            self.due.append((ceil(event.time / step - 1e-9), event, None if same else after))

    def run(self, estimator: Estimator, learner: Learner | None, progress: Progress | None) -> None:
        """Fly to the end, or up to where the flight breaks."""
        simulator, done, call = self.simulator, 0, 0.0
        rate = getattr(learner, "period", self.controller.period)
        every = max(1, round(rate / simulator.time_step))
        while done < simulator.steps and simulator.outcome is Outcome.COMPLETED:
            while self.due and self.due[0][0] <= done:
                self._happen(*self.due.pop(0)[1:])
            learning, control = learner is not None and done % every == 0, done == round(call)
            if learning or control:
                estimate = self._estimate(estimator)
                if learning and learner is not None and estimate is not None:
                    learner.learn(simulator.time, estimate.state, estimate.acceleration)
                if control:
                    self._control(None if estimate is None else estimate.state)
                    call += self.controller.period / simulator.time_step
            ahead = [round(call), done - done % every + every]
            ahead += [first for first, *_ in self.due[:1]]
            last = min(*ahead, simulator.steps)
            simulator.advance(last - done, progress)
            done = last

    def _happen(self, event: Event, machine: Machine | None) -> None:
        """Change the truth as an event says."""
        if isinstance(event, StuckEvent):
            gait = self.simulator.steered
            places = gait.places(event.command)
            gait.stuck.difference_update(places)
            if event.value is not None:
                self.simulator.command({event.command: event.value})
            gait.stuck.update(places)
        if machine is not None:
            self.simulator.change(*machine)

    def _estimate(self, estimator: Estimator) -> Estimate | None:
        q, v, a = (self.simulator.run.samples[name] for name in ("q", "v", "a"))
        found = estimator(Truth(self.robot, self.simulator.time_step, q, v, a, self._along))
        of_kind("estimate", found, Estimate | None)
        return found

    def _along(self, time: Array) -> Array:
        """Rows of q, v and a on the orbit that is followed, but for where it is; see `Truth`."""
        model = getattr(self.controller, "model", None)
        if not (isinstance(model, OrbitModel) and isinstance(model.orbit, Orbit)):
            return self.orbit.along(time)
        return model.orbit.along(time - model.time(0), model.course.heading + model.course.lead)

    def _control(self, state: FlightState | None) -> None:
        """Have the controller answer an estimate of the state."""
        unknown = np.full(self.robot.state_size, np.nan)
        self.estimates.append(unknown if state is None else np.concatenate([state.q, state.v]))
        self.called.append(time := self.simulator.time)
        commands = self.controller(time, state)
        of_kind("commands", commands, Mapping | None)
        if isinstance(model := getattr(self.controller, "model", None), OrbitModel):
            along = model.course.along(model.number(time))
            self.followed.append(dict(zip(model.names, map(float, along), strict=True)))
        given, gait = (commands or {}).items(), self.simulator.steered
        free = {k: value for k, value in given if not gait.stuck.issuperset(gait.places(k))}
        if free:
            self.simulator.command(free)

    def flight(self) -> xr.Dataset:
        """The flight so far, with what was known and wanted."""
        flight, names = self.simulator.flight(), self.robot.dof_names
        states = [*self.robot.coordinate_names, *(f"velocity of {name}" for name in names)]
        time = np.array(self.called)
        wanted = self.orbit.along(time)[:, : len(states)]
        for row, followed in zip(wanted, self.followed, strict=False):
            row[:] = [followed.get(name, own) for name, own in zip(states, row, strict=True)]
        dims, units = ("control_time", "state"), {"units": "m, rad, 1 or per s"}
        estimates = np.array(self.estimates).reshape(len(time), len(states))
        flight = flight.assign_coords(
            control_time=("control_time", time, {"units": "s"}), state=("state", states)
        ).assign(
            estimate=(dims, estimates, units | {"long_name": "state that the controller knew"}),
            reference=(dims, wanted, units | {"long_name": "state on the orbit"}),
        )
        flight.attrs["events"] = json.dumps(json_ready([one.describe() for one in self.events]))
        if hasattr(self.controller, "report"):
            flight.attrs["controller"] = self.controller.report()
        if hasattr(self.controller, "held"):
            held = json_ready(self.controller.held)
            flight.attrs["held"] = json.dumps(held)
            if sum(held.values()) == len(time):
                flight.attrs["message"] += f"; no sample was answered ({', '.join(held)})"
        return flight
