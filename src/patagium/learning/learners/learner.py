"""Interface of all learners: prediction, update, description.

A learner holds a network and an estimate of its weights, and takes one sample at a
time. Neglected: threads.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, real_array
from patagium.errors import FilterDiverged, Outcome, ShapeError
from patagium.learning.models.network import Network

_KEPT = 2**16


@runtime_checkable
class Updated(Protocol):
    """Predictor of a measurement that follows samples one by one."""

    def predict(self, x: ArrayLike) -> tuple[Array, Array]:
        """Mean, (n_y,), and covariance, (n_y, n_y), of a measurement at x, noise included."""

    def update(self, x: ArrayLike, y: ArrayLike, time: float | None = None) -> Array:
        """Learn one sample made at a time [s]; gives the innovation y - mean, (n_y,)."""


class Learner(Updated, Protocol):
    """An estimate of a network's weights that follows samples one by one."""

    @property
    def network(self) -> Network:
        """The network whose weights are learned."""

    @property
    def weights(self) -> Array:
        """The estimate, (n,)."""

    @property
    def covariance(self) -> Array | None:
        """Covariance of the weights, (n, n); None where the learner has none."""

    @property
    def variances(self) -> Array | None:
        """Diagonal of that covariance, (n,); None where the learner has none."""

    @property
    def count(self) -> int:
        """Samples learned."""

    @property
    def events(self) -> dict[str, int]:
        """Number of samples of each event; see `screening.EVENTS`."""

    @property
    def time_per_update(self) -> float:
        """Median wall-clock time of an update, without prediction and scores [s]; NaN before."""

    def describe(self) -> dict[str, Any]:
        """Kind, network and settings of the learner as JSON values, without the weights.

        Settings that nobody gave are None, and "found" holds what was found for them.
        """


class Stopwatch:
    """Durations of updates, in nanoseconds; the last 2^16 are kept.

    Args:
        earlier: Updates before, of which no duration is known.

    Attributes:
        count: Number of updates.
    """

    def __init__(self, earlier: int = 0) -> None:
        self._durations, self.count = deque[int](maxlen=_KEPT), earlier

    @property
    def median(self) -> float:
        """Median duration [s]; NaN when there is none."""
        return float(np.median(self._durations)) * 1e-9 if self._durations else float("nan")

    def add(self, nanoseconds: int) -> None:
        """One more duration [ns]."""
        self._durations.append(nanoseconds)
        self.count += 1


def found_part(found: Mapping[str, Any]) -> dict[str, Any]:
    """Part of a learner's description that holds what was found; empty where all was given.

    Args:
        found: Settings that nobody gave, by name.
    """
    return {"found": dict(found)} if found else {}


def as_input(network: Network, x: ArrayLike) -> Array:
    """x as an array, (n_x,).

    Raises:
        ShapeError: If it has another shape.
    """
    try:
        return real_array("x", x, (network.inputs,))
    except ShapeError as problem:
        robot, told = getattr(network, "robot", None), ""
        if robot is not None and network.inputs == robot.state_size + robot.dof:
            told = " of np.concatenate([q, v, a])"
        raise ShapeError("x", f"{problem.expected}{told}", problem.found) from None


def row_by_row(
    predict: Callable[[Array], tuple[Array, Array]], rows: Array, outputs: int
) -> tuple[Array, Array]:
    """Means, (N, n_y), and covariances, (N, n_y, n_y), at inputs, (N, n_x) [units of x]."""
    found = [predict(row) for row in rows]
    means, covariances = ([one[k] for one in found] for k in (0, 1))
    return np.reshape(means, (-1, outputs)), np.reshape(covariances, (-1, outputs, outputs))


def shaped_sample(network: Network, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """x, (n_x,), and y, (n_y,), as arrays.

    Raises:
        ShapeError: If one of them has another shape.
    """
    return as_input(network, x), real_array("y", y, (network.outputs,))


def diverged(outcome: Outcome, count: int, x: ArrayLike = (), y: ArrayLike = ()) -> FilterDiverged:
    """The exception for an update that failed, naming what was wrong with the sample."""
    for name, values in (("x", np.asarray(x)), ("y", np.asarray(y))):
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            return FilterDiverged(
                f"update {count + 1}: {name}[{bad[0]}] is {values[bad[0]]}, expected a finite "
                "number; the learner is as it was before",
                Outcome.NOT_FINITE,
            )
    reason, remedy = "the covariance is no longer positive definite", outcome.remedy
    if outcome is Outcome.NOT_FINITE:
        reason = "the network's output or the new weights are not finite"
        remedy = "lower prior_std or the spread, or scale inputs and outputs"
    remedy += "; where forgetting_factor is below 1, let prior_share take its place"
    return FilterDiverged(
        f"update {count + 1}: {reason}; the learner is as it was before; {remedy}", outcome
    )
