"""Motion of a robot as a spline: control points of coordinates, unit quaternions for attitude.

The attitude is the normalized sum of unit quaternions by the weights of the spline, so that it
turns through any angle without a singularity. A control point of the attitude is changed by a
rotation vector in its own body axes, three unknowns like the position.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from patagium.arrays import Array, Indices
from patagium.sensing.motion.banded import SEEN, Knots


@dataclass(frozen=True)
class SplinePoint:
    """Motion at given times, and the attitude's part of its slopes.

    Attributes:
        span: Span of each time, (N,) [-].
        weights: Weights of the six points that a time sees, (N, levels, 6) [1/s per level].
        levels: Position, velocity, acceleration of each column, (N, 3, n) [m, rad, per s,
            per s^2]; for attitude zero, angular velocity and its derivative in body axes.
        attitude: Rotations from body to world axes, N; None without a floating body.
        slopes: Change of (small rotation in body axes, angular velocity, its derivative) by the
            rotation vectors of the six points, (N, 3, 3, 6, 3) [1/s per level]; empty without a
            floating body.
    """

    span: Indices
    weights: Array
    levels: Array
    attitude: Rotation | None
    slopes: Array


class MotionSpline:
    """Spline of the motion of some coordinates.

    Args:
        knots: Knots of the spline.
        points: Control points of the coordinates, (K, n) [m, rad]; those of attitude are zero.
        turn: Places of the three attitude columns among the n; None without them.
        turns: Unit quaternions x, y, z, w of the control points, (K, 4) [-]; None without them.
    """

    def __init__(
        self, knots: Knots, points: Array, turn: Indices | None = None, turns: Array | None = None
    ) -> None:
        self.knots, self.points, self.turn, self.turns = knots, points, turn, turns

    def moved(self, change: Array) -> MotionSpline:
        """Spline with its control points moved by a change, (K, n) [m, rad]."""
        points = self.points + change
        if self.turn is None or self.turns is None:
            return MotionSpline(self.knots, points)
        points[:, self.turn] = 0.0
        turned = product(self.turns, Rotation.from_rotvec(change[:, self.turn]).as_quat())
        return MotionSpline(self.knots, points, self.turn, turned)

    def at(self, times: Array) -> SplinePoint:
        """Motion at given times, (N,) [s]."""
        span = self.knots.span_of(times)
        weights = self.knots.weights(times)
        seen = span[:, None] + np.arange(SEEN)
        levels = np.einsum("nlj,njc->nlc", weights, self.points[seen])
        if self.turn is None or self.turns is None:
            return SplinePoint(span, weights, levels, None, np.zeros((len(times), 3, 3, SEEN, 0)))
        attitude, spin, spin_rate, slopes = _turning(weights, self.turns[seen])
        levels[:, :, self.turn] = np.stack([np.zeros_like(spin), spin, spin_rate], axis=1)
        return SplinePoint(span, weights, levels, Rotation.from_quat(attitude), slopes)

    def rows(self, point: SplinePoint, slope: Array) -> Array:
        """Slopes of measurements with respect to the control points that a time sees.

        Args:
            point: Motion at the times of the measurements.
            slope: Slopes with respect to 1 to 3 levels, (N, k, levels, n) [of the measurements].

        Returns:
            (N, k, 6 n), point by point.
        """
        used = slope.shape[2]
        found = np.einsum("nklc,nlj->nkjc", slope, point.weights[:, :used], optimize=True)
        if self.turn is not None:
            turned = slope[:, :, :, self.turn]
            found[..., self.turn] = np.einsum(
                "nkla,nlajb->nkjb", turned, point.slopes[:, :used], optimize=True
            )
        return np.ascontiguousarray(found).reshape(len(slope), slope.shape[1], -1)

    def driven(self, times: Array, order: int) -> tuple[Array, Array]:
        """Derivative of a given order of each column, and its weights.

        For attitude it is twice the vector part of the conjugate quaternion times that derivative
        of the quaternion, which vanishes for any steady turn.

        Args:
            times: Times, (N,) [s].
            order: Order of the derivative.

        Returns:
            Derivatives, (N, n) [unit/s^order]; slopes with respect to the six control points of
            the same column, (N, 6), without the turn of the body axes.
        """
        every = self.knots.weights(times, order + 1)
        weights = every[:, order]
        seen = self.knots.span_of(times)[:, None] + np.arange(SEEN)
        value = np.einsum("nj,njc->nc", weights, self.points[seen])
        if self.turn is not None and self.turns is not None:
            parts = self.turns[seen]
            now = np.einsum("nj,njc->nc", every[:, 0], parts)
            now /= np.linalg.norm(now, axis=1)[:, None]
            high = np.einsum("nj,njc->nc", weights, parts)
            value[:, self.turn] = 2 * product(conjugate(now), high)[:, :3]
        return value, weights


def product(one: Array, other: Array) -> Array:
    """Products of quaternions x, y, z, w, (..., 4) [-]."""
    u, s, v, t = one[..., :3], one[..., 3:], other[..., :3], other[..., 3:]
    vector = s * v + t * u + np.cross(u, v)
    return np.concatenate([vector, s * t - (u * v).sum(axis=-1, keepdims=True)], axis=-1)


def conjugate(one: Array) -> Array:
    """Conjugate quaternions x, y, z, w, (..., 4) [-]."""
    return np.asarray(one * np.array([-1.0, -1.0, -1.0, 1.0]))


def _turning(weights: Array, parts: Array) -> tuple[Array, Array, Array, Array]:
    """Attitude (N, 4), angular velocity and its derivative (N, 3), and their slopes.

    With the path q = sum of weights times quaternions, of length one at the time, and p = q* q_j:
    w = 2 vec(q* q'), w' = 2 vec(q* q'') - 2 (q . q') w. A change of the points by rotation
    vectors turns the body by s0, and w, w' change by s1 + w x s0 / 2 ... with s_l the sum of the
    derivatives of order l of the weights times vec(p phi). `weights`, (N, 3, 6)
    [1/s per level], are those of the control points, and `parts`, (N, 6, 4), their quaternions.
    """
    path = np.einsum("nlj,njc->nlc", weights, parts)
    length = np.linalg.norm(path[:, 0], axis=1)
    path = path / length[:, None, None]
    back = conjugate(path[:, 0])
    first, second = product(back, path[:, 1]), product(back, path[:, 2])
    stretch = first[:, 3:]
    spin = 2 * first[:, :3]
    spin_rate = 2 * second[:, :3] - 2 * stretch * spin
    apart = product(back[:, None], parts) / length[:, None, None]
    turns = apart[:, :, 3, None, None] * np.eye(3) + skew(apart[:, :, :3])
    sums = np.einsum("nlj,njab->nlajb", weights, turns)
    ends = -np.einsum("nlj,njb->nljb", weights, apart[:, :, :3])
    across, across_rate = skew(spin), skew(spin_rate)
    slopes = np.empty_like(sums)
    slopes[:, 0] = sums[:, 0]
    half = 0.5 * across - stretch[:, :, None] * np.eye(3)
    slopes[:, 1] = sums[:, 1] + np.einsum("nac,ncjb->najb", half, sums[:, 0])
    slopes[:, 1] -= 0.5 * spin[:, :, None, None] * ends[:, None, 0]
    bend = 0.5 * across_rate - 0.25 * across @ across
    slopes[:, 2] = sums[:, 2] + np.einsum("nac,ncjb->najb", bend, sums[:, 0])
    slopes[:, 2] -= 0.5 * spin[:, :, None, None] * ends[:, None, 1]
    return path[:, 0], spin, spin_rate, slopes


def skew(vector: Array) -> Array:
    """Matrices of the cross product with vectors, (..., 3, 3), in the unit of the vectors."""
    return np.cross(np.eye(3), vector[..., None, :])
