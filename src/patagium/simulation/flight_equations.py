"""Equations of flight with prescribed joints, as CasADi functions of a flat state.

Passive coordinates are integrated; actuated ones (and those of a body that a mount holds) follow a
table row exactly (partitioned dynamics). The works of all forces and the impulse of the external
ones are states too, so that audits are of the integrator's order. `state_layout` says where
everything is in state and row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import casadi as ca

from patagium.aerodynamics import AddedMass, Aerodynamics
from patagium.aerodynamics.gusts import GUST, GUST_COMPONENTS, strip_delays, strip_winds
from patagium.aerodynamics.model import OF_STRIPS, checked_air
from patagium.aerodynamics.strip_loads import AeroExpressions
from patagium.dynamics.chain import QuaternionTurn
from patagium.dynamics.equations import (
    BodyAddedMass,
    damping_force,
    fluid_energy,
    fluid_momentum,
    forward_prescribed,
    inverse,
    kinetic_energy,
    kirchhoff_force,
    momentum,
    potential_energy,
    response,
)
from patagium.dynamics.kinematics import body_poses, coordinate_rates
from patagium.native import named_function
from patagium.robot import Robot
from patagium.simulation.mounts import CELL_COORDINATES, InternalLoadCell, Mount
from patagium.simulation.state_layout import ADDED_WORK, StateLayout, state_layout

RECORDED = (
    *("q", "v", "a", "u1", "aero_force", "damping_force", "mount_force", "mount_wrench"),
    *("strip_force", "strip_point", "angle_of_attack", "effective_angle_of_attack"),
    "strip_airspeed",
    *("circulation", "downwash"),
    *("kinetic_energy", "potential_energy", "aero_power", "momentum", "works", "impulse"),
    "aero_state",
)
"""Quantities that the record function gives, in order."""
RECORDED_WITH_ADDED_MASS = (*RECORDED, "added_mass_force", "fluid_energy", "fluid_momentum")
"""Recorded quantities of a flight with added mass."""
LOAD_CELLS = "load_cell_wrench"
"""Recorded quantity of a flight with load cells."""
STRIP_WIND = "strip_wind"
"""Recorded quantity of a flight in shear or a gust that travels, the last."""


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
        aero: Model of the air around it.
        mount: Mount that holds it.
        added_mass: Inertia of the air, whose parameters follow the model's; or None.
        cells: Load cells.
    """
    layout, inputs = _symbols(robot, aero, mount, added_mass, cells)
    machine, (state, row, _, aero_parameters) = layout.machine, inputs
    motion = _motion(layout, aero, added_mass, inputs)
    held = (*range(layout.hidden), *layout.prescribed)
    a, constraint = forward_prescribed(
        machine,
        motion.q,
        motion.v,
        layout.prescribed_acceleration(row),
        motion.applied + motion.damping,
        held,
        motion.added,
    )
    rate, recorded = _equations(layout, motion, state, a, constraint)
    outputs = {"rate": {"rate": rate}, "record": recorded}
    if layout.met:
        delays = strip_delays(machine, motion.q, motion.v, aero_parameters[-GUST:])
        outputs["meet"] = {"delays": delays}
    if layout.quaternions:
        outputs["prepare"] = {"prepared": layout.normalized(state)}
    names = "state", "row", "robot_parameters", "aero_parameters"
    named = dict(zip(names, inputs, strict=True))
    return [named_function(name, named, output) for name, output in outputs.items()]


class FlightBalance(NamedTuple):
    """Equations of flight before they are solved for the free accelerations.

    Attributes:
        inputs: State, prescribed row, parameters of the robot and of its air.
        free: Symbols of the free accelerations, (m, 1) [m/s^2, rad/s^2].
        rate: Rate of the state with them.
        effort: Forces and powers of the actuated joints with them, (2 n_a, 1) [N, N m, W].
        lacking: Force that the motion of the free coordinates lacks, (m, 1) [N, N m].
        response: Gives the free accelerations of forces on these coordinates.
    """

    inputs: list[ca.SX]
    free: ca.SX
    rate: ca.SX
    effort: ca.SX
    lacking: ca.SX
    response: Callable[[ca.SX], ca.SX]


def flight_balance(
    robot: Robot, aero: Aerodynamics, mount: Mount, added_mass: AddedMass | None
) -> FlightBalance:
    """Balance of forces of a flight.

    Args:
        robot: The machine around which the model of the air is.
        aero: Model of the air around it.
        mount: Mount that holds it.
        added_mass: Inertia of the air, or None.
    """
    layout, inputs = _symbols(robot, aero, mount, added_mass)
    machine, motion = layout.machine, _motion(layout, aero, added_mass, inputs)
    free, a = ca.SX.sym("a", len(layout.passive)), ca.SX.zeros(machine.dof, 1)
    passive = list(layout.passive)
    a[[*range(layout.hidden), *layout.prescribed]] = layout.prescribed_acceleration(inputs[1])
    a[passive] = free
    lacking = inverse(machine, motion.q, motion.v, a, motion.added)
    lacking = lacking - (motion.applied + motion.damping)
    constraint = ca.SX(lacking)
    constraint[passive] = 0
    rate, recorded = _equations(layout, motion, inputs[0], a, constraint)
    effort = recorded["u1"], recorded["u1"] * recorded["v"]
    own = list(robot.actuated)

    def answer(force: ca.SX) -> ca.SX:
        return response(machine, motion.q, force, layout.passive, motion.added)[0]

    effort = ca.vertcat(*(part[own] for part in effort))
    return FlightBalance(inputs, free, rate, effort, lacking[passive], answer)


