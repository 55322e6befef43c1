"""Flight of a robot through the air: what happens next, step by step.

Joints follow the gait exactly, everything else the equations of motion; fourth
order in the time step. Neglected: contact, actuator limits, sensors.
"""

from __future__ import annotations

from collections.abc import Sequence

import xarray as xr
from numpy.typing import ArrayLike

from patagium.aerodynamics import AddedMass, Aerodynamics
from patagium.errors import Outcome, SimulationFailed
from patagium.robot import Robot
from patagium.simulation.gaits import Gait
from patagium.simulation.internal_load_cells import InternalLoadCell
from patagium.simulation.mounts import Mount
from patagium.simulation.runge_kutta import Progress
from patagium.simulation.simulator import Simulator


def simulate(
    robot: Robot,
    aero: Aerodynamics,
    gait: Gait,
    *,
    duration: float,
    time_step: float,
    added_mass: AddedMass | None = None,
    mount: Mount | None = None,
    load_cells: Sequence[InternalLoadCell] = (),
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
    flying = Simulator(
        robot, aero, gait, duration=duration, time_step=time_step, added_mass=added_mass,
        mount=mount, load_cells=load_cells, q=q, v=v,
    )  # fmt: skip
    flying.advance(flying.steps, progress)
    flight = flying.flight()
    outcome = Outcome[flight.attrs["outcome"]]
    if throw and outcome is not Outcome.COMPLETED:
        raise SimulationFailed(flight.attrs["message"], flight, outcome)
    return flight
