"""Extended Kalman filter of a robot's motion from encoders, cameras and IMUs.

Each coordinate is a chain of integrators driven by white noise. Attitude is an error-state about a
rotation (a rotation vector in body axes, reset after each measurement). Biases of inertial units
are part of the state. The filter is iterated where a measurement moves it far. It works on square
roots of the covariance, which stays positive definite however exact the sensors are. Neglected: the
effect of resets on the covariance, which is of second order.

References:
    Markley (2003), Attitude error representations for Kalman filtering; Andrews (1968), A square
    root formulation of the Kalman covariance equations.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dgeqrf
from scipy.spatial.transform import Rotation

from patagium.arrays import Array
from patagium.errors import FilterDiverged, Outcome
from patagium.native import load_kernel
from patagium.native.function import as_c
from patagium.native.structs import MOTION_FILTER, MOTION_SENSOR
from patagium.robot import Robot
from patagium.sensing.motion.frame_model import (
    FloatingBase,
    Motion,
    floating_base,
    turn_places,
)
from patagium.sensing.motion.sensor_streams import (
    EncoderModel,
    ImuModel,
    MeasurementModel,
    Observation,
)
from patagium.sensing.motion.smoothers import added_covariance, transition

_MOST_ITERATIONS = 5
_NEAR = np.array([1e-2, 1.0, 10.0])
"""Changes of the levels within which slopes stay the same [m or rad, per s, per s^2]."""


@dataclass(frozen=True)
class MotionEstimate:
    """Mean and covariance of the motion and the biases.

    Attributes:
        motion: Mean of the motion.
        biases: Biases of the inertial units one after the other, (6 units,) [m/s^2, rad/s].
        root: Square root S of the covariance S S^T of the error-state (levels of the estimated
            coordinates one after the other, biases), (s, s), in the units of the state.
    """

    motion: Motion
    biases: Array
    root: Array

    @property
    def covariance(self) -> Array:
        """Covariance S S^T of the error-state, (s, s), in products of its units."""
        return self.root @ self.root.T

    @cached_property
    def row(self) -> Array:
        """Levels, attitude, biases and root one after the other, in their units."""
        parts = self.motion.levels, self.motion.attitude, self.biases, self.root
        return np.concatenate([part.ravel() for part in parts])


class Corrected(NamedTuple):
    """Estimate after the measurements of one time.

    Attributes:
        estimate: The estimate.
        innovation: Normalized innovation, (m,) [1].
        slope: Jacobian of the normalized measurements, (m, s) [1 per unit of the state].
        gain: Kalman gain for normalized innovations, (s, m) [unit of the state].
    """

    estimate: MotionEstimate
    innovation: Array
    slope: Array
    gain: Array

    @property
    def nis(self) -> float:
        """Normalized innovation squared for each measured value; about 1."""
        return float(self.innovation @ self.innovation) / len(self.innovation)


class MotionFilter:
    """Kalman filter of a motion.

    Args:
        robot: The machine.
        columns: Indices of the estimated coordinates; the others stay at zero.
        density: Density of the white noise that drives each, (n_columns,) [unit^2/s^(2m-1)].
        order: Number m of levels of each coordinate.
        models: Measurement models by name of the sensor.

    Raises:
        ParameterError: If the robot has several floating bodies.
    """

    def __init__(
        self,
        robot: Robot,
        columns: Sequence[int],
        density: Array,
        order: int,
        models: Mapping[str, MeasurementModel],
    ) -> None:
        self.robot, self.order = robot, order
        self.columns = np.array(columns, int)
        gaps = set(np.diff(self.columns).tolist()) - {1}
        self._own = self.columns if gaps else slice(int(columns[0]), int(columns[-1]) + 1)
        self.density = np.array(density, float)
        self._models = dict(models)
        self.base: FloatingBase | None = floating_base(robot)
        n = len(self.columns)
        units = [name for name, model in models.items() if model.biases]
        self._bias = {name: slice(6 * k, 6 * k + 6) for k, name in enumerate(units)}
        self.biases = 6 * len(units)
        self.size = order * n + self.biases
        self.turn = turn_places(self.base, columns)
        walks = [np.asarray(models[name].bias_walk) ** 2 for name in units]
        self.walk = np.concatenate([np.zeros(0), *walks])
        self._cached: dict[float, tuple[Array, Array]] = {}
        kernel = load_kernel("motion")
        self.compiled = None if kernel is None else CompiledFilter(self, models, kernel)

    def __copy__(self) -> MotionFilter:
        """Filter with the same numbers, and memory of its own."""
        own = self.robot, self.columns.tolist(), self.density, self.order
        return MotionFilter(*own, self._models)

    def estimate_of(self, row: Array) -> MotionEstimate:
        """Estimate whose `row` is this one."""
        n, s = self.robot.dof, self.size
        a, b = self.order * n, self.order * n + 9
        motion = Motion(row[:a].reshape(self.order, n), row[a:b].reshape(3, 3))
        root = row[b + self.biases :].reshape(s, s)
        found = MotionEstimate(motion, row[b : b + self.biases], root)
        found.__dict__["row"] = row
        return found

    def predict(self, estimate: MotionEstimate, span: float) -> tuple[MotionEstimate, Array]:
        """Predicted estimate, and rotation vector over the time span in body axes, (3,) [rad].

        Args:
            estimate: Estimate at the beginning.
            span: Length of the span, zero or more [s].
        """
        if self.compiled is not None:
            row, turned = self.compiled.predict(estimate.row, span)
            return self.estimate_of(row), turned
        motion, turned = self.predicted_motion(estimate.motion, span)
        root = _lower_triangle(self._predicted_root(estimate.root, span, turned))
        return MotionEstimate(motion, estimate.biases, root), turned

    def update(self, estimate: MotionEstimate, observations: Sequence[Observation]) -> Corrected:
        """Estimate given the measurements of one time.

        Args:
            estimate: Estimate before the measurements.
            observations: All measurements of this time.

        Raises:
            FilterDiverged: If the estimate or its covariance is not finite.
        """
        if self.compiled is not None:
            done = self.compiled.update(estimate.row, observations)
            if done is None:
                raise _diverged(observations)
            return Corrected(self.estimate_of(done[0]), *done[1:])
        now, change, n = estimate, np.zeros(self.size), len(self.columns)
        linear = all(self._models[one.name].linear for one in observations)
        for _ in range(_MOST_ITERATIONS):
            residual, slope, variance = self._residuals(now, observations)
            noise, seen = np.diag(np.sqrt(variance)), slope @ estimate.root
            factor = _lower_triangle(np.hstack([noise, seen]))  # root of the innovation's
            factor *= np.copysign(1.0, np.diagonal(factor))
            innovation = residual + slope @ change
            before = change
            parts = _solved(factor, np.hstack([innovation[:, None], slope, seen]))
            scaled, gain = parts[:, 0], estimate.root @ parts[:, 1 + self.size :].T
            change = gain @ scaled
            if not np.isfinite(change).all():
                raise _diverged(observations)
            now = self.corrected(estimate, change)
            moved = (change - before)[: self.order * n].reshape(self.order, n)[:3]
            if linear or not (np.abs(moved).max(axis=1) > _NEAR).any():
                break
        root = estimate.root - gain @ _solved(factor + noise, seen)
        after = MotionEstimate(now.motion, now.biases, root)
        return Corrected(after, scaled, parts[:, 1 : 1 + self.size], gain)

    def enliven(self, factor: float) -> None:
        """Multiply the density of the driving noise by a factor."""
        self.density *= factor
        self._cached.clear()

    def _residuals(
        self, estimate: MotionEstimate, observations: Sequence[Observation]
    ) -> tuple[Array, Array, Array]:
        """Residuals of all observations, (k,), Jacobian, (k, s), and noise variances, (k,)."""
        motion = (
            estimate.motion.levels[None, :3],
            Rotation.from_matrix(estimate.motion.attitude[None]),
        )
        residuals, slopes, noise = [], [], []
        for observation in observations:
            model = self._models[observation.name]
            (residual,), (slope,) = model.residuals(*motion, observation.values[None])
            if model.biases:
                residual = residual - estimate.biases[self._bias[observation.name]]
            seen = np.isfinite(residual)
            residuals.append(residual[seen])
            slopes.append(self._in_error_state(slope[seen], observation.name))
            noise.append(model.variances[seen])
        return np.concatenate(residuals), np.vstack(slopes), np.concatenate(noise)

    def corrected(self, estimate: MotionEstimate, change: Array) -> MotionEstimate:
        """Estimate with its mean moved by an error-state, (s,), and the same covariance."""
        n = len(self.columns)
        levels = estimate.motion.levels.copy()
        levels[:, self._own] += change[: self.order * n].reshape(self.order, n)
        attitude = estimate.motion.attitude
        if self.turn is not None:
            turned = self.columns[self.turn]
            attitude = attitude @ Rotation.from_rotvec(levels[0, turned]).as_matrix()
            levels[0, turned] = 0.0
        biases = estimate.biases + change[self.order * n :]
        return MotionEstimate(Motion(levels, attitude), biases, estimate.root)

    def advanced(self, errors: Array, span: float, turned: Array, *, back: bool = False) -> Array:
        """Product F M of the transition matrix of a span with error-states M, (s, k) or (s,).

        Args:
            errors: Error-states M; adjoint ones, per unit of the state, to go back.
            span: Length of the span [s].
            turned: Rotation vector of the attitude over the span, body axes, (3,) [rad].
            back: Whether F is transposed: from the end of the span to its beginning.
        """
        main = self.order * len(self.columns)
        moved = np.array(errors)
        half = None
        if self.turn is not None:
            half = Rotation.from_rotvec((0.5 if back else -0.5) * turned).as_matrix()
            moved[self.turn] = half @ moved[self.turn]
        move, _ = self._blocks(span)
        levels = moved[:main].reshape(self.order, -1)
        moved[:main] = ((move.T if back else move) @ levels).reshape(moved[:main].shape)
        if half is not None:
            moved[self.turn] = half @ moved[self.turn]
        return moved

    def _predicted_root(self, root: Array, span: float, turned: Array) -> Array:
        """Wide root of the predicted covariance, [F S, root of the process noise]."""
        main = self.order * len(self.columns)
        added = np.zeros((self.size, self.size))
        added[:main, :main] = self._blocks(span)[1]
        rows = main + np.arange(len(self.walk))
        added[rows, rows] = np.sqrt(self.walk * span)
        return np.hstack([self.advanced(root, span, turned), added])

    def predicted_motion(self, motion: Motion, span: float) -> tuple[Motion, Array]:
        """Motion after a span, and the rotation vector of the attitude over it, body axes.

        Args:
            motion: Motion at the beginning.
            span: Length of the span, zero or more [s].
        """
        move, _ = self._blocks(span)
        levels = move @ motion.levels
        turned, attitude = np.zeros(3), motion.attitude
        if self.turn is not None:
            columns = self.columns[self.turn]
            turned = levels[0, columns].copy()
            if self.order > 2:  # body axes turn while they turn
                spin, spin_rate = motion.levels[1, columns], motion.levels[2, columns]
                (a, b, c), (d, e, f) = spin.tolist(), spin_rate.tolist()
                turned += span**3 / 12 * np.array([b * f - c * e, c * d - a * f, a * e - b * d])
            attitude = attitude @ Rotation.from_rotvec(turned).as_matrix()
            levels[0, columns] = 0.0
        return Motion(levels, attitude), turned

    def _in_error_state(self, slope: Array, name: str) -> Array:
        """Jacobian with respect to the error-state, (k, s), from that to all levels, (k, m', n)."""
        n = len(self.columns)
        whole = np.zeros((len(slope), self.size))
        for level in range(min(slope.shape[1], self.order)):
            whole[:, level * n : (level + 1) * n] = slope[:, level, self._own]
        if name in self._bias:
            whole[:, self.order * n :][:, self._bias[name]] = np.eye(6)
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


def _diverged(observations: Sequence[Observation]) -> FilterDiverged:
    return FilterDiverged(
        f"motion filter: measurements of {', '.join(one.name for one in observations)} "
        "cannot be weighed: the estimate is not finite; raise their std",
        Outcome.NOT_FINITE,
    )


def _lower_triangle(wide: Array) -> Array:
    """Lower triangular T, (k, k), with T T^T = A A^T for a wide A, (k, l >= k), overwritten."""
    size = len(wide)
    factored, *_ = dgeqrf(wide.T, overwrite_a=True)
    return np.asarray(factored[:size].T * _below(size))


@lru_cache(maxsize=64)
def _below(size: int) -> Array:
    """Ones on and below the diagonal, (size, size)."""
    return np.tri(size)


def _solved(lower: Array, right: Array) -> Array:
    """Solution X of L X = B for a lower triangular L.

    LAPACK's own (dtrtrs) starts threads for matrices of any size, which takes a thousand times as
    long where other programs use the cores.
    """
    return np.asarray(dtrsm(1.0, lower, right, lower=1))


class CompiledFilter:
    """Steps of a motion filter in C, over rows of numbers: see `MotionEstimate.row`."""

    def __init__(
        self, owner: MotionFilter, models: Mapping[str, MeasurementModel], kernel: ctypes.CDLL
    ) -> None:
        self._kernel, self._keep = kernel, [owner.density]
        self.numbers = {name: k for k, name in enumerate(models)}
        own, s, b = owner.columns.tolist(), owner.size, owner.biases
        self.sensors = (MOTION_SENSOR.type * len(models))()
        biased = 0
        for sensor, model in zip(self.sensors, models.values(), strict=True):
            sensor.variance = self._kept(model.variances)
            sensor.values, sensor.width = len(model.variances), model.width
            if isinstance(model, EncoderModel):
                places = [own.index(k) if k in own else -1 for k in model.columns]
                sensor.place = self._kept(places, np.int32)
                continue
            frame = model.frame
            inertial = isinstance(model, ImuModel)
            sensor.kind = 1 if inertial else 2
            sensor.frame = (frame.inertial_function if inertial else frame.pose_function).address
            sensor.offset, sensor.mount = self._kept(frame.offset), self._kept(frame.mount)
            sensor.parameters = self._kept(frame.parameters)
            if inertial:
                sensor.bias, biased = biased, biased + 6
        values = sum(sensor.values for sensor in self.sensors)
        most, n = max(values, 6), owner.robot.dof
        spare = (s + 4) * (2 * s + 16) + 5 * (most + 1) * (most + s + 16)
        scratch = np.zeros(spare + max(27 * n + 24, most * (s + 16)))
        self.row_size = owner.order * n + 9 + b + s * s
        turn, base = owner.turn, owner.base
        self.struct = MOTION_FILTER.type(
            order=owner.order,
            coordinates=n,
            own=len(own),
            states=s,
            biases=b,
            values=most,
            spare=spare,
            columns=self._kept(own, np.int32),
            turn=None if turn is None else self._kept(turn, np.int32),
            base=None if base is None else self._kept([*base.place, *base.turn], np.int32),
            density=owner.density.ctypes.data,
            walk=self._kept(owner.walk),
            noise=self._kept(np.linalg.cholesky(added_covariance(owner.order, 1.0))),
            sensors=ctypes.addressof(self.sensors),
            work=self._kept(scratch),
        )
        self.found: Array = np.zeros(most * (2 * s + 1))
        self._turned: Array = np.zeros(3)
        self._struct = ctypes.byref(self.struct)
        self._doubles = as_c(self._turned, self.found)

    def _kept(self, values: Any, kind: Any = float) -> int:
        """Address of an array that lives as long as this."""
        array = np.ascontiguousarray(values, kind)
        self._keep.append(array)
        return int(array.ctypes.data)

    def predict(self, row: Array, span: float) -> tuple[Array, Array]:
        """Estimate after a span, and the rotation vector of the attitude over it, (3,) [rad]."""
        to = np.empty(self.row_size)
        (begin, end), length = as_c(row, to), ctypes.c_double(span)
        self._kernel.motion_predict(self._struct, begin, length, end, self._doubles[0])
        return to, self._turned.copy()

    def update(
        self, row: Array, observations: Sequence[Observation]
    ) -> tuple[Array, Array, Array, Array] | None:
        """Estimate, innovation, slope and gain as of `Corrected`; None if they are not finite."""
        numbers = np.array([self.numbers[one.name] for one in observations], np.int32)
        values = np.concatenate([one.values for one in observations])
        to, s = np.empty(self.row_size), self.struct.states
        places = as_c(numbers, values, row, to)
        m = self._kernel.motion_update(self._struct, len(numbers), *places, self._doubles[1])
        if m < 0:
            return None
        found, end = self.found[: m * (2 * s + 1)].copy(), m + m * s
        return to, found[:m], found[m:end].reshape(m, s), found[end:].reshape(s, m)
