"""Flight of a robot through the air, step by step, in one go or in pieces.

Joints follow the gait exactly, everything else the equations of motion; fourth order in the
time step. The state goes from piece to piece, for those who look at the flight or steer it on
its way, and the record of all of them is the flight. Neglected: contact, actuator limits, sensors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike

from patagium.aerodynamics import AddedMass, Aerodynamics, Air, QuasiSteady
from patagium.aerodynamics.gusts import OneMinusCosineGust
from patagium.arguments import Progress, checked, of_kind
from patagium.arrays import Array, brief, real_array
from patagium.dynamics.chain import vector
from patagium.dynamics.crba import mass_matrix
from patagium.errors import Outcome, ParameterError, SimulationFailed, check_names, positive
from patagium.limits import MOST_STEPS
from patagium.native import load_functions
from patagium.robot import Robot
from patagium.robot.attitude import body_accelerations, body_rates, quaternion_from_angles
from patagium.simulation.flight import (
    COMMAND,
    GIVEN,
    MASS,
    WINGBEATS,
    FlightOrigin,
    described_gait,
    flight_record,
)
from patagium.simulation.flight_equations import STRIP_WIND, flight_functions, recorded_names
from patagium.simulation.gaits import (
    Gait,
    PrescribedMotion,
    check_gait,
    check_limits,
    cruise,
    level_start,
)
from patagium.simulation.mounts import InternalLoadCell, Mount, check_cells, mount_of
from patagium.simulation.paths import Path
from patagium.simulation.runge_kutta import (
    Equations,
    GustField,
    Integration,
    IntegrationResult,
    times_of,
)
from patagium.simulation.state_layout import StateLayout, state_layout
from patagium.simulation.state_limits import (
    PITCH_MARGIN,
    SINGULARITY_REMEDY,
    SPEED_LIMIT,
    StepTooLong,
    check_start,
    chosen_step,
    diagnose_step,
    limits,
    outcome_message,
    rate_slopes,
    singular_places,
    tidy_step,
    tightest_limit,
)
from patagium.simulation.steered_gait import SteeredGait


def whole_steps(duration: float, time_step: float) -> int:
    """Number of time steps in a duration.

    Args:
        duration: The duration [s].
        time_step: Step [s].

    Raises:
        ParameterError: If either is not positive, they do not divide, or steps are too many.
    """
    for which, value in (("duration", duration), ("time_step", time_step)):
        positive(which, value, "a positive number of seconds")
    if not duration / time_step <= MOST_STEPS:
        expected = f"at most {MOST_STEPS:.0e} time steps of {time_step:g} s (shorten it)"
        raise ParameterError("duration", expected, f"{duration:g} s")
    steps = round(duration / time_step)
    if steps < 1 or abs(duration / time_step - steps) > 1e-6 * steps:
        near = f"{max(steps, 1) * time_step:.9g}"
        expected = f"a whole number of time steps of {time_step} s, such as {near}"
        raise ParameterError("duration", expected, duration)
    return steps


@checked
def check_robots(robot: Robot, aero: Aerodynamics) -> None:
    """Refuse a model of the air around another robot.

    Raises:
        ParameterError: If its coordinates or strips are not the robot's.
    """
    if _shape(aero.robot) != _shape(robot):
        raise ParameterError(
            "aero", f"a model of the air around {_named(robot)}", _named(aero.robot)
        )


def check_added_mass(robot: Robot, aero: Aerodynamics, added_mass: AddedMass | None) -> None:
    """Refuse added mass of another robot, or in other air.

    Raises:
        ParameterError: If its coordinates, strips or air are not those of robot and model.
    """
    if added_mass is None:
        return
    if _shape(added_mass.robot) != _shape(robot):
        raise ParameterError("added_mass", f"that of {_named(robot)}", _named(added_mass.robot))
    if added_mass.air != aero.air:
        raise ParameterError("added_mass.air", f"the air of aero, {aero.air}", added_mass.air)
    below = {name: float(f"{one:.3g}") for name, one in added_mass.factors.items() if one < 0}
    if below:  # as learned: a little below zero, for all that is off
        q, numbers = vector(robot.coordinates(**robot.resting)), vector(added_mass.parameters)
        inertia = mass_matrix(robot, q, added_mass.inertia(robot, vector(np.zeros(3)), numbers))
        if np.linalg.eigvalsh(ca.evalf(inertia).full()).min() <= 0:
            expected = "factors that leave the robot an inertia above zero (learned from forces "
            expected += "that are noise alone? learn the log without them, by `measured` of "
            expected += "LinearStripNetwork, or a flight in which the part moves the robot)"
            raise ParameterError("added_mass", expected, below)


def _shape(robot: Robot) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    return robot.dof_names, robot.coordinate_names, len(robot.strips)


def _named(robot: Robot) -> str:
    return robot.name + (" with a quaternion" if robot.attitude == "quaternion" else "")


def _initial_coordinates(robot: Robot, values: ArrayLike | None) -> Array:
    """Initial coordinates, zero and springs at rest by default, (n_q,); attitudes checked."""
    given = robot.coordinates(**robot.resting) if values is None else values
    q = _finite("q", given, robot.coordinate_names)
    for body in robot.bodies:
        if body.by_quaternion:
            places = list(robot.floating_coordinates(body)[3:])
            length = float(np.linalg.norm(q[places]))
            if abs(length - 1) > _LENGTH_TOLERANCE:
                raise ParameterError("q", "a quaternion of length 1", f"one of {length:.6g}")
            q[places] /= length
    return q


_LENGTH_TOLERANCE = 1e-6
"""Error of the length of a quaternion as written: six digits."""


def _finite(name: str, values: ArrayLike | None, names: tuple[str, ...]) -> Array:
    """Finite numbers, one for each of the names; zeros by default."""
    given = np.zeros(len(names)) if values is None else values
    vector = real_array(name, given, (len(names),)).copy()
    if not np.isfinite(vector).all():
        wrong = names[int(np.argmin(np.isfinite(vector)))]
        raise ParameterError(name, "finite numbers", f"not finite at {wrong}")
    return vector


def _check_joints(robot: Robot, gait: Gait, q: Array, v: Array) -> None:
    """Refuse a start of a joint that is not its gait's, nor zero as where it is not named."""
    start, dofs = gait.motion(np.zeros(1)), list(robot.actuated)
    places = [robot.coordinate_indices[i] for i in dofs]
    for name, given, own in (("q", q[places], start.position), ("v", v[dofs], start.velocity)):
        other = (given != 0) & ~np.isclose(given, own[0], rtol=1e-6, atol=1e-6)  # as written
        if other.any():
            k = int(np.argmax(other))
            expected = f"no start, as its gait prescribes it ({own[0, k]:.6g} there)"
            raise ParameterError(f"{name} of {gait.joints[k]}", expected, given[k])


