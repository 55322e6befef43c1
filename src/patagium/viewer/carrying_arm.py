"""The arm that carries a robot, to be looked at: tubes between its joints, and its foot.

The shapes of its links are not drawn.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from patagium.dynamics.dynamics import poses_at
from patagium.robot import Robot
from patagium.robot.solids import Solid, carried_body, solids, tube
from patagium.simulation.flight import Carrier

Array = NDArray[np.float64]


class CarryingArm(NamedTuple):
    """An arm on the ground, at F times.

    Attributes:
        names: Of its bodies, its foot last.
        position: Of each in the world, (F, n_b, 3) [m].
        rotation: Body axes to world axes, (F, n_b, 3, 3).
        solids: What they look like.
    """

    names: tuple[str, ...]
    position: Array
    rotation: Array
    solids: list[Solid]


def carrying_arm(
    robot: Robot, carrier: Carrier | None, frames: NDArray[np.int64]
) -> CarryingArm | None:
    """Arm under the robot of a flight; None if there is no arm.

    Of a robot composed with its arm only the foot: its links are bodies of the robot.

    Args:
        robot: The robot of the flight.
        carrier: The arm that carried it, or None.
        frames: Samples to be shown, (F,).
    """
    count = len(frames)
    ground = np.zeros((count, 1, 3)), np.broadcast_to(np.eye(3), (count, 1, 3, 3))
    if carrier is None:
        own = carried_body(robot)
        thick = [solid for solid in solids(robot) if solid.body < own]
        return CarryingArm(("foot",), *ground, _foot(robot, thick, 0)) if own else None
    arm = carrier.arm
    position, rotation = poses_at(arm, carrier.q[frames])
    drawn = solids(arm)
    return CarryingArm(
        (*(f"{arm.name} {body.name}" for body in arm.bodies), f"{arm.name} foot"),
        np.concatenate([position, ground[0]], axis=1),
        np.concatenate([rotation, ground[1]], axis=1),
        [*drawn, *_foot(arm, drawn, len(arm.bodies)), *_flange(carrier, drawn)],
    )


def _foot(arm: Robot, drawn: list[Solid], body: int) -> list[Solid]:
    """From the ground to the first joint."""
    first = np.array(arm.bodies[0].position, float)
    if not np.linalg.norm(first) > 0:
        return []
    return [tube(body, np.zeros(3), first, 1.4 * _radius(drawn))._replace(kind="cylinder")]


def _flange(carrier: Carrier, drawn: list[Solid]) -> list[Solid]:
    """From the tool to the robot."""
    if not np.linalg.norm(carrier.position) > 0:
        return []
    tool = carrier.arm.body_index(carrier.at)
    return [tube(tool, np.zeros(3), carrier.position, _radius(drawn))]


def _radius(drawn: list[Solid]) -> float:
    return max(solid.size[0] for solid in drawn if solid.kind == "capsule")
