"""Equations of flight with prescribed joints, as compiled functions of a flat state.

Passive coordinates are integrated; actuated ones (and a fixed body's) follow a
table row exactly (partitioned dynamics). Works and the impulse of external forces
ride along as states, so that audits are of the integrator's order. This module
owns the layout of the state:

    state = [q passive, v passive, lag states, works (4, 5 with added mass), impulse (3)]
    row = [q, v, a of the prescribed coordinates, wind (3), what strips meet of a gust that
           travels (9 a strip)]

The last part of a row is not prescribed: the march looks it up where the strips are.

A quaternion that is integrated is four of q and three of v. Its rate keeps its length but
for the integrator's error, and nothing else depends on that length; so scaling it to one
where a step begins is a projection onto what the flow keeps, and costs no order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from patagium.aerodynamics import AddedMass, Aerodynamics, AeroExpressions
from patagium.aerodynamics.gust_encounter import GUST, gust_rates, strip_delays, strip_winds
from patagium.aerodynamics.traveling_gust import GUST_COMPONENTS
from patagium.dynamics.chain import QuaternionTurn, cross
from patagium.dynamics.equations import (
    damping_force,
    fluid_energy,
    fluid_momentum,
    forward_prescribed,
    kinetic_energy,
    kirchhoff_force,
    momentum,
    potential_energy,
    total_mass,
)
from patagium.dynamics.kinematics import coordinate_rates
from patagium.robot import Robot
from patagium.simulation.internal_load_cells import (
    CELL_COORDINATES,
    InternalLoadCell,
    with_load_cells,
)
from patagium.simulation.mounts import (
    Mount,
    floating_coordinates,
    floating_dofs,
    on_massless_mount,
)

WORKS = ("joint_work", "air_work", "damping_work", "mount_work")
ADDED_WORK = "added_mass_work"
"""The work that rides along after the others with added mass."""
IMPULSE = ("impulse_x", "impulse_y", "impulse_z")
RECORDED = (
    *("q", "v", "a", "u1", "aero_force", "damping_force", "mount_force", "mount_wrench"),
    *("strip_force", "strip_point", "angle_of_attack", "strip_airspeed"),
    *("circulation", "downwash"),
    *("kinetic_energy", "potential_energy", "aero_power", "momentum", "works", "impulse"),
    "aero_state",
)
"""What the record function gives, in order."""
RECORDED_WITH_ADDED_MASS = (*RECORDED, "added_mass_force", "fluid_energy", "fluid_momentum")
"""What it gives with added mass."""
LOAD_CELLS = "load_cell_wrench"
"""What it gives after the others with load cells."""
STRIP_WIND = "strip_wind"
"""What it gives last in a gust that travels."""


@dataclass(frozen=True)
class StateLayout:
    """Where everything is in state and row.

    Attributes:
        machine: The robot, on a massless mount if it has no floating body; its
            coordinates and velocities are the last of the machine's.
        hidden: Coordinates held at zero, the first: 6 of each load cell, 6 of a massless mount.
        passive: Degrees of freedom of the machine that are integrated, as places in v.
        prescribed: Those that follow the row, in its order, as places in v.
        passive_coordinates: Places in q of those integrated.
        prescribed_coordinates: Places in q of those prescribed, in the row's order.
        lags: Number of the aerodynamic model's own states.
        works: Names of the works that ride along.
        cells: Load cells.
        met: Strips that meet a gust that travels, all or none.
    """

    machine: Robot
    hidden: int
    passive: tuple[int, ...]
    prescribed: tuple[int, ...]
    passive_coordinates: tuple[int, ...]
    prescribed_coordinates: tuple[int, ...]
    lags: int
    works: tuple[str, ...] = WORKS
    cells: int = 0
    met: int = 0

    @property
    def size(self) -> int:
        """Length of the state."""
        return self.moving + self.lags + len(self.works) + len(IMPULSE)

    @property
    def moving(self) -> int:
        """Length of q and v at the beginning of the state."""
        return len(self.passive_coordinates) + len(self.passive)

    @property
    def row_size(self) -> int:
        """Length of what is prescribed of a row."""
        return len(self.prescribed_coordinates) + 2 * len(self.prescribed) + 3

    @property
    def quaternions(self) -> tuple[tuple[int, ...], ...]:
        """Places in the state of each quaternion that is integrated."""
        places = {k: place for place, k in enumerate(self.passive_coordinates)}
        turning = [body for body in self.machine.bodies if body.by_quaternion]
        found = [self.machine.floating_coordinates(body)[3:] for body in turning]
        return tuple(tuple(places[k] for k in q) for q in found if q[0] in places)

    @property
    def state_names(self) -> tuple[str, ...]:
        """What each entry of the state is, for messages."""
        names = [self.machine.coordinate_names[i] for i in self.passive_coordinates]
        rates = [f"velocity of {self.machine.dof_names[i]}" for i in self.passive]
        lags = [f"lag state {k}" for k in range(self.lags)]
        return (*names, *rates, *lags, *self.works, *IMPULSE)


def state_layout(
    robot: Robot,
    aero: Aerodynamics,
    mount: Mount,
    added_mass: AddedMass | None = None,
    cells: Sequence[InternalLoadCell] = (),
) -> StateLayout:
    """Layout of a robot's flight.

    Args:
        robot: The machine; numbers or symbols.
        aero: What the air does to it.
        mount: How it is held.
        added_mass: Inertia of the air, or None.
        cells: Load cells.
    """
    on_ground = robot if robot.floating else on_massless_mount(robot)
    machine = with_load_cells(on_ground, cells)
    hidden = machine.dof - robot.dof
    held = floating_dofs(machine) if robot.floating and mount.kind != "free" else ()
    prescribed = (*machine.actuated, *(i for i in held if i not in machine.actuated))
    follows = {*range(hidden), *prescribed}
    passive = tuple(i for i in range(machine.dof) if i not in follows)
    works = WORKS if added_mass is None else (*WORKS, ADDED_WORK)
    places = machine.coordinate_indices
    driven = tuple(places[i] for i in machine.actuated)
    kept = floating_coordinates(machine) if held else ()
    follows = {*range(hidden), *driven, *kept}
    return StateLayout(
        machine=machine,
        hidden=hidden,
        passive=passive,
        prescribed=prescribed,
        passive_coordinates=tuple(k for k in range(machine.coordinate_count) if k not in follows),
        prescribed_coordinates=(*driven, *(k for k in kept if k not in driven)),
        lags=aero.state_size,
        works=works,
        cells=len(cells),
        met=len(robot.strips) if aero.air.traveling else 0,
    )


def flight_functions(
    robot: Robot,
    aero: Aerodynamics,
    mount: Mount,
    added_mass: AddedMass | None = None,
    cells: Sequence[InternalLoadCell] = (),
) -> Sequence[ca.Function]:
    """CasADi functions `rate` and `record` of (state, row, robot and aero parameters).

    Where a quaternion is integrated `prepare` too, which scales it to one; in a gust that
    travels `meet`, which says when strips meet it.

    Args:
        robot: The machine.
        aero: What the air does to it.
        mount: How it is held.
        added_mass: Inertia of the air, whose parameters follow the model's; or None.
        cells: Load cells.
    """
    symbolic, robot_parameters = robot.symbolic()
    layout = state_layout(symbolic, aero, mount, added_mass, cells)
    state = ca.SX.sym("state", layout.size)
    row = ca.SX.sym("row", layout.row_size + GUST_COMPONENTS * layout.met)
    count = len(aero.parameters) + (0 if added_mass is None else len(added_mass.parameters))
    aero_parameters = ca.SX.sym("c", count + (GUST if layout.met else 0))
    rate, recorded = _equations(layout, aero, added_mass, state, row, aero_parameters)
    inputs = [state, row, robot_parameters, aero_parameters]
    names = ["state", "row", "robot_parameters", "aero_parameters"]
    functions = [
        ca.Function("rate", inputs, [rate], names, ["rate"]),
        ca.Function("record", inputs, [*recorded.values()], names, [*recorded]),
    ]
    if layout.met:
        delays = strip_delays(layout.machine, *_moving(layout, state, row), aero_parameters[-GUST:])
        functions.append(ca.Function("meet", inputs, [delays], names, ["delays"]))
    if layout.quaternions:
        prepared = _normalized(layout, state)
        functions.append(ca.Function("prepare", inputs, [prepared], names, ["prepared"]))
    return functions


def _normalized(layout: StateLayout, state: ca.SX) -> ca.SX:
    """The state with its quaternions scaled to length one."""
    scaled = ca.SX(state)
    for places in layout.quaternions:
        quaternion = state[list(places)]
        scaled[list(places)] = quaternion / ca.sqrt(ca.sumsqr(quaternion))
    return scaled


def _moving(layout: StateLayout, state: ca.SX, row: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Coordinates and velocities of the machine from state and row."""
    machine = layout.machine
    n_u, n_p = len(layout.passive_coordinates), len(layout.prescribed_coordinates)
    q, v = ca.SX.zeros(machine.coordinate_count, 1), ca.SX.zeros(machine.dof, 1)
    for k, i in enumerate(layout.passive_coordinates):
        q[i] = state[k]
    for k, i in enumerate(layout.prescribed_coordinates):
        q[i] = row[k]
    for k, i in enumerate(layout.passive):
        v[i] = state[n_u + k]
    for k, i in enumerate(layout.prescribed):
        v[i] = row[n_p + k]
    return q, v