Controller: TypeAlias = Callable[[float, "FlightState"], Mapping[str, float] | None]
"""Function from time [s] and state to commands by name, as `SteeredGait` takes them.

It may have a `period` [s] at which it is called, and a method `check_flight(robot, gait, mount)`
that refuses a flight for which it was not made."""


@dataclass(frozen=True)
class FlightState:
    """State of a flight at one time, as it truly is.

    Attributes:
        robot: The machine.
        time: Since the start [s].
        q: Coordinates, (n_q,) [m, rad, 1].
        v: Velocities, (n,) [m/s, rad/s].
    """

    robot: Robot
    time: float
    q: Array
    v: Array
    __repr__ = brief

    def position(self, name: str) -> float:
        """Coordinate of a name, such as `z` or `pitch` [m, rad, 1].

        Raises:
            ParameterError: If the robot has no such coordinate.
        """
        return float(self.q[_place("position", name, self.robot.coordinate_names)])

    def velocity(self, name: str) -> float:
        """Velocity of a degree of freedom, such as `x` or `pitch` [m/s, rad/s].

        Raises:
            ParameterError: If the robot has no such degree of freedom.
        """
        return float(self.v[_place("velocity", name, self.robot.dof_names)])


def _place(what: str, name: str, names: Sequence[str]) -> int:
    check_names(what, [name], names)
    return names.index(name)


