"""Implicit steps of flights with springs that answer faster than a step.

Lobatto IIIC with three stages, at the beginning, middle and end of a step: of fourth order and
L-stable. Modes that are too fast for the step follow what drives them, and what they swung by
themselves fades. The stages are found by Newton's method, whose derivative is kept as long as it
serves, and damped where it does not converge otherwise. Neglected: step-size control.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from patagium.arrays import Array

Rate: TypeAlias = Callable[[Array, int], Array]

_STAGES = np.array([[2, -4, 2], [2, 5, -1], [2, 8, 2]]) / 12
_CLOSE, _FAIR = 1e-11, 1e-8
"""Newton correction over a state's size that ends the search; that where rounding stops it."""
_TRIALS, _DAMPED_TRIALS = 10, 100
_HALVED = 10
"""Times that a correction is halved, at most."""


def rate_jacobian(rate: Callable[..., Any], state: Array, *more: Any) -> Array:
    """Derivative of the rate by the state, (size, size) [1/s], by central differences.

    Args:
        rate: Rate of a state, (size,) to (size,) [1/s].
        state: State at which it is taken, (size,) [SI].
        more: Further arguments of the rate.
    """
    sizes = 1e-6 * np.maximum(1.0, np.abs(state))
    with np.errstate(all="ignore"):
        steps = np.diag(sizes)
        ends = [[np.asarray(rate(state + s * k, *more)) for s in (1, -1)] for k in steps]
        return np.stack([(ahead - behind) for ahead, behind in ends], axis=1) / (2 * sizes)


class LobattoStep:
    """One step of Lobatto IIIC after the other, with the factors of the last one."""

    def __init__(self) -> None:
        self._solved: Any = None

    def __call__(self, rate: Rate, state: Array, place: int, time_step: float) -> Array:
        """State a step later, (size,) [SI]; not finite where Newton's method does not converge.

        Args:
            rate: Rate of a state at a place of the table, which has two places a step.
            state: At the beginning, (size,) [SI].
            place: Row of the table at the beginning of the step.
            time_step: Step [s].
        """

        def missing(changes: Array) -> Array:
            rates = np.array([rate(state + one, place + k) for k, one in enumerate(changes)])
            return np.asarray(time_step * _STAGES @ rates - changes)

        def renew(changes: Array) -> bool:
            from scipy.linalg import lu_factor, lu_solve  # slow to import, rarely needed

            reached = enumerate(state + changes, place)
            slopes = [rate_jacobian(rate, one, k) for k, one in reached]
            if not np.isfinite(slopes).all():
                return False
            size = 3 * state.size
            each = np.broadcast_to(slopes, (3, state.size, state.size))
            parts = np.einsum("ij,jab->iajb", time_step * _STAGES, each)
            self._solved = partial(lu_solve, lu_factor(np.eye(size) - parts.reshape(size, size)))
            return True

        for fresh, damped in ((self._solved is None, None), (True, None), (True, renew)):
            if fresh and not renew(np.zeros((1, state.size))):
                break
            found = self._search(missing, state, damped)
            if found is not None:
                return found
        return np.full_like(state, np.nan)

    def _search(
        self, missing: Callable[[Array], Array], state: Array, renew: Callable[[Array], bool] | None
    ) -> Array | None:
        """State a step later, or None where Newton's method does not converge.

        Args:
            missing: Residual of the equations by changes of the stages, (3, size) each [SI].
            state: At the beginning, (size,) [SI].
            renew: Function that renews the factors. With it each correction is damped until the
            residual falls, and the factors are renewed after it.
        """
        changes, last = np.zeros((3, state.size)), np.inf
        left, scale = missing(changes), 1.0 + np.abs(state)
        for _ in range(_TRIALS if renew is None else _DAMPED_TRIALS):
            if not np.isfinite(left).all():
                return None
            correction = self._solved(left.ravel()).reshape(changes.shape)
            size = float((np.abs(correction) / scale).max())
            if size < _CLOSE or (size < _FAIR and size > last / 2):
                return np.asarray(state + changes[2] + correction[2])
            further, most = missing(changes + correction), np.abs(left / scale).max()
            for _ in range(_HALVED if renew is not None else 0):
                if np.abs(further / scale).max() < most:
                    break
                correction, size = correction / 2, np.inf
                further = missing(changes + correction)
            changes, left, last = changes + correction, further, size
            if renew is not None and not renew(changes):
                return None
        return None
