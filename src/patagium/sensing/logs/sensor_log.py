"""Sensor log of an imported log: from named quantities to encoders, cameras and inertial units.

The unit and the shape of a quantity tell what measured it, its name where: an attitude and a
position are motion capture, a specific force and an angular rate an inertial unit, an angle with
the name of a joint an encoder, a force or moment with it the joint's, a force and a moment in
space a load cell. The noise of the sensors is left to `estimate_motion`, which learns it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from patagium.aerodynamics import RecordedGust
from patagium.arguments import checked
from patagium.arrays import Array, median_step, stored
from patagium.errors import LogError, ParameterError
from patagium.robot import Robot, load_robot
from patagium.sensing.force.air_force import PARTS, flight_labels, recorded, recorded_wind_change
from patagium.sensing.logs.record import load_log
from patagium.sensing.sensors import (
    Encoder,
    Imu,
    LoadCell,
    MotionCapture,
    MotorCurrent,
    Sensor,
    SensorLog,
    as_quaternion,
)
from patagium.simulation import air_of, robot_of

_VECTORS = {
    "m": "position",
    "m/s^2": "specific_force",
    "rad/s": "angular_rate",
    "N": "force",
    "N m": "moment",
}
"""Quantities with three components, by their unit."""


@checked
def sensor_log(
    log: str | Path | xr.Dataset,
    robot: Robot | str | None = None,
    *,
    bodies: Mapping[str, str] | None = None,
) -> SensorLog:
    """Sensors and their readings in an imported log, for `estimate_motion`.

    Attitudes with positions become motion capture, specific forces with angular rates inertial
    units, angles named after joints an encoder, their forces motor currents of one newton metre
    per ampere, and a force with a moment a load cell. A quantity belongs to the body whose name is
    in its own, else to the floating body. A vector named `wind` is the air's, in the world.

    Args:
        log: File that `patagium import` wrote, or what `load_log` makes of it.
        robot: The machine, or its name or file; None for the one that the mapping named.
        bodies: Body of each quantity whose name does not tell, by name of the quantity.

    Returns:
        The sensor log; `quantities` among the attributes of each reading names what it was made of.

    Raises:
        LogError: If the log has no quantity that tells of motion, one of a pair is missing, or a
            coordinate has another unit than its own.
        ParameterError: If no robot is given, or `bodies` names a quantity that is not there.
    """
    table = log if isinstance(log, xr.Dataset) else load_log(log)
    machine = _machine(table, robot)
    table = _by_coordinate(table, machine)
    if "time" not in table:
        raise LogError("log", "a variable `time` [s]", "none")
    given = dict(bodies or {})
    for name, body in given.items():
        if name not in table:
            held = ", ".join(map(str, table.data_vars))
            raise ParameterError("bodies", f"quantities among {held}", name)
        machine.body_index(body)
    found = _Found(machine, table, stored(table, "time"))
    units = flight_labels(machine)
    for name in map(str, table.data_vars):
        unit = str(table[name].attrs.get("units", ""))
        if unit != units.get(name, unit):
            raise LogError(name, f"a quantity in {units[name]}", f"one in {unit!r}")
        _place(found, name, table[name], given.get(name))
    readings, sensors = found.sensors()
    if not readings:
        held = ", ".join(f"{name} [{table[name].attrs.get('units', '')}]" for name in table)
        raise LogError(
            "log: expected an attitude with a position, a specific force with an angular rate, or "
            f"angles named after joints of {machine.name} ({', '.join(machine.dof_names[:8])}), "
            f"found {held}"
        )
    mount = "load cell" * any(isinstance(sensor, LoadCell) for sensor in sensors.values())
    air, change = air_of(table), recorded_wind_change(table)
    if change is not None:
        air = replace(air, gust=RecordedGust(found.time, change))
    return SensorLog(readings, sensors, {}, machine, mount, air)


_GROUPS: tuple[tuple[str, str, str, Any, dict[str, float]], ...] = (
    ("position", "attitude", "cameras", MotionCapture, {}),
    (
        *("specific_force", "angular_rate", "inertial unit", Imu),
        {"accelerometer_bias": 0.2, "gyroscope_bias": 0.02},
    ),
    ("force", "moment", "load cell", LoadCell, {}),
)
"""Two quantities of a body that one sensor measures, with its name, kind and known errors."""


@dataclass
class _Found:
    """Quantities found so far, each with its name and values.

    Attributes:
        robot: The machine.
        table: The log, whose quantities may state their median step and rounding in the log that
            was imported.
        time: Stamps of the log, (N,) [s].
        bodies: Quantities of each body, by their kind.
        joints: Angles of joints by name.
        efforts: Forces of joints by name.
    """

    robot: Robot
    table: xr.Dataset
    time: Array
    bodies: dict[str, dict[str, tuple[str, Array]]] = field(default_factory=dict)
    joints: dict[str, tuple[str, Array]] = field(default_factory=dict)
    efforts: dict[str, tuple[str, Array]] = field(default_factory=dict)

    def sensors(self) -> tuple[dict[str, xr.Dataset], dict[str, Sensor]]:
        """Readings and sensors by name."""
        step = median_step(self.time)
        readings: dict[str, xr.Dataset] = {}
        sensors: dict[str, Sensor] = {}

        def add(sensor: Sensor, parts: Mapping[str, tuple[str, Array]], names: list[str]) -> None:
            """Add a sensor, at its own rate: interpolated samples are no new measurements."""
            facts = [self.table[name].attrs for name in names]
            longest = max(float(fact.get("step_in_log", 0.0)) for fact in facts)
            every = max(1, ceil(longest / step - 0.1))
            coarse = [float(fact.get("rounding_in_log", 0.0)) for fact in facts]
            rounded = [coarse] if len(parts) == 1 else [[one] for one in coarse]
            readings[sensor.name] = xr.Dataset(
                {
                    part: (("time", dim), values[::every], {"rounding": max(coarse)})
                    for (part, (dim, values)), coarse in zip(parts.items(), rounded, strict=False)
                },
                coords={"time": ("time", self.time[::every], {"units": "s"})},
                attrs={"quantities": names},
            )
            sensors[sensor.name] = replace(sensor, rate=1.0 / (every * step))

        self._take_base_pose()
        for one, other, word, kind, facts in _GROUPS:
            for body, seen in self.bodies.items():
                missing = [part for part in (one, other) if part not in seen]
                if len(missing) == 2:
                    continue
                if missing:
                    (here,) = seen.keys() & {one, other}
                    raise LogError(
                        f"{seen[here][0]}: expected {missing[0].replace('_', ' ')} of {body} to go "
                        "with it; add its field to the mapping"
                    )
                (name, first), (also, second) = seen[one], seen[other]
                parts = {one: ("axis", first), other: ("axis", second)}
                if kind is LoadCell:
                    parts = {"wrench": ("component", np.hstack([first, second]))}
                elif kind is MotionCapture:
                    parts = {one: ("axis", first), "quaternion": ("part", second)}
                sensor = kind(name=f"{word} of {body}", rate=1.0 / step, body=body, **facts)
                add(sensor, parts, [name, also])
        motors = partial(MotorCurrent, torque_constant=1.0)
        units = dict(zip(self.robot.dof_names, self.robot.dof_units, strict=True))
        turns = {name: one for name, one in self.joints.items() if units[name] == "rad"}
        slides = {name: one for name, one in self.joints.items() if name not in turns}
        for part, word, make, found in (
            ("position", "encoders", Encoder, turns),
            ("position", "slides", Encoder, slides),
            ("current", "joint forces", motors, self.efforts),
        ):
            if found:
                labels, columns = zip(*found.values(), strict=True)
                sensor = make(name=word, rate=1.0 / step, joints=tuple(found))
                add(sensor, {part: ("joint", np.column_stack(columns))}, [*labels])
        return readings, sensors

    def _take_base_pose(self) -> None:
        """Add the pose of each floating body whose six coordinates the log has."""
        for body in self.robot.bodies:
            names = [self.robot.dof_names[i] for i in body.floating_dofs or ()]
            if not names or not set(names) <= set(self.joints):
                continue
            columns = [self.joints.pop(name) for name in names]
            place = np.column_stack([values for _, values in columns[:3]])
            angles = np.column_stack([values for _, values in columns[:2:-1]])
            turn = as_quaternion(Rotation.from_euler("ZYX", angles))
            pose = self.bodies.setdefault(body.name, {})
            pose.setdefault("position", (columns[0][0], place))
            pose.setdefault("attitude", (columns[3][0], turn))


def _machine(log: xr.Dataset, robot: Robot | str | None) -> Robot:
    if isinstance(robot, Robot):
        return robot
    if robot is not None:
        return load_robot(robot)
    if "robot" in log.attrs:
        return robot_of(log)
    raise ParameterError("robot", "a robot: the mapping of the log named none", None)


def _by_coordinate(table: xr.Dataset, robot: Robot) -> xr.Dataset:
    """Log of a flight with one quantity for each coordinate, such as `q.roll`, as it was named."""
    if not set(PARTS) <= set(table) or "dof" not in table.dims:
        return table
    units, single = flight_labels(robot), dict[str, Any]()
    for part in PARTS:
        names = robot.coordinate_names if part == "q" else robot.dof_names
        for name, values in zip(names, recorded(table, part, robot).T, strict=True):
            label = f"{part}.{name}"
            single[label] = ("time", values, {"units": units[label]})
    return table.drop_vars(PARTS).assign(single)


def _place(found: _Found, name: str, values: xr.DataArray, body: str | None) -> None:
    """Put a quantity with what measured it; one that tells nothing of motion is left out."""
    if values.ndim > 2:  # of strips
        return
    unit = str(values.attrs.get("units", ""))
    numbers = np.asarray(values.transpose("time", ...).values, float)
    where, dim = body or body_in(name, found.robot), values.dims[-1]
    if dim in ("axis", "quaternion"):
        kind = "attitude" if dim == "quaternion" else _VECTORS.get(unit)
        if kind is not None and where is not None:
            _add_one(found.bodies.setdefault(where, {}), kind, f"{kind} of {where}", name, numbers)
        return
    joint = name.replace("[", ".").replace("]", "").replace("/", ".").rpartition(".")[2]
    if joint not in found.robot.dof_names or name.startswith(("v.", "a.")):
        return
    place = found.robot.index(joint)
    if unit == found.robot.dof_units[place]:
        _add_one(found.joints, joint, f"position of {joint}", name, numbers)
    elif unit == found.robot.force_units[place] and place in found.robot.actuated:
        _add_one(found.efforts, joint, f"force of {joint}", name, numbers)


def _add_one(
    held: dict[str, tuple[str, Array]], key: str, words: str, name: str, numbers: Array
) -> None:
    """Add a quantity; refuse a second one of the same kind, such as that of another robot."""
    if key in held:
        raise LogError(
            f"{name}: expected one {words.replace('_', ' ', 1)}, found {held[key][0]}, too; leave "
            "out of the mapping what is commanded or of another robot, or say whose it is by "
            "`bodies` (--body NAME=BODY)"
        )
    held[key] = name, numbers


def body_in(name: str, robot: Robot) -> str | None:
    """Body whose name is the longest one in the name of a quantity, else the floating one."""
    named = [body.name for body in robot.bodies if body.name.lower() in name.lower()]
    floating = [body.name for body in robot.floating_bodies.values()]
    return max(named, key=len) if named else (floating or [robot.bodies[0].name])[0]
