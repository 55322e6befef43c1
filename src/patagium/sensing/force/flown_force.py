"""Motion and force of the air from a sensor log in one call, and their file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from patagium.arrays import Array, Bools, median_step, runs
from patagium.errors import LogError
from patagium.netcdf_file import write_netcdf
from patagium.robot import Robot
from patagium.robot.planform import wing_span
from patagium.sensing.force.air_force import HELD
from patagium.sensing.force.measured_force import (
    ForceSamples,
    Measured,
    Wrench,
    cell_wrench,
    inverse_dynamics_force,
    motor_forces,
)
from patagium.sensing.motion.clock_shifts import drift_notes, mended_drift
from patagium.sensing.motion.estimate_motion import estimate_motion
from patagium.sensing.sensors import LoadCell, MotorCurrent, SensorLog, from_quaternion
from patagium.sensing.sensors.joints import joint_names

_WHITE = {"correlation": 0.0, "jitter": 0.0, "doubted": 0.0, "nis": 1.0, "shown": None}

_HELD_DOWN = 1.5
"""Mean lift over weight from which the sign of a load cell is asked for."""

_SCATTER = 3.0
"""Scatter of a body's pose over its standard deviation below which the body is at rest [1]."""
_STILL = 0.05
"""Share of its fastest velocity up to which a coordinate rests: air has a 400th of its force."""
_REST = 0.3
"""Least duration of a rest [s]."""
_OFF = 0.05
"""Force of the air at rest over the weight from which the zero of a load cell is doubted; more than
a tilt of the cameras by 2 degrees or an error of the mass by 3 % makes."""
_DRIFT = 0.02
"""Change of it from one rest to another, over the weight, from which the zero moved."""
_CALM = 0.05
"""Share of a log's fastest wind below which wind is zero, or equal at two rests [1]."""

_WINDOWS, _FEWEST = 10, 5
"""Parts of a log, of two beats at least, of which each has a phase of the load cell."""
_STEADY = 0.95
"""Least size of the beat in a part over the largest."""
_ALIKE = 0.03
"""Change of the ratio of the cell to the motion over it, in parts that are compared."""
_EVENLY = 10.0
"""Change of a delay over its scatter about a line from which a clock drifts."""

_LONG = 10.0
"""Arm of the moment of a load cell, over the span, from which its unit is asked for."""
_DRIVEN = 0.3
"""Correlation of the force of the air with the momentum of the robot from which the sign is asked
for: air brakes what moves in it."""


def motion_and_force(
    log: SensorLog, *, shifts: Mapping[str, float] | None = None
) -> tuple[xr.Dataset, ForceSamples]:
    """Motion, and force of the air by inverse dynamics from it.

    Joint forces by motor currents and the wrench of a load cell are used where the log has them.

    Args:
        log: The log.
        shifts: Shift of late stamps by name of the sensor [s]; see `estimate_shifts`.

    Returns:
        The motion, and the force, which is NaN where the motion is not known.

    Raises:
        LogError: If the sensors do not see the motion, several load cells hold the robot, or
            several motor currents drive a joint.
    """
    late = dict(shifts or {})
    motion = estimate_motion(log, shifts=late)
    joints = mount = None
    facts = json.loads(motion.attrs["findings"])
    facts["notes"] += drift_notes(log)
    for name, sensor in log.sensors.items():
        shift = late.get(name, 0.0)
        if isinstance(sensor, MotorCurrent):
            force = motor_forces(log, motion, name, shift=shift)
            parts = joint_names(sensor.joints, log.robot)
            joints = _joined(joints, force, name)
            units = [log.robot.force_units[log.robot.index(part)] for part in parts]
            white = zip(parts, units, force.noise.tolist(), strict=True)
        elif isinstance(sensor, LoadCell) and sensor.at is not None:
            facts["notes"].append(f"load cell {name!r}: not used, for it is within the robot")
            continue
        elif isinstance(sensor, LoadCell) and log.robot.floating:
            if mount is not None:
                raise LogError("load cells", "one that holds the robot", f"{name!r} too")
            mount = cell_wrench(log, motion, name, shift=shift)
            noise = np.sqrt((mount.measured.noise.reshape(2, 3) ** 2).mean(axis=1))
            white = zip(("force", "moment"), ("N", "N m"), noise.tolist(), strict=True)
        else:
            continue
        for part, unit, std in white:
            told = {"sensor": name, "part": part, "unit": unit, "std": std, "off": std}
            facts["noise"].append(told | _WHITE)
    found = inverse_dynamics_force(motion, joints=joints, mount=mount)
    unknown = ~motion["known"].values
    found.force[unknown] = np.nan
    found.covariance[unknown] = np.nan
    if mount is not None:
        doubts = _cell_notes(motion, found, joints, mount)
        facts["notes"] += [f"Warning: load cell: {doubt}" for doubt in doubts]
    elif log.robot.floating and log.mount in ("", "free") and _stands(motion, log.robot):
        facts["notes"].append(f"Warning: {HELD}")
    motion.attrs["findings"] = json.dumps(facts)
    return motion, found


