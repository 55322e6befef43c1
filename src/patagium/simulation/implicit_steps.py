"""Implicit steps of flights with springs that answer faster than a step.

Lobatto IIIC with three stages, at the beginning, middle and end of a step: of fourth order and
L-stable. Modes that are too fast for the step follow what drives them, and what they swung by
themselves fades. The stages are found by Newton's method, whose derivative is kept as long as it
serves. Neglected: step-size control.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from patagium.arrays import Array

Rate: TypeAlias = Callable[[Array, int], Array]

_STAGES = np.array([[2, -4, 2], [2, 5, -1], [2, 8, 2]]) / 12
_CLOSE, _FAIR = 1e-11, 1e-8
"""Newton correction over a state's size that ends the search; that where rounding stops it."""
_TRIALS = 10


def rate_jacobian(rate: Callable[[Array], Any], state: Array) -> Array:
    """Derivative of the rate by the state, (size, size) [1/s], by central differences.

    Args:
        rate: Rate of a state, (size,) to (size,) [1/s].
        state: Where, (size,) [SI].
    """
    sizes = 1e-6 * np.maximum(1.0, np.abs(state))
    with np.errstate(all="ignore"):
        ends = [[np.asarray(rate(state + s * step)) for s in (1, -1)] for step in np.diag(sizes)]
        return np.stack([(ahead - behind) for ahead, behind in ends], axis=1) / (2 * sizes)


class LobattoStep:
    """One step of Lobatto IIIC after the other, with the factors of the last one."""

    def __init__(self) -> None:
        self._factors: Any = None

    def __call__(self, rate: Rate, state: Array, place: int, time_step: float) -> Array:
        """State a step later, (size,) [SI]; not finite where Newton's method does not converge.

        Args:
            rate: Rate of a state at a place of the table, which has two places a step.
            state: At the beginning, (size,) [SI].
            place: Where the step begins in the table.
            time_step: Step [s].
        """
        for fresh in (self._factors is None, True):
            if fresh:
                slope = rate_jacobian(lambda x: rate(x, place), state)
                if not np.isfinite(slope).all():
                    break
                matrix = np.eye(3 * state.size) - time_step * np.kron(_STAGES, slope)
                self._factors = lu_factor(matrix)
            found = self._search(rate, state, place, time_step)
            if found is not None:
                return found
        return np.full_like(state, np.nan)

    def _search(self, rate: Rate, state: Array, place: int, time_step: float) -> Array | None:
        """State a step later, or None where Newton's method does not converge."""
        changes, last = np.zeros((3, state.size)), np.inf
        for _ in range(_TRIALS):
            rates = np.array([rate(state + one, place + k) for k, one in enumerate(changes)])
            missing = time_step * _STAGES @ rates - changes
            if not np.isfinite(missing).all():
                return None
            correction = lu_solve(self._factors, missing.ravel()).reshape(changes.shape)
            changes = changes + correction
            size = float((np.abs(correction) / (1.0 + np.abs(state))).max())
            if size < _CLOSE or (size < _FAIR and size > last / 2):
                return np.asarray(state + changes[2])
            last = size
        return None
