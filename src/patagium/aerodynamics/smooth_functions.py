"""Differentiable stand-ins for sign and norm, exact outside of a narrow band.

Each has three continuous derivatives and is *equal* to what it replaces beyond
`width` from zero, so that formulas hold to rounding there, gradients are finite
everywhere, and a fourth-order integrator keeps its order through the switch.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

SWITCH_SPEED = 0.1
"""Half-width of the band of velocity in which signs and norms are smoothed [m/s]."""


def smooth_sign(x: Any, width: Any = SWITCH_SPEED) -> Any:
    """Sign of x: -1 and 1 beyond the width, an odd polynomial within.

    s(x) = (35 t - 35 t^3 + 21 t^5 - 5 t^7) / 16, t = x / width clipped to -1..1.

    Args:
        x: Expression, scalar.
        width: Half width of the band, in the unit of x.

    Returns:
        s, scalar, monotonic, |s| <= 1.
    """
    t = ca.fmax(-1.0, ca.fmin(1.0, x / width))
    square = t * t
    return t * (35.0 + square * (-35.0 + square * (21.0 - 5.0 * square))) / 16.0


def smooth_norm(square: Any, width: float = SWITCH_SPEED) -> Any:
    """Square root of a sum of squares: exact beyond the width, a polynomial within.

    n = width (1 + e/2 - e^2/8 + e^3/16), e = square / width^2 - 1 <= 0; never zero:
    n >= 0.3125 width.

    Args:
        square: Sum of squares, scalar.
        width: Radius of the band, in the unit of the norm.

    Returns:
        n, scalar, positive.
    """
    e = ca.fmin(square / width**2, 1.0) - 1.0
    return ca.sqrt(ca.fmax(square, width**2)) + width * e * (0.5 + e * (0.0625 * e - 0.125))


def smooth_step(x: Any) -> Any:
    """Step from 0 at x <= 0 to 1 at x >= 1, x^4 (35 - 84 x + 70 x^2 - 20 x^3) between."""
    t = ca.fmax(0.0, ca.fmin(1.0, x))
    square = t * t
    return square * square * (35.0 + t * (-84.0 + t * (70.0 - 20.0 * t)))
