"""Training data by inverse dynamics of a recorded flight.

Neglected: errors of the recorded accelerations and of the robot's parameters; they end up in the
force.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.errors import FlightError, LogError
from patagium.robot import Robot
from patagium.sensing.force.air_force import OPTIONAL_PARTS, PARTS, SampleForm
from patagium.simulation import quantities, robot_of

Array = NDArray[np.float64]


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
        Time (N,) [s]; x = [q, v], (N, n_x); y = B2 u2, (N, n) [N, N m].

    Raises:
        FlightError: If a quantity is missing or of another robot.
        LogError: If a number is missing.
    """
    machine = robot_of(flight) if robot is None else robot
    air = ("added_mass_force",) if with_added_mass else ()
    carried = tuple(name for name in OPTIONAL_PARTS if name in flight and name not in air)
    form = SampleForm(machine, carried=carried)
    q, v, a, u1, *others = (recorded(flight, name, machine) for name in (*PARTS, *carried))
    x, y = form.function.batch(q, v, a, np.hstack([u1, *others]), form.parameters)
    count, time = len(q), np.asarray(flight["time"].values, float)
    return time, np.array(x).reshape(count, -1), np.array(y).reshape(count, -1)


def recorded(flight: xr.Dataset, name: str, robot: Robot) -> Array:
    """Recorded quantity of a flight, (N, n_q) for q and (N, n) for the others.

    Args:
        flight: The record.
        name: Name of the quantity, such as `v`.
        robot: The machine whose coordinates it should have.

    Raises:
        FlightError: If it is missing or of another robot.
        LogError: If a number is missing.
    """
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
