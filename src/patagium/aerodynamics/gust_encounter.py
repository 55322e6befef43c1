"""Encounter of strips with a traveling gust: delays and effective winds, as expressions.

Where a chord is in the gust depends on the state; what is there is looked up between the two
(`traveling_gust.gusts_at_strips`). Neglected: strips are points along the span.
"""

from __future__ import annotations

import casadi as ca

from patagium.aerodynamics.local_flow import strip_motions, velocity_at
from patagium.aerodynamics.smooth_functions import smooth_sign
from patagium.aerodynamics.traveling_gust import GUST_COMPONENTS
from patagium.dynamics.chain import cross, vector
from patagium.dynamics.kinematics import body_poses, body_velocities
from patagium.robot.model import Robot

GUST = 6
"""Numbers of a gust that travels: slowness and origin."""


def strip_delays(robot: Robot, q: ca.SX, v: ca.SX, gust: ca.SX) -> ca.SX:
    """Delays of strips behind a gust's origin, and their rates, (4, n_strips) [s, s, 1, 1].

    With slowness s = n/c: s . (p - p0) of mid-chord [s], how much later than that the leading
    edge is [s], and the rates of both [1].

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        gust: Slowness [s/m] and origin [m], (6,).
    """
    poses, twists = body_poses(robot, q), body_velocities(robot, q, v)
    slowness, origin = gust[:3], gust[3:]
    columns = []
    for strip in robot.strips:
        pose, twist = poses[strip.body], twists[strip.body]
        ahead = vector(strip.forward) * (strip.chord / 2)
        middle = vector(strip.quarter_chord) - ahead / 2
        local = pose.rotation.T @ slowness
        columns.append(
            ca.vertcat(
                ca.dot(slowness, pose.position - origin) + ca.dot(local, middle),
                ca.dot(local, ahead),
                ca.dot(local, velocity_at(twist, middle)),
                ca.dot(local, cross(twist.angular, ahead)),
            )
        )
    return ca.horzcat(*columns) if columns else ca.SX(4, 0)


def strip_winds(robot: Robot, q: ca.SX, v: ca.SX, wind: ca.SX, met: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Wind that the circulation of each strip answers to, and the mean along its chord.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        v: Generalized velocities, (n,) [m/s, rad/s].
        wind: What of the wind is the same everywhere, world axes, (3,) [m/s].
        met: What strips meet, (9, n_strips).

    Returns:
        World axes, (3, n_strips) each [m/s].
    """
    count = len(robot.strips)
    mean = ca.repmat(wind, 1, count) + met[:3, :]
    edges = [smooth_sign(motion.forward) for motion in strip_motions(robot, q, v, mean)]
    weighted = [mean[:, i] - edges[i] * met[3:6, i] for i in range(count)]
    return ca.horzcat(ca.SX(3, 0), *weighted), mean


def gust_rates(met: ca.SX) -> ca.SX:
    """Rate of the gust that pushes the air carried by each strip, world axes, (3, n) [m/s^2].

    Args:
        met: Gust at the strips, (9, n) [m/s, m/s^2].
    """
    return met[6:GUST_COMPONENTS, :]
