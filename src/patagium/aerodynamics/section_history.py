"""Airfoil test: one section that pitches, plunges and surges, with any model of the air.

The section is a wing of a million chords, so that its ends do nothing. Neglected: what the
model neglects; walls of a wind tunnel.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from itertools import pairwise
from math import inf, isfinite
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from patagium.aerodynamics.added_mass import AddedMass
from patagium.aerodynamics.air import Air
from patagium.aerodynamics.model import Aerodynamics
from patagium.aerodynamics.smooth_functions import SWITCH_SPEED
from patagium.arguments import checked, of_kind
from patagium.arrays import Array, classic_step, real_array
from patagium.errors import ParameterError, positive
from patagium.robot.model import FLOATING_COORDINATES, Body, Robot, Strip

_SPAN = 1e6
"""Span of the wing without end [chords]."""
_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_AHEAD, _UP, _PITCH = 0, 2, 4
_TOLERANCE = 1e-6
"""Difference of one Runge-Kutta step and two halves, over 1 + |state|."""
_HALVED = 20
"""Times that a step may be halved."""


@checked
def section_history(
    model: Callable[[Robot, Air], Aerodynamics],
    time: ArrayLike,
    *,
    pitch: ArrayLike,
    airspeed: ArrayLike,
    chord: float,
    plunge: ArrayLike = 0.0,
    pitch_axis: float = 0.25,
    added_mass: bool = True,
) -> xr.Dataset:
    """Coefficients of a section over time.

    Splines through the given motion drive the section; the states of the model begin at zero and
    follow by the Runge-Kutta method of order four, from time to time in steps that are halved until
    two agree with one of twice the length within 1e-6 of 1 + |state|. Coefficients are over the
    dynamic pressure of the mean airspeed over time. A `UserWarning` tells of one that is smoothed
    over. Wind and gusts of the model's air come on top, at the same times, unless they travel.

    Args:
        model: Makes the model of the air for the section, as `LiftingLine` itself does.
        time: Ascending times, (N,) [s].
        pitch: Angle of the chord above the direction of flight, scalar or (N,) [rad].
        airspeed: Speed of flight, scalar or (N,) where it surges [m/s].
        chord: Chord [m].
        plunge: Height, scalar or (N,) [m].
        pitch_axis: Place that the section turns about behind its leading edge [chords].
        added_mass: Whether the air carried along counts.

    Returns:
        `lift`, `drag`, `moment` (C_l, C_d, and C_m about the quarter chord, nose up) [1],
        `angle_of_attack` and `effective_angle_of_attack` [rad], over `time`, and the states of
        the model as `aero_state`.

    Raises:
        ParameterError: If times do not ascend, a length, a number or the motion is not possible, or
            a gust travels.
    """
    times = real_array("time", time)
    if times.ndim != 1 or len(times) < 2 or not (np.diff(times) > 0).all():
        raise ParameterError("time", "two or more ascending times, (N,) [s]", times.shape)
    positive("chord", chord, "a positive number [m]")
    if not (isfinite(pitch_axis) and abs(pitch_axis) <= 2):
        raise ParameterError("pitch_axis", "chords behind the leading edge, -2 to 2", pitch_axis)
    lever = (pitch_axis - 0.25) * chord
    aero = model(_wing(chord, lever), Air())
    of_kind("model", aero, Aerodynamics)
    if aero.air.traveling is not None:
        expected = "air without a gust that travels; simulate a wing on pt.mounts.fixed() in one"
        raise ParameterError("model", expected, aero.air.gust)
    motion = _Motion(times, pitch, plunge, airspeed, aero.air)
    carried = AddedMass(aero.robot, aero.air) if added_mass else None
    if motion.slowest < SWITCH_SPEED:
        said = f"airspeed: coefficients err below {SWITCH_SPEED:g} m/s; take ten times the speed, a"
        warnings.warn(f"{said} tenth of the chord and a hundredth of the times", stacklevel=3)
    area = 0.5 * aero.air.density * motion.mean_speed**2 * chord * _SPAN * chord
    states = [np.zeros(aero.state_size)]
    for now, later in pairwise(times):
        states.append(_step(aero, motion, states[-1], now, later - now))
    along = zip(map(motion.at, times), states, strict=True)
    rows = [_row(aero, carried, lever, *reached) for reached in along]
    columns = np.array(rows).T / [[area], [area], [area * chord], [1.0], [1.0]]
    pairs = zip(_NAMES, columns, strict=True)
    variables: dict[str, Any] = {name: ("time", column) for name, column in pairs}
    variables["aero_state"] = (("time", "lag"), np.array(states))
    return xr.Dataset(variables, coords={"time": times}, attrs={"model": aero.name})


_NAMES = ("lift", "drag", "moment", "angle_of_attack", "effective_angle_of_attack")


class _Motion:
    """Splines through a motion in the air; each part is one number or (N,) [rad, m, m/s]."""

    def __init__(
        self, times: Array, pitch: ArrayLike, plunge: ArrayLike, airspeed: ArrayLike, air: Air
    ) -> None:
        given = {"pitch": pitch, "plunge": plunge, "airspeed": airspeed}
        columns = []
        for name, values in given.items():
            column = real_array(name, values)
            if column.shape not in ((), times.shape) or not np.isfinite(column).all():
                raise ParameterError(name, f"finite, scalar or ({len(times)},)", column.shape)
            columns.append(np.broadcast_to(column, times.shape))
        self.slowest = float(columns[2].min())
        self._air, self._splines = air, [CubicSpline(times, column) for column in columns]
        mean = self._splines[2].integrate(times[0], times[-1]) / np.ptp(times)
        self.mean_speed = positive("airspeed", float(mean), "a positive mean [m/s]")

    def at(self, time: float) -> tuple[Array, Array, Array, Array]:
        """Coordinates, velocities, accelerations, (6,) each, wind velocity, (3,) [m, rad, s]."""
        pitch, height, speed = self._splines
        q, v, a = np.zeros((3, 6))
        q[_UP], v[_UP], a[_UP] = (height(time, order) for order in range(3))
        q[_PITCH], v[_PITCH], a[_PITCH] = (-pitch(time, order) for order in range(3))
        v[_AHEAD], a[_AHEAD] = speed(time), speed(time, 1)
        return q, v, a, self._air.uniform_wind_at([time])[0]


def _row(
    aero: Aerodynamics,
    carried: AddedMass | None,
    lever: float,
    motion: tuple[Array, Array, Array, Array],
    state: Array,
) -> list[float]:
    """Lift, drag [N], moment about the quarter chord [N m] and both angles of attack [rad]."""
    q, v, a, wind = motion
    force = aero.generalized_force(q, v, state, wind)
    if carried is not None:
        force = force + carried.generalized_force(q, v, a, wind)
        force = force + carried.circulatory_force(q, v, wind)
    strips, angle = aero.strips(q, v, state, wind), -q[_PITCH]
    normal = np.cos(angle) * force[_UP] - np.sin(angle) * force[_AHEAD]
    moment = -force[_PITCH] - lever * normal
    angles = [float(strips[name][0]) for name in _NAMES[3:]]
    return [force[_UP], -force[_AHEAD], moment, *angles]


def _step(
    aero: Aerodynamics, motion: _Motion, state: Array, time: float, step: float, halved: int = 0
) -> Array:
    """States of the model a step later, (n_z,); halved until two halves agree with the whole."""

    def after(begin: float, z: Array, step: float) -> Array:
        def rate(reached: Array, place: int) -> Array:
            q, v, _, wind = motion.at(time + begin + place * step / 2)
            return aero.state_derivative(q, v, reached, wind)

        return classic_step(rate, z, 0, step)

    if not aero.state_size:
        return state
    half = step / 2
    whole, halves = after(0.0, state, step), after(half, after(0.0, state, half), half)
    if (np.abs(halves - whole) <= _TOLERANCE * (1.0 + np.abs(halves))).all():
        return halves
    if halved == _HALVED:
        found = f"states at {time:.4g} s that do not settle"
        raise ParameterError("time", "samples that resolve the motion", found)
    middle = _step(aero, motion, state, time, half, halved + 1)
    return _step(aero, motion, middle, time + half, half, halved + 1)


def _wing(chord: float, lever: float) -> Robot:
    """Free wing without end that turns about its origin, the quarter chord ahead of it."""
    strip = Strip(
        "section", "section", 0, False, (lever, 0.0, 0.0), _AXES[0], _AXES[2], chord, _SPAN * chord
    )
    still, lower, upper = (0.0, 0.0, 0.0), (-inf,) * 6, (inf,) * 6
    body = Body("section", -1, still, _AXES, (), tuple(range(6)), 1.0, still, (1.0,) * 3 + still)
    coordinates = FLOATING_COORDINATES, ("m",) * 3 + ("rad",) * 3
    return Robot("section", (body,), (strip,), *coordinates, (), (0.0,) * 6, lower, upper, 9.81)
