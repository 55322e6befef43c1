"""Flight of a robot through the air: what happens next, step by step.

Joints follow the gait exactly, everything else the equations of motion; fourth
order in the time step. Neglected: contact, actuator limits, sensors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from patagium.aerodynamics import AddedMass, Aerodynamics
from patagium.errors import Outcome, ParameterError, ShapeError, SimulationFailed
from patagium.native import load_functions
from patagium.robot import Robot
from patagium.simulation.bounds import check_start, limits, message_of
from patagium.simulation.flight import Origin, flight_record
from patagium.simulation.gaits import Gait, Motion, check_gait
from patagium.simulation.load_cells import LoadCell, check_cells
from patagium.simulation.march import Array, Equations, Progress, march, times_of
from patagium.simulation.mounts import Mount, mount_of
from patagium.simulation.stage import (
    LOAD_CELLS,
    RECORDED,
    RECORDED_WITH_ADDED_MASS,
    Layout,
    flight_functions,
    layout_of,
)


def simulate(
    robot: Robot,
    aero: Aerodynamics,
    gait: Gait,
    *,
    duration: float,
    time_step: float,
    added_mass: AddedMass | None = None,
    mount: Mount | None = None,
    load_cells: Sequence[LoadCell] = (),
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    throw: bool = True,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Flight of a robot whose actuated joints follow a gait.

    Classic Runge-Kutta at a fixed step, compiled. A run stops where a quantity is not
    finite, pitch nears 90 degrees (where roll and yaw are one), a coordinate leaves the
    robot's limits, or the speed is absurd; what was flown is kept.

    Args:
        robot: The machine.
        aero: What the air does to it.
        gait: What its actuated joints do.
        duration: A whole number of time steps [s].
        time_step: Step [s].
        added_mass: Inertia of the air that moves with the wings, in the same air as `aero`.
        mount: Free, fixed, carried along a path or on an arm (`patagium.mounts`); by
            default free if the robot has a floating body.
        load_cells: Six-axis cells (`patagium.mounts.load_cell`) whose wrenches to record.
        q: Initial coordinates, (n,) [m, rad]; the gait's and the path's are overwritten.
            Zero by default.
        v: Initial velocities, (n,) [m/s, rad/s]; likewise. What a fixed mount holds
            must not move: let the air move instead.
        throw: Whether a run that stops early raises; else the flight up to there is
            returned, `outcome` and `message` among its attributes.
        progress: Told the steps done and to do, from time to time.

    Returns:
        The flight: see `patagium.simulation.flight.QUANTITIES`, attributes and audits.

    Raises:
        ParameterError: If an argument is not what it may be.
        ShapeError: If q or v is not (n,).
        SimulationFailed: If the run stopped early and `throw` is set; it carries the flight.
    """
    steps = whole_steps(duration, time_step)
    check_robots(robot, aero)
    check_added_mass(robot, aero, added_mass)
    check_gait(robot, gait)
    held = mount_of(robot, mount)
    cells = tuple(load_cells)
    check_cells(robot, cells, held.kind != "free")
    layout = layout_of(robot, aero, held, added_mass, cells)
    start_q, start_v = initial(robot, "q", q), initial(robot, "v", v)
    base = held.path or _Held(_held_positions(robot, layout, start_q, start_v))

    def rows(time: Array) -> Array:
        joints, body = gait.motion(time), base.motion(time)
        parts = [
            *(joints.position, body.position),
            *(joints.velocity, body.velocity),
            *(joints.acceleration, body.acceleration),
        ]
        return np.column_stack([*parts, aero.air.wind_at(time)])

    passive = [i - layout.hidden for i in layout.passive]
    state = np.zeros(layout.size)
    state[: 2 * len(passive)] = np.concatenate([start_q[passive], start_v[passive]])
    equations = _equations(robot, aero, added_mass, held, cells, layout, state)
    check_start(equations, layout.state_names, state)
    run = march(equations, state, rows, steps, time_step, progress)
    message = message_of(run, layout.state_names, equations, steps, time_step)
    time = times_of(0, run.steps + 1, time_step)
    run.samples["wind"] = aero.air.wind_at(time)
    stepping = "partitioned RK4"
    origin = Origin(robot, aero, gait.describe(), held.kind, time_step, stepping, added_mass)
    origin = replace(origin, mount_path=held.describe(), load_cells=cells)
    flight = flight_record(origin, time, run.samples, run.outcome, message)
    if throw and run.outcome is not Outcome.COMPLETED:
        raise SimulationFailed(message, flight, run.outcome)
    return flight


