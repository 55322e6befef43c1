"""The robot as other programs want it: one joint a row, axes aligned, parents first in depth.

Pinocchio's fast joints turn about x, y or z only, so an oblique or reversed axis
is moved into the placements: R(a, t) = A Rx(t) A^T with A e_x = a. Bodies
without a coordinate are lumped into what carries them. Coordinates stay those of q.
Damping, limits, strips: not carried over.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.arrays import Array
from patagium.robot.model import Axis, Body, Robot

KINDS = ("PX", "PY", "PZ", "RX", "RY", "RZ", "translation", "zyx", "spherical")


@dataclass
class JointRow:
    """One joint and the rigid body behind it.

    Attributes:
        name: Name.
        parent: Row of the parent, -1 for the world.
        kind: One of `KINDS`.
        dofs: Velocities of the joint, as indices in v, in the joint's own order.
        rotation: Joint axes to the parent's, (3, 3) [1].
        position: Origin in the parent's axes, (3,) [m].
        mass: Mass [kg]; zero for an intermediate row.
        first_moment: Mass times centre of mass, joint axes, (3,) [kg m].
        inertia: About the joint's origin, joint axes, (3, 3) [kg m^2].
    """

    name: str
    parent: int
    kind: str
    dofs: tuple[int, ...]
    rotation: Array
    position: Array
    mass: float = 0.0
    first_moment: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def center_of_mass(self) -> Array:
        """Centre of mass in joint axes, (3,) [m]."""
        return self.first_moment / self.mass if self.mass else np.zeros(3)

    @property
    def central_inertia(self) -> Array:
        """Inertia about the centre of mass, joint axes, (3, 3) [kg m^2]."""
        return self.inertia - self.mass * _spread(self.center_of_mass)


def joint_table(robot: Robot) -> list[JointRow]:
    """Rows of the robot, depth first.

    Args:
        robot: Machine with numbers, not symbols.

    Returns:
        One row a joint; a floating base is the two rows `translation` and `zyx`, or
        `spherical` with a quaternion.
    """
    rows: list[JointRow] = []
    for root, body in enumerate(robot.bodies):
        if body.parent < 0:
            _append(robot, root, -1, np.eye(3), np.zeros(3), rows)
    return rows


def coordinate_order(rows: list[JointRow]) -> NDArray[np.intp]:
    """Index in v of each velocity of the table, (n,); in q too but for a quaternion."""
    return np.array([dof for row in rows for dof in row.dofs], dtype=np.intp)


def configuration_order(robot: Robot, rows: list[JointRow]) -> NDArray[np.intp]:
    """Index in q of each coordinate of the table, (n_q,); quaternions with their scalar last.

    Args:
        robot: The machine.
        rows: Table of the joints.
    """
    order: list[int] = []
    for row in rows:
        places = [robot.coordinate_indices[dof] for dof in row.dofs]
        order += [*places, min(places) - 1] if row.kind == "spherical" else places
    return np.array(order, dtype=np.intp)


def _append(
    robot: Robot, index: int, parent: int, turn: Array, shift: Array, rows: list[JointRow]
) -> None:
    """Adds body `index` and all behind it; the parent's axes lie (turn, shift) in its row's."""
    body = robot.bodies[index]
    shift = shift + turn @ np.array(body.position, float)
    turn = turn @ np.array(body.orientation, float)
    for name, kind, axis, dofs in _steps(body):
        aligned, letter = _aligned(axis)
        full_kind = kind if kind in KINDS else kind + letter
        rows.append(JointRow(name, parent, full_kind, dofs, turn @ aligned, shift))
        parent, turn, shift = len(rows) - 1, aligned.T, np.zeros(3)
    if parent >= 0:
        _lump(rows[parent], body, turn, shift)
    for child, other in enumerate(robot.bodies):
        if other.parent == index:
            _append(robot, child, parent, turn, shift, rows)


def _steps(body: Body) -> list[tuple[str, str, Axis, tuple[int, ...]]]:
    x_axis = (1.0, 0.0, 0.0)
    if body.floating_dofs is not None:
        x, y, z, roll, pitch, yaw = body.floating_dofs
        by_angles = ("zyx", x_axis, (yaw, pitch, roll))
        by_quaternion = ("spherical", x_axis, (roll, pitch, yaw))
        return [
            (f"{body.name}.position", "translation", x_axis, (x, y, z)),
            (f"{body.name}.attitude", *(by_quaternion if body.by_quaternion else by_angles)),
        ]
    letters = {"revolute": "R", "prismatic": "P"}
    return [(j.name, letters[j.kind], j.axis, (j.dof,)) for j in body.joints]


def _lump(row: JointRow, body: Body, turn: Array, shift: Array) -> None:
    xx, yy, zz, xy, xz, yz = body.inertia
    central = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], float) @ turn.T
    center = shift + turn @ np.array(body.center_of_mass, float)
    row.mass += float(body.mass)
    row.first_moment = row.first_moment + body.mass * center
    row.inertia = row.inertia + central + body.mass * _spread(center)


def _spread(center: Array) -> Array:
    return np.asarray(center @ center * np.eye(3) - np.outer(center, center))


def _aligned(axis: Axis) -> tuple[Array, str]:
    """Rotation A and letter such that A maps that coordinate axis onto `axis`."""
    direction = np.array(axis, float)
    for k, letter in enumerate("XYZ"):
        if direction[k] == 1.0:
            return np.eye(3), letter
        if direction[k] == -1.0:
            flip = -np.eye(3)
            flip[(k + 1) % 3, (k + 1) % 3] = 1.0
            return flip, letter
    across = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    across /= np.linalg.norm(across)
    return np.column_stack([direction, across, np.cross(direction, across)]), "X"


def flat(rows: list[JointRow]) -> dict[str, Any]:
    """The table as flat arrays, for a C interface.

    Returns:
        parent (m,), kind (m,), placement (m, 12) rotation by rows then position,
        inertia (m, 10) mass, centre of mass, central inertia xx, yy, zz, xy, xz, yz.
    """
    placement = [np.concatenate([row.rotation.ravel(), row.position]) for row in rows]
    upper = (np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2]))
    inertia = [[row.mass, *row.center_of_mass, *row.central_inertia[upper]] for row in rows]
    return {
        "parent": np.array([row.parent for row in rows], np.int32),
        "kind": np.array([KINDS.index(row.kind) for row in rows], np.int32),
        "placement": np.array(placement, float),
        "inertia": np.array(inertia, float),
    }