def _symbols(
    robot: Robot,
    aero: Aerodynamics,
    mount: Mount,
    added_mass: AddedMass | None,
    cells: Sequence[InternalLoadCell] = (),
) -> tuple[StateLayout, list[ca.SX]]:
    """Layout of a robot whose numbers are symbols; state, row, robot and aero parameters."""
    symbolic, robot_parameters = robot.symbolic()
    layout = state_layout(symbolic, aero, mount, added_mass, cells)
    state = ca.SX.sym("state", layout.size)
    row = ca.SX.sym("row", layout.row_size + GUST_COMPONENTS * layout.met)
    count = len(aero.parameters) + (0 if added_mass is None else len(added_mass.parameters))
    aero_parameters = ca.SX.sym("c", count + (GUST if layout.met else 0))
    return layout, [state, row, robot_parameters, aero_parameters]


def _equations(
    layout: StateLayout, motion: _Motion, state: ca.SX, a: ca.SX, constraint: ca.SX
) -> tuple[ca.SX, dict[str, ca.SX]]:
    """Rate of the state, (size, 1), and the recorded quantities by name [SI].

    Args:
        layout: Layout of state and row.
        motion: Coordinates, velocities and forces.
        state: The state.
        a: Accelerations, (n, 1) [m/s^2, rad/s^2].
        constraint: Force that keeps the prescribed motion, (n, 1) [N, N m].
    """
    machine, q, v = layout.machine, motion.q, motion.v
    applied, damping, added = motion.applied, motion.damping, motion.added
    joint = ca.SX.zeros(machine.dof, 1)
    joint[list(machine.actuated)] = constraint[list(machine.actuated)]
    mount = constraint - joint
    forces, external = [joint, applied, damping, mount], applied + damping + mount
    if added is not None:
        forces.append(kirchhoff_force(machine, q, v, a, added))
        external = external + forces[-1]
    rate = ca.vertcat(
        coordinate_rates(machine, q, v)[list(layout.passive_coordinates)],
        a[list(layout.passive)],
        motion.on_strips.state_derivative,
        ca.vertcat(*[ca.dot(force, v) for force in forces]),
        external_force(machine, external),
    )
    of_robot = slice(layout.hidden, machine.dof)
    lag, works, impulse = layout.after_velocities(state)
    recorded = {
        **{"q": q[layout.hidden :], "v": v[of_robot], "a": a[of_robot], "u1": joint[of_robot]},
        "aero_force": motion.on_strips.generalized_force[of_robot],
        **{"damping_force": damping[of_robot], "mount_force": mount[of_robot]},
        "mount_wrench": mount_wrench(machine, q, mount),
        **observed(machine, q, v, motion.on_strips),
        **{"works": works, "impulse": impulse, "aero_state": lag},
    }
    if added is not None:
        recorded["added_mass_force"] = (forces[-1] + motion.circulation)[of_robot]
        recorded["fluid_energy"] = fluid_energy(machine, q, v, added)
        recorded["fluid_momentum"] = fluid_momentum(machine, q, v, added)
    if layout.cells:
        recorded[LOAD_CELLS] = _through_cells(layout, q, constraint, damping)
    if layout.several:
        met = motion.on_strips.wind
        recorded[STRIP_WIND] = motion.wind if met is None else met
    return rate, {name: recorded[name] for name in recorded_names(layout)}


class _Motion(NamedTuple):
    """Motion of a machine in flight, and the forces that do not depend on accelerations.

    Attributes:
        q: Generalized coordinates, (n_q, 1) [m, rad, 1].
        v: Generalized velocities, (n, 1) [m/s, rad/s].
        damping: Force of the passive dampers, (n, 1) [N, N m].
        on_strips: Expressions of the aerodynamic model.
        circulation: Part of the added mass's force that circulation takes back, (n, 1) [N, N m]:
            not the strips' own force, but its power is the air's, for carried air keeps its energy.
        added: Added mass of the bodies, or None.
        wind: Wind before shear, world axes, (3, 1) or (3, n_strips) [m/s].
    """

    q: ca.SX
    v: ca.SX
    damping: ca.SX
    on_strips: AeroExpressions
    circulation: ca.SX
    added: BodyAddedMass | None
    wind: ca.SX

    @property
    def applied(self) -> ca.SX:
        """Force of the air but for its inertia, (n, 1) [N, N m]."""
        return self.on_strips.generalized_force + self.circulation