class Simulator:
    """A flight that goes on step by step, and whose gait may be commanded on the way.

    Pieces of any size give the same flight as `simulate`.

    Args:
        robot: The machine.
        aero: Model of the air around it.
        gait: Motion of the actuated joints; of a `SteeredGait` a copy is flown and commanded.
        duration: Longest time it can fly, a whole number of time steps; of chosen steps as many as
            come nearest [s].
        time_step: Step [s]; None for the shortest of a 400th of a wingbeat, a 20th of a gust, 1 ms,
            half the longest stable one at the start, and .3/w for an undamped swing of w rad/s.
        mount: Mount that holds the robot; free by default if it floats, else fixed.
        control_period: Time that `step` takes, a whole number of time steps [s]; by default a
            twentieth of a wingbeat, or 10 ms where the gait stands still. A controller with a
            `period` of its own is called at that.
        q: Initial coordinates, (n_q,) [m, rad, 1]; those of zero angles by default.
        v: Initial velocities, (n,) [m/s, rad/s]; by default zero, or as on a fixed mount.
        added_mass: Inertia of the air that moves with the wings, in the same air as the model.
        load_cells: Six-axis load cells (`patagium.mounts.load_cell`) whose wrenches are recorded.
        aero_state: Initial states of the model of the air, (n_z,) [m/s, -]; zero by default.

    Attributes:
        time_step: Step that was given or chosen [s].

    Raises:
        ParameterError: If an argument is not what it may be.
        ShapeError: If q is not (n_q,) or v not (n,).
    """

    def __repr__(self) -> str:
        return f"<Simulator of {self._robot.name}, time step {self.time_step:g} s>"

    @checked
    def __init__(
        self,
        robot: Robot,
        aero: Aerodynamics,
        gait: Gait,
        *,
        duration: float,
        time_step: float | None = None,
        mount: Mount | None = None,
        control_period: float | None = None,
        q: ArrayLike | None = None,
        v: ArrayLike | None = None,
        added_mass: AddedMass | None = None,
        load_cells: Sequence[InternalLoadCell] = (),
        aero_state: ArrayLike | None = None,
    ) -> None:
        whole_steps(duration, duration if time_step is None else time_step)
        self._steered = gait.copied() if isinstance(gait, SteeredGait) else None
        gait = self._steered or gait
        self._commands: list[tuple[int, dict[str, float]]] = []
        cells = tuple(load_cells)
        check_robots(robot, aero)
        check_added_mass(robot, aero, added_mass)
        check_gait(robot, gait)
        if self._steered is None:  # which keeps the limits itself
            check_limits(robot, gait, duration)
        held = mount_of(robot, mount)
        check_cells(robot, cells, held.kind != "free")
        layout = state_layout(robot, aero, held, added_mass, cells)
        place, speed = _initial_coordinates(robot, q), _finite("v", v, robot.dof_names)
        _check_joints(robot, gait, place, speed)
        base = _base_motion(robot, layout, held, place, speed)
        self._robot, self._aero, self._gait, self._layout = robot, aero, gait, layout
        self._rows = partial(self._row_table, base)
        lags = _finite("aero_state", aero_state, aero.state_names)
        state = layout.initial_state(place, speed, lags)
        self._equations = _equations(robot, aero, added_mass, held, cells, layout, state)
        self._singular = singular_places(layout.machine, layout.passive_coordinates)
        check_start(self._equations, layout.state_names, state, self._singular)
        if time_step is None:
            at_start = self._equations, state, self._rows, gait.period, duration
            part = positive("control_period", control_period or duration)  # 0 is refused below
            gust = getattr(aero.air.gust, "profile", aero.air.gust)
            passing = gust.length_time if isinstance(gust, OneMinusCosineGust) else np.inf
            time_step = chosen_step(*at_start, part, bool(robot.stiffness), passing)
            duration = max(1, round(duration / time_step)) * time_step
        self.steps, self.time_step = whole_steps(duration, time_step), time_step
        self._control_steps = _control_steps(gait, control_period, time_step)
        self._implicit = self._stiff(0.0, state)
        self._integration = Integration(
            self._equations, state, self._rows, self.steps, time_step, implicit=self._implicit
        )
        self._cause: StepTooLong | None = None
        self._own_commands: dict[str, float] = {}
        self._changes: list[tuple[int, Array, float]] = []
        self._held, self._control_period = held, control_period
        self._origin = FlightOrigin(
            robot, aero, described_gait(gait), held.kind, time_step, _STEPPING[self._implicit],
            added_mass, mount_path=held.describe(), load_cells=cells,
        )  # fmt: skip

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_equations"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._take(self._robot, self._aero, self._layout)

    def _take(self, robot: Robot, aero: Aerodynamics, layout: StateLayout) -> None:
        """Equations of a machine in its air from now on, from the state as it is."""
        added, cells = self._origin.added_mass, self._origin.load_cells
        added = None if added is None else replace(added, robot=robot)
        self._equations = _equations(
            robot, aero, added, self._held, cells, layout, self._integration.state
        )
        self._integration.change(self._equations, self._implicit)
        self._robot, self._aero, self._layout = robot, aero, layout

    def _stiff(self, time: float, state: Array) -> bool:
        """Whether springs ask for implicit steps, from a state on, (size,)."""
        if not self._robot.stiffness:
            return False
        slopes = rate_slopes(self._equations, [state], self._rows, np.array([time]))
        return tightest_limit(slopes, self.time_step) is not None

    def _row_table(self, base: Callable[[Array], PrescribedMotion], time: Array) -> Array:
        """Rows of the equations at given times: motion of joints and of a held body, wind."""
        pairs = zip(self._gait.motion(time), base(time), strict=True)
        motion = [part for pair in pairs for part in pair]
        return np.column_stack([*motion, self._aero.air.uniform_wind_at(time)])

    @property
    def time(self) -> float:
        """Flown so far [s]."""
        return self._integration.done * self.time_step

    @property
    def steered(self) -> SteeredGait:
        """Gait of this flight, as commands steer it."""
        if self._steered is None:
            self._gait = self._steered = SteeredGait(self._robot, self._gait)
        return self._steered

    @property
    def run(self) -> IntegrationResult:
        """Result of the integration so far."""
        return self._integration.run

    @checked
    def advance(self, steps: int, progress: Progress | None = None) -> Outcome:
        """Fly further, or up to where the run breaks.

        Args:
            steps: Steps to take, fewer where fewer are left.
            progress: Function that takes the steps done and to do, called from time to time.

        Returns:
            COMPLETED while all is well.
        """
        sound = Outcome.COMPLETED, Outcome.INTERRUPTED
        flown = self.outcome in sound
        if self._integration.advance(steps, progress) not in sound and flown:
            run, state_of = self.run, self._layout.state_of_sample
            known = self._equations, state_of, run.samples, self._rows, run.steps
            self._cause = diagnose_step(*known, self.steps, self.time_step)  # or None
        return self.outcome

    @property
    def outcome(self) -> Outcome:
        """Outcome of the flight so far: COMPLETED while all is well."""
        return self._integration.outcome if self._cause is None else Outcome.STEP_TOO_LONG

    @property
    def longest_step(self) -> float | None:
        """Longest stable step where the run broke because its step was longer; else None [s]."""
        return None if self._cause is None else self._cause.longest

    @property
    def state(self) -> FlightState:
        """State of the flight now."""
        samples = self.run.samples
        return FlightState(self._robot, self.time, samples["q"][-1].copy(), samples["v"][-1].copy())

    @checked
    def command(self, commands: Mapping[str, float]) -> None:
        """Have the gait go to other values from now on; names are those of `SteeredGait`.

        Args:
            commands: Values by name; what is not named stays as it was commanded.

        Raises:
            ParameterError: If a name is no command, or a value not possible.
        """
        for name in commands:
            if name not in self._own_commands:
                self._own_commands[name] = self.steered.commanded(name)
        self.steered.command(self.time, commands)
        self._commands.append((self._integration.done, dict(commands)))

    @checked
    def change(self, robot: Robot, aero: Aerodynamics) -> None:
        """Fly on as another machine in other air, from the state as it is: damage, a payload.

        Coordinates, strips and wind are those of before; where only numbers differ, nothing is
        compiled, and steps are implicit where springs ask for it, as in a flight that begins there.
        The flight keeps the first machine and air as its origin, and its residuals of energy and
        momentum leave out what the change took or gave.

        Args:
            robot: The machine from now on.
            aero: Model of the air around it from now on, with the same states.

        Raises:
            ParameterError: If coordinates, strips, states or wind would be others.
        """
        check_robots(robot, aero)
        check_robots(robot, self._aero)
        if aero.air != self._aero.air:
            raise ParameterError("aero.air", f"the air of before, {self._aero.air}", aero.air)
        if aero.state_size != self._aero.state_size:
            expected = f"a model of {self._aero.state_size} states, as before"
            raise ParameterError("aero", expected, f"{aero.name} of {aero.state_size}")
        before = _energy_and_momentum(self.run)
        cells = self._origin.load_cells
        layout = state_layout(robot, aero, self._held, self._origin.added_mass, cells)
        if layout.several != self._layout.several:
            raise ParameterError("aero", "shear or none, as before", aero.name)
        self._take(robot, aero, layout)
        implicit = self._stiff(self.time, self._integration.state)
        if implicit != self._implicit:
            self._implicit = implicit
            self._integration.change(self._equations, implicit)
            stepping = f"{self._origin.stepping}, then {_STEPPING[implicit]}"
            self._origin = replace(self._origin, stepping=stepping)
        given = _energy_and_momentum(self.run) - before
        self._changes.append((self._integration.done, given, robot.flying.mass))

    @checked
    def fly(
        self, controller: Controller | None = None, progress: Progress | None = None
    ) -> Outcome:
        """Fly to the end, or up to where the run breaks.

        Args:
            controller: Function that commands the gait once every control period.
            progress: Function that takes the steps done and to do, called from time to time.

        Returns:
            COMPLETED if all is well.

        Raises:
            ParameterError: If a command has no such name, or is not possible; or if the
                controller is one of another period, robot or gait.
        """
        if controller is None:
            return self.advance(self.steps, progress)
        if isinstance(controller, type):
            raise ParameterError("controller", "a function or an object, no class", controller)
        period = period_of(controller, self._robot, self._gait, self._held, self._control_period)
        if period is not None:
            self._control_steps = _control_steps(self._gait, period, self.time_step)
        call = float(self._integration.done)
        while self.outcome is Outcome.COMPLETED and self._integration.done < self.steps:
            commands = controller(self.time, self.state)
            if (own := getattr(controller, "period", None)) is not None:  # may change on the way
                call += own / self.time_step
                self._control_steps = max(1, round(call) - self._integration.done)
            self._fly_period(commands, progress)
        return self.outcome

    def _fly_period(
        self, commands: Mapping[str, float] | None, progress: Progress | None = None
    ) -> Outcome:
        """Outcome after a command, if there is any, and one control period."""
        of_kind("commands", commands, Mapping | None)
        if commands:
            self.command(commands)
        return self.advance(self._control_steps, progress)

    def step(self, commands: Mapping[str, float] | None = None) -> FlightState:
        """Command, fly on for one control period, and look.

        Args:
            commands: Values by name, as of `command`; None leaves all as they were commanded.

        Returns:
            The state at the end of the period.

        Raises:
            ParameterError: If a name is no command, a value not possible, or no step is left.
            SimulationFailed: If the run broke; it carries the flight.
        """
        if self._integration.done >= self.steps:
            expected = f"one longer than {self.time:g} s, whose steps are all flown"
            raise ParameterError("duration", expected, self.time)
        if self._fly_period(commands) is not Outcome.COMPLETED:
            raise SimulationFailed(self.message(), self.flight(), self.outcome)
        return self.state

    def message(self) -> str:
        """Outcome of the flight so far, in words."""
        run = self.run
        steps = run.steps if run.outcome is Outcome.COMPLETED else self.steps
        known = run, self._layout.state_names, self._equations, steps, self.time_step
        return outcome_message(*known, self._singular, self._cause)

    def flight(self) -> xr.Dataset:
        """The flight so far; one that may go on shares its numbers, and is read-only."""
        run = self.run
        time = times_of(0, run.steps + 1, self.time_step)
        run.samples["wind"] = _wind(self._aero, run.samples, time)
        origin = replace(self._origin, gait=described_gait(self._gait))
        if self._commands:
            names, values = self._command_samples(run.steps + 1)
            origin = replace(origin, commands=names)
            run.samples[COMMAND] = values
        if self._steered is not None and self._steered.period:
            run.samples[WINGBEATS] = self._steered.wingbeats(time)
        for first, given, mass in self._changes:
            run.samples.setdefault(GIVEN, np.zeros((run.steps + 1, 4)))[first:] += given
            first_mass = np.full(run.steps + 1, origin.robot.flying.mass)
            run.samples.setdefault(MASS, first_mass)[first:] = mass
        if self.outcome is Outcome.COMPLETED and run.steps < self.steps:  # it may fly on
            for values in run.samples.values():
                values.flags.writeable = False
        flight = flight_record(origin, time, run.samples, self.outcome, self.message())
        if self._steered is not None:
            flight.attrs["commands_limited"] = self._steered.limited
        return flight

    def _command_samples(self, count: int) -> tuple[tuple[str, ...], Array]:
        """Names of commands, and what was commanded last at each sample, (N, names)."""
        changes = [(0, self._own_commands), *self._commands]
        table = pd.DataFrame([given for _, given in changes]).ffill()
        firsts = [first for first, _ in changes]
        rows = np.searchsorted(firsts, np.arange(count), side="right") - 1
        return tuple(self._own_commands), table.to_numpy()[rows]


