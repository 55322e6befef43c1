"""Clock shifts between sensors, estimated from the motion that they all see.

Inertial units are predicted from encoders and cameras that see the same bodies. Each sensor is
shifted in time until the prediction is best, a maximum of the likelihood with noise and biases of
every axis unknown. Only the sum of delay and clock offset can be seen. Load cells and motors are
left out: where the motion is one sine, a delay and a drag look alike. Drift of a clock is told by
the shifts in two parts of a log, and not corrected.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize, minimize_scalar
from scipy.spatial.transform import Rotation, Slerp

from patagium.arguments import checked
from patagium.arrays import Array, median_step
from patagium.errors import LogError, check_names, positive
from patagium.robot import Robot
from patagium.robot.attitude import without_flips
from patagium.sensing.motion.first_motion import spectral_noise
from patagium.sensing.motion.frame_model import floating_base, with_euler_angles
from patagium.sensing.motion.motion_spline import conjugate, product
from patagium.sensing.motion.sensor_streams import (
    CaptureModel,
    EncoderModel,
    ImuModel,
    Stream,
    streams_of,
)
from patagium.sensing.motion.smoothers import smooth_series
from patagium.sensing.sensors import Imu, SensorLog, from_quaternion

_MOST_SAMPLES = 2000
_ROUGH, _COARSE = 500, (1e-4, 2e-3)
"""Samples of the first search over shifts; its least and largest step [s]."""
_TURN = 0.5
"""Angle by which a motion turns in such a step, at its root mean square frequency [rad]."""
_ALIKE = 0.5
"""Misfit above the least of shifts that are as likely: 5 in the logarithm of the likelihood where
each stretch of the log counts as one sample."""
_DEEP = 6.0
"""Misfit below the largest from which a minimum is looked at: every row better by a factor e."""
_SWEEPS = 3
_LARGEST = 0.05
"""Largest shift of the search [s]."""
_TOLD = 0.1
"""Standard deviation of a shift over the largest one from which the motion does not tell it."""
_SURE, _DRIFTED = 8.0, 5e-4
"""Change of a shift within a log, in standard deviations and [s], from which a clock drifts."""
_BRIEF = 2.0
"""Duration below which none is looked for: a drift of 250 ppm makes .5 ms in it [s]."""
_STEP = 2e-4
"""Step of the slope of the likelihood over a shift [s]."""
_STRETCHES = 20
"""Stretches of a log whose errors count as independent of each other."""
_SPARSE = 100.0
"""Span of a log over that of its samples from which its grid is not made."""


@dataclass(frozen=True)
class Shifts:
    """Shifts of the stamps of sensors against those of a reference.

    Args:
        seconds: Shift of each sensor by name, positive if its stamps are late [s]. Sensors that
            share no motion with it have as theirs the first unit that they are linked to.
        std: Standard deviation of each shift; zero for a reference [s].
        unlinked: Encoders and cameras that no inertial unit is linked to, and such units.
        largest: Largest shift of the search [s].
        repeat: Least step to other shifts that are as likely, a beat of a periodic motion [s];
            infinite where there are none. The smallest shifts are taken.
    """

    seconds: dict[str, float]
    std: dict[str, float]
    unlinked: tuple[str, ...]
    largest: float
    repeat: float

    @property
    def told(self) -> dict[str, float]:
        """Shifts that the motion tells [s]."""
        return {
            name: late
            for name, late in self.seconds.items()
            if abs(late) <= self.largest and self.std[name] <= _TOLD * self.largest
        }


@checked
def estimate_shifts(
    log: SensorLog,
    *,
    reference: str | None = None,
    largest: float = _LARGEST,
) -> Shifts:
    """Clock shifts of encoders, cameras and inertial units against each other.

    Args:
        log: Log with an inertial unit on a body that encoders or cameras see.
        reference: Sensor whose stamps are taken as right; None for the first linked inertial unit.
        largest: Largest shift of the search [s].

    Returns:
        Shifts of all linked sensors, for `estimate_motion`.

    Raises:
        LogError: If no inertial unit is linked to others, or there is too little time in common.
        ParameterError: If the reference is not among the sensors that are linked.
    """
    positive("largest", largest)
    machine = with_euler_angles(log.robot)
    streams = streams_of(log, machine, {})
    units = [s for s in streams if isinstance(s.model, ImuModel)]
    if not units:
        raise LogError("log", "an inertial unit", ", ".join(log.readings))
    search = _Search(machine, streams, units, largest)
    if not search.units:
        raise LogError("log: expected an inertial unit on a body that encoders or cameras see")
    groups = search.run()
    linked = [name for late, _ in groups for name in late]
    check_names("reference", {reference} - {None}, linked)
    seconds: dict[str, float] = {}
    stds: dict[str, float] = {}
    for late, std in groups:
        zero = reference if reference in late else next(iter(late))
        seconds |= {name: value - late[zero] for name, value in late.items()}
        # the error of the reference's own shift is in all others
        stds |= {name: float(np.hypot(value, std[zero])) for name, value in std.items()}
        stds[zero] = 0.0
    unlinked = tuple(s.name for s in streams if s.name not in seconds)
    return Shifts(seconds, stds, unlinked, largest, search.repeat)


def found_shifts(log: SensorLog) -> tuple[dict[str, float], str]:
    """Clock shifts where sensors have clocks of their own [s], and a note in words."""
    stamps = [reading["time"].values for reading in log.readings.values()]
    if all(len(one) == len(stamps[0]) and (one == stamps[0]).all() for one in stamps[1:]):
        return {}, "All quantities have the same stamps, which are taken as right."
    try:
        found = estimate_shifts(log)
    except LogError as problem:
        return {}, f"Clocks are taken as right: {problem}."
    told = found.told
    late = ", ".join(f"{name} {1e3 * value:.2f} ms" for name, value in told.items())
    rest = ", ".join([*(name for name in found.seconds if name not in told), *found.unlinked])
    note = f"Clocks, found from the motion that the sensors share: {late}."
    if np.isfinite(found.repeat):
        note += f" The motion repeats every {1e3 * found.repeat:.3g} ms: shifts by whole beats "
        note += "look alike, and the smallest are taken."
    if rest:
        note += f" Taken as right, for the motion does not tell them: {rest}."
    return told, note


def drift_notes(log: SensorLog) -> list[str]:
    """Warnings that the clock of a sensor drifts from that of the first unit it is linked to.

    The shifts in the first third of the motion are compared with those in the last third.
    """
    unit = next((n for n, one in log.sensors.items() if isinstance(one, Imu)), None)
    if unit is None or np.ptp(log[unit]["time"].values) < _BRIEF:
        return []
    rows = np.hstack([log[unit][name].values for name in ("specific_force", "angular_rate")])
    power = np.cumsum(np.nan_to_num((rows - np.nanmean(rows, axis=0)) ** 2), axis=0).sum(axis=1)
    time, share = log[unit]["time"].values, power / max(power[-1], 1e-300)
    early, cut, other, late = np.interp([1 / 6, 1 / 3, 2 / 3, 5 / 6], share, time)
    try:
        first = estimate_shifts(_between(log, time[0], cut, {}))
        last = estimate_shifts(_between(log, other, time[-1], first.told))  # the same beat
    except LogError:
        return []
    notes, apart = [], late - early
    for name in first.seconds:
        unit = name if first.std[name] == 0.0 else unit  # the reference of those after it
        if name not in first.told.keys() & last.told.keys():
            continue
        moved = last.seconds[name]
        begun, ended = 1e3 * first.seconds[name], 1e3 * (first.seconds[name] + moved)
        if abs(moved) > max(_DRIFTED, _SURE * np.hypot(first.std[name], last.std[name])):
            notes.append(
                f"Warning: {name}: its clock drifts by about {1e6 * moved / apart:.0f} ppm from "
                f"that of {unit} ({begun:.2f} ms late at first, {ended:.2f} ms at last), "
                f"which no shift mends: {mended_drift(moved / apart)}"
            )
    return sorted(notes)


def mended_drift(rate: float) -> str:
    """Remedy for a clock that drifts by a rate [s/s]."""
    return (
        f"take {rate:.2g} (t - t[0]) from its stamps t in the log and import it again, or import "
        "shorter parts (`start` and `end`)"
    )


def _between(log: SensorLog, begin: float, end: float, late: dict[str, float]) -> SensorLog:
    """Log of a span of time [s], with stamps that are as much earlier as they are late [s]."""
    parts = {}
    for name, reading in log.readings.items():
        time = reading["time"].values - late.get(name, 0.0)
        inside = np.flatnonzero((time >= begin) & (time <= end))
        parts[name] = reading.assign_coords(time=time).isel(time=inside)
    return replace(log, readings=parts)


@dataclass(frozen=True)
class _Track:
    """Motion of the coordinates that one sensor sees, interpolated in time.

    Attributes:
        stream: Measurements of the sensor.
        columns: Indices of the coordinates.
        levels: Position, velocity, acceleration of each, (k, 3) [m, rad, per s, per s^2].
        attitude: Rotation from body to world axes; None from an encoder.
    """

    stream: Stream
    columns: tuple[int, ...]
    levels: CubicSpline
    attitude: Slerp | None

    def at(self, times: Array) -> tuple[Array, Rotation | None]:
        inside = np.clip(times, self.levels.x[0], self.levels.x[-1])
        attitude = None if self.attitude is None else self.attitude(inside)
        return np.asarray(self.levels(inside)), attitude


def _track(robot: Robot, stream: Stream) -> _Track | None:
    """Motion seen by one encoder or camera system alone; None for other sensors.

    Raises:
        LogError: If cameras do not see the floating body, or nearly all samples are missing.
    """
    model, base = stream.model, floating_base(robot)
    begin, end = stream.time[0], stream.time[-1]
    median = median_step(stream.time)
    if end - begin > _SPARSE * median * len(stream.time):
        raise LogError(stream.name, "samples without long gaps", f"{end - begin:g} s")
    step = min(median, 1e-3)
    times = np.linspace(begin, end, 1 + round((end - begin) / step))
    if isinstance(model, EncoderModel):
        state = _smoothed(stream.time, stream.rows, np.sqrt(model.variances), times)
        return _Track(stream, tuple(model.columns), CubicSpline(times, state), None)
    if isinstance(model, CaptureModel) and base is not None:
        state, attitude = _smooth_base(stream, model, times)
        levels, turns = CubicSpline(times, state), Slerp(times, attitude)
        return _Track(stream, (*base.place, *base.turn), levels, turns)
    return None


def _smooth_base(camera: Stream, model: CaptureModel, times: Array) -> tuple[Array, Rotation]:
    """Position and rotation of a floating body with two derivatives, (M, 6, 3), and its attitude.

    Attitude is smoothed as a quaternion, whose noise is half that of the angles.
    """
    if not model.frame.on_base:
        raise LogError(f"{camera.name}: expected cameras that see the floating body itself")
    seen = np.isfinite(camera.rows).all(axis=1)
    std = np.sqrt(model.variances)
    place = _smoothed(camera.time[seen], camera.rows[seen, :3], std[:3], times)
    mount = Rotation.from_matrix(model.frame.mount)
    shown = from_quaternion(camera.rows[seen, 3:]) * mount.inv()
    parts = without_flips(shown.as_quat())
    turned = _smoothed(camera.time[seen], parts, std[3:].mean() / 2, times)
    four = turned / np.linalg.norm(turned[:, :, 0], axis=1)[:, None, None]
    attitude = Rotation.from_quat(np.array(four[:, :, 0]))
    back = conjugate(four[:, :, 0])
    spin, spin_rate = (2 * product(back, four[:, :, level])[:, :3] for level in (1, 2))
    lever = np.tile(model.frame.offset, (len(spin), 1))
    lever_velocity = np.cross(spin, lever)
    lever_acceleration = np.cross(spin_rate, lever) + np.cross(spin, lever_velocity)
    moved = np.stack(
        [attitude.apply(part) for part in (lever, lever_velocity, lever_acceleration)], axis=-1
    )
    turn = np.stack([np.zeros_like(spin), spin, spin_rate], axis=-1)
    return np.concatenate([place - moved, turn], axis=1), attitude


def _smoothed(time: Array, values: Array, stated: ArrayLike, at: Array) -> Array:
    """Values and two derivatives, (M, B, 3), with the noise of the spectrum where less is stated.

    With too little noise the derivatives are noise, least between samples: a shift of half a step.
    """
    seen = np.isfinite(values).all(axis=1)
    shown = spectral_noise(time[seen], values[seen], 4).std if seen.any() else np.nan
    return smooth_series(time, values, np.fmax(stated, shown), at).state


def _alike(
    misfit: Callable[[Array], float], best: Array, way: Array, steps: Array, tried: Array
) -> list[float]:
    """Steps along a way from the best shifts to all that are as likely, zero included, in order.

    Minima among equal steps that were `tried` with fewer samples are looked at closely.
    """

    def along(step: float) -> float:
        return misfit(best + step * way)

    low = tried < np.minimum(np.append(tried[1:], np.inf), np.append(np.inf, tried[:-1]))
    found = {0.0: along(0.0)}
    for k in np.flatnonzero(low & (tried < tried.max() - min(_DEEP, np.ptp(tried) / 4))):
        between = tried[np.abs(steps - steps[k] / 2) < abs(steps[k]) / 2]
        if between.max(initial=-np.inf) < tried.min() + 2 * _ALIKE:
            continue  # the same minimum
        ends = steps[k] + (steps[1] - steps[0]) * np.array([-1, 1])
        there = minimize_scalar(along, bounds=ends, method="bounded", options={"xatol": 1e-7})
        found[float(there.x)] = float(there.fun)
    return sorted(s for s, value in found.items() if value < min(found.values()) + _ALIKE)


_Found: TypeAlias = tuple[dict[str, float], dict[str, float]]
"""Shifts of sensors by name, and their standard deviations [s]."""


class _Search:
    """Search for the shifts by which inertial units are predicted best."""

    def __init__(
        self,
        robot: Robot,
        streams: Sequence[Stream],
        units: Sequence[Stream],
        largest: float,
    ) -> None:
        self.robot, self.largest = robot, largest
        self.repeat = float("inf")
        tracks = [_track(robot, s) for s in streams]
        self.tracks = {track.stream.name: track for track in tracks if track is not None}
        self.links = {unit.name: self._seen_by(unit) for unit in units}
        self.units = [unit for unit in units if self.links[unit.name]]

    def run(self) -> list[_Found]:
        """Shifts of each group of linked sensors, and their standard deviations [s]."""
        groups: list[_Found] = []
        left, known = list(self.units), set[str]()
        while left:  # each unit after one that shares a sensor with it if possible
            unit = next((one for one in left if known & {*self.links[one.name]}), left[0])
            left.remove(unit)
            known |= {*self.links[unit.name]}
            names = (unit.name, *self.links[unit.name])
            if not groups or not groups[-1][0].keys() & {*names}:
                groups.append(({unit.name: 0.0}, {unit.name: 0.0}))
            late, std_of = groups[-1]
            free = [name for name in names if name not in late]
            if free:
                found, std = self._fit(unit, late, free)
                late |= found
                std_of |= std
        return groups

    def _seen_by(self, unit: Stream) -> list[str]:
        """Names of the sensors that see coordinates which move an inertial unit."""
        moving = unit.model.sees(self.robot)
        return [name for name, track in self.tracks.items() if moving & set(track.columns)]

    def _fit(self, unit: Stream, known: dict[str, float], free: list[str]) -> _Found:
        """Shifts of the free sensors with the others fixed, and their standard deviations [s]."""
        unit = self._sampled(unit)
        step = self._step(unit, known | dict.fromkeys(free, 0.0))

        def misfit(values: Array, every: int = 1) -> float:
            late = known | dict(zip(free, values.tolist(), strict=True))
            return self._misfit(unit, late, every)

        def tried(way: Array, reach: float) -> tuple[Array, Array]:
            steps = step * np.arange(-(reach // step), reach // step + 1)
            most = max(self.largest + step, np.abs(best).max())
            steps = steps[[np.abs(best + s * way).max() <= most for s in steps]]
            every = max(1, len(unit.time) // _ROUGH)
            return steps, np.array([misfit(best + s * way, every) for s in steps])

        def polished() -> Array:
            corners = best + step / 2 * np.vstack([np.zeros(len(free)), np.eye(len(free))])
            options = {"initial_simplex": corners, "xatol": 1e-6, "fatol": 1e-9}
            return np.asarray(minimize(misfit, best, method="Nelder-Mead", options=options).x)

        best = np.zeros(len(free))
        ways = [*np.eye(len(free))] + ([np.ones(len(free))] if len(free) > 1 else [])
        for sweep in range(_SWEEPS if len(free) > 1 else 1):
            for way in ways:  # each by itself, then all together
                steps, values = tried(way, self.largest / 2**sweep)
                best = best + steps[int(np.argmin(values))] * way
        best = polished()
        for way in ways:
            alike = _alike(misfit, best, way, *tried(way, 2 * self.largest))
            self.repeat = min([self.repeat, *np.diff(alike).tolist()])
            best = best + alike[int(np.argmin([np.abs(best + s * way).sum() for s in alike]))] * way
        best = polished()
        seconds = dict(zip(free, best.tolist(), strict=True))
        std = self._std(unit, known, seconds)
        return seconds, dict(zip(free, std.tolist(), strict=True))

    def _step(self, unit: Stream, late: dict[str, float]) -> float:
        """Step of the search over shifts, short against the periods of the motion [s]."""
        first, last = (self._expected(unit, unit.time + d, late) for d in (-_STEP, _STEP))
        size, change = (
            np.var(x, axis=0) @ (1 / unit.model.variances) for x in (first, last - first)
        )
        return float(np.clip(2 * _STEP * _TURN * np.sqrt(size / max(change, 1e-300)), *_COARSE))

    def _sampled(self, unit: Stream) -> Stream:
        """Some samples of an inertial unit, within the span of what it is compared with."""
        tracks = [self.tracks[name] for name in self.links[unit.name]]
        begin = max([unit.time[0], *(t.stream.time[0] for t in tracks)]) + self.largest
        end = min([unit.time[-1], *(t.stream.time[-1] for t in tracks)]) - self.largest
        whole = np.isfinite(unit.rows).all(axis=1)
        chosen = np.flatnonzero((unit.time > begin) & (unit.time < end) & whole)
        if len(chosen) < 20:
            raise LogError(
                f"{unit.name}: expected more than {2 * self.largest:g} s in common with "
                f"{', '.join(self.links[unit.name]) or 'encoders or cameras'}"
            )
        chosen = chosen[:: max(1, len(chosen) // _MOST_SAMPLES)]
        return replace(unit, time=unit.time[chosen], rows=unit.rows[chosen])

    def _misfit(self, unit: Stream, late: dict[str, float], every: int) -> float:
        """Sum over the axes of the logarithm of the residual variance."""
        error = unit.rows[::every] - self._expected(unit, unit.time[::every], late)
        return float(np.log(np.var(error, axis=0) + unit.model.variances).sum())

    def _expected(self, unit: Stream, times: Array, late: dict[str, float]) -> Array:
        """Rows of an inertial unit as the others tell them, (N, 6) [m/s^2, rad/s]."""
        now = times - late[unit.name]
        levels = np.zeros((len(times), 3, self.robot.dof))
        attitude = Rotation.identity(len(times))
        for name in self.links[unit.name]:
            track = self.tracks[name]
            state, turn = track.at(now + late[name])
            levels[:, :, list(track.columns)] = np.swapaxes(state, 1, 2)
            attitude = attitude if turn is None else turn
        rows, _ = unit.model.frame.inertials(levels, attitude)
        return np.asarray(rows)

    def _std(self, unit: Stream, known: dict[str, float], best: dict[str, float]) -> Array:
        """Standard deviations of shifts that were found, (k,) [s].

        The slopes of the likelihood are summed over stretches of the log, each of which may be
        correlated in itself (Liang & Zeger 1986, Biometrika 73).
        """

        def expected(name: str, step: float) -> Array:
            return self._expected(unit, unit.time, known | best | {name: best[name] + step})

        error = unit.rows - self._expected(unit, unit.time, known | best)
        weight = 1 / (np.var(error, axis=0) + unit.model.variances)
        slopes = [(expected(name, _STEP) - expected(name, -_STEP)) / (2 * _STEP) for name in best]
        slope = np.stack([one - one.mean(axis=0) for one in slopes], axis=-1)
        inverse = np.linalg.pinv(np.einsum("nai,a,naj->ij", slope, weight, slope), hermitian=True)
        pulls = np.einsum("na,a,nai->ni", error - error.mean(axis=0), weight, slope)
        sums = np.array([part.sum(axis=0) for part in np.array_split(pulls, _STRETCHES)])
        moved = sums @ inverse
        return np.asarray(np.sqrt((moved**2).sum(axis=0)))
