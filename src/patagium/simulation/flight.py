"""The record of a flight: one named, united array per quantity, its audits and its file.

A flight is an `xarray.Dataset`; its attributes hold the robot, the air and the gait
it was flown with, and from them these are made again. The audits compare what energy and
momentum did with the works and impulses that should explain it. Files are netCDF4, written
whole or not at all, checked when read, and compressed: a flight of 1 s at 1e-4 s takes about
6 MB. Flow at the strips is stored in single precision, all else in double.
Neglected: sensors; all values are the true ones.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isclose
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from patagium.aerodynamics import AddedMass, Aerodynamics, Air, LiftingLine
from patagium.aerodynamics.added_mass import added_mass_from_description
from patagium.aerodynamics.air import air_from_description
from patagium.aerodynamics.description import aero_from_description
from patagium.arguments import checked, of_kind
from patagium.arrays import Array, rising, stored
from patagium.dynamics.dynamics import poses_at
from patagium.errors import FlightError, LogError, Outcome, ParameterError, positive
from patagium.netcdf_file import kind_of, loaded_dataset, netcdf_content, write_netcdf
from patagium.reading import json_object, json_ready, made_again, parsed_json
from patagium.robot import Robot
from patagium.robot.files import robot_attributes, robot_of_text
from patagium.robot.strip_chains import chain_words
from patagium.scratch import release
from patagium.simulation.arm import Tool, track_tool
from patagium.simulation.flight_equations import LOAD_CELLS, STRIP_WIND
from patagium.simulation.gaits import Gait
from patagium.simulation.mounts import InternalLoadCell
from patagium.simulation.state_layout import ADDED_WORK, WORKS
from patagium.version import __version__

AXES = ("x", "y", "z")
WRENCH = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")


@dataclass(frozen=True)
class Quantity:
    """A variable of a flight.

    Attributes:
        dims: Dimensions after time.
        units: SI units; of coordinates that turn after those of coordinates that slide. Empty
            where the model of the air decides.
        meaning: Description.
    """

    dims: tuple[str, ...]
    units: str
    meaning: str


_FORCE = "N or N m"
QUANTITIES: dict[str, Quantity] = {
    "q": Quantity(("dof",), "m or rad", "generalized coordinates"),
    "v": Quantity(("dof",), "m/s or rad/s", "generalized velocities"),
    "a": Quantity(("dof",), "m/s^2 or rad/s^2", "generalized accelerations"),
    "u1": Quantity(("dof",), _FORCE, "force of the actuated joints"),
    "aero_force": Quantity(("dof",), _FORCE, "generalized aerodynamic force B2 u2"),
    "damping_force": Quantity(("dof",), _FORCE, "force of the passive dampers"),
    "mount_force": Quantity(("dof",), _FORCE, "generalized force of the mount"),
    "added_mass_force": Quantity(
        ("dof",), _FORCE, "generalized force of added mass, circulation's part included, if modeled"
    ),
    "mount_wrench": Quantity(
        ("component",), _FORCE, "force of the mount on the robot, moment about the world's origin"
    ),
    "strip_force": Quantity(("strip", "axis"), "N", "force on each strip, world axes"),
    "strip_point": Quantity(("strip", "axis"), "m", "where it acts, world axes"),
    "angle_of_attack": Quantity(
        ("strip",), "rad", "geometric incidence of each strip: of its motion through the wind"
    ),
    "strip_airspeed": Quantity(("strip",), "m/s", "speed of each strip relative to the air"),
    "circulation": Quantity(("strip",), "m^2/s", "bound circulation of each strip, if modeled"),
    "downwash": Quantity(
        ("strip",), "m/s", "velocity the wings induce at each strip, against its normal, if modeled"
    ),
    "wind": Quantity(("axis",), "m/s", "velocity of the air, mean over the wings, world axes"),
    "kinetic_energy": Quantity((), "J", "kinetic energy"),
    "potential_energy": Quantity((), "J", "potential energy of gravity and of springs"),
    "joint_work": Quantity((), "J", "work of the actuated joints since the start"),
    "air_work": Quantity((), "J", "work of the air since the start"),
    "damping_work": Quantity((), "J", "work of the passive dampers since the start"),
    "mount_work": Quantity((), "J", "work of the mount since the start"),
    "added_mass_work": Quantity(
        (), "J", "work of the air carried along since the start; circulation's part is in air_work"
    ),
    "fluid_energy": Quantity((), "J", "energy of the air that moves with the wings, if modeled"),
    "energy_residual": Quantity((), "J", "change of energy less all works"),
    "aero_power": Quantity((), "W", "force of the air times velocity relative to the air"),
    "momentum": Quantity(("axis",), "kg m/s", "linear momentum, world axes"),
    "fluid_momentum": Quantity(
        ("axis",), "kg m/s", "momentum of the air that moves with the wings, if modeled"
    ),
    "momentum_residual": Quantity(
        ("axis",), "kg m/s", "change of momentum less the impulse of external forces"
    ),
    "aero_state": Quantity(("lag",), "", "states of the aerodynamic model"),
}
"""Every variable of a flight, where q and v have the same names."""
COMMAND = "command"
"""Name of what a controller commanded of the gait."""
WINGBEATS = "wingbeats"
"""Name of the wingbeats since the start of a gait that was steered."""
GIVEN = "given"
"""Samples of the energy and momentum that changes of the machine gave, (N, 4) [J, kg m/s]."""
MASS = "mass"
"""Name of the mass that flies, of flights in which it changed."""
OPTIONAL: dict[str, Quantity] = {
    MASS: Quantity((), "kg", "mass that flies: a payload or a loss changed it"),
    "effective_angle_of_attack": Quantity(
        ("strip",),
        "rad",
        "incidence of the chord with the lag and the downwash of the wake, if modeled",
    ),
    COMMAND: Quantity(
        ("command_name",), "Hz, rad, m or 1", "what was commanded of the gait, held between"
    ),
    WINGBEATS: Quantity((), "1", "wingbeats of the steered gait since the start"),
    LOAD_CELLS: Quantity(
        ("load_cell", "component"),
        _FORCE,
        "force and moment through each load cell on what it holds, axes and origin of the cell",
    ),
    STRIP_WIND: Quantity(
        ("strip", "axis"),
        "m/s",
        "wind each strip answers to in shear or a gust that travels, world axes",
    ),
}
"""Variables that a flight need not have, such as those that older versions lack."""
SINGLE = (
    "strip_point",
    "angle_of_attack",
    "effective_angle_of_attack",
    "strip_airspeed",
    "circulation",
    "downwash",
)
"""What files hold in single precision (relative error 6e-8): it follows from the rest, and neither
learning nor an audit reads it."""

_TIME = {"time": Quantity((), "s", "time")}
_Q_WITH_QUATERNION = Quantity(("coordinate",), "m, rad or 1", "generalized coordinates")


def quantities(robot: Robot) -> dict[str, Quantity]:
    """Every variable of a robot's flight.

    With a quaternion q has a dimension of its own, `coordinate`, for it is longer than v.
    """
    longer = robot.attitude == "quaternion"
    return QUANTITIES | ({"q": _Q_WITH_QUATERNION} if longer else {})


ATTRIBUTES = ("robot", "robot_name", "aero", "gait", "mount", "time_step", "outcome")
"""Attributes that a flight must carry to be used again."""


@dataclass(frozen=True)
class FlightOrigin:
    """Robot, air, gait, mount and integrator of a flight.

    Attributes:
        robot: The machine.
        aero: Model of the air around it.
        gait: Description of the gait.
        mount: Kind of mount that held it.
        time_step: Step of the integrator [s].
        stepping: The integrator, in words.
        added_mass: Inertia of the air that moved with it, or None.
        mount_path: Description of the path it was carried along, or None.
        load_cells: Load cells.
        commands: Names of what was commanded of the gait.
    """

    robot: Robot
    aero: Aerodynamics
    gait: Mapping[str, Any]
    mount: str
    time_step: float
    stepping: str
    added_mass: AddedMass | None = None
    mount_path: Mapping[str, Any] | None = None
    load_cells: tuple[InternalLoadCell, ...] = ()
    commands: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        robot_attributes(self.robot)  # a flight that cannot be read is not flown


def flight_record(
    origin: FlightOrigin, time: Array, samples: Mapping[str, Array], outcome: Outcome, message: str
) -> xr.Dataset:
    """Flight from the samples of a run, audits included.

    Args:
        origin: Robot, air, gait, mount and integrator.
        time: Times of the samples, (N,) [s].
        samples: Quantities of `flight_equations.RECORDED` and `wind`, (N, ...) each [SI]; with
            added mass those of `RECORDED_WITH_ADDED_MASS`; of a machine that changed `GIVEN`.
        outcome: Outcome of the run.
        message: Outcome in words.
    """
    values = dict(samples)
    works = values.pop("works").T
    values |= dict(zip((*WORKS, ADDED_WORK)[: len(works)], works, strict=True))
    impulse = values.pop("impulse")
    energy = (values["kinetic_energy"] + values["potential_energy"])[:, 0]
    given = values.pop(GIVEN, np.zeros((len(time), 4)))
    values["energy_residual"] = (energy - energy[0]) - works.sum(axis=0) - given[:, 0]
    momentum = values["momentum"] - given[:, 1:].reshape(values["momentum"].shape)
    values["momentum_residual"] = momentum - values["momentum"][0] - impulse
    coordinates = _coordinates(origin, time)
    sizes = {dim: len(labels[1]) for dim, labels in coordinates.items()}
    sizes["lag"] = origin.aero.state_size

    def variable(name: str, kind: Quantity) -> tuple[tuple[str, ...], Array, dict[str, str]]:
        dims = ("time", *kind.dims)
        shape = [sizes[dim] for dim in dims]
        shaped = values[name].reshape(shape) if name in values else np.zeros(shape)
        units = kind.units or " or ".join(dict.fromkeys(origin.aero.state_units)) or "m/s"
        attributes = {"units": units, "long_name": kind.meaning}
        return dims, np.ascontiguousarray(shaped), attributes

    flight = xr.Dataset(
        {
            name: variable(name, kind)
            for name, kind in (quantities(origin.robot) | OPTIONAL).items()
            if name in QUANTITIES or name in values
        },
        coords=coordinates,
        attrs=_origin_attributes(origin),
    )
    flight.attrs |= {"outcome": outcome.name, "message": message, **audits(flight, origin.robot)}
    return flight


def audits(flight: xr.Dataset, robot: Robot) -> dict[str, float]:
    """Largest residuals of a flight, stored among its attributes.

    Returns:
        energy_exchanged [J]: integral of the absolute powers of joints, air (or relative to it
        where that is more), dampers, mount, springs and weight. impulse_exchanged [N s]:
        integral of the absolute forces of air, dampers, mount and weight. energy_audit,
        momentum_audit: largest residuals relative to them.
        fluid_energy_audit: largest change of the carried air's energy that its work does not
        explain, relative likewise; a gust shows in it, its rate is not part of added mass.
        aero_power_largest [W]: not above zero if the air opposes motion relative to it.
    """
    energy = impulse = 0.0
    for first in range(0, max(flight.sizes["time"] - 1, 1), _BLOCK):
        more = _exchanged(flight.isel(time=slice(first, first + _BLOCK + 1)), robot)
        energy, impulse = energy + more[0], impulse + more[1]
    residual = np.abs(stored(flight, "energy_residual")).max()
    fluid = stored(flight, "fluid_energy")
    unexplained = np.abs(fluid - fluid[0] + stored(flight, "added_mass_work")).max()
    drift = np.linalg.norm(stored(flight, "momentum_residual"), axis=1).max()
    return {
        "energy_exchanged": energy,
        "impulse_exchanged": impulse,
        "energy_audit": float(residual / (energy or 1.0)),
        "fluid_energy_audit": float(unexplained / (energy or 1.0)),
        "momentum_audit": float(drift / (impulse or 1.0)),
        "aero_power_largest": float(stored(flight, "aero_power").max()),
    }


_BLOCK = 1 << 16  # samples whose powers and forces are summed at once


def _exchanged(flight: xr.Dataset, robot: Robot) -> tuple[float, float]:
    """Energy [J] and impulse [N s] exchanged in a part of a flight."""
    time = stored(flight, "time")
    velocity = stored(flight, "v")
    names = ("u1", "aero_force", "damping_force", "mount_force", "added_mass_force")
    forces = [stored(flight, name) for name in names]
    powers = [np.abs((force * velocity).sum(axis=1)) for force in forces]
    powers[1] = np.maximum(powers[1], np.abs(stored(flight, "aero_power")))  # held in a wind
    gravity = float(robot.gravity)
    lifting = gravity * stored(flight, "momentum")[:, 2]
    strips, mount = (stored(flight, name) for name in ("strip_force", "mount_wrench"))
    pushes = strips.sum(axis=1), mount[:, :3]
    weight = gravity * flying_mass(flight, robot)
    pushed = weight + sum(np.linalg.norm(f, axis=1) for f in pushes)
    for used in (velocity, *forces, strips, mount):
        release(used)
    energy = float(np.trapezoid(np.abs(lifting) + sum(powers), time))
    if robot.stiffness:  # what is stored and is not of the weight
        risen = np.diff(time) * (lifting[1:] + lifting[:-1]) / 2
        kept = np.diff(stored(flight, "potential_energy"))
        energy += float(np.abs(kept - risen).sum())
    return energy, float(np.trapezoid(pushed, time))


def flying_mass(flight: xr.Dataset, robot: Robot) -> Array:
    """Mass that flies, (N,) [kg]: that of its robot but where a payload or a loss changed it."""
    if MASS in flight:
        return stored(flight, MASS)
    return np.full(flight.sizes["time"], robot.flying.mass)


def robot_of(flight: xr.Dataset, name: str = "flight", late: bool = False) -> Robot:
    """The robot a flight was flown with, its parameters as they were.

    Args:
        flight: The record.
        name: What to call it in errors.
        late: Whether samples may come after later ones, as in a stream.

    Raises:
        FlightError: If the flight does not carry it, or its coordinates or strips are not the
            robot's, or time does not rise.
    """
    _require(flight, ("robot", "robot_name"))
    with made_again("the flight's robot", FlightError):
        robot = robot_of_text(str(flight.attrs["robot"]), str(flight.attrs["robot_name"]))
    check_labels(flight, robot, name)
    try:
        time = flight.coords.get("time")
        if late or time is None or (time.ndim and rising(time).size):
            return robot
    except (LogError, ParameterError) as problem:
        raise FlightError(f"{name}: time does not rise: {problem}") from None
    raise FlightError(name, "samples", "none")


def check_labels(flight: xr.Dataset, robot: Robot, name: str = "flight") -> None:
    """Refuse a record with other coordinates, strips or axes than a robot's, or in other units.

    Args:
        flight: The record; labels and units that it does not state are not checked.
        robot: The machine.
        name: What to call it in errors.

    Raises:
        FlightError: If they are others.
    """
    known = {
        "dof": robot.dof_names,
        "coordinate": robot.coordinate_names,
        "strip": tuple(strip.name for strip in robot.strips),
        "axis": AXES,
    }
    for dim, labels in known.items():
        found = tuple(map(str, np.ravel(flight[dim] if dim in flight.coords else labels)))
        if found != labels:
            expected = f"expected {len(labels)} {'strips' if dim == 'strip' else 'coordinates'}"
            told = f"{len(found)}: {', '.join(found)} in place of {', '.join(labels)}"
            raise FlightError(f"{name}: {dim}: {expected} of robot {robot.name!r}, found {told}")
    for quantity, kind in (_TIME | quantities(robot) | OPTIONAL).items():
        held = flight.variables.get(quantity)
        if held is not None and {*held.dims} == {"time", *kind.dims} and kind.units:
            stated = held.attrs.get("units", kind.units)
            if stated != kind.units:
                raise FlightError(f"{name}: {quantity}", f"[{kind.units}]", f"[{stated}]")


def aero_of(flight: xr.Dataset) -> Aerodynamics:
    """Aerodynamic model of a flight.

    Raises:
        FlightError: If the flight does not carry it.
    """
    robot = robot_of(flight)
    _require(flight, ("aero",))
    with made_again("the flight's air", FlightError):
        return aero_from_description(robot, aero_words(flight))


def aero_words(flight: xr.Dataset) -> dict[str, Any]:
    """Description of a flight's aerodynamic model; empty where it carries none.

    Raises:
        FlightError: If it is no description.
    """
    with made_again("the flight's air", FlightError):
        return json_object(flight.attrs.get("aero", "{}"), "aero")


def air_of(flight: xr.Dataset) -> Air:
    """Air of a flight: that of its aerodynamic model, or that which a log states.

    At rest at sea level where the flight carries neither.
    """
    if "air" not in flight.attrs and "aero" in flight.attrs:  # a log has no model
        return aero_of(flight).air
    with made_again("the log's air", FlightError):
        stated = json_object(flight.attrs.get("air", "{}"), "air")
        return air_from_description(Air().describe() | stated)


def added_mass_of(flight: xr.Dataset) -> AddedMass | None:
    """The added mass a flight was flown with, or None.

    Raises:
        FlightError: If the flight does not carry it.
    """
    robot = robot_of(flight)
    with made_again("the flight's added mass", FlightError):
        description = parsed_json(flight.attrs.get("added_mass", "null"), "added_mass")
        return None if description is None else added_mass_from_description(robot, description)


def gait_period(flight: xr.Dataset) -> float | None:
    """Time of one wingbeat [s]; None if the flight's gait has none.

    Args:
        flight: Record whose attribute `gait` describes the gait; of its parts the slowest counts.
    """
    _require(flight, ())
    with made_again("the period of the flight's gait", FlightError):
        return _period(json_object(flight.attrs.get("gait", "{}"), "gait"))


def described_gait(gait: Gait) -> dict[str, Any]:
    """Description of a gait, with its period where its own words do not tell it [s]."""
    words: dict[str, Any] = json_ready(gait.describe())
    told = _period(words)
    same = told is not None and gait.period is not None and isclose(told, gait.period)
    return words if same or not gait.period else {**words, "period": float(gait.period)}


def _period(gait: Mapping[str, Any]) -> float | None:
    if gait.get("period"):
        return positive("period", gait["period"])
    if gait.get("frequency"):
        return positive("period", 1.0 / gait["frequency"])
    if "time" in gait:
        return positive("period", gait["time"][-1] - gait["time"][0])
    return max(filter(None, map(_period, gait.get("parts", ()))), default=None)


def _require(flight: xr.Dataset, names: Sequence[str], name: str = "the flight") -> None:
    of_kind("flight", flight, xr.Dataset)
    missing = [attribute for attribute in names if attribute not in flight.attrs]
    if missing:
        table = "; `pt.sensing.read_table` reads a log without one" * ("findings" in flight.attrs)
        raise FlightError(f"{name} has no attribute {', '.join(missing)}{table}")


def _coordinates(origin: FlightOrigin, time: Array) -> dict[str, Any]:
    robot, aero = origin.robot, origin.aero
    quaternion = robot.attitude == "quaternion"
    labels: dict[str, Sequence[str]] = {
        "dof": robot.dof_names,
        "dof_unit": robot.dof_units,
        "coordinate": robot.coordinate_names * quaternion,
        "coordinate_unit": robot.coordinate_units * quaternion,
        "strip": [strip.name for strip in robot.strips],
        "axis": AXES,
        "component": WRENCH,
        "lag": aero.state_names,
        "lag_unit": aero.state_units,
        "load_cell": [cell.at for cell in origin.load_cells],
        "command_name": origin.commands,
    }
    named = {name: (name.removesuffix("_unit"), list(own)) for name, own in labels.items()}
    there = {name: one for name, one in named.items() if one[1] or name == "strip"}
    return {"time": ("time", time, {"units": "s", "long_name": "time"}), **there}


def _origin_attributes(origin: FlightOrigin) -> dict[str, Any]:
    robot, added_mass = origin.robot, origin.added_mass
    aero = json.dumps(json_ready(origin.aero.describe()))
    return {
        **robot_attributes(robot),
        "aero": aero,
        "added_mass": json.dumps(None if added_mass is None else added_mass.describe()),
        "gait": json.dumps(origin.gait),
        "mount": origin.mount,
        "mount_path": json.dumps(origin.mount_path),
        "load_cells": json.dumps([cell.describe() for cell in origin.load_cells]),
        "time_step": origin.time_step,
        "stepping": origin.stepping,
        "lifting_lines": chain_words(robot) if f'"{LiftingLine.name}"' in aero else "",
        "patagium_version": __version__,
    }


_KNOTS = 1000  # samples at which the arm is followed one by one; between them all at once


class Carrier(NamedTuple):
    """An arm and what it did.

    Attributes:
        arm: The arm, on the world.
        at: Body that holds the robot.
        position: Position of the robot on it, in its axes, (3,) [m].
        q: Joint positions at every sample of the flight, (N, 6) [rad, m].
    """

    arm: Robot
    at: str
    position: Array
    q: Array


def carrier_of(flight: xr.Dataset) -> Carrier | None:
    """The arm that carried the robot of a flight; None if none did.

    Args:
        flight: Record of a robot, on an arm or not.

    Raises:
        FlightError: If the flight tells an arm that cannot be made again, or that could not
            hold the robot where it was.
    """
    with made_again("the flight's arm", FlightError):
        told: Any = parsed_json(flight.attrs.get("mount_path", "null"), "mount_path")
        if flight.attrs.get("mount") != "arm" or not told or "arm" not in told:
            return None
        words = told["arm"]
        arm = robot_of_text(words["source"], words["name"])
        tool = Tool(arm, words["at"], tuple(words["position"]), tuple(words["orientation"]))
        time = stored(flight, "time")
        start = np.array(words["start"], float)
        robot = robot_of(flight)
        position, rotation = poses_at(robot, stored(flight, "q"))
        held = next(iter(robot.floating_bodies))
        placed = position[:, held], rotation[:, held]
        q = track_tool(tool, time, placed, start, _KNOTS)
        return Carrier(arm, words["at"], np.array(words["position"], float), q)


@checked
def save_flight(flight: xr.Dataset, path: str | Path) -> Path:
    """Write a flight as netCDF4; an interrupted write leaves the former file.

    Args:
        flight: The flight.
        path: The file, replaced if it exists, in a folder that is there.

    Returns:
        The path.

    Raises:
        FlightError: If the flight misses a quantity.
        OutputError: If the file cannot be written.
    """
    check_flight(flight, "flight")
    single = [name for name in SINGLE if name in flight]
    return write_netcdf(path, flight, single=single, compressed=True)


@checked
def load_flight(path: str | Path) -> xr.Dataset:
    """Flight from a netCDF4 file, read and checked.

    Args:
        path: A netCDF4 file written by `save_flight`.

    Returns:
        The flight, in memory; the file is closed.

    Raises:
        FlightError: If there is no such file, or it is not a whole flight. An imported log is
            read by `load_log`.
    """
    path = Path(path)
    flight = loaded_dataset(path, FlightError, "a flight such as patagium simulate writes")
    found = kind_of(path)
    if found and not found.startswith("a flight"):
        raise FlightError(path, "a simulated flight", found)
    with netcdf_content(path, FlightError, "a whole flight"):
        for name in SINGLE:
            if name in flight and flight[name].dtype == np.float32:
                flight[name].variable.data = flight[name].values.astype(np.float64)
        check_flight(flight, str(path))
    return flight


def check_flight(flight: xr.Dataset, name: str) -> None:
    """Refuse a record that is not a whole flight.

    Args:
        flight: The record.
        name: What to call it in errors.

    Raises:
        FlightError: If a quantity, attribute or coordinate is missing, has other
            dimensions or units, time does not rise, the state is not finite, or the
            coordinates are not its robot's.
    """
    missing = [k for k in ("time", "dof", "strip", "axis", *QUANTITIES) if k not in flight]
    if missing:
        raise FlightError(f"{name}: no {', '.join(missing)}: not a whole flight")
    _require(flight, ATTRIBUTES, name)
    for quantity, kind in (quantities(robot_of(flight, name)) | OPTIONAL).items():
        if quantity not in flight:
            continue  # only what is optional may be missing here
        variable = flight[quantity]
        for expected, found in (
            (("time", *kind.dims), variable.dims),
            *[(f"[{kind.units}]", f"[{variable.attrs.get('units')}]")] * bool(kind.units),
            (np.dtype(float), variable.dtype),
        ):
            if found != expected:
                raise FlightError(f"{name}: {quantity}", expected, found)
    time = stored(flight, "time")
    for state in ("q", "v"):
        values = stored(flight, state)
        if not np.isfinite(values).all():
            first = time[~np.isfinite(values).all(axis=1)][0]
            raise FlightError(f"{name}: {state} is not finite at t = {first:g} s")
