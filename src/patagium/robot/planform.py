"""Places of a robot's bodies and strips, in plain numbers.

Pictures, warnings and chains of strips are made from them. The equations of motion have their
own kinematics, `patagium.dynamics.kinematics`, on symbols; a test holds the two together.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, real_array
from patagium.robot.model import Body, Robot, Strip


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
        position, rotation = np.zeros(3), np.eye(3)
        if body.parent >= 0:
            position, rotation = found[body.parent]
        position = position + rotation @ np.array(body.position, float)
        rotation = rotation @ np.array(body.orientation)
        for turn, slide in _motions(robot, body, coordinates):
            position, rotation = position + rotation @ slide, rotation @ turn
        found.append((position, rotation))
    return found


def _motions(robot: Robot, body: Body, q: Array) -> Iterator[tuple[Array, Array]]:
    """Turn (3, 3) and slide (3,) [m] of each joint, from the parent on."""
    unit, still = np.eye(3), np.zeros(3)
    if body.floating_dofs is not None:
        position, attitude = np.split(q[list(robot.floating_coordinates(body))], [3])
        yield unit, position
        if body.by_quaternion:
            sine = float(np.linalg.norm(attitude[1:]))
            axis = attitude[1:] / (sine or 1.0)
            yield _turn(axis, 2.0 * np.arctan2(sine, attitude[0])), still
        else:
            for axis, angle in zip(unit[::-1], attitude[::-1], strict=True):
                yield _turn(axis, angle), still
    for joint in body.joints:
        axis = np.array(joint.axis)
        value = float(q[robot.coordinate_indices[joint.dof]])
        turns = joint.kind == "revolute"
        yield (_turn(axis, value), still) if turns else (unit, axis * value)


def _turn(axis: Array, angle: float) -> Array:
    """Rotation about a unit axis (Rodrigues), (3, 3)."""
    cross = np.cross(np.eye(3), axis)
    turned = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return np.asarray(turned)


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
    return np.asarray(position + points @ rotation.T)


def wing_span(robot: Robot) -> float:
    """Tip to tip distance of the strips along y, or z if longer, at zero coordinates [m]."""
    places = poses(robot)
    sides = [placed(places[s.body], strip_corners(s))[:, 1:] for s in robot.strips]
    return float(np.ptp(np.concatenate(sides), axis=0).max()) if sides else 0.0


def carried_sides(robot: Robot) -> list[set[bool]]:
    """Whether the strips that each body carries are mirrored: both on one between two wings."""
    carried: list[set[bool]] = [set() for _ in robot.bodies]
    for strip in robot.strips:
        index = strip.body
        while index >= 0:
            carried[index].add(strip.mirrored)
            index = robot.bodies[index].parent
    return carried


def mirrored_bodies(robot: Robot) -> set[int]:
    """Indices of the bodies that carry wings made by mirroring, and no others."""
    return {index for index, sides in enumerate(carried_sides(robot)) if sides == {True}}


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
        "mass [kg]": round(robot.mass, 9),
        "span [m]": round(wing_span(robot), 9),
        "wing area [m^2]": round(sum(float(s.chord * s.width) for s in robot.strips), 9),
        "parameters": len(robot.parameter_names),
    }
