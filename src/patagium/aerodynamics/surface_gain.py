"""Lift of a lifting surface over that of a lifting line: what low aspect ratio takes off.

Neglected: any difference between the strips of a wing.
"""

from __future__ import annotations

from math import pi
from typing import Any

import casadi as ca

from patagium.robot.model import Robot, Strip

SURFACE_CONSTANT = 13.5
"""K of the line-to-surface gain (Izraelevitz, Zhu and Triantafyllou 2017)."""


def surface_gains(numbers: Robot, robot: Robot, constant: Any) -> list[Any]:
    """Lift of a lifting surface over that of a lifting line, for every strip.

    The aspect ratio is that of a wing and its mirror image together.

    Args:
        numbers: The robot in numbers: which wings are mirror images.
        robot: The same in numbers or symbols.
        constant: K.
    """
    twins = {
        strip.wing for strip in numbers.strips if strip.mirrored or _has_mirror(numbers, strip)
    }
    gains = {}
    for wing in {strip.wing: None for strip in robot.strips}:
        strips = [strip for strip in robot.strips if strip.wing == wing]
        span, area = ca.SX(0), ca.SX(0)
        for strip in strips:
            span, area = span + strip.width, area + strip.width * strip.chord
        aspect_ratio = (2 if wing in twins else 1) * span * span / area
        line = 1 / (2 * pi) + 1 / (pi * aspect_ratio)
        gains[wing] = line / (line + constant * pi / (180 * aspect_ratio * aspect_ratio))
    return [gains[strip.wing] for strip in robot.strips]


def _has_mirror(robot: Robot, strip: Strip) -> bool:
    return any(
        other.mirrored and (other.chord, other.width) == (strip.chord, strip.width)
        for other in robot.strips
    )