_STEPPING = {False: "partitioned RK4", True: "partitioned Lobatto IIIC"}
"""Integrator in words, by whether its steps are implicit."""


def _energy_and_momentum(run: IntegrationResult) -> Array:
    """Energy [J], then momentum [kg m/s], at the last sample of a run, (4,)."""
    last = {name: run.samples[name][-1].ravel() for name in run.samples}
    energy: Array = last["kinetic_energy"] + last["potential_energy"]
    return np.concatenate([energy, last["momentum"]])


def _wind(aero: Aerodynamics, samples: dict[str, Array], time: Array) -> Array:
    """Velocity of the air, mean over the wings, world axes, (N, 3) [m/s]."""
    if STRIP_WIND not in samples:
        return aero.air.wind_at(time)
    areas = np.array([float(s.chord * s.width) for s in aero.robot.strips])
    winds = samples[STRIP_WIND].reshape(len(time), -1, 3)  # of one strip it is (N, 3)
    return np.average(winds, axis=1, weights=areas)


def period_of(
    controller: Controller,
    robot: Robot,
    gait: Gait,
    mount: Mount | None = None,
    stated: float | None = None,
) -> float | None:
    """Control period of a controller [s]: its own `period`, else the stated one, else None.

    Raises:
        ParameterError: If the two differ, its own is no positive number, or it refuses the flight.
    """
    if hasattr(controller, "check_flight"):
        flown = gait.gait if isinstance(gait, SteeredGait) else gait
        controller.check_flight(robot, flown, mount_of(robot, mount))
    own = getattr(controller, "period", None)
    if own is None:
        return stated
    own = positive("period of the controller", own)
    if stated is not None and abs(stated - own) > 1e-6 * own:
        raise ParameterError("control_period", f"the controller's {own:g} s, or none", stated)
    return own