def _stands(motion: xr.Dataset, robot: Robot) -> bool:
    """Whether the pose of the floating body is constant within its standard deviation."""
    known, base = motion["known"].values, [*robot.floating_dofs]
    q, spread = (motion[one].values[known] for one in ("q", "covariance"))
    apart = (q - np.median(q, axis=0))[:, base] ** 2 / np.einsum("tii->ti", spread)[:, base]
    return bool((apart.mean(axis=0) < _SCATTER**2).all())


def _joined(joints: Measured | None, force: Measured, name: str) -> Measured:
    """Joint forces from several sensors, each of which measures other joints."""
    if joints is None:
        return force
    known = np.isfinite(joints.values)
    if (known & np.isfinite(force.values)).any():
        raise LogError("motor currents", "one for each joint", f"{name!r} too")
    values = np.where(known, joints.values, force.values)
    return Measured(values, joints.variance + force.variance)


def _cell_notes(
    motion: xr.Dataset, found: ForceSamples, joints: Measured | None, mount: Wrench
) -> Iterator[str]:
    """Warnings about unit, clock, sign and zero of the load cell that holds a robot."""
    place = list(found.robot.floating_dofs[:3])  # x, y, z
    known = np.asarray(np.isfinite(found.force[:, place]).all(axis=1))
    if known.sum() < 2:
        yield "no two samples have a force that is known"
        return
    weight = found.robot.flying.mass * found.robot.scale_gravity
    turned = replace(mount.measured, values=-mount.measured.values)
    against = inverse_dynamics_force(motion, joints=joints, mount=replace(mount, measured=turned))
    time, force = found.time[known], found.force[known][:, place]
    flipped = against.force[known][:, place]
    lift, lesser = (float(one[:, 2].mean()) / weight for one in (force, flipped))
    whole, cell = 0.5 * (force + flipped), 0.5 * (flipped - force)
    along, drifts = _drag(time, force, whole), [*_late_notes(time, whole, cell)]
    yield from _arm_notes(mount.measured.values, wing_span(found.robot))
    yield from drifts
    heavy = bool(found.robot.gravity) and lift > _HELD_DOWN
    if heavy or (along > _DRIVEN and not drifts):
        first, other = ("drives", "brakes") if along > 0 else ("brakes", "drives")
        yield (
            f"the air lifts {lift:.2g} times the weight and {first} the motion, or, if the cell "
            f"shows what the robot does to it, lifts {lesser:.2g} times the weight and {other} it: "
            "then it lacks `negated: true` in the mapping"
        )
    else:
        yield from _zero_notes(motion, found, known, weight)


