"""Foreign force and motion as an ordinary record of a flight.

What moves the robot beside the air is found by inverse dynamics, so that `training_data` gives
back the foreign force. Quantities that another program does not tell, such as the forces of single
strips, are NaN.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from patagium.aerodynamics import Air
from patagium.arrays import Array
from patagium.robot import Robot
from patagium.sensing import training_data
from patagium.simulation.flight import AXES, WRENCH, quantities
from patagium.version import __version__


@dataclass(frozen=True)
class ForeignOrigin:
    """Origin of a foreign flight.

    Attributes:
        robot: The machine.
        air: Density and wind.
        program: Program and model that made the force, in words.
        gait: Description of the gait.
        mount: "carried" on a mount, or "free".
    """

    robot: Robot
    air: Air
    program: str
    gait: Mapping[str, Any]
    mount: str


def foreign_record(
    origin: ForeignOrigin, time: Array, motion: tuple[Array, Array, Array], force: Array
) -> xr.Dataset:
    """Flight record of a motion and the force of foreign air.

    Actuated joints get D a + C v + G - damping - force as u1, all others as the force of the
    mount, which is zero up to the integration in free flight.

    Args:
        origin: Robot, air, gait and mount.
        time: Times of the samples, (N,) [s].
        motion: q, (N, n_q), v and a, (N, n) [SI].
        force: Generalized force of the air, (N, n) [N, N m].
    """
    robot = origin.robot
    known = dict(zip(("q", "v", "a"), motion, strict=True))
    none = np.zeros_like(force)
    known |= {"u1": none, "mount_force": none, "added_mass_force": none, "aero_force": force}
    known["damping_force"] = -motion[1] * np.array(robot.damping, float)
    known["wind"] = origin.air.wind_at(time)
    _, _, needed = training_data(_dataset(origin, time, known))
    joints = np.isin(np.arange(robot.dof), robot.actuated)
    known["u1"] = np.where(joints, needed - force, 0.0)
    known["mount_force"] = np.where(joints, 0.0, needed - force)
    return _dataset(origin, time, known)


def _dataset(origin: ForeignOrigin, time: Array, known: Mapping[str, Array]) -> xr.Dataset:
    robot = origin.robot
    sizes = {
        "dof": robot.dof,
        "coordinate": robot.coordinate_count,
        "strip": len(robot.strips),
        "axis": len(AXES),
        "component": len(WRENCH),
        "lag": 0,
    }
    variables = {}
    for name, kind in quantities(robot).items():
        shape = [len(time), *(sizes[dim] for dim in kind.dims)]
        values = known[name] if name in known else np.full(shape, np.nan)
        facts = {"units": kind.units, "long_name": kind.meaning}
        variables[name] = (("time", *kind.dims), np.ascontiguousarray(values, float), facts)
    coordinates = {
        "time": ("time", time, {"units": "s", "long_name": "time"}),
        "dof": ("dof", list(robot.dof_names)),
        "dof_unit": ("dof", list(robot.dof_units)),
        "strip": ("strip", [strip.name for strip in robot.strips]),
        "axis": ("axis", list(AXES)),
        "component": ("component", list(WRENCH)),
    }
    return xr.Dataset(variables, coordinates, _attributes(origin, time))


def _attributes(origin: ForeignOrigin, time: Array) -> dict[str, Any]:
    return {
        "robot": origin.robot.source,
        "robot_name": origin.robot.name,
        "aero": json.dumps({"kind": origin.program}),
        "air": json.dumps(origin.air.describe()),
        "added_mass": json.dumps(None),
        "gait": json.dumps(origin.gait),
        "mount": origin.mount,
        "mount_path": json.dumps(None),
        "load_cells": json.dumps([]),
        "time_step": float(time[1] - time[0]),
        "stepping": origin.program,
        "outcome": "COMPLETED",
        "message": "",
        "patagium_version": __version__,
    }
