"""Generalized force of the air as an expression, and the samples that it makes of measurements.

y = D(q) a + C(q, v) v + G(q) - u1 - damping - mount - added mass [paper, eq. training_data]: what
the known forces do not explain is ascribed to the air. A flight, a packet of a stream and a
measured motion all take this one expression. Neglected: errors of sensors and of the robot's
parameters, which end up in the force.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
import xarray as xr

from patagium.aerodynamics import AddedMass
from patagium.arguments import checked
from patagium.arrays import Array, real_array, rising
from patagium.dynamics import equations
from patagium.errors import FlightError, LogError, ParameterError
from patagium.native import NativeFunction, load_functions, named_function
from patagium.robot import Robot
from patagium.simulation import quantities, robot_of
from patagium.simulation.flight import air_of, check_labels

PARTS = ("q", "v", "a", "u1")
"""Quantities of each coordinate that every sample carries, in this order, after its time."""
OPTIONAL_PARTS = ("damping_force", "mount_force", "added_mass_force")
"""Known generalized forces, (n,) [N, N m] each, that a sample may carry after them."""
HELD = (
    "the body never moves: what holds it has a force, which is taken for that of the air; import a "
    "load cell (`cell.force`, `cell.moment`) and use patagium motion, or leave out `floating` in "
    "the robot file"
)
"""Finding about a floating body that stands where it is."""


def air_force(robot: Robot, q: ca.SX, v: ca.SX, a: ca.SX, known: Mapping[str, ca.SX]) -> ca.SX:
    """Generalized force of the air, D a + C v + G less the known forces, (n, 1) [N, N m].

    Args:
        robot: The machine, its numbers floats or symbols.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        a: Generalized accelerations, (n,) [m/s^2, rad/s^2].
        known: Generalized forces that are not the air's, (n,) [N, N m], by name: `u1` and
            those of `OPTIONAL_PARTS`. The robot's dampers give `damping_force` where it is not
            among them; the others are zero.
    """
    force, damping = equations.inverse(robot, q, v, a), equations.damping_force(robot, v)
    for one in {"u1": 0, "damping_force": damping, **known}.values():
        force = force - one
    return force


def added_mass_force(
    robot: Robot, model: AddedMass, motion: tuple[ca.SX, ca.SX, ca.SX], wind: ca.SX, numbers: ca.SX
) -> ca.SX:
    """Force of the air that moves with the wings, circulation included, (n, 1) [N, N m].

    Args:
        robot: The machine, its numbers floats or symbols.
        model: Added mass of its wings.
        motion: q, v and a as in `air_force`.
        wind: Velocity of the air, world axes, (3,) [m/s].
        numbers: Parameters of the model, (2,).
    """
    q, v, a = motion
    force = equations.kirchhoff_force(robot, q, v, a, model.inertia(robot, wind, numbers))
    return force + model.circulation_force(robot, q, v, wind, numbers)


class Column(NamedTuple):
    """Column of a packet.

    Attributes:
        name: `time`, or part and coordinate such as `v.roll`.
        unit: Its SI unit.
    """

    name: str
    unit: str


def packet_columns(robot: Robot, carried: Sequence[str] = ()) -> tuple[Column, ...]:
    """Names and units of the numbers of a packet, in order, 1 + n_q + (3 + k) n.

    Args:
        robot: The machine that sends them.
        carried: Which k of `OPTIONAL_PARTS` the packet carries after u1.
    """
    found, per = [Column("time", "s")], {"v": "/s", "a": "/s^2"}
    found += map(Column, [f"q.{name}" for name in robot.coordinate_names], robot.coordinate_units)
    for part in (*PARTS[1:], *carried):
        units = [unit + per[part] for unit in robot.dof_units] if part in per else robot.force_units
        found += map(Column, [f"{part}.{name}" for name in robot.dof_names], units)
    return tuple(found)


def flight_labels(robot: Robot | None) -> dict[str, str]:
    """Units of the numbers that make a log a flight of a robot, by name; none without a robot."""
    return {} if robot is None else {c.name: c.unit for c in packet_columns(robot)[1:]}


def packet_parts(packets: Array, robot: Robot) -> list[Array]:
    """Parts of packets: q, (..., n_q), then v, a, u1 and the known forces, (..., n) each.

    Args:
        packets: (..., 1 + n_q + (3 + k) n).
        robot: The machine that sent them.
    """
    cuts = range(1 + robot.coordinate_count, packets.shape[-1], robot.dof)
    return np.split(packets, [1, *cuts], axis=-1)[1:]


@dataclass(frozen=True)
class SampleForm:
    """Samples for a network, as computed from the motion and the known forces of a robot.

    Args:
        robot: The machine.
        inputs: Names of what the network sees, such as `v.roll`; None: q, then v.
        outputs: Coordinates whose force it learns; None: all.
        carried: Which of `OPTIONAL_PARTS` are measured, in the order of `forces`.
        added_mass: Model of the added mass, in steady wind; None for none, or where its force is
            carried.
        sees_acceleration: Whether a follows the inputs.
        explains_added_mass: Whether y is all that the air does, added mass included.

    Raises:
        ParameterError: If an input or a part has no such name, or added mass is given twice or
            in wind that changes.
    """

    robot: Robot
    inputs: tuple[str, ...] | None = None
    outputs: tuple[str, ...] | None = None
    carried: tuple[str, ...] = ()
    added_mass: AddedMass | None = None
    sees_acceleration: bool = False
    explains_added_mass: bool = False

    def __post_init__(self) -> None:
        unknown = [name for name in self.carried if name not in OPTIONAL_PARTS]
        if unknown or len(set(self.carried)) < len(self.carried):
            expected = f"names among {', '.join(OPTIONAL_PARTS)}, each once"
            raise ParameterError("carried", expected, self.carried)
        if self.added_mass is not None:
            if "added_mass_force" in self.carried:
                raise ParameterError("added_mass", "None where packets carry its force", "a model")
            if self.added_mass.air.gust is not None:
                raise ParameterError("added_mass.air", "steady wind", self.added_mass.air.gust)
        state_columns(self.robot, self.inputs or ())

    @property
    def parameters(self) -> Array:
        """Numbers of the robot and of its added mass, (n_p,)."""
        if self.added_mass is None:
            return np.ascontiguousarray(self.robot.parameters, float)
        air = self.added_mass.air
        return np.concatenate([self.robot.parameters, air.wind, self.added_mass.parameters])

    @cached_property
    def function(self) -> NativeFunction:
        """Compiled (q, v, a, forces, parameters) -> x (n_x,), y (n_y,) [N, N m].

        The forces are u1, then those carried, ((1 + k) n,) [N, N m].
        """
        robot = self.robot
        added = None if self.added_mass is None else self.added_mass.structure
        choices = (self.inputs, self.outputs, self.carried, added)
        flags = (self.sees_acceleration, self.explains_added_mass)
        key = f"samples of the air's force {choices} {flags} {robot.structure}"
        label = f"force of the air on {robot.name}"
        return load_functions(key, lambda: [self._function()], label=label)["air_force"]

    def _function(self) -> ca.Function:
        robot, n = self.robot, self.robot.dof
        machine, p = robot.symbolic()
        q = ca.SX.sym("q", robot.coordinate_count)
        v, a = ca.SX.sym("v", n), ca.SX.sym("a", n)
        forces = ca.SX.sym("forces", (1 + len(self.carried)) * n)
        known = dict(zip(("u1", *self.carried), ca.vertsplit(forces, n), strict=True))
        if self.added_mass is not None:
            more = ca.SX.sym("more", 3 + len(self.added_mass.parameters))
            motion, p = (q, v, a), ca.vertcat(p, more)
            known["added_mass_force"] = added_mass_force(
                machine, self.added_mass, motion, more[:3], more[3:]
            )
        if self.explains_added_mass:
            known.pop("added_mass_force", None)
        x = ca.vertcat(q, v)
        if self.inputs is not None:
            x = x[state_columns(robot, self.inputs)]
        if self.sees_acceleration:
            x = ca.vertcat(x, a)
        y = air_force(machine, q, v, a, known)
        if self.outputs is not None:
            y = y[[robot.index(name) for name in self.outputs]]
        inputs = {"q": q, "v": v, "a": a, "forces": forces, "parameters": p}
        return named_function("air_force", inputs, {"x": x, "y": ca.densify(y)})


def state_names(robot: Robot) -> list[str]:
    """Names of q and v as inputs of a network: `q.roll`, `v.left_plunge`."""
    return [column.name for column in packet_columns(robot)[1 : 1 + robot.state_size]]


def state_columns(robot: Robot, inputs: Sequence[str]) -> list[int]:
    """Columns of named inputs in the state [q, v].

    Args:
        robot: The machine.
        inputs: Names such as `q.roll`, `v.left_plunge`.

    Raises:
        ParameterError: If there is no such name.
    """
    names = state_names(robot)
    for name in inputs:
        if name not in names:
            expected = f"coordinates and velocities of {robot.name}, {names[0]} to {names[-1]}"
            raise ParameterError("inputs", expected, name)
    return [names.index(name) for name in inputs]


@checked
def training_data(
    flight: xr.Dataset, robot: Robot | None = None, *, with_added_mass: bool = False
) -> tuple[Array, Array, Array]:
    """Training data of a flight: states, and the force of the air at each.

    y = D a + C v + G - u1 - damping - mount [paper, eq. training_data]. Added mass that the
    flight was flown with is known inertia and no part of y, which then is a force that the
    state alone can explain.

    Args:
        flight: Record with v, a, u1 (time, dof) [SI] and q, which has a dimension of its own where
            the attitude is a quaternion; `damping_force` is computed from the robot, `mount_force`
            and `added_mass_force` are zero where the record has none.
        robot: The machine; None for the one the flight carries.
        with_added_mass: Whether y is all that the air does, added mass included.

    Returns:
        Time (N,) [s]; x = [q, v], (N, n_x); y = B2 u2, (N, n) [N, N m], NaN where a known force
        is NaN.

    Raises:
        FlightError: If a quantity is missing or of another robot.
        LogError: If a number of the motion is missing, or one is infinite.
    """
    machine = robot_of(flight) if robot is None else robot
    air = ("added_mass_force",) if with_added_mass else ()
    carried = tuple(name for name in OPTIONAL_PARTS if name in flight and name not in air)
    form = SampleForm(machine, carried=carried)
    q, v, a, u1, *others = (recorded(flight, name, machine) for name in (*PARTS, *carried))
    x, y = form.function.batch(q, v, a, np.hstack([u1, *others]), form.parameters)
    count, time = len(q), rising(flight["time"].values)
    return time, np.array(x).reshape(count, -1), np.array(y).reshape(count, -1)


def recorded_wind_change(flight: xr.Dataset) -> Array | None:
    """Change of the recorded wind from its steady part, (N, 3) [m/s], world axes; None: no change.

    Raises:
        FlightError: If the wind is no vector over time in m/s.
        LogError: If a number of it is missing.
    """
    if "wind" not in flight:
        return None
    wind = flight["wind"]
    unit = wind.attrs.get("units", "m/s")
    if {*wind.dims} != {"time", "axis"} or unit != "m/s":
        raise FlightError("wind", "(time, axis) in m/s", f"{wind.dims} in {unit}")
    change = real_array("wind", wind.transpose("time", "axis").values, ("N", 3))
    change = change - air_of(flight).wind
    if not np.isfinite(change).all():
        at = float(flight["time"][int(np.argmin(np.isfinite(change).all(axis=1)))])
        raise LogError("wind", "finite numbers", f"one that is not at t = {at:.6g} s")
    return change if change.any() else None


def relative_to_wind(
    x: Array, change: Array, robot: Robot, inputs: Sequence[str] | None = None
) -> Array:
    """Inputs of a network with base velocities relative to the wind, (N, n_x) [units of x].

    Air that is the same everywhere acts on a robot by its velocity relative to it, so that a
    network for steady wind serves. Neglected: the push of the wind's rate on the air's inertia.

    Args:
        x: q and v, or the named ones, and what else follows, (N, n_x) [units of x].
        change: Wind less the steady one, (N, 3) or (3,) [m/s].
        robot: The machine.
        inputs: Names of what the network sees, such as `v.x`; None: q, then v.
    """
    names = state_names(robot) if inputs is None else list(inputs)
    x = np.array(x)
    for body in robot.floating_bodies.values():
        for axis, dof in enumerate((body.floating_dofs or ())[:3]):
            name = f"v.{robot.dof_names[dof]}"
            if name in names:
                x[:, names.index(name)] -= change[..., axis]
    return x


def recorded(flight: xr.Dataset, name: str, robot: Robot) -> Array:
    """Recorded quantity of a flight, (N, n_q) for q and (N, n) for the others; forces may be NaN.

    Raises:
        FlightError: If it is missing or of another robot.
        LogError: If a number of the motion is missing, or one is infinite.
    """
    (dim,) = quantities(robot)[name].dims
    names = robot.coordinate_names if name == "q" else robot.dof_names
    for part in ("time", name):
        if part not in flight.variables:
            held = ", ".join(map(str, flight.variables))
            raise FlightError(
                f"flight: expected the quantity `{part}` over (time, {dim}), but it holds {held}"
            )
    if {*flight[name].dims} != {"time", dim}:
        raise FlightError(name, f"(time, {dim})", flight[name].dims)
    check_labels(flight, robot)
    values = real_array(name, flight[name].transpose("time", dim).values, ("N", len(names)))
    missing = np.isnan(values) if name in (PARTS[3], *OPTIONAL_PARTS) else False
    bad = np.flatnonzero(~(np.isfinite(values) | missing).all(axis=1))
    if len(bad):
        first = float(flight["time"][bad[0]])
        found = f"{len(bad)} samples that are not, the first at t = {first:.6g} s"
        raise LogError(name, "finite numbers", found)
    return values
