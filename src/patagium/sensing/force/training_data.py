"""What the air did to a robot, by inverse dynamics of a recorded flight.

B2 u2 = D(q) a + C(q, v) v + G(q) - B1 u1 - damping - mount: whatever the modeled forces
do not explain is ascribed to the air. Neglected: errors of the recorded accelerations and
of the robot's parameters; they end up in the force.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.dynamics import Dynamics
from patagium.errors import FlightError, LogError, ParameterError
from patagium.robot import Robot
from patagium.simulation import quantities, robot_of

Array = NDArray[np.float64]


def training_data(
    flight: xr.Dataset, robot: Robot | None = None, *, with_added_mass: bool = False
) -> tuple[Array, Array, Array]:
    """States of a flight and the generalized force of the air at each of them.

    y = D a + C v + G - u1 - damping - mount [paper, eq. training_data]. Added mass that the
    flight was flown with is known inertia and no part of y, which then is a force that the
    state alone can explain.

    Args:
        flight: Record with v, a, u1 (time, dof) and q, which has a dimension of its own where
            the attitude is a quaternion; `damping_force` is computed from the
            robot, `mount_force` and `added_mass_force` are zero where the record has none.
        robot: The machine; None for the one the flight carries.
        with_added_mass: Whether y is all that the air does, added mass included.

    Returns:
        Time (N,) [s]; x = [q, v], (N, n_x); y = B2 u2, (N, n) [N, N m].

    Raises:
        FlightError: If a quantity is missing or of another robot.
        LogError: If a number is missing.
    """
    machine = robot_of(flight) if robot is None else robot
    q, v, a, u1 = (_recorded(flight, name, machine) for name in ("q", "v", "a", "u1"))
    force = Dynamics(machine).batch.inverse(q, v, a) - u1
    if "damping_force" in flight:
        force = force - _recorded(flight, "damping_force", machine)
    else:
        force = force + np.asarray(machine.damping, float) * v
    if "mount_force" in flight:
        force = force - _recorded(flight, "mount_force", machine)
    if "added_mass_force" in flight and not with_added_mass:
        force = force - _recorded(flight, "added_mass_force", machine)
    return np.asarray(flight["time"].values, float), np.hstack([q, v]), force


def state_columns(robot: Robot, inputs: Sequence[str]) -> list[int]:
    """Places of named inputs in the state [q, v].

    Args:
        robot: The machine.
        inputs: Names such as `q.roll`, `v.left_plunge`.

    Raises:
        ParameterError: If there is no such name.
    """
    names = [f"q.{name}" for name in robot.coordinate_names]
    names += [f"v.{name}" for name in robot.dof_names]
    for name in inputs:
        if name not in names:
            raise ParameterError("inputs", f"names among {', '.join(names)}", name)
    return [names.index(name) for name in inputs]


def _recorded(flight: xr.Dataset, name: str, robot: Robot) -> Array:
    (dim,) = quantities(robot)[name].dims
    size = robot.coordinate_count if name == "q" else robot.dof
    if name not in flight:
        held = ", ".join(map(str, flight.data_vars))
        raise FlightError(f"flight: expected {name} (time, {dim}), but it holds {held}")
    if dim not in flight[name].dims:
        raise FlightError(f"{name}: expected (time, {dim}), found {flight[name].dims}")
    values = np.asarray(flight[name].transpose("time", dim).values, float)
    if values.shape[1] != size:
        raise FlightError(
            f"{name}: expected {size} coordinates of robot {robot.name!r}, found {values.shape[1]}"
        )
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(bad):
        raise LogError(
            f"{name}: expected finite numbers, found {len(bad)} samples that are not, "
            f"the first at t = {float(flight['time'][bad[0]]):.6g} s"
        )
    return values
