"""Estimation of the coordinates, velocities and accelerations of a robot from a sensor log.

Measurements of all rates are put on one time axis, each shifted by its clock and delay.
Coordinates that one encoder alone sees are smoothed by themselves, the others together. Neglected:
counters of encoders that were reset; biases of encoders and cameras.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from patagium.arguments import checked
from patagium.arrays import Array, Bools, median_step, real_array
from patagium.errors import LogError, ParameterError
from patagium.robot import Robot
from patagium.robot.files import robot_attributes
from patagium.sensing.motion.camera_faults import (
    Stretch,
    consistent_frames,
    on_regular_clock,
    open_gaps,
)
from patagium.sensing.motion.encoder_faults import dropped_out
from patagium.sensing.motion.first_motion import Noise, base_poses, first_motion, spectral_noise
from patagium.sensing.motion.frame_model import (
    Motion,
    euler_function,
    floating_base,
    with_euler_angles,
)
from patagium.sensing.motion.motion_filter import MotionEstimate, MotionFilter
from patagium.sensing.motion.motion_smoother import MotionFit, Samples
from patagium.sensing.motion.sensor_streams import (
    FLOOR,
    CaptureModel,
    EncoderModel,
    ImuModel,
    Stream,
    captured_motion,
    common_times,
    encoded_coordinates,
    first_camera,
    streams_of,
)
from patagium.sensing.motion.smoothers import check_order
from patagium.sensing.sensors import SensorLog, as_quaternion
from patagium.sensing.sensors.imu import WEIGHTLESS

UNKNOWN = (1e-1, 3e1, 3e2)
"""Least standard deviation of position [m, rad], rate and acceleration before any sample."""
_APART = 5.0
"""Distance from the motion over noise of the spectrum from which sensors contradict each other."""
_BIAS = 1.0
"""Least bias of an accelerometer that is doubted, a tenth of gravity [m/s^2]."""
_MEMORY = 0.02
"""Time over which driving noise may have built up the initial rates [s]."""


@dataclass(frozen=True)
class SmoothedMotion:
    """Motion at given times, with the attitude as a rotation.

    Attributes:
        levels: Position, velocity, acceleration of each coordinate, (M, 3, n) [m, rad, per s,
            per s^2]; for attitude zero, angular velocity and its derivative in body axes.
        attitude: Rotations from body to world axes, M; the identity without a floating body.
        covariance: Covariance of the levels one after the other, with small rotations for
            attitude, (M, 3 n, 3 n) [products of their units].
    """

    levels: Array
    attitude: Rotation
    covariance: Array


_KNOWN = np.radians(3.0)
"""Standard deviation of the attitude up to which it counts as known [rad]."""
_CHUNK = 1000
"""Times whose covariance is computed at once."""


@dataclass(frozen=True)
class MotionFits:
    """Motion fitted to all samples of a log.

    Attributes:
        robot: The machine.
        fits: Fits of coordinates that no sensor links.
        stretches: Stretches of samples that were left out or could not be bridged.
        notes: Assumptions about stamps, in words.
    """

    robot: Robot
    fits: list[MotionFit]
    stretches: list[Stretch]
    notes: list[str]

    def at(self, times: Array) -> SmoothedMotion:
        """Motion at given times, (M,) [s]."""
        n = self.robot.dof
        levels, covariance = np.zeros((len(times), 3, n)), np.zeros((len(times), 3 * n, 3 * n))
        attitude = Rotation.identity(len(times)).as_quat()
        for fit in self.fits:
            place = np.concatenate([fit.columns + level * n for level in range(3)])
            for begin in range(0, len(times), _CHUNK):
                part = slice(begin, begin + _CHUNK)
                found, spread, turned = fit.at(times[part])
                levels[part][:, :, fit.columns] = found
                covariance[part][:, place[:, None], place] = spread
                if turned is not None:
                    attitude[part] = turned.as_quat()
        return SmoothedMotion(levels, Rotation.from_quat(attitude), covariance)

    def density(self) -> Array:
        """Density of the noise that drives each coordinate, (n,) [unit^2/s^(2 order - 1)]."""
        found = np.ones(self.robot.dof)
        for fit in self.fits:
            found[fit.columns] = fit.density
        return found

    def variances(self) -> dict[str, Array]:
        """Variance of the noise of each value as learned, by name of the sensor, (k,) each."""
        found = {}
        for one in (one for fit in self.fits for one in fit.samples):
            found[one.stream.name] = one.variance.copy()
            for k, _, place in one.parts():
                found[one.stream.name][place] *= one.color[k]
        return found

    def open_times(self, times: Array) -> Bools:
        """Whether each time lies in a gap that cannot be bridged, or beyond the samples, (M,)."""
        found = np.zeros(len(times), bool)
        for fit in self.fits:
            found |= (times < fit.span[0]) | (times > fit.span[1])
            for begin, end in fit.gaps:
                found |= (times > begin) & (times < end)
        return found


def fit_motion(robot: Robot, streams: Sequence[Stream], order: int, wanted: Array) -> MotionFits:
    """Fit of the motion to all samples, with what the samples say about their noise.

    Args:
        robot: The machine.
        streams: Measurements.
        order: Order of the derivative that noise drives.
        wanted: Times at which the motion is wanted, (M,) [s].

    Raises:
        LogError: If a coordinate is seen by no sensor.
        FilterDiverged: If the information about the motion is singular.
    """
    groups, base = groups_of(robot, streams), floating_base(robot)
    if base is not None and first_camera(streams) is None:
        silent = ", ".join(robot.dof_names[i] for i in robot.floating_dofs)
        raise LogError(
            f"log: expected cameras that see {silent}, found none; the file of a robot that is "
            "held leaves out `floating`, unless a load cell holds it, whose log needs its pose: "
            "columns of position and attitude, which may be constant"
        )
    fitted = MotionFits(robot, [], [], [])
    checked = {s.name: _checked(s, fitted) for s in streams}
    sound = [*checked.values()]
    camera, guess = first_camera(sound), first_motion(robot, sound)
    for group, seeing in groups:
        found = [_samples(checked[s.name], group, order) for s in seeing]
        samples = [one for one in found if one is not None]
        fit = MotionFit(robot, group, samples, _extent(samples, wanted), order)
        if base is not None and base.turn[0] in group and camera is not None and not fit.biases:
            fit.gaps = open_gaps(camera, camera.used)
        fit.run(guess)
        fitted.fits.append(fit)
        fitted.stretches.extend(_unknown(fit, wanted))
    fitted.stretches.sort(key=lambda one: one.begin)
    return fitted


def _checked(s: Stream, fitted: MotionFits) -> Stream:
    """Stream on a regular clock where it fits better, without samples that contradict the others.

    Notes about stamps and stretches of samples left out are added to the fits.
    """
    regular = None if isinstance(s.model, ImuModel) else on_regular_clock(s)
    if regular is not None:
        late = 1e3 * float((s.time - regular.time).std())
        fitted.notes.append(
            f"{s.name}: stamps jitter by {late:.2g} ms about equal steps, which the motion "
            "fits better: equal steps are taken"
        )
    stream, used = s if regular is None else regular, np.ones(len(s.time), bool)
    if isinstance(stream.model, EncoderModel):
        stream = _without_dropouts(stream, stream.model, fitted)
    if isinstance(s.model, CaptureModel):
        used, stretches = consistent_frames(stream)
        fitted.stretches.extend(stretches)
    return replace(stream, used=used)


def _without_dropouts(stream: Stream, model: EncoderModel, fitted: MotionFits) -> Stream:
    """Stream of an encoder without the angles that jump and jump back; a stretch tells of them."""
    rows = stream.rows.copy()
    for k, column in enumerate(model.columns):
        seen = np.flatnonzero(np.isfinite(rows[:, k]))
        gone = seen[dropped_out(rows[seen, k])]
        if len(gone):
            rows[gone, k] = np.nan
            begin, end = stream.time[gone[[0, -1]]].tolist()
            words = f"{fitted.robot.dof_names[column]} jumps and jumps back"
            fitted.stretches.append(Stretch(begin, end, words, len(gone)))
    return replace(stream, rows=rows)


def _unknown(fit: MotionFit, wanted: Array) -> list[Stretch]:
    """Stretches in which a fit does not know the motion."""
    begin, end = fit.span
    found = [Stretch(*gap, "no frame for too long to tell the turn", 0) for gap in fit.gaps]
    ends = (float(wanted[0]), begin), (end, float(wanted[-1]))
    beyond = [(first, last) for first, last in ends if last - first > 1e-6]  # rounding of stamps
    return found + [Stretch(*span, "no samples to tell the motion", 0) for span in beyond]


def _extent(samples: Sequence[Samples], wanted: Array) -> tuple[float, float]:
    """Begin and end of the motion that samples show: a little beyond the first and the last [s]."""
    times = [
        one.stream.time[one.stream.used & np.isfinite(one.stream.rows).any(axis=1)]
        for one in samples
    ]
    first, last = min(float(t[0]) for t in times), max(float(t[-1]) for t in times)
    step = max(median_step(t) for t in times)
    begin = first if wanted[0] >= first else max(float(wanted[0]), first - 2 * step)
    return begin, last if wanted[-1] <= last else min(float(wanted[-1]), last + 2 * step)


def _samples(stream: Stream, group: Sequence[int], order: int) -> Samples | None:
    """Samples of a sensor for the fit of a group of coordinates; None if it sees none of them."""
    if not isinstance(stream.model, EncoderModel):
        return Samples(stream, _noise(stream, order))
    others = [k for k, i in enumerate(stream.model.columns) if i not in group]
    if len(others) == len(stream.model.columns):
        return None
    rows = stream.rows.copy()
    rows[:, others] = np.nan
    untold = Noise(float("nan"), 0.0)  # of a part whose spectrum is not asked
    return Samples(replace(stream, rows=rows), (untold,) * len(stream.model.parts))


def _noise(stream: Stream, order: int) -> tuple[Noise, ...]:
    """Noise of cameras and inertial units by part, as their spectrum shows it."""
    kept = stream.used & np.isfinite(stream.rows).all(axis=1)
    time, rows = stream.time[kept], stream.rows[kept]
    if isinstance(stream.model, ImuModel):  # accelerations and rates: higher in the spectrum
        force = spectral_noise(time, rows[:, :3], order - 2)
        rate = spectral_noise(time, rows[:, 3:], order - 1)
        return force._replace(correlation=0.0), rate._replace(correlation=0.0)
    place, turn = captured_motion(rows)
    return spectral_noise(time, place, order), spectral_noise(time, turn, order)


def coupled(robot: Robot, streams: Sequence[Stream]) -> list[int]:
    """Coordinates that must be estimated together: all that more than one encoder depends on.

    Raises:
        LogError: If a coordinate is seen by no sensor.
    """
    found, seen = {*robot.floating_dofs}, list[int]()
    for s in streams:
        if isinstance(s.model, EncoderModel):
            seen += s.model.columns
        else:
            found |= s.model.sees(robot)
    alone = {i for i in seen if seen.count(i) == 1} - found
    unseen = set(range(robot.dof)) - set(seen) - found
    if unseen:
        silent = ", ".join(robot.dof_names[i] for i in sorted(unseen))
        remedy = "an encoder, or in a mapping angles named after these joints, would"
        raise LogError("log", f"sensors that see {silent}", f"none; {remedy}")
    return sorted(set(range(robot.dof)) - alone)


def groups_of(robot: Robot, streams: Sequence[Stream]) -> list[tuple[list[int], Sequence[Stream]]]:
    """Coordinates that are estimated together, and the sensors that see them, group by group.

    Raises:
        LogError: If a coordinate is seen by no sensor.
    """
    linked = coupled(robot, streams)
    encoders = [(s, s.model.columns) for s in streams if isinstance(s.model, EncoderModel)]
    own = [(sorted({*columns}.difference(linked)), [s]) for s, columns in encoders]
    return [group for group in ((linked, streams), *own) if group[0]]


def initial_estimate(motion_filter: MotionFilter, streams: Sequence[Stream]) -> MotionEstimate:
    """Estimate before the first measurement: first samples with large standard deviations."""
    robot, order = motion_filter.robot, motion_filter.order
    levels, attitude = np.zeros((order, robot.dof)), Rotation.identity(1)
    for column, (s, k) in encoded_coordinates(streams).items():
        seen = s.rows[np.isfinite(s.rows[:, k]), k]
        if len(seen) and column in motion_filter.columns:
            levels[0, column] = seen[0]
    camera, base = first_camera(streams), floating_base(robot)
    if camera is not None and base is not None:
        rows = camera.rows[np.isfinite(camera.rows).all(axis=1)][:1]
        place, attitude = base_poses(camera, rows, levels[None, :3])
        levels[0, list(base.place)] += place[0]
    biases = [s.model.bias_std for s in streams if s.model.biases]
    owed = [
        np.sqrt(motion_filter.density * _MEMORY ** (2 * (order - 1 - k) + 1)) for k in range(order)
    ]
    owed[0] = np.zeros(len(owed[0]))  # the first samples show where the robot is
    least = np.zeros((order, 1))
    least[:3, 0] = UNKNOWN
    std = np.concatenate([np.maximum(owed, least).ravel(), *biases])
    motion = Motion(levels, attitude.as_matrix()[0])
    return MotionEstimate(motion, np.zeros(6 * len(biases)), np.diag(std))


@checked
def estimate_motion(
    log: SensorLog,
    *,
    shifts: Mapping[str, float] | None = None,
    times: ArrayLike | None = None,
    order: int = 4,
) -> xr.Dataset:
    """Coordinates, velocities and accelerations with their covariance, given a whole log.

    Args:
        log: Readings of encoders, inertial units and cameras; other sensors are left out.
        shifts: Shift of late stamps, delay and clock together, by name of the sensor [s]; see
            `estimate_shifts`. Sensors that are not named have no shift.
        times: Times of the result, (M,) [s]; None for the samples of the fastest sensor within
            the span of all others.
        order: Number of levels of each coordinate: 3 for white jerk, 4 for white snap.

    Returns:
        A dataset over `time` and `dof`: q, v, a [m, rad and their rates], `covariance` of
        [q, v, a], (time, 3 n, 3 n), and the robot as attributes, with roll, pitch and yaw if its
        attitude is a quaternion.

    Raises:
        LogError: If a coordinate is seen by no sensor, or readings cannot be used.
        ParameterError: If an argument is out of its range.
        ShapeError: If `times` is not (N,).
    """
    machine = with_euler_angles(log.robot)
    check_order(order)
    streams = streams_of(log, machine, shifts or {})
    if times is None:
        wanted = common_times(streams)
    else:
        wanted = real_array("times", np.atleast_1d(real_array("times", times)), ("N",))
        if not (len(wanted) and np.isfinite(wanted).all()):
            raise ParameterError("times", "finite numbers", times)
    return _dataset(wanted, fit_motion(machine, streams, order, wanted), log)


def in_coordinates(robot: Robot, found: SmoothedMotion) -> tuple[Array, Array]:
    """Coordinates q, v, a, (N, 3, n), and their covariance, (N, 3 n, 3 n), with Euler angles.

    Args:
        robot: The machine.
        found: Motion with its attitude as a rotation.
    """
    levels, covariance = found.levels.copy(), found.covariance.copy()
    base = floating_base(robot)
    if base is None:
        return levels, covariance
    turn, n = list(base.turn), robot.dof
    angles = np.unwrap(found.attitude.as_euler("ZYX")[:, ::-1], axis=0)
    first, second, slope = (
        np.array(part)
        for part in euler_function().batch(angles, levels[:, 1, turn], levels[:, 2, turn])
    )
    for level, values in enumerate((angles, first, second)):
        levels[:, level, turn] = values
    places = np.concatenate([np.array(turn) + level * n for level in range(3)])
    covariance[:, places] = slope @ covariance[:, places]
    covariance[:, :, places] = covariance[:, :, places] @ np.swapaxes(slope, 1, 2)
    return levels, covariance


def _dataset(times: Array, fitted: MotionFits, log: SensorLog) -> xr.Dataset:
    """Motion with its covariance and findings, at given times, as xarray has it."""
    robot, found = fitted.robot, fitted.at(times)
    levels, covariance = in_coordinates(robot, found)
    parts = [f"{part}.{name}" for part in "qva" for name in robot.dof_names]
    units = {"q": "m or rad", "v": "m/s or rad/s", "a": "m/s^2 or rad/s^2"}
    variables: dict[str, object] = {
        one: (("time", "dof"), levels[:, k], {"units": units[one]}) for k, one in enumerate(units)
    }
    variables["covariance"] = (("time", "part", "other_part"), covariance, {})
    coordinates: dict[str, object] = {
        "time": ("time", times, {"units": "s"}),
        "dof": list(robot.dof_names),
        "part": parts,
        "other_part": parts,
    }
    known, base = np.ones(len(times), bool), floating_base(robot)
    if base is not None:
        turn = list(base.turn)
        std = np.sqrt(found.covariance[:, turn, turn])
        known &= np.sqrt((std**2).mean(axis=1)) < _KNOWN
        turned = as_quaternion(found.attitude)
        variables["attitude"] = (("time", "quaternion"), turned, {"units": "1"})
        variables["attitude_std"] = (("time", "axis"), std, {"units": "rad"})
        coordinates |= {"quaternion": list("wxyz"), "axis": list("xyz")}
    attributes = {**robot_attributes(robot), "mount": log.mount}
    attributes["air"] = json.dumps(log.air.describe())
    known &= ~fitted.open_times(times)
    facts = motion_findings(fitted)
    facts["notes"] += log.saturated().values()
    attributes["findings"] = json.dumps(facts)
    variables["known"] = ("time", known, {})
    return xr.Dataset(variables, coordinates, attributes)


def motion_findings(fitted: MotionFits) -> dict[str, Any]:
    """Noise of the sensors and stretches without a motion, JSON-able.

    Returns:
        `noise`: for each sensor and part its standard deviation, correlation from sample to
        sample, jitter of stamps [s], distance from the motion by both, share of samples with
        little weight, mean square of the residuals over what is expected, and noise of its
        spectrum; `stretches`: times left out or not known, with reasons; `notes`: assumptions
        about stamps, and sensors that contradict each other.
    """
    seen = [(fit, one) for fit in fitted.fits for one in fit.samples]
    noise = [{"sensor": one.stream.name, **facts} for _, one in seen for facts in one.describe()]
    floor = [
        f"{one['sensor']}, {one['part']}: the noise lies on its least value of "
        f"{FLOOR[one['part']]:g} {one['unit']}, for the log does not tell it: the standard "
        "deviations are too small for a sensor that is less exact, and too large for one that is "
        "more exact"
        for one in noise
        if 0.99 < one["std"] / FLOOR[one["part"]] < 1.01
    ]
    apart = [
        f"Warning: {one['sensor']}, {one['part']}: its samples scatter by {one['shown']:.2g} "
        f"{one['unit']}, but are {one['off']:.2g} {one['unit']} off what the other sensors say: "
        "check clocks (pt.sensing.estimate_shifts), units, axes, and where the sensor sits and how"
        for one in noise
        if one["shown"] is not None and one["off"] > _APART * max(one["shown"], FLOOR[one["part"]])
    ]
    cause = "check units, axes, and where the unit and the cameras sit and how"
    cause = cause if fitted.robot.gravity else WEIGHTLESS
    biased = [
        f"Warning: {one.stream.name}, specific force: its bias is {bias:.2g} m/s^2, where "
        f"{std:.2g} is expected: {cause}"
        for fit, one in seen
        if (place := fit.biases.get(one.stream.name))
        and (bias := np.abs(fit.spline.at(one.stream.time).levels[:, 0, place][:, :3]).max())
        > max(_APART * (std := one.stream.model.bias_std[0]), _BIAS)
    ]
    return {
        "noise": noise,
        "stretches": [asdict(one) for one in fitted.stretches],
        "notes": fitted.notes + floor + apart + biased,
    }
