"""The arm that carried a robot, found again from the record of a flight.

A flight keeps the arm, where it began and where the robot was; the arm's joints follow from
these by inverse kinematics, on the branch that it was on. If the
record begins later than the flight did, the nearest way to hold the robot is taken.
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.dynamics.poses import poses_at
from patagium.errors import FlightError, PatagiumError, PathError
from patagium.robot import Robot, load_robot_text
from patagium.simulation.arm_kinematics import Tool
from patagium.simulation.arm_plans import track_tool
from patagium.simulation.flight import robot_of

Array = NDArray[np.float64]

_KNOTS = 1000  # samples at which the arm is followed one by one; between them all at once


class Carrier(NamedTuple):
    """An arm and what it did.

    Attributes:
        arm: The arm, on the world.
        at: Body that holds the robot.
        position: Where on it, in its axes, (3,) [m].
        q: Its joints at every sample of the flight, (N, 6) [rad, m].
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
    told: Any = json.loads(flight.attrs.get("mount_path", "null"))
    if flight.attrs.get("mount") != "arm" or not told or "arm" not in told:
        return None
    words = told["arm"]
    try:
        arm = load_robot_text(words["source"], words["name"])
        tool = Tool(arm, words["at"], tuple(words["position"]), tuple(words["orientation"]))
        time, start = np.asarray(flight["time"].values, float), np.array(words["start"], float)
        q = track_tool(tool, time, _placed(flight), start, _KNOTS)
    except (KeyError, PathError, PatagiumError) as problem:
        raise FlightError(f"the flight's arm cannot be made again: {problem}") from None
    return Carrier(arm, words["at"], np.array(words["position"], float), q)


def _placed(flight: xr.Dataset) -> tuple[Array, Array]:
    """Position of the floating body, (N, 3) [m], and its rotation to the world, (N, 3, 3)."""
    robot = robot_of(flight)
    position, rotation = poses_at(robot, np.asarray(flight["q"].values, float))
    held = next(k for k, body in enumerate(robot.bodies) if body.floating_dofs is not None)
    return position[:, held], rotation[:, held]
