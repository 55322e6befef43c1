"""Kalman smoother of measured coordinates, their rates and accelerations.

A coordinate is a chain of integrators driven by white noise: order 3 is a Wiener process of the
acceleration (white jerk), order 4 one of the jerk (white snap). The smoother is linear in the
measurements, so that its covariance is exact for white noise. Many coordinates measured at the
same times go through one pass.
"""

from __future__ import annotations

from math import factorial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, Indices, median_step, real_array, rising
from patagium.errors import LogError, ParameterError, ShapeError

_ORDERS = (3, 4, 5)
"""Orders of a chain that has an acceleration."""
_DIFFUSE = 3.0
"""Initial standard deviation, in largest changes between measurements."""
_REACHES = ((-14.0, 8.0, 45), (-0.5, 0.5, 21))
"""Grids of the search for a density, in powers of ten: from, to, number of points."""


class Smoothed(NamedTuple):
    """Coordinates with their derivatives.

    Attributes:
        state: Coordinate, rate, acceleration (, jerk), (M, B, m) [unit, unit/s, ...].
        covariance: Covariance of the state, (M, B, m, m) [unit^2, unit^2/s, ...].
    """

    state: Array
    covariance: Array


def transition(order: int, step: float) -> Array:
    """Transition matrix of a chain over a step, (m, m), in powers of [s].

    Args:
        order: Number m of levels.
        step: Length of the step [s].
    """
    powers = [step**k / factorial(k) for k in range(order)]
    return np.array([[0.0] * i + powers[: order - i] for i in range(order)])


def added_covariance(order: int, step: float) -> Array:
    """Covariance that white noise of density one adds to a chain over a step, (m, m).

    Args:
        order: Number m of levels.
        step: Length of the step [s].
    """

    def entry(i: int, j: int) -> float:
        """Entry of levels that are i and j below the driven one."""
        return step ** (i + j + 1) / ((i + j + 1) * factorial(i) * factorial(j))

    below = range(order - 1, -1, -1)
    return np.array([[entry(i, j) for j in below] for i in below])


def smooth_chain(time: Array, values: Array, std: Array, density: Array, order: int) -> Smoothed:
    """Coordinates and their derivatives given all measurements.

    A Kalman filter runs forwards and a Rauch-Tung-Striebel smoother backwards.

    Args:
        time: Increasing times, (N,) [s].
        values: Measured coordinates, (N, B) [unit]; NaN where one was not measured.
        std: Standard deviation of the measurements, (N, B), positive [unit].
        density: Density of the driving noise, (B,) [unit^2/s^(2m-1)].
        order: Number m of levels.
    """
    measured = time[np.isfinite(values).any(axis=1)]
    unit = median_step(measured)  # time in steps: entries of like size
    run = _Pass(time / unit, values, std**2, density * unit ** (2 * order - 1), order)
    state, covariance = run.backwards()
    scale = unit ** -np.arange(order, dtype=float)
    return Smoothed(state * scale, covariance * np.outer(scale, scale))


def likely_density(time: Array, values: Array, std: Array, order: int) -> Array:
    """Density of the driving noise for which the measurements are most likely, (B,).

    The search is a grid over 22 powers of ten, refined about its best point.

    Args:
        time: Increasing times, (N,) [s].
        values: Measured coordinates, (N, B) [unit]; NaN where one was not measured.
        std: Standard deviation of the measurements, (N, B), positive [unit].
        order: Number m of levels.

    Returns:
        Density of each coordinate, (B,) [unit^2/s^(2m-1)].
    """
    noise, count = std**2, values.shape[1]
    unit = median_step(time)
    best = np.log10(noise.mean(axis=0)) - (2 * order - 1) * np.log10(unit)
    for reach in _REACHES:
        exponents = best + np.linspace(*reach)[:, None]
        tried, drive = len(exponents), 10.0 ** exponents.ravel() * unit ** (2 * order - 1)
        y, variance = np.tile(values, tried), np.tile(noise, tried)
        run = _Pass(time / unit, y, variance, drive, order, keep=False)
        likely = run.log_likelihood.reshape(exponents.shape).argmax(axis=0)
        best = exponents[likely, np.arange(count)]
    return np.asarray(10.0**best)