def _control_steps(gait: Gait, period: float | None, time_step: float) -> int:
    """Number of time steps in a control period."""
    if period is None:
        wanted = CONTROL_SHARE * gait.period if gait.period else CONTROL_PERIOD
        return max(1, round(wanted / time_step))
    steps = min(positive("control_period", period) / time_step, 1e15)
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-6 * steps:
        near = f"{period / ceil(steps):.9g}"
        expected = f"the control period of {period:.9g} s over a whole number, such as {near}"
        raise ParameterError("time_step", expected, time_step)
    return round(steps)


CONTROL_SHARE = 0.05
"""Control period over the wingbeat, where none is given."""
CONTROL_PERIOD = 0.01
"""Control period of a gait that stands still, where none is given [s]."""


def _equations(
    robot: Robot,
    aero: Aerodynamics,
    added_mass: AddedMass | None,
    mount: Mount,
    cells: tuple[InternalLoadCell, ...],
    layout: StateLayout,
    state: Array,
) -> Equations:
    """Compiled equations of a flight that starts at a state, (size,)."""
    kind = "free" if mount.kind == "free" else "fixed"  # whatever holds it, the row says where
    kind += "" if added_mass is None else f" with {added_mass.structure}"
    kind += f" on {cells!r}" if cells else ""
    gust = aero.air.traveling if robot.strips else None
    kind += "" if gust is None else " in a gust that travels"
    models = (one for one in (aero, added_mass, gust) if one is not None)
    parameters = robot.parameters, np.concatenate([one.parameters for one in models])
    functions = load_functions(
        f"flight {kind} {aero.key} {robot.structure}",
        lambda: flight_functions(robot, aero, mount, added_mass, cells),
        label=f"flight of {robot.name}",
        many_only=["record"],
    )
    lower, upper = limits(layout.machine, layout.passive_coordinates, layout.passive, state)
    field = None
    if gust is not None:
        drift = SPEED_LIMIT / gust.speed
        field = GustField(functions["meet"], parameters, gust.pieces, drift)
    return Equations(
        rate=functions["rate"],
        record=functions["record"],
        prepare=functions.get("prepare"),
        recorded=recorded_names(layout),
        constants=parameters,
        lower=lower,
        upper=upper,
        field=field,
    )


