"""Flight of a robot through the air, step by step.

Joints follow the gait exactly, everything else the equations of motion; fourth
order in the time step. Neglected: contact, actuator limits, sensors.
"""

from __future__ import annotations

from typing import Unpack

import xarray as xr

from patagium.aerodynamics import Aerodynamics
from patagium.errors import Outcome, SimulationFailed
from patagium.robot import Robot
from patagium.simulation.gaits import Gait
from patagium.simulation.mounts import Mount
from patagium.simulation.runge_kutta import Progress
from patagium.simulation.simulator import FlightOptions, Simulator, check_keywords


class SimulationOptions(FlightOptions, total=False):
    """Keywords of `simulate` that a run mostly does without; see `FlightOptions` for the others.

    Attributes:
        throw: Whether a run that stops early raises; True where not given.
        progress: Function that takes the steps done and to do, called from time to time.
    """

    throw: bool
    progress: Progress | None


def simulate(
    robot: Robot,
    aero: Aerodynamics,
    gait: Gait,
    *,
    duration: float,
    time_step: float,
    mount: Mount | None = None,
    **options: Unpack[SimulationOptions],
) -> xr.Dataset:
    """Flight of a robot whose actuated joints follow a gait.

    Classic Runge-Kutta at a fixed step, compiled. A run stops where a quantity is not
    finite, an Euler angle of pitch nears 90 degrees (where roll and yaw are one; a quaternion
    goes through), a coordinate leaves the robot's limits, or the speed is absurd; what was
    flown is kept.

    Args:
        robot: The machine.
        aero: Model of the air around it.
        gait: Motion of the actuated joints.
        duration: A whole number of time steps [s].
        time_step: Step [s].
        mount: Free, fixed, carried along a path or on an arm (`patagium.mounts`); by
            default free if the robot has a floating body, else fixed.
        **options: Further keywords, all optional:
            q: Initial coordinates, (n_q,) [m, rad, 1], as `robot.coordinates(pitch=...)` makes
            them; the gait's and the path's are overwritten. Those of zero angles by default.
            v: Initial velocities, (n,) [m/s, rad/s]; likewise. What a fixed mount holds
            must not move: let the air move instead.
            added_mass: Inertia of the air that moves with the wings, in the same air as `aero`.
            load_cells: Six-axis cells (`patagium.mounts.load_cell`) whose wrenches to record.
            throw: Whether a run that stops early raises (default); else the flight up to there
            is returned, `outcome` and `message` among its attributes.
            progress: Function that takes the steps done and to do, called from time to time.

    Returns:
        The flight: see `patagium.simulation.flight.QUANTITIES`, attributes and audits.

    Raises:
        ParameterError: If an argument is not what it may be.
        ShapeError: If q is not (n_q,) or v not (n,).
        SimulationFailed: If the run stopped early and `throw` is set; it carries the flight.
    """
    check_keywords(options, SimulationOptions)
    throw, progress = options.pop("throw", True), options.pop("progress", None)
    started: FlightOptions = options
    simulator = Simulator(
        robot, aero, gait, duration=duration, time_step=time_step, mount=mount, **started
    )
    simulator.advance(simulator.steps, progress)
    flight = simulator.flight()
    outcome = Outcome[flight.attrs["outcome"]]
    if throw and outcome is not Outcome.COMPLETED:
        raise SimulationFailed(flight.attrs["message"], flight, outcome)
    return flight