def _equations(
    layout: StateLayout,
    aero: Aerodynamics,
    added_mass: AddedMass | None,
    state: ca.SX,
    row: ca.SX,
    aero_parameters: ca.SX,
) -> tuple[ca.SX, dict[str, ca.SX]]:
    machine, passive, prescribed = layout.machine, layout.passive, layout.prescribed
    n_p = len(layout.prescribed_coordinates)
    q, v = _moving(layout, state, row)
    a_given = row[n_p + len(prescribed) : n_p + 2 * len(prescribed)]
    lag = state[layout.moving : layout.moving + layout.lags]
    wind = mean = row[layout.row_size - 3 : layout.row_size]
    if layout.met:
        met = ca.reshape(row[layout.row_size :], GUST_COMPONENTS, layout.met)
        wind, mean = strip_winds(machine, q, v, wind, met)
    own, others = aero_parameters[: len(aero.parameters)], aero_parameters[len(aero.parameters) :]
    air = aero.expressions(machine, q, v, lag, wind, own)
    aero_force, added, circulation = air.generalized_force, None, ca.SX.zeros(machine.dof, 1)
    if added_mass is not None:
        added = added_mass.inertia(machine, mean, others)
        # not the strips' own force, but its power is the air's: carried air keeps its energy
        circulation = added_mass.circulation_force(machine, q, v, wind, others)
        if layout.met:
            rates = gust_rates(met)
            circulation = circulation + added_mass.gust_force(machine, q, rates, others)
        aero_force = aero_force + circulation
    damping = damping_force(machine, v)
    still = ca.SX.zeros(layout.hidden, 1)
    a, constraint = forward_prescribed(
        machine,
        q,
        v,
        ca.vertcat(still, a_given),
        aero_force + damping,
        (*range(layout.hidden), *prescribed),
        added,
    )
    joint, mount = _split(constraint, machine.actuated)
    forces = [joint, aero_force, damping, mount]
    external = aero_force + damping + mount
    if added is not None:
        forces.append(kirchhoff_force(machine, q, v, a, added))
        external = external + forces[-1]
    powers = ca.vertcat(*[ca.dot(force, v) for force in forces])
    rate = ca.vertcat(
        coordinate_rates(machine, q, v)[list(layout.passive_coordinates)],
        a[list(passive)],
        air.state_derivative,
        powers,
        external_force(machine, external),
    )
    of_robot = slice(layout.hidden, machine.dof)
    totals = layout.moving + layout.lags
    recorded = {
        "q": q[layout.hidden :],
        "v": v[of_robot],
        "a": a[of_robot],
        "u1": joint[of_robot],
        "aero_force": air.generalized_force[of_robot],
        "damping_force": damping[of_robot],
        "mount_force": mount[of_robot],
        "mount_wrench": mount_wrench(machine, q, mount),
        **observed(machine, q, v, air),
        "works": state[totals : totals + len(layout.works)],
        "impulse": state[totals + len(layout.works) :],
        "aero_state": lag,
    }
    recorded = {name: recorded[name] for name in RECORDED}
    if added is not None:
        recorded["added_mass_force"] = (forces[-1] + circulation)[of_robot]
        recorded["fluid_energy"] = fluid_energy(machine, q, v, added)
        recorded["fluid_momentum"] = fluid_momentum(machine, q, v, added)
    if layout.cells:
        recorded[LOAD_CELLS] = constraint[: CELL_COORDINATES * layout.cells]
    if layout.met:
        recorded[STRIP_WIND] = wind
    return rate, recorded


