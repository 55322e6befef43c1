"""Memory of the air in a grey box: lags of the model, and how they depend on its numbers.

Lags follow the flow by the exponential trapezoid of `wash.lag_step`, their slopes S = dz/dW
by its derivative. Neglected: flow between samples other than straight.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.learning.models.network import Memory
from patagium.native import NativeFunction

Array = NDArray[np.float64]
_MOST_ROUNDS, _CLOSE = 20, 1e-11


class GreyMemory:
    """What is recalled behind x: [z, vec S, W], nothing for a model without memory.

    Args:
        functions: Of `GreyEquations`.
        numbers: All numbers, then the scales of the weights.
        sizes: Of x, of z and of W.
        steady: Whether memory begins with a flow that was always there; else at zero.
    """

    def __init__(
        self,
        functions: Mapping[str, NativeFunction],
        numbers: Array,
        sizes: tuple[int, int, int],
        steady: bool,
    ) -> None:
        self._functions, self._numbers, self._steady = functions, numbers, steady
        self._inputs, self._states, self._count = sizes

    @property
    def size(self) -> int:
        """Length of [z, vec S, W]."""
        return self._states * (1 + self._count) + (self._count if self._states else 0)

    def read(self, x: Array, weights: Array) -> tuple[Array, Array]:
        """Lags at weights, z + S (W - W_m), (N, n_z), and S, (N, n_z, n_w).

        Args:
            x: With what was recalled, (N, n_x).
            weights: (N, n_w).
        """
        rest = x[:, self._inputs : self._inputs + self.size]
        state = rest[:, : self._states]
        slopes = rest[:, self._states : self._states * (1 + self._count)]
        slopes = slopes.reshape(len(x), self._states, self._count)
        if not self._states:
            return state, slopes
        change = weights - rest[:, -self._count :]
        return state + np.einsum("kij,kj->ki", slopes, change), slopes

    def recall(
        self, weights: Array, time: Array, x: Array, memory: Memory | None, gaps: ArrayLike
    ) -> tuple[Array, Memory | None]:
        """[z, vec S, W] at each sample of a block, (N, size), and what the next goes on from.

        Args:
            weights: (n_w,).
            time: Increasing, (N,) [s].
            x: What is measured, (N, n_measured).
            memory: At the sample before.
            gaps: First sample after each gap.
        """
        rows = np.empty((len(x), self.size))
        if not self._states:
            return rows, None
        anew = set(np.asarray(gaps, int).tolist())
        for k, (stamp, sample) in enumerate(zip(time.tolist(), x, strict=True)):
            if memory is None or k in anew:
                state, slopes = self._begun(sample, weights)
            else:
                state, slopes = self._advanced(memory, stamp, sample, weights)
            memory = Memory(stamp, sample, state, slopes, weights)
            rows[k] = np.concatenate([state, slopes.ravel(), weights])
        return rows, memory

    def _advanced(
        self, memory: Memory, stamp: float, sample: Array, weights: Array
    ) -> tuple[Array, Array]:
        function, step = self._functions["step_forward"], stamp - memory.time
        known, state = (memory.x, sample, memory.state, weights), memory.state
        slopes = np.empty((self._states, self._count))
        for k, along in enumerate(np.eye(self._count)):
            moved = memory.slopes[:, k], along, step, self._numbers
            state, slopes[:, k] = function(*known, *moved)
        return np.atleast_1d(state), slopes

    def _begun(self, sample: Array, weights: Array) -> tuple[Array, Array]:
        """Lags and slopes where a memory begins."""
        state = np.zeros(self._states)
        if not self._steady:
            return state, np.zeros((self._states, self._count))
        eye = np.eye(self._states)
        for _ in range(_MOST_ROUNDS):  # Newton's method; of attached flow one round is enough
            target, by_state = self._followed(sample, state, weights, of_state=True)
            apart = target - state
            if np.abs(apart).max() <= _CLOSE * (1.0 + np.abs(state).max()):
                break
            state = state + np.linalg.solve(eye - by_state, apart)
        _, by_weights = self._followed(sample, state, weights, of_state=False)
        return state, np.asarray(np.linalg.solve(eye - by_state, by_weights))

    def _followed(
        self, sample: Array, state: Array, weights: Array, of_state: bool
    ) -> tuple[Array, Array]:
        """What lags follow, and its slopes for the lags, or for the weights."""
        function, columns, target = self._functions["follow_forward"], [], state
        size = self._states + self._count
        chosen = slice(0, self._states) if of_state else slice(self._states, size)
        for along in np.eye(size)[chosen]:
            moved = along[: self._states], along[self._states :]
            target, column = function(sample, state, weights, *moved, self._numbers)
            columns.append(np.atleast_1d(column))
        return np.atleast_1d(target), np.column_stack(columns)
