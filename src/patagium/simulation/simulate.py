"""Flight of a robot through the air: what happens next, step by step.

Joints follow the gait exactly, everything else the equations of motion; fourth
order in the time step. Neglected: contact, actuator limits, sensors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from patagium.aerodynamics import AddedMass, Aerodynamics
from patagium.errors import Outcome, ParameterError, ShapeError, SimulationFailed
from patagium.native import load_functions
from patagium.robot import Robot
from patagium.robot.attitude import body_accelerations, body_rates, quaternion_from_angles
from patagium.simulation.bounds import check_start, limits, message_of, singular_places
from patagium.simulation.flight import Origin, flight_record
from patagium.simulation.gaits import Gait, Motion, check_gait
from patagium.simulation.load_cells import LoadCell, check_cells
from patagium.simulation.march import Array, Equations, Progress, march, times_of
from patagium.simulation.mounts import Mount, mount_of
from patagium.simulation.paths import Path
from patagium.simulation.stage import (
    LOAD_CELLS,
    RECORDED,
    RECORDED_WITH_ADDED_MASS,
    Layout,
    flight_functions,
    layout_of,
)
from patagium.simulation.stiffness import too_long


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
    finite, an Euler angle of pitch nears 90 degrees (where roll and yaw are one; a quaternion
    goes through), a coordinate leaves the robot's limits, or the speed is absurd; what was
    flown is kept.

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
        q: Initial coordinates, (n_q,) [m, rad, 1], as `robot.coordinates(pitch=...)` makes
            them; the gait's and the path's are overwritten. Those of zero angles by default.
        v: Initial velocities, (n,) [m/s, rad/s]; likewise. What a fixed mount holds
            must not move: let the air move instead.
        throw: Whether a run that stops early raises; else the flight up to there is
            returned, `outcome` and `message` among its attributes.
        progress: Told the steps done and to do, from time to time.

    Returns:
        The flight: see `patagium.simulation.flight.QUANTITIES`, attributes and audits.

    Raises:
        ParameterError: If an argument is not what it may be.
        ShapeError: If q is not (n_q,) or v not (n,).
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
    start_q, start_v = initial_coordinates(robot, q), initial_velocities(robot, v)
    base = _base_motion(robot, layout, held, start_q, start_v)

    def rows(time: Array) -> Array:
        joints, body = gait.motion(time), base.motion(time)
        parts = [
            *(joints.position, body.position),
            *(joints.velocity, body.velocity),
            *(joints.acceleration, body.acceleration),
        ]
        return np.column_stack([*parts, aero.air.wind_at(time)])

    places = [k - layout.hidden for k in layout.passive_coordinates]
    passive = [i - layout.hidden for i in layout.passive]
    state = np.zeros(layout.size)
    state[: layout.moving] = np.concatenate([start_q[places], start_v[passive]])
    equations = _equations(robot, aero, added_mass, held, cells, layout, state)
    singular = singular_places(layout.machine, layout.passive_coordinates)
    check_start(equations, layout.state_names, state, singular)
    run = march(equations, state, rows, steps, time_step, progress)
    cause = None
    if run.outcome is not Outcome.COMPLETED:

        def state_of(samples: dict[str, Array], k: int) -> Array:
            parts = [samples["q"][k, places], samples["v"][k, passive]]
            return np.concatenate([*parts, *(samples[name][k] for name in _CARRIED)])

        known = run.samples
        cause = too_long(equations, state_of, known, rows, run.steps, steps, time_step)
    message = message_of(run, layout.state_names, equations, steps, time_step, singular, cause)
    outcome = run.outcome if cause is None else Outcome.STEP_TOO_LONG
    time = times_of(0, run.steps + 1, time_step)
    run.samples["wind"] = aero.air.wind_at(time)
    stepping = "partitioned RK4"
    origin = Origin(robot, aero, gait.describe(), held.kind, time_step, stepping, added_mass)
    origin = replace(origin, mount_path=held.describe(), load_cells=cells)
    flight = flight_record(origin, time, run.samples, outcome, message)
    if throw and outcome is not Outcome.COMPLETED:
        raise SimulationFailed(message, flight, outcome)
    return flight


_CARRIED = ("aero_state", "works", "impulse")
"""What follows coordinates and velocities in the state, as recorded."""


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
    lower, upper = limits(layout.machine, layout.passive_coordinates, layout.passive, state)
    return Equations(
        rate=functions["rate"],
        record=functions["record"],
        prepare=functions.get("prepare"),
        recorded=(*recorded, LOAD_CELLS) if cells else recorded,
        robot_parameters=robot.parameters,
        aero_parameters=np.concatenate(parameters),
        lower=lower,
        upper=upper,
    )


class _BaseMotion(Protocol):
    """What a mount makes the floating body's coordinates do."""

    def motion(self, time: Array) -> Motion: ...


