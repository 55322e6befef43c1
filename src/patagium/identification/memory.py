"""What strips remember of their flow: a bank of lags that is stable whatever is asked of it.

The lags depend on the motion alone, not on weights: they are found for a whole log, or
sample by sample in flight, before anything is learned. Neglected: what neighbors' wakes do
to the lags themselves (their induced velocity enters where lags are read), gusts.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.local_flow import strip_motions
from patagium.aerodynamics.wash import airspeed, normalwash
from patagium.errors import ParameterError, ShapeError
from patagium.native import load_functions
from patagium.robot.model import Robot

Array = NDArray[np.float64]


class StripMemory:
    """Lagged normalwashes of strips, d xi_k/dt = (2 U / c) b_k (w - xi_k).

    w is the normalwash at three quarters of the chord c, U the airspeed there, b_k > 0 the
    rates; a step of h with mean w and U of its ends,

        xi_k <- e xi_k + (1 - e) w,    e = exp(-2 U b_k h / c),

    is a weighted mean for any step: 0 < e < 1, and no lag ever leaves the range of the
    normalwashes it has met. At the start and after a gap the flow is taken as steady.

    Args:
        robot: The machine.
        air: Its steady wind.
        rates: b, how fast each lag fades, (n_lags,) [1/semichord].

    Raises:
        ParameterError: If a rate is not positive and finite.
    """

    def __init__(self, robot: Robot, air: Air, rates: Sequence[float]) -> None:
        self.rates = tuple(float(rate) for rate in rates)
        if not all(np.isfinite(rate) and rate > 0 for rate in self.rates):
            raise ParameterError("rates", "positive rates [1/semichord]", rates)
        self._robot, self._parameters = robot, np.array([*air.wind, *robot.parameters])
        self._semichord = np.array([float(strip.chord) / 2 for strip in robot.strips])
        key = f"memory of strips {robot.structure}"
        functions = load_functions(key, self._build, label=f"memory of {robot.name}")
        self._washes = functions["washes"]

    @property
    def size(self) -> int:
        """Number of lags of all strips: strip by strip, the lags of each together."""
        return len(self._robot.strips) * len(self.rates)

    def start(self, state: ArrayLike) -> Array:
        """Lags of a flow that was always as it is now, (n_xi,) [m/s].

        Args:
            state: [q, v], (2n,).

        Raises:
            ShapeError: If it has another shape.
        """
        wash, _ = self._flow(self._shaped(state))
        return np.repeat(wash[0], len(self.rates))

    def advance(self, lags: ArrayLike, before: ArrayLike, after: ArrayLike, step: float) -> Array:
        """Lags one step later, (n_xi,) [m/s].

        Args:
            lags: At the beginning of the step, (n_xi,) [m/s].
            before: [q, v] at its beginning, (2n,).
            after: [q, v] at its end, (2n,).
            step: Its length [s].

        Raises:
            ShapeError: If an argument has another shape.
            ParameterError: If the step is not positive.
        """
        if not (np.isfinite(step) and step > 0):
            raise ParameterError("step", "a positive time [s]", step)
        held = np.asarray(lags, float)
        if held.shape != (self.size,):
            raise ShapeError("lags", (self.size,), held.shape)
        states = np.vstack([self._shaped(before), self._shaped(after)])
        keep, wash = self._steps(np.array([step]), states)
        return np.asarray(held * keep[0] + (1.0 - keep[0]) * wash[0])

    def states(
        self,
        time: ArrayLike,
        state: ArrayLike,
        gaps: ArrayLike = (),
        first: ArrayLike | None = None,
    ) -> Array:
        """Lags at every sample of a log, each from samples up to it alone, (N, n_xi) [m/s].

        Args:
            time: Increasing, (N,) [s].
            state: [q, v], (N, 2n).
            gaps: First sample after each gap, where memory begins anew.
            first: Lags at the first sample, (n_xi,) [m/s]; None: its flow was always there.
        """
        stamps, states = np.asarray(time, float), np.ascontiguousarray(state, float)
        anew = {0, *np.asarray(gaps, int).tolist()}
        keep, wash = self._steps(np.diff(stamps), states)
        taken = (1.0 - keep) * wash
        steady, _ = self._flow(states)
        lags = np.repeat(steady, len(self.rates), axis=1)
        if first is not None:
            lags[0] = first
        for k in range(1, len(stamps)):
            if k not in anew:
                lags[k] = keep[k - 1] * lags[k - 1] + taken[k - 1]
        return lags

    def _steps(self, steps: Array, states: Array) -> tuple[Array, Array]:
        """Share of each lag that a step keeps, and its mean normalwash, (N - 1, n_xi) each."""
        wash, speed = self._flow(states)
        semichords = steps[:, None] * (speed[1:] + speed[:-1]) / (2 * self._semichord)
        keep = np.exp(-semichords[:, :, None] * np.array(self.rates))
        mean = np.repeat((wash[1:] + wash[:-1]) / 2, len(self.rates), axis=1)
        return keep.reshape(len(steps), self.size), mean

    def _flow(self, states: Array) -> tuple[Array, Array]:
        """Normalwash and airspeed of every strip, (N, n_strips) each [m/s]."""
        wash, speed = self._washes.batch(np.atleast_2d(states), self._parameters)
        shape = (-1, len(self._robot.strips))
        return np.asarray(wash).reshape(shape), np.asarray(speed).reshape(shape)

    def _shaped(self, state: ArrayLike) -> Array:
        values = np.asarray(state, float)
        if values.shape != (self._robot.state_size,):
            raise ShapeError("state", (self._robot.state_size,), values.shape)
        return values

    def _build(self) -> list[ca.Function]:
        robot, parameters = self._robot.symbolic()
        x, wind = ca.SX.sym("x", robot.state_size), ca.SX.sym("wind", 3)
        n_q = robot.coordinate_count
        motions = strip_motions(robot, x[:n_q], x[n_q:], wind)
        wash = ca.vertcat(*[normalwash(motion) for motion in motions])
        speed = ca.vertcat(*[airspeed(motion) for motion in motions])
        inputs = [x, ca.vertcat(wind, parameters)]
        names_in, names_out = ["x", "memory_parameters"], ["wash", "speed"]
        return [ca.Function("washes", inputs, [wash, speed], names_in, names_out)]
