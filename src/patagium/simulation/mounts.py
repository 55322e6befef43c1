"""Mounts of a robot (none, a rigid stand, or an arm), and six-axis load cells in its tree.

A mount prescribes the floating coordinates; the force that this takes is the mount's
force on the robot. A robot without a floating body is always fixed: its equations are
written on a massless mount at the world's origin that is held still, so that the
reaction comes out the same way. A load cell is a massless, rigid link with six coordinates that
are held at zero, anywhere in the tree: the force that holds them is the wrench through it, in
its own axes, whatever acts beyond it: inertia, weight, air, added mass. The damper of a floating
base acts on the body, beyond its cell, as in free flight: a cell under the base shows the mount's
wrench. Neglected: elastic stands, what the robot does to the arm's motion, the cell's mass and
elasticity; noise belongs to the sensor that reads a cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from numpy.typing import ArrayLike

from patagium.arguments import checked
from patagium.errors import ParameterError, check_names, suggest_names
from patagium.robot import Body, Joint, Robot
from patagium.robot.attitude import rotation_from_angles
from patagium.robot.model import (
    CAPACITIES,
    FLOATING_COORDINATES,
    Axis,
    axes_of,
    axis_of,
    finite_triple,
)
from patagium.simulation.arm import ArmPlan, plan_arm
from patagium.simulation.paths import Path, check_path

__all__ = ["carried", "fixed", "free", "load_cell", "on_arm"]
suggest_names(__name__)


@dataclass(frozen=True)
class Mount:
    """Mount of a robot.

    Attributes:
        kind: "free" in the air, "fixed" where it starts, "carried" along a path, or so by an "arm".
        path: Path of the floating body, or None.
        plan: Motion of the arm's joints for it, or None.
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


@checked
def carried(path: Path) -> Mount:
    """Mount that moves the floating body along a path, whatever that takes.

    Raises:
        ParameterError: If it is no path.
    """
    check_path(path)
    return Mount("carried", path)


