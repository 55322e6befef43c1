"""Solids of bodies for pictures: shapes from the robot file, else bones.

A body with a shape is drawn as it; a plate that carries strips is left to the strips.
A body without is a bone: capsules from its origin to the joints it carries, or along its
wing, or through its center of mass. Fairings and gears are not drawn.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import yaml
from pydantic import ValidationError

from patagium.arrays import Array
from patagium.robot.model import Body, Robot, Strip, axis_of
from patagium.robot.planform import reflected_axis, sides_of, wing_span
from patagium.robot.schema import Box, Cylinder, Ellipsoid, Plate, PointMass, RobotFile

_BONE = 0.008  # radius of a bone over the span
_STOUTNESS = 0.02  # the same over its own length, at least
_TUBE = 0.06  # radius of a tube over the longest, where there is no wing: an arm's links
_LEAST_BONE = 0.002  # radius of a robot without extent [m]


class Solid(NamedTuple):
    """A simple solid fixed to a body.

    Attributes:
        body: Index of the body.
        kind: "cylinder", "capsule", "box" or "ellipsoid".
        center: In body axes, (3,) [m].
        axis: Unit vector along a cylinder or capsule, body axes, (3,) [-].
        size: Radius and length of a cylinder; radius and distance of the ends' centers of a
            capsule; edges of a box; semi-axes of an ellipsoid [m].
    """

    body: int
    kind: str
    center: tuple[float, ...]
    axis: tuple[float, ...]
    size: tuple[float, ...]


def solids(robot: Robot) -> list[Solid]:
    """Solids of the bodies of a robot, one or more each."""
    shapes = _shapes(_described(robot.source))
    own = carried_body(robot)
    ways = [float(np.linalg.norm(k.position)) for k in robot.bodies[1 : own or None]]
    thin, thick = _BONE * wing_span(robot), _TUBE * max(ways, default=0.0)
    found: list[Solid] = []
    for index, body in enumerate(robot.bodies):
        shape = shapes.get(body.name)
        strips = [strip for strip in robot.strips if strip.body == index]
        radius = (thick if index < own or not robot.strips else thin) or _LEAST_BONE
        if shape is None or isinstance(shape, PointMass) or (isinstance(shape, Plate) and strips):
            found += _bones(robot, index, strips, radius)
        else:
            found.append(_solid(index, body, shape))
    return found


def tube(body: int, start: Array, end: Array, radius: float) -> Solid:
    """A tube of a radius [m] from one point to another, in the axes of its body, (3,) [m]."""
    link = end - start
    length = float(np.linalg.norm(link))
    middle = axis_of((start + end) / 2)
    return Solid(body, "capsule", middle, axis_of(link / length), (radius, length))


def carried_body(robot: Robot) -> int:
    """First body of a robot that an arm carries (`Robot.mounted_on`); 0 without an arm."""
    described = _described(robot.source)
    if not (isinstance(described, dict) and "mounted_on" in described):
        return 0
    prefix = described.get("prefix", "")
    arms = [prefix and body.name.startswith(prefix) for body in robot.bodies]
    return arms.index(False) if False in arms else 0


def _described(source: str) -> Any:
    try:
        return yaml.safe_load(source)
    except yaml.YAMLError:  # not every robot comes from a robot file
        return None


def _shapes(described: Any) -> dict[str, Any]:
    """Shapes by body, mirrored and mounted ones too, as far as the robot's source tells."""
    if isinstance(described, dict) and "mounted_on" in described:
        carrier = _shapes(described["mounted_on"]).items()
        prefix = described.get("prefix", "")
        return {prefix + name: k for name, k in carrier} | _shapes(described.get("robot"))
    try:
        file = RobotFile.model_validate(described)
    except ValidationError:
        return {}
    written: dict[str, Any] = {k: b.shape for k, b in file.bodies.items() if b.shape is not None}
    images = {
        mirror.image(name): _reflected(shape)
        for mirror in file.mirror
        for name, shape in written.items()
        if name.startswith(mirror.source)
    }
    return written | images


def _reflected(shape: Any) -> Any:
    if not isinstance(shape, Cylinder):
        return shape
    return shape.model_copy(update={"axis": reflected_axis("prismatic", shape.axis)})


def _solid(index: int, body: Body, shape: Cylinder | Box | Ellipsoid | Plate) -> Solid:
    center, up = axis_of(body.center_of_mass), (0.0, 0.0, 1.0)
    if isinstance(shape, Cylinder):
        return Solid(index, "cylinder", center, tuple(shape.axis), (shape.radius, shape.length))
    if isinstance(shape, Ellipsoid):
        return Solid(index, "ellipsoid", center, up, tuple(shape.semi_axes))
    return Solid(index, "box", center, up, tuple(shape.size))


def _bones(robot: Robot, index: int, strips: list[Strip], radius: float) -> list[Solid]:
    body = robot.bodies[index]
    ends = [np.array(k.position, float) for k in robot.bodies if k.parent == index]
    if strips and not ends:
        last = robot.strips.index(strips[-1])
        ends = [outer_end(strips[-1], sides_of(robot)[last])]
    if not ends and not strips:
        ends = [2.0 * np.array(body.center_of_mass, float)]
    long = [end for end in ends if np.linalg.norm(end) > radius]
    if not long and not strips:
        size = 2 * radius if robot.strips and index >= carried_body(robot) else radius
        return [_solid(index, body, Ellipsoid(type="ellipsoid", semi_axes=(size, size, size)))]
    stout = [max(radius, _STOUTNESS * float(np.linalg.norm(end))) for end in long]
    return [tube(index, np.zeros(3), *one) for one in zip(long, stout, strict=True)]


def outer_end(strip: Strip, side: int) -> Array:
    """Quarter chord of a strip of a side at its edge away from its hinge, body axes (3,) [m]."""
    half = (side or 1) * strip.width / 2 * np.cross(strip.normal, strip.forward)
    return np.asarray(strip.quarter_chord + half)


def wing_tips(robot: Robot) -> dict[str, tuple[int, Array]]:
    """Wing -> the body that carries its last strip, and that strip's outer end, (3,) [m]."""
    sides = zip(robot.strips, sides_of(robot), strict=True)
    return {strip.wing: (strip.body, outer_end(strip, side)) for strip, side in sides}
