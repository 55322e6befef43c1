"""Physical limits of the air's forces in a flight: power, coefficients, downwash, ground.

Still air can only take power from wings over whole wingbeats, no section has been measured whose
force passes a few times its dynamic pressure, and wings do not drive air faster than they move.
A flight beyond these limits is an error of a model or of its parameters, whatever its outcome.
Wings that come too near to each other are beyond the models as well. Neglected: power in air that
changes with time, and coefficients within fast reversals.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr

from patagium.aerodynamics.description import innermost
from patagium.aerodynamics.inflow import Inflow
from patagium.aerodynamics.smooth_functions import SWITCH_SPEED
from patagium.aerodynamics.wind_shear import WindShear
from patagium.arrays import Array, stored
from patagium.dynamics.dynamics import poses_at
from patagium.errors import FlightError
from patagium.reading import made_again
from patagium.robot import Robot
from patagium.simulation.cycles import air_velocity, beat_means, flight_between
from patagium.simulation.flight import aero_of, aero_words

LARGEST_COEFFICIENT = 4.0
"""Force on a strip over area and dynamic pressure that no section reaches [1]."""
NO_POWER = 1e-3
"""Mean power over the mean of its size that a wake of long memory may leave [1]."""
VORTEX_RING = (0.4, 2.0)
"""Descent over the induced velocity at which momentum theory does not hold [1]: at half of the
induced velocity of hover, V, the latter is 1.28 V; as a windmill at twice V it is V."""

NEAREST, LOOKS = 0.5, 200
"""Distance over the chord within which wings clap [1]; samples of a flight that are looked at."""


def air_findings(robot: Robot, flight: xr.Dataset, ends: Array | None) -> list[str]:
    """Sentences about forces of the air that are physically impossible, with strip and time.

    Args:
        robot: The machine.
        flight: The flight.
        ends: Ends of whole wingbeats, (cycles + 1,) [s]; None where the gait has no period.
    """
    told = str(flight.attrs.get("aero", "{}"))
    air = innermost(aero_words(flight)).get("air")
    if not robot.strips or not isinstance(air, dict):
        return []
    with made_again("the flight's air", FlightError):
        ground = air.get("ground")
        density, ground = float(air["density"]), ground and float(ground)
    whole = stored(flight, "time")[[0, -1]] if ends is None else ends
    part = flight_between(flight, whole)
    found = [] if ends is None or air.get("gust") else [*_power(part)]
    found += [*_coefficient(robot, flight, density), *_downwash(flight)]
    if ground is None and f'"{WindShear.name}"' in told:
        ground = 0.0
    found += _descent(robot, part, whole) if f'"{Inflow.name}"' in told else []
    return [*found, *_clap(robot, part), *_slow(flight), *_ground(flight, ground)]


def _at(flight: xr.Dataset, sample: int | np.integer[Any]) -> str:
    return f"{float(flight['time'][sample]):.3g} s"


def _power(flight: xr.Dataset) -> Iterator[str]:
    """Sentence about still air that gives power to the wings."""
    time, wind = stored(flight, "time"), stored(flight, "wind")
    if time.size < 3:
        return
    if not wind.any():
        steps = np.diff((flight["air_work"] + flight["added_mass_work"]).to_numpy())
    elif flight["added_mass_work"].any():
        return  # circulation's share of it is not recorded relative to the wind
    else:
        power = stored(flight, "aero_power")
        steps = np.diff(time) * (power[1:] + power[:-1]) / 2
    given = float(steps.sum())
    if given <= NO_POWER * np.abs(steps).sum():
        return
    moving = np.gradient(stored(flight, "strip_point"), time, axis=0) - wind[:, None]
    of_strips = (stored(flight, "strip_force") * moving).sum(-1).mean(0)
    most, span = int(of_strips.argmax()), time[-1] - time[0]
    yield (
        f"Still air gives the wings {given / span:.2g} W on average from {time[0]:.3g} to "
        f"{time[-1]:.3g} s, {of_strips[most]:.2g} W of it to {flight['strip'].values[most]}: air "
        "at rest can only take power, so the model of the air fails here."
    )


def _coefficient(robot: Robot, flight: xr.Dataset, density: float) -> Iterator[str]:
    """Sentence about the largest force coefficient, if no section has it.

    The dynamic pressure is at least that of the strip's root-mean-square speed.
    """
    speed = stored(flight, "strip_airspeed")
    force = np.linalg.norm(stored(flight, "strip_force"), axis=-1)
    areas = np.array([s.chord * s.width for s in robot.strips], float)
    square = np.maximum(speed**2, (speed**2).mean(axis=0))
    pressure = 0.5 * density * areas * square
    ratio = np.divide(force, pressure, out=np.zeros_like(force), where=pressure > 0)
    at, strip = np.unravel_index(int(np.nanargmax(ratio)), ratio.shape)
    if ratio[at, strip] > LARGEST_COEFFICIENT:
        yield (
            f"{flight['strip'].values[strip]} has a force coefficient of {ratio[at, strip]:.3g} at "
            f"{_at(flight, at)}: no section reaches {LARGEST_COEFFICIENT:g}."
        )


def _downwash(flight: xr.Dataset) -> Iterator[str]:
    """Sentence about the fastest downwash, if it is faster than any strip has been."""
    wash = np.abs(stored(flight, "downwash"))
    at, strip = np.unravel_index(int(np.nanargmax(wash)), wash.shape)
    fastest = float(np.nanmax(stored(flight, "strip_airspeed")))
    if wash[at, strip] > fastest > 0:
        yield (
            f"The downwash at {flight['strip'].values[strip]} is {wash[at, strip]:.3g} m/s at "
            f"{_at(flight, at)}: no strip moves faster than {fastest:.3g} m/s."
        )


def _descent(robot: Robot, flight: xr.Dataset, ends: Array) -> Iterator[str]:
    """Sentence about wings that sink into the air that they throw down, against its inflow."""
    time = stored(flight, "time")
    states = beat_means(stored(flight, "aero_state"), time, ends)
    moving = beat_means(air_velocity(flight, robot), time, ends)
    for k, name in enumerate(aero_of(flight).state_names):
        if not re.fullmatch(r"induced (\d+ )?velocity of x", name):
            continue
        induced = states[:, k : k + 3]
        sizes = np.linalg.norm(induced, axis=1)
        along = (moving * induced).sum(1) / np.maximum(sizes, SWITCH_SPEED)
        size, sinking = float(sizes.mean()), float(along.mean())
        least, most = (share * size for share in VORTEX_RING)
        if least < sinking < most and (moving**2).sum(1).mean() - sinking**2 < size**2:
            yield (
                f"It sinks at {sinking:.2g} m/s into air that its wings drive down at {size:.2g} "
                f"m/s: from {least:.2g} to {most:.2g} m/s they work in a vortex ring, where the "
                "momentum theory of Inflow does not hold."
            )
            return


def _slow(flight: xr.Dataset) -> Iterator[str]:
    """Sentence about wings so slow that the smoothing changes their forces by 3 % and more."""
    fastest = float(np.sqrt((stored(flight, "strip_airspeed") ** 2).mean(axis=0).max()))
    if 0 < fastest < 2.5 * SWITCH_SPEED:
        yield (
            f"No strip is faster than {fastest:.2g} m/s (root mean square), and forces err: speeds "
            f"are smoothed within {SWITCH_SPEED:g} m/s. Fly a tenth of the size at ten times the "
            "speed."
        )


def _ground(flight: xr.Dataset, ground: float | None) -> Iterator[str]:
    """Sentence about the first strip that goes into the ground, which holds nothing."""
    heights = stored(flight, "strip_point")[:, :, 2]
    if ground is not None and (heights < ground).any():
        at = int((heights < ground).any(axis=1).argmax())
        strip = flight["strip"].values[int(heights[at].argmin())]
        yield f"{strip} goes into the ground at {_at(flight, at)}: nothing holds it."


def _clap(robot: Robot, flight: xr.Dataset) -> list[str]:
    """Sentence about the two wings, or segments of one wing, that come nearest to each other.

    It is half of each wing at once, and half of one of the segments.
    """
    count = flight.sizes["time"]
    flight = flight.isel(time=np.unique(np.linspace(0, count - 1, min(count, LOOKS)).astype(int)))
    origin, axes = poses_at(robot, stored(flight, "q"))
    bodies, wings = map(np.array, zip(*((s.body, s.wing) for s in robot.strips), strict=True))
    axes = axes[:, bodies]
    point = origin[:, bodies] + np.einsum(
        "nsij,sj->nsi", axes, [s.quarter_chord for s in robot.strips]
    )
    spans = [np.cross(s.normal, s.forward) for s in robot.strips]
    span = np.einsum("nsij,sj->nsi", axes, spans)
    chord, width = np.array([[s.chord, s.width] for s in robot.strips], float).T
    nearest, found = NEAREST, list[str]()
    every = {name: np.flatnonzero(wings == name) for name in robot.wing_names}
    pairs = [(*pair, False) for pair in combinations(every.items(), 2)]
    for strips in every.values():
        parts = {robot.bodies[b].name: strips[bodies[strips] == b] for b in set(bodies[strips])}
        pairs += [(*pair, True) for pair in combinations(parts.items(), 2)]
    for (first, i), (second, j), folded in pairs:
        away = point[:, i, None] - point[:, None, j]
        near = np.linalg.norm(away, axis=-1) / np.minimum(chord[i, None], chord[j])
        beside = np.abs((away * span[:, i, None]).sum(-1)) > 0.45 * (width[i, None] + width[j])
        across = np.abs((span[:, i, None] * span[:, None, j]).sum(-1)) < 0.7
        near[beside | across] = np.inf
        halves = [np.median(near.min(k), axis=1) for k in (1, 2)]
        apart = np.min(halves, axis=0) if folded else np.max(halves, axis=0)
        if apart.min() < nearest:
            nearest = float(apart.min())
            found = [
                f"{first} and {second} come within {nearest:.2g} chords of each other at "
                f"{_at(flight, int(apart.argmin()))}: what surfaces that clap or "
                "cover each other do is not modeled; the air pushes each as if it were alone."
            ]
    return found
