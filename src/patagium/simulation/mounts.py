"""What holds the robot: nothing, or a rigid stand.

A fixed mount prescribes the floating coordinates; the force that this takes is
the mount's force on the robot. A robot without a floating body is always fixed:
its equations are written on a massless mount at the world's origin that is held
still, so that the reaction comes out the same way. Neglected: elastic stands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from patagium.errors import ParameterError
from patagium.robot import Body, Robot

MOUNT_COORDINATES = 6
"""Coordinates a massless mount adds before those of the robot."""

_UPRIGHT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Mount:
    """How the robot is held.

    Attributes:
        kind: "free" in the air, or "fixed" where it starts.
    """

    kind: Literal["free", "fixed"]


def free() -> Mount:
    """Mount of a robot in free flight: none."""
    return Mount("free")


def fixed() -> Mount:
    """Mount that holds the floating coordinates where they start."""
    return Mount("fixed")


def mount_of(robot: Robot, mount: Mount | None) -> Mount:
    """The mount asked for, or what the robot implies: free if it floats, else fixed.

    Raises:
        ParameterError: If a robot without a floating body is to fly freely.
    """
    if mount is None:
        return free() if robot.floating else fixed()
    if mount.kind == "free" and not robot.floating:
        raise ParameterError("mount", f"fixed: {robot.name!r} has no floating body", mount.kind)
    return mount


def floating_dofs(robot: Robot) -> tuple[int, ...]:
    """Coordinates of the floating bodies: x, y, z, roll, pitch, yaw of each."""
    return tuple(i for body in robot.bodies for i in body.floating_dofs or ())


def on_massless_mount(robot: Robot) -> Robot:
    """The same machine on a massless floating body, whose six coordinates come first.

    Args:
        robot: A robot without a floating body; numbers or symbols.

    Returns:
        A robot of n + 6 coordinates. With the first six held at zero it moves as the
        original; the force that holds them is the reaction of the ground.
    """
    k = MOUNT_COORDINATES
    zero = (0.0, 0.0, 0.0)
    mount = Body(
        name="mount",
        parent=-1,
        position=zero,
        orientation=_UPRIGHT,
        joints=(),
        floating_dofs=tuple(range(k)),
        mass=0.0,
        center_of_mass=zero,
        inertia=(0.0,) * 6,
    )
    bodies = tuple(
        replace(
            body,
            parent=body.parent + 1,
            joints=tuple(replace(joint, dof=joint.dof + k) for joint in body.joints),
        )
        for body in robot.bodies
    )
    infinity = (float("inf"),) * k
    return replace(
        robot,
        bodies=(mount, *bodies),
        strips=tuple(replace(strip, body=strip.body + 1) for strip in robot.strips),
        dof_names=(*(f"mount_{name}" for name in "xyz"), "mount_roll", "mount_pitch", "mount_yaw")
        + robot.dof_names,
        dof_units=("m",) * 3 + ("rad",) * 3 + robot.dof_units,
        actuated=tuple(i + k for i in robot.actuated),
        damping=(0.0,) * k + robot.damping,
        lower=tuple(-x for x in infinity) + robot.lower,
        upper=infinity + robot.upper,
    )
