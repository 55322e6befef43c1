"""A robot on paper: bodies, joints with axes and limits, strips; and its facts in words.

Strips are drawn as the rectangles the aerodynamics sees, bodies as the outlines of their solids.
"""

from __future__ import annotations

from math import degrees

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from patagium.arrays import Array
from patagium.report.figures import Hinge, machine
from patagium.report.still import solid_faces
from patagium.robot.model import Robot
from patagium.robot.planform import mirrored_bodies, placed, poses, strip_corners
from patagium.robot.solids import solids
from patagium.robot.strip_chains import strip_chains


def draw_robot(robot: Robot, q: ArrayLike | None = None) -> Figure:
    """Figure of the robot from above, from behind and from the left.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1]; those of zero angles when None.

    Raises:
        ShapeError: If `q` is not (n_q,).
    """
    places = poses(robot, q)
    strips: dict[str, list[Array]] = {}
    for strip in robot.strips:
        strips.setdefault(strip.wing, []).append(placed(places[strip.body], strip_corners(strip)))
    middles = [placed(places[s.body], np.array(s.quarter_chord, float)) for s in robot.strips]
    winged = {strip.body for strip in robot.strips}
    return machine(
        robot.name,
        strips={wing: np.array(corners) for wing, corners in strips.items()},
        joints=_hinges(robot, robot.coordinates() if q is None else np.asarray(q, float)),
        centers={
            b.name: placed(pose, np.array(b.center_of_mass, float))
            for b, pose in zip(robot.bodies, places, strict=True)
            if b.mass
        },
        outlines=[
            placed(places[solid.body], solid_faces(*solid[1:]).reshape(-1, 3))
            for solid in solids(robot)
            if solid.kind != "capsule" or solid.body not in winged
        ],
        lines=[np.array([middles[i] for i in chain.strips]) for chain in strip_chains(robot)],
    )


_SPOKEN = {"revolute": ("about", "deg", degrees(1)), "prismatic": ("along", "cm", 100.0)}


def _hinges(robot: Robot, q: Array) -> dict[str, Hinge]:
    """Joints of the robot by name; those of mirrored wings are not listed."""
    images = mirrored_bodies(robot)
    hinges: dict[str, Hinge] = {}
    places = poses(robot, q)
    for index, body in enumerate(robot.bodies):
        own = [strip_corners(s) for s in robot.strips if s.body == index]
        points = np.concatenate([[body.center_of_mass], *own]).astype(float)
        for joint in body.joints:
            axis = np.array(joint.axis)
            away = np.linalg.norm(np.cross(points, axis), axis=1) + 1e-6 * np.abs(points @ axis)
            far = points[away.argmax()]  # of a straight edge its outer end
            limits = (robot.lower[joint.dof], robot.upper[joint.dof])
            sweep, ways = np.zeros((0, 3)), "no limits"
            how, unit, factor = _SPOKEN[joint.kind]
            if np.isfinite(limits).all():
                sweep = _sweep(robot, q, index, far, joint.dof)
                ways = " to ".join(f"{factor * k:.0f}" for k in limits) + f" {unit}"
            words = "" if index in images else f"{joint.name}: {how} {_letter(axis)}, {ways}"
            hinges[joint.name] = Hinge(places[index][0], places[index][1] @ axis, sweep, words)
    return hinges


def _sweep(robot: Robot, q: Array, body: int, point: Array, dof: int) -> Array:
    """Way of a point of a body while one joint goes from limit to limit, (n, 3) [m]."""
    turned = np.tile(q, (33, 1))
    turned[:, robot.coordinate_indices[dof]] = np.linspace(robot.lower[dof], robot.upper[dof], 33)
    return np.array([placed(poses(robot, one)[body], point) for one in turned])


def _letter(axis: Array) -> str:
    """Axis as a letter with its sign, or as three numbers."""
    along = int(np.abs(axis).argmax())
    if abs(axis[along]) > 1 - 1e-9:
        return ("" if axis[along] > 0 else "-") + "xyz"[along]
    return "[" + ", ".join(f"{k:.2g}" for k in axis) + "]"
