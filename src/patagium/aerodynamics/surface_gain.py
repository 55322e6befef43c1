"""Aspect ratio of wings, and what low aspect ratio takes off the lift of a lifting line.

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

    Args:
        numbers: The robot in numbers: which wings are mirror images.
        robot: The same in numbers or symbols.
        constant: K.
    """
    gains = []
    for ratio in aspect_ratios(numbers, robot):
        line = 1 / (2 * pi) + 1 / (pi * ratio)
        gains.append(line / (line + constant * pi / (180 * ratio * ratio)))
    return gains


def aspect_ratios(numbers: Robot, robot: Robot) -> list[Any]:
    """Aspect ratio of the wing that each strip is of, span^2 over area.

    That of a wing and its mirror image together.

    Args:
        numbers: The robot in numbers: which wings are mirror images.
        robot: The same in numbers or symbols.
    """
    twins = {
        strip.wing for strip in numbers.strips if strip.mirrored or _has_mirror(numbers, strip)
    }
    ratios = {}
    for wing in {strip.wing: None for strip in robot.strips}:
        strips = [strip for strip in robot.strips if strip.wing == wing]
        span, area = ca.SX(0), ca.SX(0)
        for strip in strips:
            span, area = span + strip.width, area + strip.width * strip.chord
        ratios[wing] = (2 if wing in twins else 1) * span * span / area
    return [ratios[strip.wing] for strip in robot.strips]


def _has_mirror(robot: Robot, strip: Strip) -> bool:
    return any(
        other.mirrored and (other.chord, other.width) == (strip.chord, strip.width)
        for other in robot.strips
    )
