"""Motion of each strip of wing relative to the air.

The velocity of a strip is that of the wing *relative to the air*, in strip axes:
forward (along the chord to the leading edge), spanwise (normal x forward),
normal (out of the upper surface). The wind is one for all strips, or one a strip.
Neglected: what the wings do to the air (induced velocity).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from patagium.aerodynamics.smooth_functions import smooth_norm, smooth_sign
from patagium.dynamics.chain import vector
from patagium.dynamics.kinematics import Pose, Twist, body_poses, body_velocities, in_body_axes
from patagium.robot.model import Robot, Strip


@dataclass(frozen=True)
class StripMotion:
    """Motion of one strip's quarter-chord point relative to the air.

    Attributes:
        strip: The strip.
        forward: Velocity to the leading edge, the same along the chord [m/s].
        spanwise: Velocity along normal x forward [m/s].
        normal: Velocity out of the upper surface [m/s].
        pitch_rate: Rate at which the leading edge rises, about the span [rad/s].
        turn_rate: Rate of turn about the normal [rad/s].
    """

    strip: Strip
    forward: ca.SX
    spanwise: ca.SX
    normal: ca.SX
    pitch_rate: ca.SX
    turn_rate: ca.SX

    def normal_ahead(self, distance: Any) -> Any:
        """Normal velocity of the chord point ahead of the quarter chord, scalar [m/s].

        Args:
            distance: Ahead of the quarter chord, negative behind [m].
        """
        return self.normal + distance * self.pitch_rate

    def spanwise_ahead(self, distance: Any) -> Any:
        """Spanwise velocity of the chord point ahead of the quarter chord, scalar [m/s].

        Args:
            distance: Ahead of the quarter chord, negative behind [m].
        """
        return self.spanwise + distance * self.turn_rate


def body_airflows(robot: Robot, q: ca.SX, v: ca.SX, wind: ca.SX) -> list[Twist]:
    """Velocity of every body relative to the air, in body axes.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        wind: Velocity of the air, world axes, (3,) [m/s].
    """
    twists = body_velocities(robot, q, v)
    winds = in_body_axes(robot, q, wind)
    return [
        Twist(twist.linear - wind, twist.angular) for twist, wind in zip(twists, winds, strict=True)
    ]


def strip_airflows(robot: Robot, q: ca.SX, v: ca.SX, wind: ca.SX) -> list[Twist]:
    """Velocity of every strip's body relative to the air at the strip, in body axes.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        wind: Velocity of the air, world axes, (3,) or (3, n_strips) [m/s].
    """
    if wind.shape[1] == 1:
        airflows = body_airflows(robot, q, v, wind)
        return [airflows[strip.body] for strip in robot.strips]
    twists, poses = body_velocities(robot, q, v), body_poses(robot, q)
    return [
        Twist(
            twists[strip.body].linear - poses[strip.body].rotation.T @ wind[:, i],
            twists[strip.body].angular,
        )
        for i, strip in enumerate(robot.strips)
    ]


def strip_axes(strip: Strip) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Unit vectors forward, normal and along normal x forward, body axes, (3, 1) each [-]."""
    forward, normal = vector(strip.forward), vector(strip.normal)
    return forward, normal, ca.cross(normal, forward)


def quarter_chord(poses: Sequence[Pose], strip: Strip) -> ca.SX:
    """Quarter-chord point of a strip in the world, (3, 1) [m]."""
    return poses[strip.body].at(vector(strip.quarter_chord))


def strip_motions(robot: Robot, q: ca.SX, v: ca.SX, wind: ca.SX) -> list[StripMotion]:
    """Motion of every strip relative to the air.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        wind: Velocity of the air, world axes, (3,) or (3, n_strips) [m/s].

    Returns:
        One motion a strip.
    """
    motions = []
    for strip, twist in zip(robot.strips, strip_airflows(robot, q, v, wind), strict=True):
        forward, normal, span = strip_axes(strip)
        velocity = twist.at(vector(strip.quarter_chord))
        motions.append(
            StripMotion(
                strip,
                ca.dot(forward, velocity),
                ca.dot(span, velocity),
                ca.dot(normal, velocity),
                -ca.dot(span, twist.angular),
                ca.dot(normal, twist.angular),
            )
        )
    return motions


def normalwash(motion: StripMotion) -> Any:
    """Air through a strip at three quarters of its chord, camber apart [m/s]."""
    return -motion.normal_ahead(collocation(motion))


def collocation(motion: StripMotion) -> Any:
    """Distance of the collocation point ahead of the quarter chord [m]."""
    return -(1.0 + smooth_sign(motion.forward)) * (motion.strip.chord / 4)


def lift_place(motion: StripMotion) -> Any:
    """Distance of the lift ahead of the quarter chord; at 3/4 of it in backward flow [m]."""
    return (smooth_sign(motion.forward) - 1.0) * (motion.strip.chord / 4)


def airspeed(motion: StripMotion) -> Any:
    """Speed across the span where the normalwash is taken, never zero [m/s]."""
    normal = motion.normal_ahead(collocation(motion))
    return smooth_norm(motion.forward * motion.forward + normal * normal)
