"""Effect of level ground on wings: mirror images of vortices, and the downwash that is lost.

The ground takes away a share of the velocity that a wing's trailing vortices induce on it, the
more the nearer it is. A lifting line has the images themselves; models without vortices take the
share of a wing with elliptic loading. Neglected: images of bound vortices and of the wing's
thickness (so nearer than a chord the lift is too low), the boundary layer, images of the wake
that is bent by the ground.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.local_flow import quarter_chord
from patagium.dynamics.kinematics import body_poses
from patagium.robot.model import Robot

NEAREST = 0.0005
"""Height over the span below which wings are no nearer to the ground [1]."""


@dataclass(frozen=True)
class GroundPlane:
    """Level ground as a plane, normal . p = level.

    Attributes:
        normal: Upward unit vector, (3, 1) [-].
        level: Distance of the plane from the origin along it [m].
    """

    normal: ca.SX
    level: Any

    def turned(self, vectors: ca.SX) -> ca.SX:
        """Mirror images of vectors, (3, n) [of the vectors]."""
        return vectors - 2 * self.normal @ (self.normal.T @ vectors)

    def image(self, points: ca.SX) -> ca.SX:
        """Mirror images of points, (3, n) [m]."""
        above = self.normal.T @ points - self.level
        return points - 2 * self.normal @ above


def ground_share(height: Any, span: Any) -> Any:
    """Share of a wing's own downwash that the ground takes away, 0 to 1.

    That which the image of an elliptic loading takes from its induced drag, as a ratio of
    polynomials of x = height/span, right to .0003 from x = .01 on and to .0007 from .001 on, with
    the limit 1/(32 x^2) far away:

        s = (1 + 144 x + 411.3 x^2) / (1 + 160.6 x + 1764 x^2 + 4295 x^3 + 13161.6 x^4).

    Wieselsberger's (1 - 1.32 x)/(1.05 + 7.4 x) is the same to .002 for x = .05 to .25.
    Below `NEAREST` the height is rounded off, so that a point in the ground gets a number, too.

    Args:
        height: Of the wing above the ground [m].
        span: From tip to tip [m].

    References:
        Wieselsberger (1922), Wing resistance near the ground, NACA TM 77.
    """
    ratio = height / span
    x = (ratio + ca.sqrt(ratio * ratio + NEAREST**2)) / 2
    above = 1.0 + x * (144.0 + 411.3 * x)
    return above / (1.0 + x * (160.6 + x * (1764.0 + x * (4295.0 + 13161.6 * x))))


def strip_ground_shares(
    air: Air, robot: Robot, q: ca.SX, spans: list[Any], parameters: ca.SX
) -> list[Any]:
    """Share of its downwash that the ground takes from each strip, n_strips, 0 to 1.

    Args:
        air: The air, with ground or without.
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        spans: Span of the wing that each strip is of, n_strips [m].
        parameters: Numbers of the model, the last of which is the height of the ground.
    """
    if air.ground is None:
        return [0.0] * len(robot.strips)
    poses = body_poses(robot, q)
    heights = [quarter_chord(poses, strip)[2] - parameters[-1] for strip in robot.strips]
    return [ground_share(height, span) for height, span in zip(heights, spans, strict=True)]