def _arm_notes(wrench: Array, span: float) -> Iterator[str]:
    """Warning that a moment of a load cell, (N, 6) [N, N m], is too large for a span [m]."""
    force, moment = np.sqrt(np.nanmean(wrench.reshape(-1, 2, 3) ** 2, axis=(0, 2)))
    if 0 < _LONG * span * force < moment:
        yield (
            f"its moment over its force is an arm of {moment / force:.3g} m, of a "
            f"robot of {span:.3g} m span: rather in N mm than N m"
        )


def _drag(time: Array, force: Array, whole: Array) -> float:
    """Correlation of the force of the air with the momentum of the robot in the world [1].

    Args:
        time: Times of the samples, (N,) [s].
        force: Force of the air, (N, 3) [N].
        whole: All force, which changes the momentum: that of the air, whichever sign the cell has,
            in the mean, (N, 3) [N].
    """
    line = np.polynomial.polynomial.polyvander(time - time[0], 1)
    pushed = np.cumsum((whole - whole.mean(axis=0)) * np.gradient(time)[:, None], axis=0)
    force, momentum = (one - line @ np.linalg.lstsq(line, one)[0] for one in (force, pushed))
    size = float(np.linalg.norm(force) * np.linalg.norm(momentum))
    return float((force * momentum).sum()) / size if size > 0 else 0.0


def _late_notes(time: Array, whole: Array, cell: Array) -> Iterator[str]:
    """Warning that a load cell is later and later behind the motion, beat by beat of one gait.

    Its phase to the force that changes the momentum moves evenly, and the ratio of both stays: what
    a gait or wind that changes does not do.

    Args:
        time: Times of the samples, (N,) [s].
        whole: Force that changes the momentum, (N, 3) [N].
        cell: Force of the load cell, (N, 3) [N].
    """
    if len(time) < 20 * _WINDOWS:
        return
    step = median_step(time)
    power = (np.abs(np.fft.rfft(whole - whole.mean(axis=0), axis=0)) ** 2).sum(axis=1)
    frequency = float(np.fft.rfftfreq(len(time), step)[int(np.argmax(power))])
    for _ in range(2):  # the first time finds the frequency
        beats = (time[-1] - time[0]) * frequency
        parts = min(_WINDOWS, int(beats / 2))
        if parts < _FEWEST:
            return
        length = int(beats / parts) / frequency
        middle = time[0] + length * (0.5 + np.arange(parts))
        apart = (time - middle[:, None]) / length
        window = np.where(np.abs(apart) < 0.5, np.cos(np.pi * apart) ** 2, 0.0)
        turned = window * np.exp(-2j * np.pi * frequency * time)
        moved, shown = turned @ whole, turned @ cell
        size = np.linalg.norm(moved, axis=1)
        steady = size > _STEADY * size.max()
        if steady.sum() < _FEWEST:
            return
        phase = np.angle((moved[1:] * moved[:-1].conj()).sum(axis=1))[steady[1:] & steady[:-1]]
        if not len(phase):
            return
        frequency += float(np.median(phase)) / (2 * np.pi * length)
    ratio = np.linalg.norm(shown, axis=1) / np.maximum(size, 1e-300)
    steady &= np.abs(ratio / np.median(ratio[steady]) - 1.0) < _ALIKE
    if steady.sum() < _FEWEST:
        return
    middle = middle[steady]
    cross = (shown * moved.conj()).sum(axis=1)[steady]
    late = -np.unwrap(np.angle(cross)) / (2 * np.pi * frequency)
    rate, start = np.polyfit(middle, late, 1)
    change = float(rate * (middle[-1] - middle[0]))
    if abs(change) < max(1e-3, _EVENLY * float(np.std(late - start - rate * middle))):
        return
    yield (
        f"from {middle[0]:.3g} s to {middle[-1]:.3g} s its delay to the motion "
        f"grows by {1e3 * change:.2f} ms: if the wind did not change, its clock drifts by about "
        f"{1e6 * rate:.0f} ppm from that of the motion, which spoils the force: "
        + mended_drift(rate)
    )