class _Pass:
    """One pass forwards over the measurements, with time in units of the median step."""

    def __init__(
        self, time: Array, y: Array, noise: Array, drive: Array, order: int, keep: bool = True
    ) -> None:
        self.time, self.y, self.noise, self.order = time, y, noise, order
        self.drive = drive
        samples, count = y.shape
        self.log_likelihood = np.zeros(count)
        if keep:
            self.state = np.empty((samples, count, order))
            self.covariance = np.empty((samples, count, order, order))
        self._steps: dict[float, tuple[Array, Array]] = {}
        x, p = self._start()
        for k in range(samples):
            if k:
                x, p = self._predict(k, x, p)
            x, p = self._update(k, x, p)
            if keep:
                self.state[k], self.covariance[k] = x, p

    def backwards(self) -> tuple[Array, Array]:
        state, covariance = self.state.copy(), self.covariance.copy()
        for k in range(len(self.time) - 2, -1, -1):
            x, p = self.state[k], self.covariance[k]
            ahead, predicted = self._predict(k + 1, x, p)
            move, _ = self._step(k + 1)
            gain = np.swapaxes(_solve(predicted, move @ p), -1, -2)
            state[k] = x + np.einsum("bij,bj->bi", gain, state[k + 1] - ahead)
            change = covariance[k + 1] - predicted
            covariance[k] = _even(p + gain @ change @ np.swapaxes(gain, -1, -2))
        return state, covariance

    def _start(self) -> tuple[Array, Array]:
        count, order = self.y.shape[1], self.order
        first = np.argmax(np.isfinite(self.y), axis=0)
        x = np.zeros((count, order))
        x[:, 0] = self.y[first, np.arange(count)]
        change = [np.abs(np.diff(y[np.isfinite(y)])).max(initial=0.0) for y in self.y.T]
        wide = _DIFFUSE * (np.array(change) + np.sqrt(self.noise.max(axis=0)))
        return x, np.einsum("b,ij->bij", wide**2, np.eye(order))

    def _step(self, k: int) -> tuple[Array, Array]:
        step = round(float(self.time[k] - self.time[k - 1]), 12)
        if step not in self._steps:
            self._steps[step] = transition(self.order, step), added_covariance(self.order, step)
        return self._steps[step]

    def _predict(self, k: int, x: Array, p: Array) -> tuple[Array, Array]:
        move, add = self._step(k)
        return x @ move.T, move @ p @ move.T + self.drive[:, None, None] * add

    def _update(self, k: int, x: Array, p: Array) -> tuple[Array, Array]:
        seen = np.isfinite(self.y[k])
        if not seen.any():
            return x, p
        variance = np.maximum(p[:, 0, 0], 0.0) + self.noise[k]
        innovation = np.where(seen, self.y[k] - x[:, 0], 0.0)
        self.log_likelihood -= np.where(
            seen, 0.5 * (innovation**2 / variance + np.log(2 * np.pi * variance)), 0.0
        )
        gain = np.where(seen[:, None], p[:, :, 0] / variance[:, None], 0.0)
        x = x + gain * innovation[:, None]
        # Joseph's form: stays definite where a measurement is nearly exact
        keep = np.eye(self.order) - gain[:, :, None] * np.eye(self.order)[0]
        p = keep @ p @ np.swapaxes(keep, -1, -2)
        p = p + self.noise[k][:, None, None] * gain[:, :, None] * gain[:, None, :]
        return x, _even(p)


def _even(matrices: Array) -> Array:
    return 0.5 * (matrices + np.swapaxes(matrices, -1, -2))


def _solve(matrices: Array, right: Array) -> Array:
    """Solutions A^-1 B for symmetric A, each scaled to a unit diagonal first."""
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("...ii->...i", matrices), 1e-300))
    scaled = matrices * scale[..., :, None] * scale[..., None, :]
    return np.asarray(scale[..., None] * np.linalg.solve(scaled, scale[..., None] * right))


def smooth_series(
    time: ArrayLike, values: ArrayLike, std: ArrayLike, at: ArrayLike, *, order: int = 4
) -> Smoothed:
    """Coordinates and two derivatives at given times, with the most likely density of each.

    Args:
        time: Increasing times of the samples, (N,) [s].
        values: Measured coordinates, (N, B) [unit]; NaN where one is missing.
        std: Standard deviation of the samples, (B,) or one for all [unit].
        at: Times of the result, (M,) [s].
        order: Number of levels, 3 to 5.

    Returns:
        Coordinate, rate and acceleration of each, (M, B, 3), and their covariance, (M, B, 3, 3).

    Raises:
        ShapeError: If arrays do not fit each other.
        ParameterError: If they hold no numbers, or the order is another.
        LogError: If there are too few samples.
    """
    check_order(order)
    stamps, y = rising(time), real_array("values", values)
    if y.ndim != 2 or stamps.shape != (len(y),) or len(y) < 2:
        raise ShapeError("values", "(N, B) with N times, N >= 2", y.shape)
    few = np.flatnonzero(np.isfinite(y).sum(axis=0) < 2)
    if len(few):
        raise LogError(f"values: expected two measurements or more in column {few[0]}")
    noise = np.broadcast_to(np.asarray(std, float), y.shape)
    if not (np.isfinite(noise).all() and (noise > 0).all()):
        raise ParameterError("std", "positive numbers", float(np.min(noise)))
    moments = real_array("at", at, ("N",))
    if not (len(moments) and np.isfinite(moments).all()):
        raise ParameterError("at", "finite numbers", at)
    drive = likely_density(stamps, y, noise, order)
    grid, rows = merged_times(stamps, moments)
    known = np.full((len(grid), y.shape[1]), np.nan)
    known[np.searchsorted(grid, stamps)] = y
    found = smooth_chain(grid, known, np.broadcast_to(noise[0], known.shape), drive, order)
    return Smoothed(found.state[rows, :, :3], found.covariance[rows, :, :3, :3])


def check_order(order: int) -> None:
    """Refuse an order of a chain that has no acceleration, or is too high.

    Raises:
        ParameterError: If it is one.
    """
    if order not in _ORDERS:
        raise ParameterError("order", f"one of {_ORDERS}", order)


def merged_times(time: Array, at: Array) -> tuple[Array, Indices]:
    """Times of both in order, and the places of the second; times within 1 ns are one."""
    both = np.concatenate([time, at])
    order = np.argsort(both, kind="stable")
    ordered = both[order]
    new = np.concatenate([[True], np.diff(ordered) > 1e-9])
    place = np.empty(len(both), np.int64)
    place[order] = np.cumsum(new) - 1
    grid = ordered[new]
    grid[place[: len(time)]] = time
    return grid, place[len(time) :]