def _base_motion(
    robot: Robot, layout: StateLayout, mount: Mount, q: Array, v: Array
) -> Callable[[Array], PrescribedMotion]:
    """Prescribed motion other than that of the joints, as a function of the times, (N,) [s]."""
    path = mount.path
    if path is not None:
        return partial(_in_quaternion, path) if robot.attitude == "quaternion" else path.motion
    count = len(layout.machine.actuated)
    dofs = [i - layout.hidden for i in layout.prescribed[count:]]
    for i in dofs:
        if v[i] != 0:
            name = f"initial velocity of {robot.dof_names[i]}"
            raise ParameterError(name, "0, as a fixed mount holds it (give the air a wind)", v[i])
    for body in robot.floating_bodies.values() if dofs else ():
        pitch = q[robot.floating_coordinates(body)[4]]
        if not body.by_quaternion and abs(np.cos(pitch)) < np.sin(PITCH_MARGIN):
            expected = f"a held pitch {PITCH_MARGIN} rad from 90 degrees ({SINGULARITY_REMEDY})"
            raise ParameterError("initial pitch", expected, pitch)
    position = q[[k - layout.hidden for k in layout.prescribed_coordinates[count:]]]
    return partial(_at_rest, position, len(dofs))


def _at_rest(position: Array, dofs: int, time: Array) -> PrescribedMotion:
    """A place that is held, as a motion."""
    still = np.zeros((len(time), dofs))
    return PrescribedMotion(np.tile(position, (len(time), 1)), still, still)