def observed(machine: Robot, q: ca.SX, v: ca.SX, air: AeroExpressions) -> dict[str, ca.SX]:
    """What is recorded of any flight, however it is integrated: strips, energies, momentum."""
    return {
        "strip_force": air.strip_force,
        "strip_point": air.strip_point,
        "angle_of_attack": air.angle_of_attack,
        "strip_airspeed": air.strip_airspeed,
        "circulation": air.circulation,
        "downwash": air.downwash,
        "kinetic_energy": kinetic_energy(machine, q, v),
        "potential_energy": potential_energy(machine, q),
        "aero_power": air.power,
        "momentum": momentum(machine, q, v),
    }


def _split(force: ca.SX, selected: Sequence[int]) -> tuple[ca.SX, ca.SX]:
    """A force as its part in the selected coordinates, and the rest."""
    part = ca.SX.zeros(force.shape[0], 1)
    for i in selected:
        part[i] = force[i]
    return part, force - part


def external_force(machine: Robot, force: ca.SX) -> ca.SX:
    """Sum of external forces, weight included, world axes, (3, 1) [N].

    Args:
        machine: A machine with a floating body.
        force: Generalized force of all that is not inertia, weight or a joint, (n, 1).
    """
    total = ca.vertcat(0, 0, -total_mass(machine) * machine.gravity)
    for body in machine.bodies:
        if body.floating_dofs is not None:
            total = total + force[list(body.floating_dofs[:3])]
    return total


