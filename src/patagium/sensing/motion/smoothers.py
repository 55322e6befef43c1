"""Smoothers of a measured coordinate, its rate and acceleration: Kalman, spline, Savitzky-Golay.

All three are linear in the measurements, so that their covariance is exact for white noise.
Neglected: motion that a spline or polynomial cannot follow; only the covariance of the Kalman
smoother allows for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded

from patagium.errors import LogError, ParameterError
from patagium.sensing.motion.kalman_smoother import MOTION_ORDERS, likely_density, smooth_chain

Array = NDArray[np.float64]


class Smoothed(NamedTuple):
    """Coordinates with two derivatives.

    Attributes:
        state: Coordinate, rate, acceleration, (M, B, 3) [unit, unit/s, unit/s^2].
        covariance: Covariance of the state, (M, B, 3, 3) [unit^2, unit^2/s, ...].
    """

    state: Array
    covariance: Array


class Smoother(Protocol):
    """Smoother that gives rates and accelerations of measured coordinates."""

    def smooth(
        self, time: Array, values: Array, std: ArrayLike, at: Array | None = None
    ) -> Smoothed:
        """Coordinates and two derivatives at given times.

        Args:
            time: Times of the samples, (N,) [s].
            values: Measured coordinates, (N, B) [unit]; NaN where one is missing.
            std: Standard deviation of the samples, (B,) or one for all [unit].
            at: Times of the result, (M,) [s]; None for those of the samples.

        Raises:
            LogError: If there are too few samples.
        """
        ...


@dataclass(frozen=True)
class Kalman:
    """Kalman smoother of a chain of integrators driven by white noise.

    Args:
        order: 3 for white jerk, 4 for white snap.
        density: Density of that noise, one for all coordinates [unit^2/s^(2 order - 1)]; None
            takes the most likely one for each coordinate.

    Raises:
        ParameterError: If a number is out of its range.
    """

    order: int = 4
    density: float | None = None

    def __post_init__(self) -> None:
        if self.order not in MOTION_ORDERS:
            raise ParameterError("order", f"one of {MOTION_ORDERS}", self.order)
        if self.density is not None and not self.density > 0:
            raise ParameterError("density", "a positive number", self.density)

    def smooth(
        self, time: Array, values: Array, std: ArrayLike, at: Array | None = None
    ) -> Smoothed:
        """Coordinates and two derivatives at the times `at`, (M,) [s]; see `Smoother`."""
        density = self.density
        drive = (
            likely_density(time, values, std, order=self.order)
            if density is None
            else np.full(values.shape[1], density)
        )
        grid, rows = merged_times(time, time if at is None else at)
        known = np.full((len(grid), values.shape[1]), np.nan)
        known[np.searchsorted(grid, time)] = values
        found = smooth_chain(grid, known, std, drive, order=self.order)
        return Smoothed(found.state[rows, :, :3], found.covariance[rows, :, :3, :3])


@dataclass(frozen=True)
class Spline:
    """Least-squares spline of degree five.

    Args:
        knot_step: Time between knots, several samples [s].

    Raises:
        ParameterError: If it is not positive.
    """

    knot_step: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.knot_step) and self.knot_step > 0):
            raise ParameterError("knot_step", "a positive number of seconds", self.knot_step)

    def smooth(
        self, time: Array, values: Array, std: ArrayLike, at: Array | None = None
    ) -> Smoothed:
        """Coordinates and two derivatives at the times `at`, (M,) [s]; see `Smoother`."""
        degree = 5
        times = time if at is None else at
        begin, end = min(time[0], times[0]), max(time[-1], times[-1])
        spans = max(1, round((end - begin) / self.knot_step))
        inner = np.linspace(begin, end, spans + 1)
        knots = np.concatenate([[begin] * degree, inner, [end] * degree])
        deviations = np.broadcast_to(np.asarray(std, float), values.shape[1:])
        rows = [_basis(knots, times, degree, k) for k in range(3)]
        state = np.empty((len(times), values.shape[1], 3))
        covariance = np.empty((*state.shape, 3))
        shapes: dict[bytes, tuple[Array, Array]] = {}
        for b, column in enumerate(values.T):
            seen = np.isfinite(column)
            key = seen.tobytes()
            if key not in shapes:
                shapes[key] = _projection(knots, time[seen], degree, rows, self.knot_step)
            weights, unit = shapes[key]
            state[:, b] = np.einsum("kmn,n->mk", weights, column[seen])
            covariance[:, b] = unit * deviations[b] ** 2
        return Smoothed(state, covariance)


@dataclass(frozen=True)
class SavitzkyGolay:
    """Least-squares polynomial through the samples around each time.

    Args:
        window: Width of the span of samples [s].
        degree: Degree of the polynomial, at least 2.

    Raises:
        ParameterError: If a number is out of its range.
    """

    window: float
    degree: int = 4

    def __post_init__(self) -> None:
        if not (np.isfinite(self.window) and self.window > 0):
            raise ParameterError("window", "a positive number of seconds", self.window)
        if not isinstance(self.degree, int) or self.degree < 2:
            raise ParameterError("degree", "an integer of at least 2", self.degree)

    def smooth(
        self, time: Array, values: Array, std: ArrayLike, at: Array | None = None
    ) -> Smoothed:
        """Coordinates and two derivatives at the times `at`, (M,) [s]; see `Smoother`.

        Raises:
            LogError: If a window holds too few samples for the polynomial.
        """
        times = time if at is None else at
        deviations = np.broadcast_to(np.asarray(std, float), values.shape[1:])
        state = np.empty((len(times), values.shape[1], 3))
        covariance = np.empty((*state.shape, 3))
        half = self.window / 2
        for b, column in enumerate(values.T):
            seen = np.isfinite(column)
            stamps, known = time[seen], column[seen]
            for m, now in enumerate(times):
                middle = min(max(now, stamps[0] + half), stamps[-1] - half)
                lo, hi = np.searchsorted(stamps, [middle - half - 1e-12, middle + half + 1e-12])
                if hi - lo <= self.degree:
                    raise LogError(
                        f"window: expected more than {self.degree} samples within "
                        f"{self.window:g} s of t = {now:.6g} s, found {hi - lo}"
                    )
                weights = _local(stamps[lo:hi], now, half, self.degree)
                state[m, b] = weights @ known[lo:hi]
                covariance[m, b] = weights @ weights.T * deviations[b] ** 2
        return Smoothed(state, covariance)


def merged_times(time: Array, at: Array) -> tuple[Array, NDArray[np.int64]]:
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


def _local(stamps: Array, now: float, half: float, degree: int) -> Array:
    """Weights of K samples in value, rate and acceleration of their polynomial, (3, K)."""
    powers = ((stamps - now) / half)[:, None] ** np.arange(degree + 1)
    inverse = np.linalg.pinv(powers)[:3]
    return np.asarray(inverse * np.array([1.0, 1 / half, 2 / half**2])[:, None])


def _basis(knots: Array, times: Array, degree: int, derivative: int) -> Array:
    count = len(knots) - degree - 1
    found = BSpline(knots, np.eye(count), degree)
    return np.asarray(found.derivative(derivative)(times) if derivative else found(times))


def _projection(
    knots: Array, time: Array, degree: int, rows: list[Array], step: float
) -> tuple[Array, Array]:
    """Weights of the samples, (3, M, N), and covariance for noise of variance one, (M, 3, 3)."""
    design = _basis(knots, time, degree, 0)
    normal = design.T @ design
    try:
        banded = np.array([np.pad(np.diagonal(normal, k), (0, k)) for k in range(degree + 1)])
        factor = cholesky_banded(banded, lower=True)
    except np.linalg.LinAlgError:
        raise LogError(
            f"knot_step: expected several samples between knots {step:g} s apart, "
            "found spans without"
        ) from None
    solved = np.stack([cho_solve_banded((factor, True), row.T).T for row in rows])
    weights = solved @ design.T
    covariance = np.einsum("imc,jmc->mij", solved, np.stack(rows))
    return weights, covariance
