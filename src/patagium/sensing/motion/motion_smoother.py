"""Most likely motion of a robot given all samples of its sensors, with noise learned from them.

A spline of the motion is fitted by Gauss-Newton steps, with white noise that drives a derivative of
each coordinate as its prior. Each step also updates what the samples say about themselves: the
density of the driving noise, by coordinate and by stretch of time; the noise of each sensor, with
its correlation from sample to sample and its growth with speed where stamps jitter; and the weight
of each sample, which falls where it contradicts all others. Neglected: the uncertainty of these
numbers; correlation of a sensor's noise over times in which the robot moves.

References:
    MacKay (1992), Bayesian interpolation (update of noise by the number of well-determined
    parameters); Barfoot (2017), State Estimation for Robotics, ch. 4 and 8 (trajectories with a
    prior, attitude by small rotations).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from patagium.arrays import Array, Bools, count_noise, median_step
from patagium.robot import Robot
from patagium.robot.attitude import without_flips
from patagium.sensing.motion.banded import SEEN, Information, Knots
from patagium.sensing.motion.first_motion import FirstMotion, Noise, spectral_noise
from patagium.sensing.motion.frame_model import floating_base, turn_places
from patagium.sensing.motion.motion_spline import MotionSpline, SplinePoint
from patagium.sensing.motion.sensor_streams import (
    FLOOR,
    CaptureModel,
    MeasurementModel,
    Part,
    Stream,
    captured_motion,
)
from patagium.sensing.sensors import as_quaternion, from_quaternion

_GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
"""Places of two samples of a span whose mean square is that of a linear function."""
_STIFF = 1e10
"""Largest information of the prior over that of the samples about a control point."""
_LOOSE = 20.0
"""Least such ratio; below, the steps between knots are too long for the motion."""
_FIRST_STEP = 2.0
"""First time between knots over that between samples."""
_SHORTEST_WINDOW = 0.2
"""Shortest stretch of time with a density of its own [s]."""
_MOST_STEPS, _ENOUGH = 40, 0.05
"""Most Gauss-Newton steps; relative change of densities and noise at which they end."""
_LEAST_KNOWN, _LIKE_OTHERS = 2.0, 0.5
"""Least number of well-determined parameters of a coordinate, and least share of the largest such
number of its body: what the samples do not show of a motion may still be there."""
_PRIOR_COUNT = 20.0
"""Values for which the stated noise of a sensor counts."""
_UNKNOWN = (1e1, 3e1, 3e2)
"""Standard deviation of position, rate and acceleration beyond the samples [m, rad, per s ...]."""
_FREE = 6e5
"""Density over a gap, times a power of its length, at which nothing is known in its middle."""
_LONGEST_TURN = 0.5
"""Longest change of a control point of the attitude in a step [rad]."""
_FOLLOWED = 0.1
"""Share of the frequencies that the motion takes, at first."""
_HASTE = 1.4
"""Power of the change of a density by which its slow approach is sped up."""
_EAGER = 11
"""Number of whole steps; later ones are half as long, because whole ones may oscillate."""
_QUIET, _EXACT = 5.0, 0.025
"""Noise of the spectrum over the least noise below which samples may be more exact than that, and
how much: all where the motion follows less than 55 % of the noise, so that they tell it, and
nothing from 80 %."""
_STILL = 0.1
"""Motion in a time step over the noise, up to which nothing tells the jitter of the stamps."""
_FAR = 4.0
"""Standard deviations beyond which a sample loses weight."""


class Samples:
    """Samples of a sensor with what was learned about them.

    Args:
        stream: The samples.
        first: Noise of each part as its spectrum shows it.

    Attributes:
        variance: Variance of the noise of each value, (k,) [square of its unit].
        color: Density of the noise at the frequencies of the motion over that of white noise,
            (parts,) [1].
        jitter: Variance of the stamps as each part shows it, (parts,) [s^2].
        off: Mean square distance from the motion, by noise and jitter, (parts,) [square of unit].
        weight: Weight of each sample, (N, parts) [1].
        nis: Mean square of the residuals of each part over what is expected, (parts,) [1].
        least: Least standard deviation of each part, (parts,) [its unit].
    """

    def __init__(self, stream: Stream, first: tuple[Noise, ...]) -> None:
        self.stream, self.first = stream, first
        count = len(stream.model.parts)
        self.variance: Array = np.array(stream.model.variances, float)
        self.color: Array = np.array([one.within(_FOLLOWED) for one in first])
        self.jitter, self.off, self.least = np.zeros((3, count))
        self.weight = np.ones((len(stream.time), count))
        self.nis, coarse = np.ones(count), stream.rounding
        for k, part, place in self.parts():
            told = () if part.name == "attitude" else stream.rows.T[place]
            self.least[k] = max([FLOOR[part.name], *map(count_noise, told), *coarse[k : k + 1]])
            self.variance[place] = np.maximum(self.variance[place], self.least[k] ** 2)
            if np.isfinite(self.first[k].std):
                self.variance[place] = max(self.first[k].std, self.least[k]) ** 2

    def parts(self) -> list[tuple[int, Part, slice]]:
        """Number, part and place among the values of each part."""
        ends = np.cumsum([part.size for part in self.stream.model.parts]).tolist()
        return [
            (k, part, slice(end - part.size, end))
            for k, (part, end) in enumerate(zip(self.stream.model.parts, ends, strict=True))
        ]

    def describe(self) -> list[dict[str, Any]]:
        """Noise and weights of each part as learned, and the noise of its spectrum, JSON-able."""
        return [
            {
                "part": part.name,
                "unit": part.unit,
                "std": float(np.sqrt(self.variance[place].mean())),
                "correlation": self.first[k].correlation,
                "jitter": float(np.sqrt(self.jitter[k])),
                "off": float(np.sqrt(self.off[k])),
                "doubted": float((self.weight[self.stream.used, k] < 0.5).mean()),
                "nis": float(self.nis[k]),
                "shown": shown if np.isfinite(shown := self.first[k].slowest) else None,
            }
            for k, part, place in self.parts()
        ]

    def scale(self, rate: Array) -> Array:
        """Square roots of the weights over the variances, (N, k), of values with a rate, (N, k)."""
        found = np.empty_like(rate)
        for k, _, place in self.parts():
            variance = self.variance[place] * self.color[k] + self.jitter[k] * rate[:, place] ** 2
            found[:, place] = np.sqrt(np.maximum(self.weight[:, k, None], 1e-6) / variance)
        return found


@dataclass(frozen=True)
class _Linear:
    """Samples linearized about a motion: residual (N, k), rows (N, k, 6 n), rate (N, k).

    `placed`, (N, k, n), is the part of the slopes that belongs to the coordinates themselves.
    """

    point: SplinePoint
    residual: Array
    rows: Array
    rate: Array
    valid: Bools
    placed: Array


def _learn_part(
    one: Samples, k: int, part: Part, place: slice, seen: Iterable[Any], robust: bool
) -> float:
    """Update noise, color, jitter and weights of a part; returns the largest relative change.

    `seen` are its residuals, their leverage, rate and validity, (N, size) each.
    """
    residual, leverage, rate, valid = seen
    weight = one.weight[:, k, None] * valid
    base, rate = one.variance[place], rate**2
    marginal = base + one.jitter[k] * rate
    share = np.clip(leverage * one.weight[:, k, None] / (marginal * one.color[k]), 0.0, 0.9999)
    followed = float(np.clip(share[valid].mean(), 1e-4, 0.98))
    one.color[k] = one.first[k].within(followed)
    lost = np.clip(share * one.color[k], 0.0, 0.98)  # of the noise, by following it
    square = residual**2 / marginal
    features = np.stack([np.broadcast_to(base, rate.shape) / marginal, rate / marginal])
    normal = np.einsum("int,jnt,nt->ij", features, features, weight * (1 - lost))
    right = np.einsum("int,nt->i", features, weight * square)
    stated = one.stream.model.variances[place]
    if (stated > 1.01 * FLOOR[part.name] ** 2).all():
        normal[0, 0] += _PRIOR_COUNT
        right[0] += _PRIOR_COUNT * float(np.mean(stated / base))
    factor, jitter = right[0] / normal[0, 0], 0.0
    step = median_step(one.stream.time)
    moves = step**2 * rate[valid].mean() > _STILL**2 * base.mean()
    if moves and np.linalg.det(normal) > 0.05 * normal[0, 0] * normal[1, 1]:
        both = np.linalg.solve(normal, right)
        if (both > 0).all():
            factor, jitter = both.tolist()
    factor = float(np.clip(factor, 0.05, 20.0))
    freedom = float(np.einsum("nc,nc->", weight, 1 - lost))
    one.nis[k] = float(np.einsum("nc,nc->", weight, square)) / max(freedom, 1e-9)
    least = one.least[k]
    if one.first[k].slowest < _QUIET * least == _QUIET * FLOOR[part.name]:
        follows = float((weight * lost).sum() / max(weight.sum(), 1e-9))
        least *= _EXACT ** np.clip(4.0 * (0.8 - follows), 0.0, 1.0)
    one.variance[place] = np.maximum(base * factor, least**2)
    one.jitter[k] = jitter
    one.off[k] = one.variance[place].mean() + jitter * rate[valid].mean()
    if robust:
        size = np.maximum(valid.sum(axis=1), 1)
        far = (np.where(valid, square, 0.0)).sum(axis=1)
        limit = (_FAR + 0.2 * size) ** 2
        one.weight[:, k] = (limit / np.maximum(far, limit)) ** 2
    return abs(float(np.log(factor)))


class MotionFit:
    """Fit of the motion of some coordinates.

    Args:
        robot: The machine.
        columns: Indices of the coordinates.
        samples: Samples of the sensors that see them.
        span: Begin and end of the motion [s].
        order: Order of the derivative that white noise drives.
    """

    def __init__(
        self,
        robot: Robot,
        columns: Sequence[int],
        samples: Sequence[Samples],
        span: tuple[float, float],
        order: int,
    ) -> None:
        self.robot, self.columns, self.order = robot, np.array(columns), order
        self.samples, self.span = list(samples), span
        base = floating_base(robot)
        self.turn = turn_places(base, columns)
        parts = () if base is None else (base.place, base.turn)
        self._body = [[c for c, i in enumerate(columns) if i in part] for part in parts]
        self.biases: dict[str, slice] = {}
        self.width = len(self.columns)
        self._biased: list[tuple[MeasurementModel, slice]] = []
        for one in self.samples:
            if one.stream.model.biases:
                self.biases[one.stream.name] = place = slice(self.width, self.width + 6)
                self._biased.append((one.stream.model, place))
                self.width += 6
        self._loose = np.full(self.width, 1e-9)  # information that keeps a step finite, if unseen
        self._loose[: len(self.columns)] = 1e-6
        if self.turn is not None:
            self._loose[self.turn] = 1e-2
        self.gaps: list[tuple[float, float]] = []

    def run(self, guess: FirstMotion) -> None:
        """Fit the motion."""
        shortest = min(median_step(s.stream.time) for s in self.samples)
        self.density = guess.density(self.columns, self.order)
        first = shortest if self.biases else _FIRST_STEP * shortest
        self._place(lambda times: guess.at(times, self.columns), first)
        settled = 0
        for k in range(_MOST_STEPS):
            moved = self._step(k > 1, 1.0 if k < _EAGER else 0.5)
            settled += 1
            if settled % 3:
                continue
            wanted = self.knots.step * (self._looseness() / _LOOSE) ** (1 / (2 * self.order))
            wanted = max(wanted, shortest)
            if wanted < 0.8 * self.knots.step or (wanted > 3 * self.knots.step and settled > 3):
                self._place(self._fitted, wanted)
                settled = 0
            elif moved < _ENOUGH:
                return
            else:
                self._look_again()

    def _look_again(self) -> None:
        """Take the correlation of the noise of cameras from the spectrum about the present fit.

        The first spectrum sums the rotations between frames, which accumulates noise where a body
        turns fast, and interpolates between stamps that jitter, which smooths it: both make white
        noise look correlated.
        """
        for one in self.samples:
            stream = one.stream
            if not isinstance(stream.model, CaptureModel):
                continue
            found = self._linearized(one)
            kept = found.valid.all(axis=1)
            noise, rows = found.residual[kept], stream.rows[kept].copy()
            rows[:, :3] -= noise[:, :3]
            turn = from_quaternion(rows[:, 3:]) * Rotation.from_rotvec(-noise[:, 3:])
            rows[:, 3:] = as_quaternion(turn)
            one.first = tuple(
                spectral_noise(stream.time[kept], values, self.order, noise[:, place])
                for values, (_, _, place) in zip(captured_motion(rows), one.parts(), strict=True)
            )

    def at(self, times: Array) -> tuple[Array, Array, Rotation | None]:
        """Levels (M, 3, n), their covariance (M, 3 n, 3 n), and the attitude at given times.

        Beyond the samples the pose is held, and nothing is known.
        """
        inside = np.clip(times, *self.span)
        point, n = self.spline.at(inside), len(self.columns)
        slope = np.zeros((len(times), 3 * n, 3, self.width))
        slope[..., :n] = np.eye(3 * n).reshape(3 * n, 3, n)
        rows = self.spline.rows(point, slope)
        covariance = rows @ self.covariance.of_spans(point.span) @ np.swapaxes(rows, 1, 2)
        beyond, places = np.flatnonzero(inside != times), np.arange(3 * n)
        covariance[beyond[:, None], places, places] += np.repeat(_UNKNOWN, n) ** 2
        return point.levels[:, :, :n], covariance, point.attitude

    def _fitted(self, times: Array) -> tuple[Array, Rotation | None]:
        """Values (N, n) [m, rad] and attitude of the present fit."""
        point = self.spline.at(times)
        return point.levels[:, 0], point.attitude

    def _place(self, motion: Callable[[Array], tuple[Array, Rotation | None]], step: float) -> None:
        """Begin with knots at a step, and control points on a motion."""
        begin, end = self.span
        self.knots = Knots(begin, end, step)
        at = np.clip(self.knots.centers, begin, end)
        values, attitude = motion(at)
        points = np.zeros((self.knots.count, self.width))
        points[:, : values.shape[1]] = values
        turns = None
        if self.turn is not None and attitude is not None:
            points[:, self.turn] = 0.0
            turns = without_flips(attitude.as_quat())
        self.spline = MotionSpline(self.knots, points, self.turn, turns)
        middles = begin + self.knots.step * (np.arange(self.knots.spans) + 0.5)
        count = max(1, int((end - begin) / max(_SHORTEST_WINDOW, 8 * self.knots.step)))
        self.window = np.minimum((middles - begin) / (end - begin) * count, count - 1).astype(int)
        self.open = np.zeros(self.knots.spans, bool)
        self.bridging = np.zeros(self.knots.spans)
        for first, last in self.gaps:
            inside = (middles > first) & (middles < last)
            near = 3 * self.knots.step
            self.open |= (middles > first - near) & (middles < last + near)
            free = _FREE * (last - first) ** (1 - 2 * self.order)
            self.bridging[inside] = np.maximum(self.bridging[inside], free)
        self.liveliness = np.ones((self.knots.spans, len(self.columns)))

    def _step(self, robust: bool, pace: float) -> float:
        """One Gauss-Newton step; returns the largest relative change of what is learned."""
        information = Information(self.knots.count, self.width)
        linear = [self._linearized(one) for one in self.samples]
        placed = np.zeros(self.width)
        for one, found in zip(self.samples, linear, strict=True):
            scale = one.scale(found.rate)
            rows = found.rows * scale[:, :, None]
            information.add(found.point.span, rows, found.residual * scale)
            placed += np.einsum("nkc,nk->c", found.placed**2, scale**2)
        self.seen = information.diagonal.mean(axis=0)
        self.placed = placed / self.knots.count
        drive = self._drive()
        self._add_prior(information, drive)
        information.diagonal[:] += self._loose
        change, self.covariance = information.solve()
        if self.turn is not None:
            length = np.linalg.norm(change[:, self.turn], axis=1, keepdims=True)
            change[:, self.turn] *= np.minimum(1.0, _LONGEST_TURN / np.maximum(length, 1e-300))
        change *= pace
        self.spline = self.spline.moved(change)
        std = np.sqrt(self.covariance.matrix[:, -1]).reshape(change.shape)
        moved = 0.3 * float((np.abs(change) / std).max())
        for one, found in zip(self.samples, linear, strict=True):
            moved = max(moved, self._learn_noise(one, found, change, robust))
        return max(moved, self._learn_density(drive, pace))

    def _linearized(self, one: Samples) -> _Linear:
        stream = one.stream
        point = self.spline.at(stream.time)
        n = self.robot.dof
        levels = np.zeros((len(stream.time), 3, n))
        levels[:, :, self.columns] = point.levels[:, :, : len(self.columns)]
        attitude = point.attitude
        if attitude is None:
            attitude = Rotation.identity(len(levels))
        residual, slope = stream.model.residuals(levels, attitude, stream.rows)
        used = slope.shape[2]
        own = np.zeros((*slope.shape[:3], self.width))
        own[..., : len(self.columns)] = slope[..., self.columns]
        if stream.name in self.biases:
            place = self.biases[stream.name]
            own[:, :, 0, place] = np.eye(6)
            residual = residual - point.levels[:, 0, place]
        rate = np.einsum("nkc,nc->nk", slope[:, :, 0], levels[:, 1])
        valid = np.isfinite(residual) & stream.used[:, None]
        residual = np.where(valid, residual, 0.0)
        own = np.where(valid[:, :, None, None], own, 0.0)
        if used > 1:  # accelerations and rates: how fast they change is not part of the levels
            rate = np.zeros_like(rate)
        return _Linear(point, residual, self.spline.rows(point, own), rate, valid, own[:, :, 0])

    def _drive(self) -> Array:
        """Density of the noise that drives each unknown on each span, (spans, width)."""
        drive = np.empty((self.knots.spans, self.width))
        n = len(self.columns)
        pressure = self.knots.step ** (1 - 2 * self.order)
        placed = np.where(self.placed > 0, self.placed, self.seen)[:n]
        least = pressure / (_STIFF * np.maximum(placed, 1e-300))
        drive[:, :n] = np.maximum(self.density * self.liveliness, least)
        if self.turn is not None:
            turned = drive[:, self.turn]
            drive[:, self.turn] = np.maximum(turned, self.bridging[:, None])
        for model, place in self._biased:
            drive[:, place] = np.maximum(model.bias_walk, 1e-2 * model.bias_std) ** 2
        return drive

    def _add_prior(self, information: Information, drive: Array) -> None:
        here = slice(0, len(self.columns))
        self.stiffness = self._add_smoothness(information, drive, here, self.order)
        first = self.knots.weights(np.array([self.knots.begin]), 1)[0, 0]
        for model, place in self._biased:
            self._add_smoothness(information, drive, place, 1)
            known = 1.0 / model.bias_std**2
            information.add_alike(np.outer(first, first), known[None], place)
            pull = information.gradient.reshape(-1, self.width)
            start = first @ self.spline.points[:SEEN, place]
            pull[:SEEN, place] -= first[:, None] * (start * known)

    def _driven(self, order: int) -> tuple[Array, Array]:
        """A derivative of the unknowns at two places of each span, and its weights, (2, 6)."""
        every = np.arange(self.knots.spans)[:, None] + _GAUSS
        times = (self.knots.begin + self.knots.step * every).ravel()
        value, weights = self.spline.driven(times, order)
        return value.reshape(-1, 2, self.width), weights[:2]

    def _add_smoothness(
        self, information: Information, drive: Array, here: slice, order: int
    ) -> Array:
        """Add the prior of a derivative of some unknowns; returns its matrix for a span, (6, 6)."""
        half = 0.5 * self.knots.step
        value, weights = self._driven(order)
        stiffness = half * weights.T @ weights
        information.add_alike(stiffness, 1.0 / drive[:, here], here)
        parts = half * np.einsum("gj,sgc->jsc", weights, value[:, :, here]) / drive[:, here]
        pull = information.gradient.reshape(-1, self.width)
        for j in range(SEEN):
            pull[j : j + self.knots.spans, here] -= parts[j]
        return stiffness

    def _learn_noise(self, one: Samples, found: _Linear, change: Array, robust: bool) -> float:
        """Update the noise and the weights of a sensor; returns the largest relative change."""
        seen = change[found.point.span[:, None] + np.arange(SEEN)].reshape(len(found.rows), -1)
        residual = found.residual - np.einsum("nkc,nc->nk", found.rows, seen)
        leverage = self.covariance.variance(found.point.span, found.rows)
        moved = 0.0
        for k, part, place in one.parts():
            if found.valid[:, place].sum() >= 10:
                own = (each[:, place] for each in (residual, leverage, found.rate, found.valid))
                moved = max(moved, _learn_part(one, k, part, place, own, robust))
        return moved

    def _learn_density(self, drive: Array, pace: float) -> float:
        """Update the densities by the number of well-determined parameters."""
        n, spans, step = len(self.columns), self.knots.spans, self.knots.step
        mean = 0.5 * step * (self._driven(self.order)[0][:, :, :n] ** 2).sum(axis=1)
        unsure = self.covariance.trace(self.stiffness, spans)[:, :n] / drive[:, :n]
        known = np.clip(1.0 - unsure, 1e-6, 1.0)
        mean[self.open], known[self.open] = 0.0, 0.0
        count = np.maximum(known.sum(axis=0), 1e-9)
        ratio = (mean / drive[:, :n]).sum(axis=0) / count
        most, body = count.copy(), list(chain(*self._body))
        most[body] = count[body].max(initial=0.0)  # of all columns of the body
        least = np.maximum(_LEAST_KNOWN, _LIKE_OTHERS * most) / count
        ratio = np.maximum(np.clip(ratio, 1e-3, 1e3), np.minimum(least, 1.5) ** self.order)
        self._learn_liveliness(mean / drive[:, :n] / ratio, known)
        ratio = ratio ** (_HASTE * pace)
        self.density = self.density * ratio
        return float(np.abs(np.log(ratio)).max()) / (2 * self.order)

    def _learn_liveliness(self, share: Array, known: Array) -> None:
        """Update how lively each stretch of time is, relative to the whole."""
        count = self.window[-1] + 1
        if count < 3:
            return
        for group in self._kinds():
            sums = [
                np.bincount(self.window, part[:, group].sum(axis=1), count)
                for part in (share * self.liveliness[:, group[:1]], known)
            ]
            mixed = [
                np.convolve(np.pad(part, 1, "edge"), [0.25, 0.5, 0.25], "valid") for part in sums
            ]
            level = (mixed[0] + 2.0) / (mixed[1] + 2.0)
            self.liveliness[:, group] = np.clip(level, 1e-6, 1e6)[self.window, None]

    def _kinds(self) -> list[list[int]]:
        """Columns that are lively together: position, attitude, each joint."""
        others = set(range(len(self.columns))).difference(*self._body)
        return [kind for kind in (*self._body, *([c] for c in sorted(others))) if kind]

    def _looseness(self) -> float:
        """Least information of the prior over that of the samples about a control point."""
        n = len(self.columns)
        top = float(np.trace(self.stiffness))
        live = self.density * self.liveliness.max(axis=0)
        return float((top / (live * np.maximum(self.seen[:n], 1e-300))).min())
