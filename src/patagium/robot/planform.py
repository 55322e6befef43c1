"""Places of a robot's bodies and strips, in plain numbers.

Pictures, warnings and chains of strips are made from them. The equations of motion have their
own kinematics, `patagium.dynamics.kinematics`, on symbols; a test holds the two together.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, real_array
from patagium.robot.attitude import rotation_from_angles
from patagium.robot.model import Axis, Body, Joint, Robot, Strip, axis_of

BOTH_SIDES = 0.5
"""Reach on one side of the hinge over that on the other, beyond which a wing goes to both sides."""


def poses(robot: Robot, q: ArrayLike | None = None) -> list[tuple[Array, Array]]:
    """Position (3,) [m] and rotation to the world (3, 3) of every body.

    Args:
        robot: The machine, with numbers for parameters.
        q: Generalized coordinates, (n_q,) [m, rad, 1]; those of zero angles when None.

    Raises:
        ShapeError: If `q` is not (n_q,).
    """
    given = robot.coordinates() if q is None else q
    coordinates = real_array("q", given, (robot.coordinate_count,))
    found: list[tuple[Array, Array]] = []
    for body in robot.bodies:
        position, rotation = found[body.parent] if body.parent >= 0 else (np.zeros(3), np.eye(3))
        position = position + rotation @ np.array(body.position, float)
        rotation = rotation @ np.array(body.orientation)
        for turn, slide in _motions(robot, body, coordinates):
            position, rotation = position + rotation @ slide, rotation @ turn
        found.append((position, rotation))
    return found


def _motions(robot: Robot, body: Body, q: Array) -> Iterator[tuple[Array, Array]]:
    """Turn (3, 3) and slide (3,) [m] of each joint, from the parent on."""
    if body.floating_dofs is not None:
        position, attitude = np.split(q[list(robot.floating_coordinates(body))], [3])
        if body.by_quaternion:
            sine = float(np.linalg.norm(attitude[1:]))
            turn = _turn(attitude[1:] / (sine or 1.0), 2.0 * np.arctan2(sine, attitude[0]))
        else:
            turn = rotation_from_angles(attitude)
        yield turn, position
    for joint in body.joints:
        axis = np.array(joint.axis)
        value = float(q[robot.coordinate_indices[joint.dof]])
        turns = joint.kind == "revolute"
        yield (_turn(axis, value), np.zeros(3)) if turns else (np.eye(3), axis * value)


def _turn(axis: Array, angle: float) -> Array:
    """Rotation about a unit axis (Rodrigues), (3, 3)."""
    cross = np.cross(np.eye(3), axis)
    turned = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return np.asarray(turned)


def reflected_axis(kind: str, axis: Any) -> Axis:
    """Axis reflected in y, (3,): a polar vector for a slide, an axial one for a turn.

    Args:
        kind: Kind of the joint, "revolute" or "prismatic".
        axis: Its unit axis, (3,) [1].
    """
    x, y, z = axis
    return axis_of((x, -y, z) if kind == "prismatic" else (-x, y, -z))


def strip_corners(strip: Strip) -> Array:
    """Corners of a strip in body axes, in order around it, (4, 3) [m]."""
    forward = np.array(strip.forward)
    half = np.cross(np.array(strip.normal), forward) * float(strip.width) / 2
    leading = np.array(strip.quarter_chord, float) + forward * float(strip.chord) / 4
    trailing = leading - forward * float(strip.chord)
    return np.array([leading - half, leading + half, trailing + half, trailing - half])


def placed(pose: tuple[Array, Array], points: Array) -> Array:
    """Points of a body in world axes, (..., 3) [m].

    Args:
        pose: Position (3,) [m] and rotation (3, 3) of the body.
        points: In body axes, (..., 3) [m].
    """
    position, rotation = pose
    return position + points @ rotation.T


def hinge_of(robot: Robot, body: int) -> int:
    """Body inwards from one whose joints move both, that floats or is mounted; else the root."""
    chain = [(k, robot.bodies[k]) for k in inwards(robot, body)]
    moved = (k for k, one in chain if one.joints or one.floating_dofs or one.mounted)
    return next(moved, chain[-1][0])


def sides_of(robot: Robot) -> tuple[int, ...]:
    """Side of each strip: 1 if normal x forward points outward along the span, -1 if inward, or 0.

    Outward is away from the joint that moves the strip, whichever frames lie between.

    Args:
        robot: The machine, in numbers.
    """
    places, found = poses(robot), []
    for strip in robot.strips:
        position, axes = places[strip.body]
        away = position + axes @ strip.quarter_chord - places[hinge_of(robot, strip.body)][0]
        outward = away @ axes @ np.cross(strip.normal, strip.forward)
        found.append(int(np.sign(np.round(outward / strip.width, 9))))
    return tuple(found)


def wing_span(robot: Robot) -> float:
    """Tip to tip distance of the strips along y, or z if longer, at zero coordinates [m]."""
    places = poses(robot)
    sides = [placed(places[s.body], strip_corners(s))[:, 1:] for s in robot.strips]
    return float(np.ptp(np.concatenate(sides), axis=0).max()) if sides else 0.0


def inwards(robot: Robot, body: int) -> list[int]:
    """Indices of a body, its parent and so on to a root."""
    found = []
    while body >= 0:
        found.append(body)
        body = robot.bodies[body].parent
    return found


def loop_of(parents: Mapping[str, str], name: str) -> list[str]:
    """Names of the loop that following the parents from a name ends in; the first stands twice."""
    walk = [name]
    while walk.count(walk[-1]) < 2:
        walk.append(parents[walk[-1]])
    return walk[walk.index(walk[-1]) :]


def from_the_root(robot: Robot, strips: Sequence[Strip]) -> list[Strip]:
    """Strips of one wing from the root outward, numbered anew.

    Inner bodies are first; on one, or on several side by side, strips near its hinge or the origin
    of their parent. Strips of wings that go to both sides of that stay as they are.

    Args:
        robot: The machine, whose own strips do not count.
        strips: Strips of the wing.
    """
    depths = [len(inwards(robot, strip.body)) for strip in strips]
    places, away = poses(robot), np.zeros(len(strips))
    for depth in {*depths}:
        own = [k for k, one in enumerate(depths) if one == depth]
        bodies = {strips[k].body for k in own}
        one = min(bodies)
        body = hinge_of(robot, one) if len(bodies) == 1 else robot.bodies[one].parent
        origin, axes = places[body] if body >= 0 else (np.zeros(3), np.eye(3))
        middles = [placed(places[strips[k].body], np.array(strips[k].quarter_chord)) for k in own]
        across = ((np.array(middles) - origin) @ axes)[:, 1:]
        far = across[np.linalg.norm(across, axis=1).argmax()]
        away[own] = across @ far / max(far @ far, 1e-30)
        if away[own].min() < -BOTH_SIDES:
            return list(strips)
    order = np.lexsort((np.round(away, 9), np.array(depths)))
    return [replace(strips[k], name=f"{strips[k].wing}[{i}]") for i, k in enumerate(order)]


def mirror_body(robot: Robot, one: str, other: str) -> int | None:
    """Innermost body in whose axes two wings are mirror images in y at zero coordinates.

    Args:
        robot: The machine, in numbers.
        one: Name of a wing.
        other: Name of the other wing.

    Returns:
        Index of a body that carries both, -1 for the world, None where they are no images.
    """
    first, second = ([s for s in robot.strips if s.wing == name] for name in (one, other))
    if len(first) != len(second):
        return None
    places = [*poses(robot), (np.zeros(3), np.eye(3))]  # the last is the world
    corners = np.array([placed(places[s.body], strip_corners(s)) for s in (*first, *second)])
    common = {*inwards(robot, first[0].body)} & {*inwards(robot, second[0].body)}
    for body in (*sorted(common, reverse=True), -1):
        origin, axes = places[body]
        seen, image = np.split((corners - origin) @ axes, 2)
        apart = image[:, [1, 0, 3, 2]] * [1.0, -1.0, 1.0] - seen
        if np.abs(apart).max() < 1e-6 * np.ptp(seen, axis=(0, 1)).max():
            return body
    return None


def image_joints(robot: Robot) -> Iterator[tuple[Joint, Joint, Array, Array]]:
    """Joints of wings that are mirror images, each with that of the image, outermost first.

    Beside them are axis of the first and its reflection, in axes of the second's body, (3,) [1].

    Args:
        robot: The machine, in numbers.
    """
    turns = [*(turn for _, turn in poses(robot)), np.eye(3)]  # the last is the world's
    for wings in map(sorted, robot.mirrored_wings):
        bodies = ([s.body for s in robot.strips if s.wing == wing] for wing in wings)
        common = turns[-1 if (base := mirror_body(robot, *wings)) is None else base]
        for pair in dict.fromkeys(zip(*bodies, strict=True)):
            one, other = (
                [(j, turns[k]) for k in inwards(robot, body) for j in robot.bodies[k].joints[::-1]]
                for body in pair
            )
            for (joint, turn), (image, own) in zip(one, other, strict=False):
                if joint is not image and joint.kind == image.kind:
                    axis = turn @ joint.axis
                    mirrored = common @ reflected_axis(joint.kind, common.T @ axis)
                    yield joint, image, own.T @ axis, own.T @ mirrored


def mirrored_bodies(robot: Robot) -> set[int]:
    """Indices of the bodies that carry wings made by mirroring, and no others."""
    seen = [(strip.mirrored, k) for strip in robot.strips for k in inwards(robot, strip.body)]
    return {k for made, k in seen if made} - {k for made, k in seen if not made}


def describe_robot(robot: Robot) -> dict[str, str | int | float]:
    """Facts of a robot for a listing, by name with the unit in brackets.

    The span is that of the strips at zero coordinates, tip to tip along y, or z if longer.

    Args:
        robot: The machine, with numbers for parameters.
    """
    joints = [robot.dof_names[k.dof] for b in robot.bodies for k in b.joints]
    return {
        "robot": robot.name,
        "base": "floating" if robot.floating else "fixed",
        "attitude": robot.attitude or "none",
        "coordinates": robot.coordinate_count,
        "joints": len(joints),
        "passive joints": sum(robot.index(k) not in robot.actuated for k in joints),
        "bodies": len(robot.bodies),
        "wings": len(robot.wing_names),
        "strips": len(robot.strips),
        "mass [kg]": float(f"{robot.mass:.9g}"),
        "span [m]": float(f"{wing_span(robot):.9g}"),
        "wing area [m^2]": float(f"{sum(float(s.chord * s.width) for s in robot.strips):.9g}"),
        "parameters": len(robot.parameter_names),
    }