@checked
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
        path: Motion of the robot's floating body in the world, where the arm stands at the origin.
        at: Body of the arm that holds the robot.
        position: Position of the robot on that body, in its axes, (3,) [m].
        orientation: Roll, pitch, yaw of the robot's axes in that body's, (3,) [rad].
        start: Joint angles near which the arm begins, (6,) [rad]; the best by default.

    Raises:
        ParameterError: If the arm is none, or it is no path.
        PathError: If the arm cannot follow, which joint, when and why.
    """
    check_path(path)
    plan = plan_arm(arm, path, at=at, position=position, orientation=orientation, start=start)
    return Mount("arm", path, plan)


@checked
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


@checked
def mount_of(robot: Robot, mount: Mount | None) -> Mount:
    """The mount asked for, or what the robot implies: free if it floats, else fixed.

    Raises:
        ParameterError: If a robot without a floating body is to fly freely.
    """
    if mount is None:
        return free() if robot.floating else fixed()
    if mount.kind != "fixed" and not robot.floating:
        raise ParameterError("mount", f"fixed: {robot.name!r} has no floating body", mount.kind)
    if mount.path is not None and len(robot.floating_dofs) != CELL_COORDINATES:
        raise ParameterError("mount", f"a robot of one floating body, for {mount.kind}", robot.name)
    return mount


def on_massless_mount(robot: Robot) -> Robot:
    """Machine on a massless floating body, whose six coordinates come first.

    Returns:
        A robot of n + 6 coordinates. With the first six held at zero it moves as the
        original; the force that holds them is the reaction of the ground.
    """
    mount = Body(
        name="mount",
        parent=-1,
        position=_ZERO,
        orientation=_UNIT,
        joints=(),
        floating_dofs=tuple(range(CELL_COORDINATES)),
        **_MASSLESS,
    )
    machine = with_leading_coordinates(robot, [f"mount_{name}" for name in FLOATING_COORDINATES])
    bodies = (replace(body, parent=body.parent + 1) for body in machine.bodies)
    strips = (replace(strip, body=strip.body + 1) for strip in machine.strips)
    return replace(machine, bodies=(mount, *bodies), strips=tuple(strips))


CELL_COORDINATES = 6
"""Coordinates a cell or a massless mount adds before those of the robot: lengths, then angles."""

_ZERO = (0.0, 0.0, 0.0)
_UNIT: tuple[Axis, Axis, Axis] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class InternalLoadCell:
    """A six-axis load cell between a body and what it hangs on.

    Attributes:
        at: Name of the body, or of the joint that moves on the cell.
        position: Origin of the cell from that of the joint's (a fixed body's) axes, in
            them, before the joint moves, (3,) [m].
        orientation: Roll, pitch, yaw of the cell's axes in those, (3,) [rad].
    """

    at: str
    position: Axis = _ZERO
    orientation: Axis = _ZERO

    def __post_init__(self) -> None:
        """Refuse what is no pose.

        Raises:
            ParameterError: If a number is not finite.
        """
        for name in ("position", "orientation"):
            values = finite_triple(f"load cell {name}", getattr(self, name))
            object.__setattr__(self, name, values)

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        return asdict(self)


def check_cells(robot: Robot, cells: Sequence[InternalLoadCell], held: bool) -> None:
    """Refuse cells that the robot cannot carry.

    Raises:
        ParameterError: If a name is neither body nor joint, a place comes twice, or a cell
            is to hold a body that nothing holds.
    """
    places = [_place(robot, cell.at) for cell in cells]
    for k, (cell, place) in enumerate(zip(cells, places, strict=True)):
        if place in places[:k]:
            raise ParameterError("load cell", "one cell a place", cell.at)
        if robot.bodies[place[0]].floating_dofs is not None and not held:
            raise ParameterError("load cell", "a body that something holds", f"{cell.at}, free")


def with_load_cells(robot: Robot, cells: Sequence[InternalLoadCell]) -> Robot:
    """Machine with a massless link of six coordinates, which come first, at each cell.

    Returns:
        A robot of 6 more coordinates a cell. With these at zero it moves as the original.
    """
    places = [_place(robot, cell.at) for cell in cells]
    names = [f"load cell {k}" for k in range(CELL_COORDINATES * len(cells))]
    machine = with_leading_coordinates(robot, names)
    # from the last place backwards, so that the others stay where they are
    for k in sorted(range(len(cells)), key=places.__getitem__, reverse=True):
        machine = _with_cell(machine, cells[k], places[k], CELL_COORDINATES * k)
    return machine


def _with_cell(machine: Robot, cell: InternalLoadCell, at: tuple[int, int], first: int) -> Robot:
    """One cell before a joint of a body; its coordinates are numbered already."""
    place, before = at
    body = machine.bodies[place]
    turn = rotation_from_angles(cell.orientation)
    foot = replace(
        body,
        name=f"{cell.at} below the cell",
        joints=body.joints[:before],
        piece=False,
        mounted=False,
        **_MASSLESS,
    )
    link = Body(
        name=f"{cell.at} load cell",
        parent=place,
        position=cell.position,
        orientation=axes_of(turn),
        joints=_six(cell.at, first),
        floating_dofs=None,
        **_MASSLESS,
    )
    carried = replace(
        body,
        parent=place + 1,
        position=axis_of(-turn.T @ cell.position),
        orientation=axes_of(turn.T),
        joints=body.joints[before:],
        floating_dofs=None,
    )
    others = (replace(k, parent=_moved(k.parent, place)) for k in machine.bodies[place + 1 :])
    bodies = (*machine.bodies[:place], foot, link, carried, *others)
    strips = tuple(replace(k, body=_moved(k.body, place)) for k in machine.strips)
    return replace(machine, bodies=bodies, strips=strips)


def _moved(body: int, place: int) -> int:
    """Index of a body after foot and link were put before the one at `place`."""
    return body + 2 if body >= place else body


def _place(robot: Robot, name: str) -> tuple[int, int]:
    """Body whose chain is cut, and how many of its joints stay before the cut."""
    places = {body.name: (index, 0) for index, body in enumerate(robot.bodies)}
    for index, body in enumerate(robot.bodies):
        for before, joint in enumerate(body.joints):
            places.setdefault(joint.name, (index, before))
    check_names("load cell", [name], places, "a body or joint:", near=True)
    return places[name]


def with_leading_coordinates(robot: Robot, names: Sequence[str]) -> Robot:
    """Machine with room for coordinates before its own, which nothing damps or limits.

    Args:
        robot: The machine; numbers or symbols.
        names: Names of the new coordinates: three lengths, then three angles, again and again.
    """
    count = len(names)

    def later(body: Body) -> Body:
        joints = tuple(replace(joint, dof=joint.dof + count) for joint in body.joints)
        floating = body.floating_dofs
        moved = None if floating is None else tuple(i + count for i in floating)
        return replace(body, joints=joints, floating_dofs=moved)

    endless = (float("inf"),) * count
    capacities: dict[str, Any] = dict.fromkeys(CAPACITIES, ())
    return replace(
        robot,
        bodies=tuple(later(body) for body in robot.bodies),
        dof_names=(*names, *robot.dof_names),
        dof_units=(("m",) * 3 + ("rad",) * 3) * (count // CELL_COORDINATES) + robot.dof_units,
        actuated=tuple(i + count for i in robot.actuated),
        damping=(0.0,) * count + robot.damping,
        stiffness=robot.stiffness and (0.0,) * count + robot.stiffness,
        rest=robot.rest and (0.0,) * count + robot.rest,
        lower=tuple(-x for x in endless) + robot.lower,
        upper=endless + robot.upper,
        **capacities,
    )


def _six(name: str, first: int) -> tuple[Joint, ...]:
    kinds = ("prismatic",) * 3 + ("revolute",) * 3
    return tuple(
        Joint(f"{name} cell {k}", kind, axis, first + k)  # type: ignore[arg-type]
        for k, (kind, axis) in enumerate(zip(kinds, (*_UNIT, *_UNIT), strict=True))
    )


_MASSLESS: dict[str, Any] = {
    "mass": 0.0,
    "center_of_mass": _ZERO,
    "inertia": (0.0,) * CELL_COORDINATES,
}
