"""Flights through air with memory: a lifting line of two states a strip, and added mass.

The robot cruises freely or sits on a rigid stand in the same wind. Gait and start are a trim
in this air: least squares over feather, mounting of the linkage, frequency or speed, climb
and attitude, for states that come back after each of six beats, level on average, at small
incidence. (At the gait of the quasi-steady flight the robot sinks into deep stall here.)
Neglected: control; the flight slowly departs from its trim.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from patagium.aerodynamics import AddedMass, Air, LiftingLine, OneMinusCosineGust
from patagium.arrays import Array
from patagium.robot import load_robot
from patagium.sensing.force.air_force import training_data
from patagium.simulation import mounts, simulate
from patagium_lab.reproduction.flights import TIME_STEP, Wingbeat

MOUNTS = {"free": "free flight", "fixed": "fixed mount"}
"""Key of a way to hold the robot to its name in words."""
CRUISE = Wingbeat(
    frequency=5.69,
    feather=0.3306,
    feather_phase=1.0316,
    feather_offset=-0.082,
    plunge_offset=-0.6705,
    speed=8.706,
    climb=0.1785,
    pitch=0.2629,
    pitch_rate=-0.1428,
)
"""The wingbeat that is learned in air with memory."""
GUST = OneMinusCosineGust((-1.0, 0.0, 1.0), start=0.1, length_time=0.2)
"""Against the robot and from below, over before the flight is."""


def unseen_wingbeats() -> dict[str, Wingbeat]:
    """Gaits and a speed that are not learned."""
    slower, faster = CRUISE.frequency - 1.0, CRUISE.speed + 1.0
    return {
        f"frequency {slower:.3g} Hz": replace(CRUISE, frequency=slower),
        "plunge 0.2 rad larger": replace(CRUISE, plunge=0.2),
        "regulator l3b 8 mm": replace(CRUISE, linkage={"l3b": 8e-3}),
        "elbow 0.3 rad more": replace(CRUISE, elbow=0.3),
        "feather 0.1 rad less, 0.3 rad earlier": replace(
            CRUISE, feather=CRUISE.feather - 0.1, feather_phase=CRUISE.feather_phase + 0.3
        ),
        f"speed {faster:.3g} m/s": replace(CRUISE, speed=faster),
    }


def unsteady_flight(
    mount: str, duration: float, wingbeat: Wingbeat = CRUISE, gust: OneMinusCosineGust | None = None
) -> xr.Dataset:
    """A flight of the corrected robot through air with memory.

    Args:
        mount: Key of `MOUNTS`; on a fixed one the air moves instead of the robot.
        duration: Duration [s].
        wingbeat: Gait, and speed and attitude at the start.
        gust: Added to the wind.
    """
    robot = load_robot("aerobat")
    q, v = wingbeat.start(robot)
    fixed = mount == "fixed"
    wind = (-wingbeat.speed, 0.0, -wingbeat.climb) if fixed else (0.0, 0.0, 0.0)
    air = Air(wind=wind, gust=gust)
    return simulate(
        robot,
        LiftingLine(robot, air),
        wingbeat.gait(robot),
        duration=duration,
        time_step=TIME_STEP,
        added_mass=AddedMass(robot, air),
        mount=mounts.fixed() if fixed else mounts.free(),
        q=q,
        v=np.zeros(robot.dof) if fixed else v,
        throw=False,
    )


def unseen_flights(mount: str, duration: float) -> dict[str, xr.Dataset]:
    """Flights that are not learned, by name.

    Args:
        mount: Key of `MOUNTS`.
        duration: Duration [s].
    """
    flights = {
        name: unsteady_flight(mount, duration, wingbeat)
        for name, wingbeat in unseen_wingbeats().items()
    }
    return {**flights, "gust": unsteady_flight(mount, duration, gust=GUST)}


def relative_samples(flight: xr.Dataset) -> tuple[Array, Array, Array]:
    """Samples of a flight: states relative to the air, and the air's force.

    The wind is the same everywhere, so that only the velocity of the robot relative to it counts,
    which a robot measures; a network then needs neither wind nor gust.

    Args:
        flight: Flight of a robot whose first coordinates are its position.

    Returns:
        Time (N,) [s]; x = [q, v, a] with the wind taken off, (N, 3n); y, (N, n) [N, N m].
    """
    time, x, y = training_data(flight)
    half = x.shape[1] // 2
    x[:, half : half + 3] -= flight["wind"].to_numpy()
    return time, np.hstack([x, flight["a"].transpose("time", "dof").to_numpy()]), y