@dataclass(frozen=True)
class _Held:
    """Coordinates that stay where they are, (n_q,), as many velocities as `count`."""

    position: Array
    count: int

    def motion(self, time: Array) -> Motion:
        still = np.zeros((len(time), self.count))
        return Motion(np.tile(self.position, (len(time), 1)), still, still)


@dataclass(frozen=True)
class _InQuaternion:
    """A path of positions and angles as the coordinates of a body with a quaternion."""

    path: Path

    def motion(self, time: Array) -> Motion:
        given = self.path.motion(time)
        parts = [np.split(part, [3], axis=1) for part in (given.position, given.velocity)]
        (position, angles), (velocity, rates) = parts
        acceleration, faster = np.split(given.acceleration, [3], axis=1)
        return Motion(
            np.hstack([position, quaternion_from_angles(angles)]),
            np.hstack([velocity, body_rates(angles, rates)]),
            np.hstack([acceleration, body_accelerations(angles, rates, faster)]),
        )


def _base_motion(robot: Robot, layout: Layout, mount: Mount, q: Array, v: Array) -> _BaseMotion:
    """Motion of what is prescribed beside the joints."""
    if mount.path is not None:
        return _InQuaternion(mount.path) if robot.attitude == "quaternion" else mount.path
    count = len(layout.prescribed) - len(layout.machine.actuated)
    return _Held(_held_positions(robot, layout, q, v), count)


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


def _shape(robot: Robot) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    return robot.dof_names, robot.coordinate_names, len(robot.strips)


def _named(robot: Robot) -> str:
    return robot.name + (" with a quaternion" if robot.attitude == "quaternion" else "")


def initial_coordinates(robot: Robot, values: ArrayLike | None) -> Array:
    """Initial coordinates, those of zero angles by default, (n_q,); quaternions of length one.

    Raises:
        ShapeError: If they are not (n_q,).
        ParameterError: If they are not finite, or a quaternion's length is not one.
    """
    q = _finite("q", robot.coordinates() if values is None else values, robot.coordinate_names)
    for body in robot.bodies:
        if body.by_quaternion:
            places = list(robot.floating_coordinates(body)[3:])
            length = float(np.linalg.norm(q[places]))
            if abs(length - 1) > _LENGTH_TOLERANCE:
                raise ParameterError("q", "a quaternion of length 1", f"one of {length:.6g}")
            q[places] /= length
    return q


_LENGTH_TOLERANCE = 1e-6
"""Of a quaternion as written: six digits."""


def initial_velocities(robot: Robot, values: ArrayLike | None) -> Array:
    """Initial velocities, zero by default, (n,).

    Raises:
        ShapeError: If they are not (n,).
        ParameterError: If they are not finite.
    """
    return _finite("v", np.zeros(robot.dof) if values is None else values, robot.dof_names)


def _finite(name: str, values: ArrayLike, names: tuple[str, ...]) -> Array:
    vector = np.array(values, float)
    if vector.shape != (len(names),):
        raise ShapeError(name, (len(names),), vector.shape)
    if not np.isfinite(vector).all():
        wrong = names[int(np.argmin(np.isfinite(vector)))]
        raise ParameterError(name, "finite numbers", f"not finite at {wrong}")
    return vector


def _held_positions(robot: Robot, layout: Layout, q: Array, v: Array) -> Array:
    """Coordinates of what a fixed mount holds, in the row's order."""
    count = len(layout.machine.actuated)
    for i in (k - layout.hidden for k in layout.prescribed[count:]):
        if v[i] != 0:
            name = f"initial velocity of {robot.dof_names[i]}"
            raise ParameterError(name, "0, as a fixed mount holds it (give the air a wind)", v[i])
    return q[[k - layout.hidden for k in layout.prescribed_coordinates[count:]]]