def _in_quaternion(path: Path, time: Array) -> PrescribedMotion:
    """A path of positions and angles as the coordinates of a body with a quaternion."""
    (position, angles), (velocity, rates), (acceleration, faster) = (
        np.split(part, [3], axis=1) for part in path.motion(time)
    )
    return PrescribedMotion(
        np.hstack([position, quaternion_from_angles(angles)]),
        np.hstack([velocity, body_rates(angles, rates)]),
        np.hstack([acceleration, body_accelerations(angles, rates, faster)]),
    )


_TRIALS = 3
"""Flights with a chosen step, where the first ones break because it was too long."""


DURATION = 1.0
"""Duration of a flight for which neither the robot's file nor the caller says any [s]."""


def _by_cruise(
    robot: Robot, aero: Any, gait: Any, duration: Any, mount: Mount | None, q: Any, v: Any
) -> tuple[Any, ...]:
    """Air, gait, duration and start as given, else of the cruise; on a stand in its wind."""
    own, wind = robot.cruise, 0.0
    if gait is None:
        gait = cruise(robot)
        speed, pitch = (own.speed, own.pitch) if own else (0.0, 0.0)
        if not robot.floating or (mount is not None and mount.kind == "fixed"):
            speed, wind = 0.0, -speed
        if robot.floating and (mount is None or mount.path is None):
            begin = level_start(robot, speed, pitch)
            q, v = (usual if one is None else one for one, usual in zip((q, v), begin, strict=True))
    if duration is None:
        duration = own.duration if own else DURATION
    return aero or QuasiSteady(robot, Air(wind=(wind, 0.0, 0.0))), gait, duration, q, v


