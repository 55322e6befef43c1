"""A robot on paper: planform, joints, strips, centers of mass; and its facts in words.

Strips are drawn as the rectangles the aerodynamics sees. The solid
shapes of the bodies are not drawn.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from patagium.report.figures import machine
from patagium.robot.model import Robot
from patagium.robot.planform import placed, poses, strip_corners

Array = NDArray[np.float64]


def draw_robot(robot: Robot, q: ArrayLike | None = None) -> Figure:
    """Figure of the robot from above and from behind.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1]; those of zero angles
            when None.

    Raises:
        ShapeError: If `q` is not (n_q,).
    """
    places = poses(robot, q)
    strips: dict[str, list[Array]] = {}
    for strip in robot.strips:
        strips.setdefault(strip.wing, []).append(placed(places[strip.body], strip_corners(strip)))
    jointed = [(b, pose) for b, pose in zip(robot.bodies, places, strict=True) if b.joints]
    return machine(
        robot.name,
        strips={wing: np.array(corners) for wing, corners in strips.items()},
        joints={b.name: position for b, (position, _) in jointed},
        centers={
            b.name: placed(pose, np.array(b.center_of_mass, float))
            for b, pose in zip(robot.bodies, places, strict=True)
        },
        links=[
            np.array([places[b.parent][0], position])
            for b, (position, _) in jointed
            if b.parent >= 0
        ],
    )


def describe_robot(robot: Robot) -> dict[str, str | int | float]:
    """Facts of a robot for a listing, by name with the unit in brackets.

    The span is that of the strips at zero coordinates, tip to tip along y.

    Args:
        robot: The machine, with numbers for parameters.
    """
    mass = sum(float(b.mass) for b in robot.bodies)
    joints = [robot.dof_names[k.dof] for b in robot.bodies for k in b.joints]
    return {
        "robot": robot.name,
        "base": "floating" if robot.floating else "fixed",
        "attitude": robot.attitude or "none",
        "coordinates": robot.coordinate_count,
        "joints": len(joints),
        "passive joints": sum(robot.index(k) not in robot.actuated for k in joints),
        "bodies": len(robot.bodies),
        "wings": len({s.wing for s in robot.strips}),
        "strips": len(robot.strips),
        "mass [kg]": round(mass, 9),
        "span [m]": round(wing_span(robot), 9),
        "wing area [m^2]": round(sum(float(s.chord * s.width) for s in robot.strips), 9),
        "parameters": len(robot.parameter_names),
    }


def wing_span(robot: Robot) -> float:
    """Tip to tip distance of the strips along y, at zero coordinates [m]."""
    places = poses(robot)
    sides = [placed(places[s.body], strip_corners(s))[:, 1] for s in robot.strips]
    return float(np.ptp(np.concatenate(sides))) if sides else 0.0
