"""First guess of a motion, by interpolation of what encoders and cameras show.

The attitude comes in closed form from the cameras' own; the density of the driving noise from the
spectrum of each coordinate, a power law over white noise, by Whittle's likelihood.

References:
    Whittle (1953), Estimation and information in stationary time series.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp
from scipy.special import softmax

from patagium.arrays import Array, Indices, find_gaps, median_step
from patagium.robot import Robot
from patagium.sensing.motion.frame_model import floating_base
from patagium.sensing.motion.sensor_streams import (
    Stream,
    captured_motion,
    encoded_coordinates,
    first_camera,
)
from patagium.sensing.sensors import from_quaternion

_SEGMENT, _MOST_SEGMENTS = 128, 24
"""Samples of a spectrum, and most spectra of a series."""
_CORRELATIONS = np.array([0.0, 0.2, 0.4, 0.55, 0.7])
"""Correlations of neighboring samples that are tried."""
_LEVELS = np.array([0.5, 0.7, 1.0, 1.4, 2.0])
"""Densities of noise that are tried, over those at the highest frequencies."""
_QUIET = 1e-12
"""Least standard deviation of a series over which a spectrum is formed [unit]."""


@dataclass(frozen=True)
class FirstMotion:
    """First guess of a motion.

    Attributes:
        values: Time (N,) [s] and values (N,) [m, rad] of each coordinate that was seen, of those
            of the attitude summed rotation angles.
        attitude: Attitude over time; None without a floating body.
    """

    values: Mapping[int, tuple[Array, Array]]
    attitude: Slerp | None

    def at(self, times: Array, columns: Indices) -> tuple[Array, Rotation | None]:
        """Values of columns at given times, (N, n) [m, rad], zero if unseen; and the attitude."""
        found = np.zeros((len(times), len(columns)))
        for k, column in enumerate(columns.tolist()):
            if column in self.values:
                found[:, k] = np.interp(times, *self.values[column])
        if self.attitude is None:
            return found, None
        return found, self.attitude(np.clip(times, *self.attitude.times[[0, -1]]))

    def density(self, columns: Indices, order: int) -> Array:
        """Density of the white noise that drives a derivative of each column.

        Args:
            columns: Places of the coordinates, indices (n,) [-].
            order: Order of the derivative.

        Returns:
            (n,) [unit^2/s^(2 order - 1)].
        """
        found = np.full(len(columns), np.nan)
        for k, column in enumerate(columns.tolist()):
            if column not in self.values:
                continue
            time, values = self.values[column]
            if (spectrum := _Spectrum.of(time, values, np.zeros_like(values))) is not None:
                misfit, density = spectrum.misfits(order, 0.0)
                found[k] = np.mean(density[np.argmin(misfit.min(axis=1), axis=1)])
        return np.where(np.isfinite(found), found, np.nanmax([*found, 1e-6]))


def first_motion(robot: Robot, streams: Sequence[Stream]) -> FirstMotion:
    """First guess of a motion from encoders and the first cameras.

    Args:
        robot: The machine.
        streams: Measurements, of a floating body by cameras among others.
    """
    values: dict[int, tuple[Array, Array]] = {}
    for column, (s, k) in encoded_coordinates(streams).items():
        seen = np.isfinite(s.rows[:, k]) & s.used
        if seen.any():
            values[column] = s.time[seen], s.rows[seen, k]
    base, camera = floating_base(robot), first_camera(streams)
    if base is None or camera is None:
        return FirstMotion(values, None)
    seen = np.isfinite(camera.rows).all(axis=1) & camera.used
    time, rows = camera.time[seen], camera.rows[seen]
    levels = np.zeros((len(time), 3, robot.dof))
    for column, series in values.items():
        levels[:, 0, column] = np.interp(time, *series)
    place, attitude = base_poses(camera, rows, levels)
    _, angles = captured_motion(rows)
    for column, one in zip((*base.place, *base.turn), (*place.T, *angles.T), strict=True):
        values[column] = time, one
    return FirstMotion(values, Slerp(time, attitude))


def base_poses(camera: Stream, rows: Array, levels: Array) -> tuple[Array, Rotation]:
    """Positions of the floating body beyond its levels, (N, 3) [m], and attitudes, by cameras.

    Args:
        camera: The cameras.
        rows: Samples of theirs, (N, 7) [m, 1].
        levels: Motion that encoders show, (N, 3, n) [m, rad, per s, per s^2].
    """
    frame = camera.model.frame
    _, guessed, _ = frame.poses(levels, Rotation.identity(len(rows)))
    attitude = from_quaternion(rows[:, 3:]) * guessed.inv()
    apart, _, _ = frame.poses(levels, attitude)
    return rows[:, :3] - apart, attitude


class Noise(NamedTuple):
    """Noise of samples as their spectrum shows it.

    Attributes:
        std: Standard deviation [unit]; NaN if there are too few samples.
        correlation: Correlation of neighboring samples [1].
    """

    std: float
    correlation: float

    @property
    def slowest(self) -> float:
        """Standard deviation of white noise with its density at the lowest frequencies [unit]."""
        return self.std * float(np.sqrt((1 + self.correlation) / (1 - self.correlation)))

    def within(self, share: float) -> float:
        """Density over a share of all frequencies, the lowest, over that of white noise [1].

        Args:
            share: Share of the frequencies below half the rate, above 0 and below 1.
        """
        lowest = (1 + self.correlation) / (1 - self.correlation)
        return float(2 / np.pi * np.arctan(lowest * np.tan(0.5 * np.pi * share)) / share)


def spectral_noise(time: Array, values: Array, order: int, noise: Array | None = None) -> Noise:
    """Noise of samples, one for all columns: the mean over correlations, by their likelihood.

    Args:
        time: Times of the samples, (N,) [s].
        values: Samples, (N, k) [unit].
        order: Order of the derivative of the motion that white noise drives.
        noise: Noise to add to the values, taken as sampled at equal steps, (N, k) [unit].
    """
    rests = np.zeros_like(values) if noise is None else noise
    columns = zip(values.T, rests.T, strict=True)
    found = [_Spectrum.of(time, *column) for column in columns]
    spectra = [one for one in found if one is not None]
    if not spectra:
        return Noise(float("nan"), 0.0)
    misfits, variances = [], []
    for correlation in _CORRELATIONS.tolist():
        misfit, variance = 0.0, []
        for one in spectra:
            by_noise = one.misfits(order, correlation)[0].min(axis=2).sum(axis=0)
            misfit += float(by_noise.min())
            variance.append(one.floor(correlation) * _LEVELS[np.argmin(by_noise)] / one.step)
        misfits.append(misfit)
        variances.append(np.mean(variance))
    likely = softmax(-np.array(misfits))
    return Noise(float(np.sqrt(likely @ variances)), float(likely @ _CORRELATIONS))


@dataclass(frozen=True)
class _Spectrum:
    """Spectra of the stretches of a series without a gap.

    Attributes:
        power: Spectral density of each stretch, (S, F) [unit^2 s].
        turn: Frequencies, (F,) [rad/s].
        step: Time between samples [s].
    """

    power: Array
    turn: Array
    step: float

    @classmethod
    def of(cls, time: Array, values: Array, noise: Array) -> _Spectrum | None:
        """Spectra of values and noise together, (N,) each; None if they are too few.

        Values are brought to equal steps by a cubic spline, noise as if it had them.
        """
        step = median_step(time)
        gaps, wholes = find_gaps(time, 2.5), []
        stretches = (np.split(one, gaps) for one in (time, values, noise))
        for stamps, own, rest in zip(*stretches, strict=True):
            if len(stamps) < 16:
                continue
            grid = np.arange(stamps[0], stamps[-1] + 0.5 * step, step)
            places = np.rint((stamps - stamps[0]) / step)
            whole = CubicSpline(stamps, own)(grid)
            wholes.append(whole + np.interp(np.arange(len(grid)), places, rest))
        length = min(_SEGMENT, max(map(len, wholes), default=0))
        if length < 16:
            return None
        parts = [one[: len(one) // length * length].reshape(-1, length) for one in wholes]
        series = np.concatenate(parts)
        series = series[:: -(-len(series) // _MOST_SEGMENTS)]
        line = np.linspace(-1.0, 1.0, length)
        window = np.hanning(length + 2)[1:-1]
        series = series - series.mean(axis=1, keepdims=True)
        series = series - (series @ line / (line @ line))[:, None] * line
        power = np.abs(np.fft.rfft(series * window, axis=1)) ** 2 * step / (window @ window)
        turn = 2 * np.pi * np.fft.rfftfreq(length, step)
        # the window mixes the lowest frequencies
        return cls(power[:, 3:-1], np.asarray(turn[3:-1], float), step)

    def misfits(self, order: int, correlation: float) -> tuple[Array, Array]:
        """Misfit by stretch, noise and density, (S, 5, 40), and the densities, (40,).

        The model is density / w^(2 order) and noise with a correlation from sample to sample.
        """
        floor = self.floor(correlation)
        shape = self._shape(correlation)
        places = np.logspace(np.log10(0.3 * self.turn[0]), np.log10(self.turn[-1]), 40)
        density = floor * places ** (2 * order)
        noise = floor * _LEVELS
        model = noise[:, None, None] * shape + density[:, None] / self.turn ** (2 * order)
        misfit = np.log(model).sum(axis=-1) + np.einsum("sf,ndf->snd", self.power, 1 / model)
        return misfit, density

    def floor(self, correlation: float) -> float:
        """Density of noise with a correlation as the highest frequencies show it [unit^2 s]."""
        count = max(1, self.power.shape[1] // 3)
        high = (self.power / self._shape(correlation))[:, -count:].mean(axis=1)
        return max(float(np.median(high)), _QUIET**2 * self.step)

    def _shape(self, correlation: float) -> Array:
        """Spectrum of noise with a correlation over that of white noise, (F,)."""
        turned = np.cos(self.turn * self.step)
        return (1 - correlation**2) / (1 + correlation**2 - 2 * correlation * turned)
