"""Two machines as one: a robot fixed to a body of an arm, one tree and one dynamics.

The robot's roots hang on the arm's body; a floating base loses its six coordinates
and their damping. Neglected: play and elasticity of the mounting.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import yaml

from patagium.errors import ParameterError
from patagium.robot.assembly import rotation
from patagium.robot.model import Axis, Body, Robot, Strip

_CAPACITIES = ("speed_limit", "acceleration_limit", "effort_limit")


def mounted(
    robot: Robot, arm: Robot, at: str, position: Axis, orientation: Axis, prefix: str
) -> Robot:
    """A robot fixed to a body of an arm.

    Args:
        robot: What is carried.
        arm: What carries it; its bodies and coordinates come first.
        at: Body of the arm that holds it.
        position: Where on that body, in its axes, (3,) [m].
        orientation: Roll, pitch, yaw of the robot's axes in that body's, (3,) [rad].
        prefix: Put before the arm's names.

    Raises:
        ParameterError: If the arm has no such body, the pose is no pose, or a name
            would be there twice.
    """
    shift, turn = _pose(position, orientation)
    carrier = arm.body_index(at)
    kept = tuple(i for i in range(robot.dof) if not _floats(robot, i))
    dof = {old: arm.dof + new for new, old in enumerate(kept)}
    first = len(arm.bodies)
    bodies = (
        *(_renamed(body, prefix) for body in arm.bodies),
        *(_carried(body, carrier, first, dof, shift, turn) for body in robot.bodies),
    )
    strips = (
        *(replace(s, name=prefix + s.name, wing=prefix + s.wing) for s in arm.strips),
        *(replace(s, body=s.body + first) for s in robot.strips),
    )

    def joined(name: str) -> tuple[Any, ...]:
        own = getattr(robot, name)
        return (*getattr(arm, name), *(own[i] for i in kept))

    composed = Robot(
        name=f"{robot.name}-on-{arm.name}",
        bodies=bodies,
        strips=strips,
        dof_names=(*(prefix + k for k in arm.dof_names), *(robot.dof_names[i] for i in kept)),
        dof_units=joined("dof_units"),
        actuated=(*arm.actuated, *(dof[i] for i in robot.actuated if i in dof)),
        damping=joined("damping"),
        lower=joined("lower"),
        upper=joined("upper"),
        gravity=robot.gravity,
        source=_source(robot, arm, at, position, orientation, prefix),
        **{name: _capacity(name, robot, arm, kept) for name in _CAPACITIES},
    )
    _check_names(composed, strips)
    return composed


def _pose(position: Sequence[float], orientation: Sequence[float]) -> tuple[Any, Any]:
    for name, values in (("position", position), ("orientation", orientation)):
        if np.shape(values) != (3,) or not np.isfinite(np.asarray(values, float)).all():
            raise ParameterError(name, "three finite numbers", tuple(np.ravel(values)))
    return np.asarray(position, float), rotation(*(float(k) for k in orientation))


def _floats(robot: Robot, dof: int) -> bool:
    return any(dof in (body.floating_dofs or ()) for body in robot.bodies)


def _renamed(body: Body, prefix: str) -> Body:
    joints = tuple(replace(joint, name=prefix + joint.name) for joint in body.joints)
    return replace(body, name=prefix + body.name, joints=joints)


def _carried(
    body: Body, carrier: int, first: int, dof: dict[int, int], shift: Any, turn: Any
) -> Body:
    """A body of the robot in the tree of the arm; a root is moved to the mounting."""
    joints = tuple(replace(joint, dof=dof[joint.dof]) for joint in body.joints)
    if body.parent >= 0:
        return replace(body, parent=body.parent + first, joints=joints)
    placed = shift + turn @ np.asarray(body.position, float)
    turned = turn @ np.asarray(body.orientation)
    return replace(
        body,
        parent=carrier,
        position=_triple(placed),
        orientation=(_triple(turned[0]), _triple(turned[1]), _triple(turned[2])),
        joints=joints,
        floating_dofs=None,
    )


def _triple(vector: Any) -> Axis:
    x, y, z = (float(k) + 0.0 for k in vector)
    return (x, y, z)


def _capacity(name: str, robot: Robot, arm: Robot, kept: tuple[int, ...]) -> tuple[float, ...]:
    own, carriers = getattr(robot, name), getattr(arm, name)
    if not own and not carriers:
        return ()
    own = own or (np.inf,) * robot.dof
    return (*(carriers or (np.inf,) * arm.dof), *(own[i] for i in kept))


def _check_names(robot: Robot, strips: tuple[Strip, ...]) -> None:
    kinds = {
        "bodies": [body.name for body in robot.bodies],
        "coordinates": list(robot.dof_names),
        "strips": [strip.name for strip in strips],
    }
    for kind, names in kinds.items():
        for name in names:
            if names.count(name) > 1:
                raise ParameterError("prefix", f"one that keeps names of {kind} apart", name)


def _source(
    robot: Robot, arm: Robot, at: str, position: Axis, orientation: Axis, prefix: str
) -> str:
    """Text of a robot file that says the same; nothing where either has none."""
    if not (robot.source and arm.source):
        return ""
    described = {
        "robot": yaml.safe_load(robot.source),
        "mounted_on": yaml.safe_load(arm.source),
        "at": at,
        "position": [float(k) for k in position],
        "orientation": [float(k) for k in orientation],
        "prefix": prefix,
    }
    return yaml.safe_dump(described, sort_keys=False)
