"""Filter and smoother of a robot's motion from sensors that see different parts of it.

Each coordinate is a chain of integrators driven by white noise; attitude is an error-state about a
rotation (a rotation vector in body axes, reset after each measurement). Biases of inertial units
are estimated with it. Extended Kalman filter, iterated where a measurement moves it far, and
Rauch-Tung-Striebel smoother, both on square roots of the covariance: definite by construction,
however exact the sensors. Neglected: what resets do to the covariance, of second order.

References:
    Markley (2003), Attitude error representations for Kalman filtering; Rauch (1965),
    Maximum likelihood estimates of linear dynamic systems; Kailath, Sayed & Hassibi (2000), Linear
    Estimation, ch. 12 (array algorithms).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from patagium.errors import FilterDiverged, Outcome
from patagium.robot import Robot
from patagium.sensing.motion.attitude import rotation_of, vector_of
from patagium.sensing.motion.chains import added_covariance, transition
from patagium.sensing.motion.model import Base, Motion, base_of
from patagium.sensing.motion.sensors import Channel, Observation

Array = NDArray[np.float64]

_MOST_LOOKS = 5
_NEAR = np.array([1e-2, 1.0, 1.0])  # m or rad, and per s and s^2: slopes are the same there


@dataclass(frozen=True)
class Belief:
    """Motion and biases with their covariance.

    Attributes:
        motion: Mean of the motion.
        biases: Of the inertial units, (6 units,) [m/s^2, rad/s].
        root: S with covariance S S^T of (levels of the estimated coordinates one after the
            other, biases), (s, s).
    """

    motion: Motion
    biases: Array
    root: Array

    @property
    def covariance(self) -> Array:
        """S S^T, (s, s)."""
        return np.asarray(self.root @ self.root.T)


@dataclass(frozen=True)
class Step:
    """A prediction over a span, as the smoother needs it again.

    Attributes:
        span: [s].
        turned: Rotation vector of the attitude over it, body axes, (3,) [rad].
    """

    span: float
    turned: Array


class MotionFilter:
    """Mean and covariance of a motion that follows measurements.

    Args:
        robot: The machine.
        columns: Coordinates that are estimated; the others stay at zero and touch nothing.
        density: Of the white noise that drives each, (n_columns,) [unit^2/s^(2m-1)].
        order: m, levels of each coordinate.
        channels: What is measured, by name of the sensor.
    """

    def __init__(
        self,
        robot: Robot,
        columns: Sequence[int],
        density: Array,
        order: int,
        channels: Mapping[str, Channel],
    ) -> None:
        self.robot, self.order = robot, order
        self.columns = np.array(columns, int)
        self.density = np.asarray(density, float)
        self._channels = dict(channels)
        self._units = [name for name, channel in channels.items() if channel.biases]
        self.base: Base | None = base_of(robot)
        n = len(self.columns)
        self.size = order * n + 6 * len(self._units)
        self._turn = (
            np.array([int(np.flatnonzero(self.columns == i)[0]) for i in self.base.turn])
            if self.base is not None and set(self.base.turn) <= set(self.columns.tolist())
            else None
        )
        walks = [np.asarray(channels[name].bias_walk) ** 2 for name in self._units]
        self._walk = np.concatenate([np.zeros(0), *walks])
        self._cached: dict[float, tuple[Array, Array]] = {}

    def bias_of(self, belief: Belief, name: str) -> Array:
        """Bias of an inertial unit, (6,) [m/s^2, rad/s]."""
        k = self._units.index(name)
        return belief.biases[6 * k : 6 * k + 6]

    def predict(self, belief: Belief, span: float) -> tuple[Belief, Step]:
        """The motion a span later, and what led there.

        Args:
            belief: Now.
            span: Zero or more [s].
        """
        motion, step = self._moved(belief.motion, span)
        root = _triangle(self._ahead(belief.root, step))
        return Belief(motion, belief.biases, root), step

    def update(self, belief: Belief, observations: Sequence[Observation]) -> tuple[Belief, float]:
        """The motion given measurements made now.

        Args:
            belief: Before them.
            observations: All that was measured at this time.

        Returns:
            After them, and the normalized innovation squared.

        Raises:
            FilterDiverged: If the estimate or its covariance is not finite.
        """
        now, change = belief, np.zeros(self.size)
        for _ in range(_MOST_LOOKS):
            residual, slope, variance = self._compared(now, observations)
            m = len(residual)
            # [R^1/2, H S; 0, S] made triangular: roots of the innovation's and the new covariance
            rows = [np.hstack([np.diag(np.sqrt(variance)), slope @ belief.root])]
            rows.append(np.hstack([np.zeros((self.size, m)), belief.root]))
            corner = _triangle(np.vstack(rows))
            innovation = residual + slope @ change
            before = change
            scaled = solve_triangular(corner[:m, :m], innovation, lower=True, check_finite=False)
            change = corner[m:, :m] @ scaled
            if not np.isfinite(change).all():
                raise FilterDiverged(
                    f"motion filter: measurements of {', '.join(o.name for o in observations)} "
                    "cannot be weighed: the estimate is not finite; raise their deviation",
                    Outcome.NOT_FINITE,
                )
            now = self.corrected(belief, change)
            if not self._is_far(change - before):
                break
        return replace(now, root=corner[m:, m:]), float(scaled @ scaled)

    def _is_far(self, change: Array) -> bool:
        """Whether a change is so large that slopes are others there."""
        n = len(self.columns)
        moved = np.abs(change[: self.order * n].reshape(self.order, n)[:3]).max(axis=1)
        return bool((moved > _NEAR).any())

    def _compared(
        self, belief: Belief, observations: Sequence[Observation]
    ) -> tuple[Array, Array, Array]:
        """Residuals of all observations, their slopes and variances."""
        residuals, slopes, noise = [], [], []
        for observation in observations:
            channel = self._channels[observation.name]
            bias = self.bias_of(belief, observation.name) if channel.biases else None
            residual, slope, variance = channel.compare(belief.motion, observation, bias)
            residuals.append(residual)
            slopes.append(self._spread(slope, observation.name))
            noise.append(variance)
        return np.concatenate(residuals), np.vstack(slopes), np.concatenate(noise)

    def corrected(self, belief: Belief, change: Array) -> Belief:
        """A motion moved by an error-state, (s,); its covariance as it was."""
        n = len(self.columns)
        levels = belief.motion.levels.copy()
        levels[:, self.columns] += change[: self.order * n].reshape(self.order, n)
        attitude = belief.motion.attitude
        if self._turn is not None:
            turned = self.columns[self._turn]
            attitude = attitude @ rotation_of(levels[0, turned])
            levels[0, turned] = 0.0
        biases = belief.biases + change[self.order * n :]
        return Belief(Motion(levels, attitude), biases, belief.root)

    def apart(self, one: Belief, other: Belief) -> Array:
        """The error-state that moves the other to the one, (s,)."""
        levels = one.motion.levels[:, self.columns] - other.motion.levels[:, self.columns]
        if self._turn is not None:
            levels[0, self._turn] = vector_of(other.motion.attitude.T @ one.motion.attitude)
        return np.concatenate([levels.ravel(), one.biases - other.biases])

    def advance(self, matrix: Array, step: Step) -> Array:
        """F M: how an error-state, (s, k), is carried over a step."""
        n = len(self.columns)
        moved = np.array(matrix)
        half = None
        if self._turn is not None:
            half = rotation_of(-0.5 * step.turned)
            moved[self._turn] = half @ moved[self._turn]
        move, _ = self._blocks(step.span)
        main = moved[: self.order * n].reshape(self.order, -1)
        moved[: self.order * n] = (move @ main).reshape(self.order * n, -1)
        if half is not None:
            moved[self._turn] = half @ moved[self._turn]
        return moved

    def retrace(self, belief: Belief, step: Step, after: Belief) -> Belief:
        """The motion given also what came after: one step of the smoother back.

        Args:
            belief: Given what came before.
            step: From there to the next.
            after: The next, given everything.
        """
        ahead, _ = self.predict(belief, step.span)
        forth = self._ahead(belief.root, step)
        still = np.zeros((self.size, forth.shape[1] - self.size))
        corner = _triangle(np.vstack([forth, np.hstack([belief.root, still])]))
        first, across = corner[: self.size, : self.size], corner[self.size :, : self.size]
        gain = solve_triangular(first.T, across.T, check_finite=False).T
        root = _triangle(np.hstack([corner[self.size :, self.size :], gain @ after.root]))
        if not np.isfinite(root).all():
            raise FilterDiverged(
                "motion smoother: the covariance was lost; raise the density or lower the order",
                Outcome.COVARIANCE_LOST,
            )
        moved = self.corrected(belief, gain @ self.apart(after, ahead))
        return replace(moved, root=root)

    def _ahead(self, root: Array, step: Step) -> Array:
        """A wide root of the covariance a step later: [F S, root of what noise adds]."""
        main = self.order * len(self.columns)
        added = np.zeros((self.size, self.size))
        added[:main, :main] = self._blocks(step.span)[1]
        rows = main + np.arange(len(self._walk))
        added[rows, rows] = np.sqrt(self._walk * step.span)
        return np.hstack([self.advance(root, step), added])

    def _moved(self, motion: Motion, span: float) -> tuple[Motion, Step]:
        move, _ = self._blocks(span)
        levels = move @ motion.levels
        turned, attitude = np.zeros(3), motion.attitude
        if self._turn is not None:
            columns = self.columns[self._turn]
            turned = levels[0, columns].copy()
            if self.order > 2:  # body axes turn while they turn
                spin, bend = motion.levels[1, columns], motion.levels[2, columns]
                turned += span**3 / 12 * np.cross(spin, bend)
            attitude = attitude @ rotation_of(turned)
            levels[0, columns] = 0.0
        return Motion(levels, attitude), Step(span, turned)

    def _spread(self, slope: Array, name: str) -> Array:
        """Derivative with respect to all levels, (k, m', n), as that to the error-state, (k, s)."""
        n = len(self.columns)
        whole = np.zeros((len(slope), self.size))
        for level in range(min(slope.shape[1], self.order)):
            whole[:, level * n : (level + 1) * n] = slope[:, level, self.columns]
        if name in self._units:
            start = self.order * n + 6 * self._units.index(name)
            whole[:, start : start + 6] = np.eye(6)
        return whole

    def _blocks(self, span: float) -> tuple[Array, Array]:
        key = round(span, 10)
        if key not in self._cached:
            if len(self._cached) > 1000:
                self._cached.clear()
            # a chain's noise over a second, each level in its own power of the span
            power = np.sqrt(span) * span ** np.arange(self.order - 1, -1, -1)
            root = power[:, None] * np.linalg.cholesky(added_covariance(self.order, 1.0))
            added = np.kron(root, np.diag(np.sqrt(self.density)))
            self._cached[key] = transition(self.order, span), np.asarray(added, float)
        return self._cached[key]


def _triangle(wide: Array) -> Array:
    """Lower triangular T, (k, k), with T T^T = A A^T, of a wide A, (k, l >= k)."""
    return np.asarray(np.linalg.qr(wide.T, mode="r")).T