def _equations(
    robot: Robot,
    aero: Aerodynamics,
    added_mass: AddedMass | None,
    mount: Mount,
    cells: tuple[LoadCell, ...],
    layout: Layout,
    state: Array,
) -> Equations:
    symbolic, _ = robot.symbolic()
    kind = "free" if mount.kind == "free" else "fixed"  # whatever holds it, the row says where
    kind += "" if added_mass is None else " with added mass"
    kind += f" on {cells!r}" if cells else ""
    recorded = RECORDED if added_mass is None else RECORDED_WITH_ADDED_MASS
    parameters = [aero.parameters, *([] if added_mass is None else [added_mass.parameters])]
    functions = load_functions(
        f"flight {kind} {aero.structure} {symbolic!r}",
        lambda: flight_functions(robot, aero, mount, added_mass, cells),
        label=f"flight of {robot.name}",
        many_only=["record"],
    )
    lower, upper = limits(layout.machine, layout.passive, layout.size, state)
    return Equations(
        rate=functions["rate"],
        record=functions["record"],
        prepare=None,
        recorded=(*recorded, LOAD_CELLS) if cells else recorded,
        robot_parameters=robot.parameters,
        aero_parameters=np.concatenate(parameters),
        lower=lower,
        upper=upper,
    )


@dataclass(frozen=True)
class _Held:
    """Coordinates that stay where they are, (n_held,)."""

    position: Array

    def motion(self, time: Array) -> Motion:
        still = np.zeros((len(time), len(self.position)))
        return Motion(still + self.position, still, still)


def whole_steps(duration: float, time_step: float) -> int:
    """Number of time steps in a duration.

    Raises:
        ParameterError: If either is not positive, or they do not divide.
    """
    for name, value in (("duration", duration), ("time_step", time_step)):
        if not (np.isfinite(value) and value > 0):
            raise ParameterError(name, "a positive number of seconds", value)
    steps = round(duration / time_step)
    if steps < 1 or abs(duration / time_step - steps) > 1e-6 * steps:
        raise ParameterError("duration", f"a whole number of time steps of {time_step} s", duration)
    return steps


def check_robots(robot: Robot, aero: Aerodynamics) -> None:
    """Refuse a model of the air around another robot.

    Raises:
        ParameterError: If its coordinates or strips are not the robot's.
    """
    other = aero.robot
    if (other.dof_names, len(other.strips)) != (robot.dof_names, len(robot.strips)):
        raise ParameterError("aero", f"a model of the air around {robot.name!r}", other.name)


def check_added_mass(robot: Robot, aero: Aerodynamics, added_mass: AddedMass | None) -> None:
    """Refuse added mass of another robot, or in other air.

    Raises:
        ParameterError: If its coordinates, strips or air are not those of robot and model.
    """
    if added_mass is None:
        return
    other = added_mass.robot
    if (other.dof_names, len(other.strips)) != (robot.dof_names, len(robot.strips)):
        raise ParameterError("added_mass", f"that of {robot.name!r}", other.name)
    if added_mass.air != aero.air:
        raise ParameterError("added_mass.air", f"the air of aero, {aero.air}", added_mass.air)


def initial(robot: Robot, name: str, values: ArrayLike | None) -> Array:
    """An initial vector over the coordinates, zero by default, (n,).

    Raises:
        ShapeError: If it is not (n,).
        ParameterError: If it is not finite.
    """
    if values is None:
        return np.zeros(robot.dof)
    vector = np.array(values, float)
    if vector.shape != (robot.dof,):
        raise ShapeError(name, (robot.dof,), vector.shape)
    if not np.isfinite(vector).all():
        wrong = robot.dof_names[int(np.argmin(np.isfinite(vector)))]
        raise ParameterError(name, "finite numbers", f"not finite at {wrong}")
    return vector


def _held_positions(robot: Robot, layout: Layout, q: Array, v: Array) -> Array:
    """Positions of the prescribed coordinates that no gait moves, (n_held,)."""
    held = [i - layout.hidden for i in layout.prescribed[len(layout.machine.actuated) :]]
    for i in held:
        if v[i] != 0:
            name = f"initial velocity of {robot.dof_names[i]}"
            raise ParameterError(name, "0, as a fixed mount holds it (give the air a wind)", v[i])
    return q[held]
