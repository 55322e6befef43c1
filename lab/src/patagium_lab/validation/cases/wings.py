"""Flat wings of textbooks, and the response of a lifting line on them, steady or to a step."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics import Indicial, LiftingLine, Section
from patagium.aerodynamics.model import aero_functions
from patagium.arrays import Array
from patagium.robot import Body, Robot, Strip

AIRSPEED = 10.0
SMALL_ANGLE = 1e-4
"""Incidence of the steady wings, where the closed forms hold [rad]."""
INFINITE = 1e6
"""Span of a wing without end [chords]."""

_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_ZERO = (0.0, 0.0, 0.0)


def flat_wing(ends: Array, chord: Array) -> Robot:
    """A free flat wing with a straight quarter-chord line.

    Args:
        ends: Edges of the strips along the span, (N + 1,) [m].
        chord: Chord of each strip, (N,) [m].
    """
    middle = (ends[1:] + ends[:-1]) / 2
    strips = tuple(
        Strip(
            f"wing[{i}]", "wing", 0, False, (0.0, float(middle[i]), 0.0), _AXES[0], _AXES[2],
            float(chord[i]), float(ends[i + 1] - ends[i]),
        )
        for i in range(len(chord))
    )  # fmt: skip
    body = Body(
        "wing", -1, _ZERO, _AXES, (), tuple(range(6)), 0.01, _ZERO, (1e-5,) * 3 + (0.0,) * 3
    )
    infinite = (np.inf,) * 6
    return Robot(
        "flat wing", (body,), strips, ("x", "y", "z", "roll", "pitch", "yaw"),
        ("m",) * 3 + ("rad",) * 3, (), (0.0,) * 6, tuple(-x for x in infinite), infinite, 9.81,
    )  # fmt: skip


def elliptic_wing(aspect_ratio: float, count: int) -> Robot:
    """Root chord 1 m; each strip has the chord that keeps its area."""
    ends = np.linspace(-1.0, 1.0, count + 1)
    area = (ends * np.sqrt(1 - ends**2) + np.arcsin(ends)) / 2
    return flat_wing(ends * aspect_ratio * np.pi / 8, np.diff(area) / np.diff(ends))


def rectangular_wing(aspect_ratio: float, count: int) -> Robot:
    """Chord 1 m, strips of one width."""
    return flat_wing(np.linspace(-0.5, 0.5, count + 1) * aspect_ratio, np.ones(count))


def lifting_line(robot: Robot, lags: Indicial, surface_constant: float = 0.0) -> LiftingLine:
    """The lifting line of textbooks: without profile drag."""
    section = Section(profile_drag=0.0)
    return LiftingLine(robot, lags=lags, section=section, surface_constant=surface_constant)


_FORCES: dict[str, ca.Function] = {}
"""Force of each structure, numbers aside: that of a hundred strips takes seconds to derive."""


def steady_coefficients(model: LiftingLine) -> tuple[float, float]:
    """Lift coefficient over angle, and drag coefficient over its square, uncompiled."""
    v = AIRSPEED * np.array([np.cos(SMALL_ANGLE), 0, -np.sin(SMALL_ANGLE), 0, 0, 0])
    lags, constants = ca.DM.zeros(model.state_size), (model.robot.parameters, model.parameters)
    key = f"{model.key} {model.robot.structure}"
    if key not in _FORCES:
        _FORCES[key] = aero_functions(model)[0]
    force = _FORCES[key](np.zeros(6), v, lags, np.zeros(3), *constants)
    x, _, z = np.array(force).ravel()[:3]
    area = sum(float(strip.chord * strip.width) for strip in model.robot.strips)
    pressure = 0.5 * model.air.density * AIRSPEED**2 * area
    lift = z * np.cos(SMALL_ANGLE) + x * np.sin(SMALL_ANGLE)
    drag = z * np.sin(SMALL_ANGLE) - x * np.cos(SMALL_ANGLE)
    return float(lift / pressure / SMALL_ANGLE), float(drag / pressure / SMALL_ANGLE**2)


def step_response(model: LiftingLine, semichords: ArrayLike) -> Array:
    """Lift after a step of normalwash, over 2 pi rho U w A / 2, (N,).

    Args:
        model: Any wing; a semichord is that of a strip at mid-span.
        semichords: Distance travelled since the step, (N,) [semichords].
    """
    system = model.state_space(np.zeros(6), [AIRSPEED, 0, 0, 0, 0, 0])
    strips = model.robot.strips
    time = np.atleast_1d(np.asarray(semichords, float)) * strips[len(strips) // 2].chord / 2
    rate, modes = np.linalg.eig(system.a)
    drive = np.linalg.solve(modes, system.b.sum(axis=1).astype(complex))
    growth = np.expm1(np.outer(time / AIRSPEED, rate)) / rate * drive
    lift = np.real(growth @ modes.T @ system.c.T) + system.d.sum(axis=1)
    area = sum(float(strip.chord * strip.width) for strip in strips)
    return np.asarray(lift.sum(axis=1) / (np.pi * model.air.density * AIRSPEED * area))