def _motion(
    layout: StateLayout, aero: Aerodynamics, added_mass: AddedMass | None, inputs: list[ca.SX]
) -> _Motion:
    """Motion of a machine whose state, row and parameters are given."""
    machine, (state, row, _, parameters) = layout.machine, inputs
    q, v = layout.coordinates_and_velocities(state, row)
    wind = mean = row[layout.row_size - 3 : layout.row_size]
    gust = ca.reshape(row[layout.row_size :], GUST_COMPONENTS, layout.met) if layout.met else None
    if gust is not None:
        wind, mean = strip_winds(machine, q, v, wind, gust)
    count = len(aero.parameters)
    lag, _, _ = layout.after_velocities(state)
    on_strips = aero.expressions(machine, q, v, lag, wind, parameters[:count])
    on_strips = checked_air(aero, machine, on_strips)
    circulation, added = ca.SX.zeros(machine.dof, 1), None
    if added_mass is not None:
        others = parameters[count:]
        circulation = added_mass.circulation_force(machine, q, v, wind, others)
        added = added_mass.inertia(machine, mean, others)
        if gust is not None:
            push = added_mass.gust_force(machine, q, gust[6:, :], others)
            circulation = circulation + push
    return _Motion(q, v, damping_force(machine, v), on_strips, circulation, added, wind)


def recorded_names(layout: StateLayout) -> tuple[str, ...]:
    """Names of the quantities that the record function gives, in order."""
    names: tuple[str, ...] = RECORDED_WITH_ADDED_MASS if ADDED_WORK in layout.works else RECORDED
    names += (LOAD_CELLS,) if layout.cells else ()
    return names + ((STRIP_WIND,) if layout.several else ())


def observed(machine: Robot, q: ca.SX, v: ca.SX, air: AeroExpressions) -> dict[str, ca.SX]:
    """Quantities recorded of any flight, however it is integrated: strips, energies, momentum.

    Args:
        machine: The machine.
        q: Generalized coordinates, (n_q, 1) [m, rad, 1].
        v: Generalized velocities, (n, 1) [m/s, rad/s].
        air: Expressions of the aerodynamic model.
    """
    return {
        **{name: getattr(air, name) for name in OF_STRIPS if name != "power"},
        "kinetic_energy": kinetic_energy(machine, q, v),
        "potential_energy": potential_energy(machine, q),
        "aero_power": air.power,
        "momentum": momentum(machine.flying, q, v),
    }


def external_force(machine: Robot, force: ca.SX) -> ca.SX:
    """Sum of the external forces on the free robot, weight included, world axes, (3, 1) [N].

    Args:
        machine: A machine with a floating body.
        force: Generalized force of all but inertia, weight and joints, (n, 1) [N, N m].
    """
    total = ca.vertcat(0, 0, -machine.flying.mass * machine.gravity)
    for body in machine.bodies:
        if body.floating_dofs is not None:
            total = total + force[list(body.floating_dofs[:3])]
    return total


def mount_wrench(machine: Robot, q: ca.SX, force: ca.SX) -> ca.SX:
    """Force on the floating body and its moment about the world's origin, (6, 1) [N, N m].

    Args:
        machine: A machine with a floating body, the one that is held.
        q: Generalized coordinates, (n_q, 1) [m, rad, 1].
        force: Generalized force, such as the mount's, (n, 1) [N, N m].
    """
    body = next(iter(machine.floating_bodies.values()))
    dofs, places = machine.floating_dofs[:6], machine.floating_coordinates(body)
    position, push = q[list(places[:3])], force[list(dofs[:3])]
    if body.by_quaternion:
        moment = QuaternionTurn(q[list(places[3:])]).inward(force[list(dofs[3:])])
    else:
        moment = _moment_on_angles(q[list(places[3:])], force[list(dofs[3:])])
    return ca.vertcat(push, moment + ca.cross(position, push))


def _through_cells(layout: StateLayout, q: ca.SX, constraint: ca.SX, damping: ca.SX) -> ca.SX:
    """Wrench through each cell, in its axes; a base's damper is beyond, (6 cells, 1) [N, N m]."""
    machine, count = layout.machine, CELL_COORDINATES * layout.cells
    wrenches = ca.SX(constraint[:count])
    for link, pose in zip(machine.bodies, body_poses(machine, q), strict=True):
        first = link.joints[0].dof if link.joints else count
        if first < count and machine.bodies[link.parent].floating_dofs is not None:
            force, moment = ca.vertsplit(mount_wrench(machine, q, damping), 3)
            moment, turn = moment - ca.cross(pose.position, force), pose.rotation.T
            wrenches[first : first + CELL_COORDINATES] -= ca.vertcat(turn @ force, turn @ moment)
    return wrenches


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
