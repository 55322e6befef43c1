"""Cycle statistics of a flapping robot, in the form that load-cell laboratories report.

Whole wingbeats of a flight are laid on top of each other. Neglected: sensors (the values
of a flight are the true ones) and drift within a wingbeat: each is taken as it is.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from patagium.arguments import checked
from patagium.arrays import Array, Bools, find_gaps, means_between, stored
from patagium.dynamics.dynamics import poses_at
from patagium.errors import FlightError, ParameterError, positive
from patagium.robot import Robot
from patagium.simulation.flight import WINGBEATS, flying_mass, gait_period, robot_of

GRAM_FORCE = 9.80665e-3
"""Weight of a gram in standard gravity [N]."""

_HOVERING = 0.1  # slower through the air, thrust is along the nose [m/s]
_COARSE = 0.05  # share of a wingbeat along which a straight line is right to 1.2 % of a swing
_MEANINGS = {
    "lift": ("N", "force of the air upward"),
    "thrust": ("N", "force of the air along the way through it, level"),
    "mount_lift": ("N", "reading of a load cell under the robot upward, weight tared"),
    "mount_thrust": ("N", "its reading along the way through the air"),
    "power": ("W", "power of the actuated joints"),
    "positive_power": ("W", "power of the joints that give some, nothing regained"),
}


@checked
def cycle_statistics(
    flight: xr.Dataset, *, period: float | None = None, skip: int = 1, phases: int = 100
) -> xr.Dataset:
    """Forces and power of a flight over one wingbeat, with their spread from beat to beat.

    Lift is the force of the air upward, thrust that along the way of the wingbeats through the
    air, level, added mass included; at less than 0.1 m/s along the nose at the start. A load cell
    under a fixed robot reads in addition what it takes to move the wings' mass, which has
    no mean over a cycle: mount_lift, mount_thrust, the robot's weight tared. Wingbeats with a gap
    in time, a step of three medians and a twentieth of a wingbeat, are left out.

    Args:
        flight: Record of a flight.
        period: Duration of a wingbeat [s]; None: that of the gait, as it was steered.
        skip: Whole wingbeats left out at the beginning.
        phases: Points of a wingbeat at which curves are given; means do not depend on it.

    Returns:
        For lift, thrust, power, positive_power and, of a fixed robot, mount_lift, mount_thrust:
        `<name>` (phase,), mean over cycles [N, W]; `<name>_spread` (phase,), standard
        deviation between cycles; `<name>_by_cycle` (cycle,), mean of each cycle. Attributes:
        cycles; cut_cycles, those left out; mean_lift, mean_thrust [N] and [gf], mean_power [W],
        mean_positive_power [W] (nothing is regained from a joint that is driven), airspeed, the
        mean of the wingbeats' own [m/s], cost_of_transport mean_positive_power / (m g airspeed),
        NaN at rest.

    Raises:
        ParameterError: If the gait has no period and none is given, or a number is not possible.
        FlightError: If no whole wingbeat is left.
    """
    known = gait_period(flight) if period is None else period
    beat = positive("period", known, "the time of a wingbeat [s]: the gait has none")
    if not (0 <= skip <= 1_000_000 and 2 <= phases <= 10_000):
        expected = "0 to a million wingbeats, 2 to ten thousand points"
        raise ParameterError("skip, phases", expected, (skip, phases))
    robot, time = robot_of(flight), stored(flight, "time")
    steered = stored(flight, WINGBEATS) if period is None and WINGBEATS in flight else None
    ends = _ends(time, beat, skip, steered)
    whole, phase, weights = _whole(time, ends), np.arange(phases) / phases, np.diff(ends)
    beat = beat if steered is None else float(weights.mean())
    stamps = (ends[:-1, None] + weights[:, None] * phase)[whole]
    velocity = beat_means(air_velocity(flight, robot), time, ends)
    signals = _signals(flight, robot, time, _forward(flight, robot, time, ends, velocity))
    by_cycle = {name: means_between(one, time, ends)[whole] for name, one in signals.items()}
    weight = float(robot.gravity * flying_mass(flight_between(flight, ends), robot).mean())
    averaged = by_cycle | {"airspeed": np.linalg.norm(velocity[whole], axis=1)}
    means = {k: float(np.average(one, weights=weights[whole])) for k, one in averaged.items()}
    variables: dict[str, tuple[str, Array, dict[str, str]]] = {}
    for name, signal in signals.items():
        variables |= _variables(name, np.interp(stamps, time, signal), by_cycle[name])
    return xr.Dataset(
        variables,
        coords={"phase": ("phase", phase, {"units": "1", "long_name": "share of a wingbeat"})},
        attrs={"cycles": len(stamps), "cut_cycles": len(whole) - len(stamps), "period": beat}
        | _attributes(weight, means),
    )


def _whole(time: Array, ends: Array) -> Bools:
    """Whether each wingbeat is without a gap in time, (cycles,).

    Raises:
        FlightError: If none is.
    """
    gaps = find_gaps(time)
    gaps = gaps[time[gaps] - time[gaps - 1] > _COARSE * np.diff(ends).mean()]
    after = np.searchsorted(time[gaps], ends[:-1], "right")
    whole: Bools = np.searchsorted(time[gaps - 1], ends[1:]) == after
    if not whole.any():
        raise FlightError(f"flight: expected a wingbeat without a gap in time, found {len(gaps)}")
    return whole


def _ends(time: Array, beat: float, skip: int, steered: Array | None) -> Array:
    """Beginning and ends of the wingbeats after those that are skipped, (cycles + 1,) [s].

    Raises:
        ParameterError: If the beat is shorter than the samples tell.
        FlightError: If no whole wingbeat is left.
    """
    begin = time[0] + skip * beat
    if time[-1] - begin > beat * len(time):
        raise ParameterError("period", "more than the time between two samples", beat)
    count = int(np.floor((time[-1] - begin) / beat + 1e-6))
    if steered is not None:
        count = int(np.floor(steered[-1] - steered[0] - skip + 1e-6))
    if count < 1:
        raise FlightError(
            f"flight: expected {skip + 1} wingbeat{'s' * bool(skip)} of {beat:.6g} s at least, "
            f"found {time[-1] - time[0]:.6g} s; fly longer, or skip fewer"
        )
    if steered is not None:
        return np.asarray(np.interp(steered[0] + skip + np.arange(count + 1), steered, time))
    return np.asarray(begin + beat * np.arange(count + 1))


def _attributes(weight: float, means: dict[str, float]) -> dict[str, float]:
    """Attributes of the statistics, from the mean of each signal over all cycles [N, W, m/s]."""
    driven, speed = means["positive_power"], means["airspeed"]
    moving = speed >= _HOVERING
    lift, thrust = means["lift"], means["thrust"]
    return {
        "mean_lift": lift,
        "mean_lift_gram_force": lift / GRAM_FORCE,
        "mean_thrust": thrust,
        "mean_thrust_gram_force": thrust / GRAM_FORCE,
        "mean_power": means["power"],
        "mean_positive_power": driven,
        "airspeed": speed,
        "cost_of_transport": driven / (weight * speed) if moving and weight else float("nan"),
    }


def _variables(
    name: str, cycles: Array, by_cycle: Array
) -> dict[str, tuple[str, Array, dict[str, str]]]:
    unit, meaning = _MEANINGS[name]
    spread = cycles.std(axis=0, ddof=1) if len(cycles) > 1 else np.full(cycles.shape[1], np.nan)
    kinds = {
        name: ("phase", cycles.mean(axis=0), meaning),
        f"{name}_spread": ("phase", spread, f"{meaning}: deviation between cycles"),
        f"{name}_by_cycle": ("cycle", by_cycle, f"{meaning}: mean of each cycle"),
    }
    return {
        key: (dim, value, {"units": unit, "long_name": words})
        for key, (dim, value, words) in kinds.items()
    }


def _signals(flight: xr.Dataset, robot: Robot, time: Array, forward: Array) -> dict[str, Array]:
    """Signals to be averaged, (N,) each [N, W]."""
    air = air_force(flight, robot, time)
    signals = {"lift": air[:, 2], "thrust": (air * forward).sum(1)}
    if flight.attrs.get("mount") == "fixed":
        cell = -stored(flight, "mount_wrench", "time", "component")[:, :3]
        cell[:, 2] += float(robot.gravity) * flying_mass(flight, robot)
        signals |= {"mount_lift": cell[:, 2], "mount_thrust": (cell * forward).sum(1)}
    joints = (flight["u1"] * flight["v"]).transpose("time", "dof").values
    return signals | {"power": joints.sum(axis=1), "positive_power": joints.clip(0.0).sum(axis=1)}


def flight_between(flight: xr.Dataset, ends: Array) -> xr.Dataset:
    """Samples of a flight from the first to the last of some ends, (cycles + 1,) [s]."""
    time, slack = stored(flight, "time"), 1e-9 * (ends[-1] - ends[0])
    first = np.searchsorted(time, ends[0] - slack)
    return flight.isel(time=slice(first, np.searchsorted(time, ends[-1] + slack, "right")))


def beat_means(values: Array, time: Array, ends: Array) -> Array:
    """Means of values, (N, k), over each wingbeat with `ends`, (cycles + 1,) [s], (cycles, k)."""
    if ends[0] == ends[-1]:
        return values[-1:]
    return np.stack([means_between(each, time, ends) for each in values.T], axis=1)


def air_force(flight: xr.Dataset, robot: Robot, time: Array) -> Array:
    """Force of the air on the robot, added mass included, world axes, (N, 3) [N].

    A robot that cannot float has no coordinate for it: it is what moves it, less all else.
    """
    force = stored(flight, "strip_force", "time", "strip", "axis").sum(axis=1)
    added = stored(flight, "added_mass_force", "time", "dof")
    if robot.floating:
        pushes = np.reshape(robot.floating_dofs, (-1, 6))[:, :3]  # x, y, z of each base
        return np.asarray(force + added[:, pushes].sum(axis=1), float)
    if not added.any():
        return np.asarray(force, float)
    momentum = stored(flight, "momentum", "time", "axis")
    mount = stored(flight, "mount_wrench", "time", "component")[:, :3]
    force = np.gradient(momentum, time, axis=0) - mount
    force[:, 2] += float(robot.gravity) * flying_mass(flight, robot)
    return np.asarray(force, float)


def air_velocity(flight: xr.Dataset, robot: Robot) -> Array:
    """Velocity of the center of mass through the air, (N, 3) [m/s]."""
    momentum = stored(flight, "momentum", "time", "axis")
    wind = stored(flight, "wind", "time", "axis")
    mass = flying_mass(flight, robot)[:, None]
    moved = np.divide(momentum, mass, out=np.zeros_like(momentum), where=mass > 0)
    return np.asarray(moved - wind, float)


def _forward(flight: xr.Dataset, robot: Robot, time: Array, ends: Array, velocity: Array) -> Array:
    """Level direction of the way through the air, of the nose in hover, (N, 3).

    The way is that of the wingbeats, with `ends`, (cycles + 1,) [s], and mean velocities
    `velocity`, (cycles, 3) [m/s]; it turns evenly from the middle of one to that of the next.
    """
    _, rotation = poses_at(robot, flight["q"].values[:1])
    body = rotation[0, next(iter(robot.floating_bodies))] if robot.floating else np.eye(3)
    nose = np.array([body[0, 0], body[1, 0], 0.0])
    middles = (ends[1:] + ends[:-1]) / 2
    level = np.stack([np.interp(time, middles, each) for each in [*velocity.T[:2], 0 * middles]], 1)
    speed = np.linalg.norm(level, axis=1, keepdims=True)
    level = np.where(speed >= _HOVERING, level, nose)
    return np.asarray(level / np.linalg.norm(level, axis=1, keepdims=True))
