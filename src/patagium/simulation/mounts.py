"""Mounts of a robot: none, a rigid stand, or an arm that carries it along a path.

A mount prescribes the floating coordinates; the force that this takes is the mount's
force on the robot. A robot without a floating body is always fixed: its equations are
written on a massless mount at the world's origin that is held still, so that the
reaction comes out the same way. Load cells may be anywhere in the tree. Neglected: elastic
stands, and what the robot does to the arm's motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from numpy.typing import ArrayLike

from patagium.errors import ParameterError
from patagium.robot import Body, Robot
from patagium.robot.model import FLOATING_COORDINATES, Axis
from patagium.simulation.arm_plans import ArmPlan, plan_arm
from patagium.simulation.internal_load_cells import (
    InternalLoadCell,
    with_leading_coordinates,
)
from patagium.simulation.paths import Path, check_path

__all__ = ["carried", "fixed", "free", "load_cell", "on_arm"]

MOUNT_COORDINATES = 6
"""Coordinates a massless mount adds before those of the robot."""

_UPRIGHT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Mount:
    """Mount of a robot.

    Attributes:
        kind: "free" in the air, "fixed" where it starts, "carried" along a path, or so by
            an "arm".
        path: Where the floating body goes, or None.
        plan: What the arm's joints do for it, or None.
    """

    kind: Literal["free", "fixed", "carried", "arm"]
    path: Path | None = None
    plan: ArmPlan | None = None

    def describe(self) -> dict[str, Any] | None:
        """The path, and the arm that follows it, as JSON can hold them; None without."""
        if self.path is None:
            return None
        arm = {} if self.plan is None else {"arm": self.plan.describe()}
        return {"path": self.path.describe(), **arm}


def free() -> Mount:
    """Mount of a robot in free flight: none."""
    return Mount("free")


def fixed() -> Mount:
    """Mount that holds the floating coordinates where they start."""
    return Mount("fixed")


def carried(path: Path) -> Mount:
    """Mount that moves the floating body along a path, whatever that takes.

    Args:
        path: Motion of the floating body's origin and axes in the world.

    Raises:
        ParameterError: If it is no path.
    """
    check_path(path)
    return Mount("carried", path)


def on_arm(
    arm: Robot,
    path: Path,
    *,
    at: str = "tool",
    position: Axis = (0.0, 0.0, 0.0),
    orientation: Axis = (0.0, 0.0, 0.0),
    start: ArrayLike | None = None,
) -> Mount:
    """Mount on an arm whose joints carry the floating body along a path.

    The body follows the path exactly; the arm is planned for it, and must be able to.

    Args:
        arm: An arm of six joints, such as `load_robot("ur5e")`.
        path: Motion of the robot's floating body in the world, where the arm stands at the
            origin.
        at: Body of the arm that holds the robot.
        position: Where the robot sits on that body, in its axes, (3,) [m].
        orientation: Roll, pitch, yaw of the robot's axes in that body's, (3,) [rad].
        start: Joint angles near which the arm begins, (6,) [rad]; the best by default.

    Raises:
        ParameterError: If the arm is none, or it is no path.
        PathError: If the arm cannot follow, which joint, when and why.
    """
    check_path(path)
    plan = plan_arm(arm, path, at=at, position=position, orientation=orientation, start=start)
    return Mount("arm", path, plan)


def load_cell(
    at: str, position: Axis = (0.0, 0.0, 0.0), orientation: Axis = (0.0, 0.0, 0.0)
) -> InternalLoadCell:
    """Six-axis load cell between a body and what it hangs on, before its joints move.

    Args:
        at: Name of a body, or of a joint that moves on the cell.
        position: Origin of the cell in the axes of that joint (a fixed body's own), (3,) [m].
        orientation: Roll, pitch, yaw of the cell's axes in those, (3,) [rad].

    Raises:
        ParameterError: If a number is not finite.
    """
    return InternalLoadCell(at, position, orientation)


def mount_of(robot: Robot, mount: Mount | None) -> Mount:
    """The mount asked for, or what the robot implies: free if it floats, else fixed.

    Raises:
        ParameterError: If a robot without a floating body is to fly freely.
    """
    if mount is None:
        return free() if robot.floating else fixed()
    if mount.kind != "fixed" and not robot.floating:
        raise ParameterError("mount", f"fixed: {robot.name!r} has no floating body", mount.kind)
    if mount.path is not None and len(floating_dofs(robot)) != MOUNT_COORDINATES:
        raise ParameterError("mount", f"a robot of one floating body, for {mount.kind}", robot.name)
    return mount


def floating_dofs(robot: Robot) -> tuple[int, ...]:
    """Places in v of the floating bodies' velocities: x, y, z, roll, pitch, yaw of each."""
    return tuple(i for body in robot.bodies for i in body.floating_dofs or ())


def floating_coordinates(robot: Robot) -> tuple[int, ...]:
    """Places in q of the floating bodies' coordinates, in the order of `floating_dofs`."""
    return tuple(i for body in robot.bodies for i in robot.floating_coordinates(body))


def on_massless_mount(robot: Robot) -> Robot:
    """Machine on a massless floating body, whose six coordinates come first.

    Args:
        robot: A robot without a floating body; numbers or symbols.

    Returns:
        A robot of n + 6 coordinates. With the first six held at zero it moves as the
        original; the force that holds them is the reaction of the ground.
    """
    zero = (0.0, 0.0, 0.0)
    mount = Body(
        name="mount",
        parent=-1,
        position=zero,
        orientation=_UPRIGHT,
        joints=(),
        floating_dofs=tuple(range(MOUNT_COORDINATES)),
        mass=0.0,
        center_of_mass=zero,
        inertia=(0.0,) * 6,
    )
    machine = with_leading_coordinates(robot, [f"mount_{name}" for name in FLOATING_COORDINATES])
    bodies = (replace(body, parent=body.parent + 1) for body in machine.bodies)
    strips = (replace(strip, body=strip.body + 1) for strip in machine.strips)
    return replace(machine, bodies=(mount, *bodies), strips=tuple(strips))
