"""Linear-quadratic regulators of a periodic orbit: gains over the phase, or of the averaged beat.

The design model is that of `predictive.OrbitModel`: exact derivatives of every interval of the
beat, and the lags by which the steered gait answers as states. u = -K(phase) x, where K follows
from the periodic Riccati equation; of the averaged regulator one K from the mean of the intervals.
Neglected: limits of commands, which the steered gait keeps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from patagium.arguments import checked
from patagium.control.predictive import OrbitController, Reference, closed_beat

Array = NDArray[np.float64]


class LinearRegulator(OrbitController):
    """Linear-quadratic regulator (LQR) about a periodic orbit.

    Args:
        orbit: The orbit, and the model of robot and air that it was found with.
        commands: Names of the commands, with a range each in the robot's `actuators`.
        parts: Intervals of a beat; one command each.
        tolerable: Departures by name of a state, such as `z` or `velocity of x`, that cost as much
            as a command over half its range [SI].
        averaged: Whether one gain from the mean of the intervals serves the whole beat.

    Raises:
        ParameterError: If a name is none, a command has no range, or the commands cannot hold
            the orbit.
    """

    @checked
    def __init__(
        self,
        orbit: Reference,
        commands: Sequence[str],
        *,
        parts: int = 10,
        tolerable: Mapping[str, float] | None = None,
        averaged: bool = False,
    ) -> None:
        super().__init__(orbit, commands, parts, tolerable, averaged)

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Multipliers of the beat under feedback, lags of the commands included, (n_x,) [1]."""
        beat = closed_beat(self.model.by_state, self.model.by_input, self.gains)
        return np.asarray(np.linalg.eigvals(beat), complex)

    def answer(self, first: int, start: Array) -> Array | None:
        """Departures of the commands, u = -K x, within their ranges; see `OrbitController`."""
        neutral = self.model.neutral
        low, high, _ = np.array(self.ends).T
        wanted = -self.gains[first % self.model.parts] @ start
        return np.asarray(np.clip(wanted, low - neutral, high - neutral))