def mount_wrench(machine: Robot, q: ca.SX, force: ca.SX) -> ca.SX:
    """Force of the mount and its moment about the world's origin, (6, 1) [N, N m].

    Args:
        machine: A machine with a floating body, the one that is held.
        q: Generalized coordinates, (n_q, 1) [m, rad, 1].
        force: Generalized force of the mount, (n, 1) [N, N m].
    """
    body = next(body for body in machine.bodies if body.floating_dofs is not None)
    dofs, places = floating_dofs(machine)[:6], machine.floating_coordinates(body)
    position, push = q[list(places[:3])], force[list(dofs[:3])]
    if body.by_quaternion:
        moment = QuaternionTurn(q[list(places[3:])]).inward(force[list(dofs[3:])])
    else:
        moment = _moment_on_angles(q[list(places[3:])], force[list(dofs[3:])])
    return ca.vertcat(push, moment + cross(position, push))


def _moment_on_angles(angles: ca.SX, force: ca.SX) -> ca.SX:
    """Moment whose generalized force on roll, pitch and yaw is given, world axes, (3, 1) [N m].

    Q_k = e_k . M, with e_k the axes of roll, pitch and yaw in the world. Singular where they
    are, at a pitch of 90 degrees.
    """
    pitch, yaw = angles[1], angles[2]
    on_roll, on_pitch, on_yaw = ca.vertsplit(force)
    level = (on_roll + ca.sin(pitch) * on_yaw) / ca.cos(pitch)
    heading = ca.vertcat(ca.cos(yaw), ca.sin(yaw), 0)
    left = ca.vertcat(-ca.sin(yaw), ca.cos(yaw), 0)
    return heading * level + left * on_pitch + ca.vertcat(0, 0, on_yaw)
