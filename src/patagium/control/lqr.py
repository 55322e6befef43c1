"""Linear-quadratic regulators of a periodic orbit: gains over the phase, or of the averaged beat.

The design model is that of `predictive.OrbitModel`: exact derivatives of every interval of the
beat, the lags by which the steered gait answers as states, and the commands in force, u. They
change by -K(phase) [x, u], where K follows from the periodic Riccati equation; of the averaged
regulator one K from the mean of the intervals. Changes cost: gains for which they are free ask for
more within a beat than actuators follow. Neglected in the design: limits, which the answers keep.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import block_diag

from patagium.arguments import checked
from patagium.arrays import Array
from patagium.control.predictive import OrbitController, OrbitModel, Reference, periodic_riccati
from patagium.errors import ParameterError


class LinearRegulator(OrbitController):
    """Linear-quadratic regulator (LQR) about a periodic orbit.

    Args:
        orbit: The orbit, and the model of robot and air that it was found with.
        commands: Names of the commands, with a range each in the robot's `actuators`.
        parts: Intervals of a beat; one command each.
        tolerable: Departures by name of a state that cost as much as a command over half its range
            [SI], as of `PredictiveController`.
        averaged: Whether one gain from the mean of the intervals serves the whole beat.
        change_cost: Cost of a change as fast as an actuator allows, over that of a command over
            half its range; 0 where changes are free, which damps small departures most [1].

    Raises:
        ParameterError: If a name is none, a command has no range, a cost is below zero, or the
            commands cannot hold the orbit.
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
        change_cost: float = 1.0,
    ) -> None:
        if not 0 <= change_cost < np.inf:
            raise ParameterError("change_cost", "zero or more", change_cost)
        self._averaged, self._change_cost = averaged, change_cost
        super().__init__(orbit, commands, parts, tolerable)

    def _law(self, model: OrbitModel) -> tuple[Array, Array]:
        """Cost-to-go matrices and feedback gains of a model whose states are all known."""
        a, b = self._loop(model)
        if self._averaged:
            a, b = (np.broadcast_to(part.mean(axis=0), part.shape) for part in (a, b))
        share = self._change_cost * (self.half / (self.rates * model.period)) ** 2
        costs = block_diag(self.state_cost, self.input_cost)
        return periodic_riccati(a, b, costs, share * self.input_cost)

    def _loop(self, model: OrbitModel) -> tuple[Array, Array]:
        """Derivatives of [x, u] after each interval, by [x, u] before it and by the change of u."""
        a, b = model.by_state, model.by_input
        own = np.tile(np.eye(b.shape[2]), (len(b), 1, 1))
        return np.block([[a, b], [0 * b.transpose(0, 2, 1), own]]), np.concatenate([b, own], 1)

    def answer(self, first: int, start: Array, before: Array) -> Array | None:
        """Departures of the commands, limited in range and rate, for one flight or several."""
        neutral, gain = self.model.neutral, self.gains[first % self.model.parts]
        change = -np.concatenate([start, before], axis=-1) @ gain.T
        change = np.clip(change, -self.fastest, self.fastest)
        values = np.clip(neutral + before + change, self.low, self.high)
        return np.asarray(values - neutral)