def _zero_notes(
    motion: xr.Dataset, found: ForceSamples, known: Bools, weight: float
) -> Iterator[str]:
    """Warnings that the force of the air at rest is not zero, or not the same in two rests.

    Args:
        motion: Motion of the robot.
        found: Force of the air along it.
        known: Whether the force of the air is known in each sample, (N,).
        weight: Weight of the robot [N].
    """
    place = list(found.robot.floating_dofs[:3])  # x, y, z
    fastest = np.percentile(np.abs(found.v[known]), 99, axis=0)
    noise = np.median(np.sqrt(np.einsum("tii->ti", motion["covariance"].values))[known], axis=0)
    moves = fastest > 20 * noise[len(fastest) : 2 * len(fastest)]
    still = known & (np.abs(found.v) < _STILL * fastest)[:, moves].all(axis=1)
    rests = [slice(a, b) for a, b in runs(still) if found.time[b - 1] - found.time[a] > _REST]
    if not rests:
        return
    turned = from_quaternion(motion["attitude"].values)
    spread = 3 * np.median(found.std[:, place][known], axis=0)

    def shown(rest: slice) -> Array:
        """Force of the cell beyond weight and inertia, (3,) [N], axes of the body."""
        return np.asarray(-turned[rest].inv().apply(found.force[rest, place]).mean(axis=0))

    def large(force: Array, share: float) -> bool:
        return bool((np.abs(force) > np.maximum(share * weight, spread)).any())

    def words(force: Array) -> str:
        return f"({', '.join(f'{one:.2g}' for one in force)}) N"

    first, last = rests[0], rests[-1]
    middle = [0.5 * (found.time[one.start] + found.time[one.stop - 1]) for one in (first, last)]
    wind = found.air.wind_at(found.time)
    speed, blown = np.linalg.norm(wind, axis=1), wind[first].mean(axis=0)
    calm = speed[first].max() <= _CALM * speed.max()
    against = -found.force[first, place].mean(axis=0) @ blown / max(np.linalg.norm(blown), 1e-9)
    here = f"while the robot rests at {middle[0]:.3g} s"
    if not calm and against > max(_DRIFT * weight, spread.max()):
        yield (
            f"{here} the air pushes it by {against:.2g} N against the wind "
            f"{tuple(blown.round(3).tolist())} m/s: its sign (a head wind is [-5, 0, 0]) or the "
            "zero or the axes of the cell are wrong"
        )
    if calm and large(offset := shown(first), _OFF):
        yield (
            f"{here} it shows {words(offset)}, axes of the body, that no weight explains, and the "
            "force of the air is wrong by as much: subtract it by `offset` in the mapping (there "
            "in unit, axes and sign of the log), check the mass, and state any wind under `air`"
        )
    change = found.q[first].mean(axis=0) - found.q[last].mean(axis=0)
    alike = (np.abs(np.delete(change, place)) < _STILL).all()
    alike &= np.linalg.norm(wind[last].mean(axis=0) - blown) <= _CALM * speed.max()
    if first is not last and alike and large(moved := shown(last) - shown(first), _DRIFT):
        yield (
            f"from the rest at {middle[0]:.3g} s to that at {middle[1]:.3g} s what it shows "
            f"changes by {words(moved)}, axes of the body: its zero drifts, or the wind changed; "
            "read the zero before and after, import shorter parts (`start`, `end`), each with its "
            "own `offset`, or use a cell that has warmed up"
        )


def write_motion(motion: xr.Dataset, forces: ForceSamples, path: str | Path) -> Path:
    """Write motion and forces as netCDF4, whole or not at all.

    Args:
        motion: From `estimate_motion`.
        forces: Of the air along it.
        path: The file, replaced if it exists.

    Raises:
        OutputError: If the file cannot be written.
    """
    units = {"units": "N or N m", "source": forces.source}
    whole = motion.assign(
        force=(("time", "dof"), forces.force, units),
        force_std=(("time", "dof"), forces.std, units),
        force_covariance=(("time", "dof", "other_dof"), forces.covariance),
    )
    return write_netcdf(path, whole.assign(known=whole["known"].astype("i1")))