@checked
def simulate(
    robot: Robot,
    aero: Aerodynamics | None = None,
    gait: Gait | None = None,
    *,
    duration: float | None = None,
    time_step: float | None = None,
    mount: Mount | None = None,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    controller: Controller | None = None,
    control_period: float | None = None,
    added_mass: AddedMass | None = None,
    load_cells: Sequence[InternalLoadCell] = (),
    aero_state: ArrayLike | None = None,
    throw: bool = True,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Flight of a robot whose actuated joints follow a gait.

    Classic Runge-Kutta at a fixed step, compiled; implicit steps where a joint's spring is too
    stiff for the step that is given. A run stops, and what was flown is kept, where
    a quantity is not finite, an Euler angle of pitch nears 90 degrees (a quaternion goes
    through), a coordinate leaves the robot's limits, or the speed is absurd.

    Args:
        robot: The machine. A gait of None is the `cruise` of its file, and so is then the start,
            or on a stand pitch and wind; a duration of None is the cruise's, or 1 s.
        aero: Model of the air around it; quasi-steady by default.
        gait: Motion of the actuated joints.
        duration: A whole number of time steps [s].
        time_step: Step [s]; None chooses one (`Simulator`), and shorter ones where it proves too
            long, but with a controller, which may have a memory; the flight's attributes say it.
        mount: Free, fixed, carried along a path or on an arm (`patagium.mounts`); by
            default free if the robot has a floating body, else fixed.
        q: Initial coordinates, (n_q,) [m, rad, 1], as `robot.coordinates(pitch=0.1)` makes; of
            joints of the gait zero, or where the gait starts.
        v: Initial velocities, (n,) [m/s, rad/s], as `robot.velocities(x=3.0)` makes, like q.
        controller: Function from time [s] and `FlightState` to commands (`SteeredGait`).
        control_period: Time between two calls of it [s]; its own `period` where it has one.
        added_mass: Inertia of the air that moves with the wings, in the same air as the model.
        load_cells: Six-axis load cells (`patagium.mounts.load_cell`) whose wrenches are recorded.
        aero_state: Initial states of the model of the air, (n_z,) [m/s, -]; zero by default.
        throw: Whether a run that stops early raises, or is returned as it is.
        progress: Function that takes the steps done and to do, called from time to time; where it
            raises `errors.Interrupted`, the run stops.

    Returns:
        The flight: see `patagium.simulation.flight.QUANTITIES`, attributes and audits.

    Raises:
        ParameterError: If an argument is not what it may be.
        ShapeError: If q is not (n_q,) or v not (n,).
        SimulationFailed: If the run stopped early and `throw` is set; it carries the flight.
    """
    aero, gait, duration, q, v = _by_cruise(robot, aero, gait, duration, mount, q, v)
    if controller is not None:
        control_period = period_of(controller, robot, gait, mount, control_period)
    elif control_period is not None:
        raise ParameterError("control_period", "a controller with it", None)

    step = time_step
    for _ in range(_TRIALS):
        whole = duration if step is None or step == time_step else round(duration / step) * step
        simulator = Simulator(
            robot, aero, gait, duration=whole, time_step=step, mount=mount,
            control_period=control_period, q=q, v=v, added_mass=added_mass, load_cells=load_cells,
            aero_state=aero_state,
        )  # fmt: skip
        simulator.fly(controller, progress)
        if simulator.longest_step is None or time_step is not None or controller is not None:
            break
        step = tidy_step(duration, 0.5 * simulator.longest_step)
    flight = simulator.flight()
    outcome = Outcome[flight.attrs["outcome"]]
    if throw and outcome is not Outcome.COMPLETED:
        raise SimulationFailed(flight.attrs["message"], flight, outcome)
    return flight
