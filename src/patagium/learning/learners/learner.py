"""Interface of all learners: prediction, update, description.

A learner holds a network and an estimate of its weights, and takes one sample at a
time. Neglected: threads.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter_ns
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from patagium.arguments import checked
from patagium.arrays import Array, Bools, real_array
from patagium.errors import FilterDiverged, Outcome
from patagium.learning.filters.screening import NEWER, Screen
from patagium.learning.filters.state import arrays_like, part
from patagium.learning.learners.state_file import write_state
from patagium.learning.models.memory import memory_of
from patagium.learning.models.network import Network

_KEPT = 2**16


@runtime_checkable
class Updated(Protocol):
    """Predictor of a measurement that follows samples one by one."""

    def predict(self, x: ArrayLike) -> tuple[Array, Array]:
        """Mean, (n_y,), and covariance, (n_y, n_y), of a measurement at x, noise included."""
        ...

    def update(self, x: ArrayLike, y: ArrayLike, time: float | None = None) -> Array:
        """Learn one sample made at a time [s]; gives the innovation y - mean, (n_y,)."""
        ...


class Learner(Updated, Protocol):
    """An estimate of a network's weights that follows samples one by one."""

    @property
    def network(self) -> Network:
        """The network whose weights are learned."""
        ...

    @property
    def weights(self) -> Array:
        """The estimate, (n,)."""
        ...

    @property
    def covariance(self) -> Array | None:
        """Covariance of the weights, (n, n); None where the learner has none."""
        ...

    @property
    def variances(self) -> Array | None:
        """Diagonal of that covariance, (n,); None where the learner has none."""
        ...

    @property
    def count(self) -> int:
        """Samples learned."""
        ...

    @property
    def events(self) -> dict[str, int]:
        """Number of samples of each event; see `screening.EVENTS`."""
        ...

    @property
    def time_per_update(self) -> float:
        """Median wall-clock time of an update, all in [s]; NaN before the first."""
        ...

    def describe(self) -> dict[str, Any]:
        """Kind, network and settings of the learner as JSON values, without the weights.

        Settings that nobody gave are None, and "found" holds what was found for them.
        """
        ...


class Stopwatch:
    """Durations of updates, in nanoseconds; the last 2^16 are kept.

    Args:
        earlier: Updates before, of which no duration is known.
    """

    def __init__(self, earlier: int = 0) -> None:
        self._durations, self._count = array("q"), earlier

    @property
    def count(self) -> int:
        """Number of samples."""
        return self._count

    @property
    def median(self) -> float:
        """Median duration [s]; NaN when there is none."""
        return float(np.median(self._durations)) * 1e-9 if self._durations else float("nan")

    def add(self, nanoseconds: int) -> None:
        """One more duration [ns]."""
        if len(self._durations) < _KEPT:
            self._durations.append(nanoseconds)
        else:
            self._durations[self._count % _KEPT] = nanoseconds
        self._count += 1


class OnlineLearner(Learner):
    """Base of the learners: network, counts, events, update, state and file.

    A subclass has a `Screen` in `_screen`, gives the rest of `Learner`, and what its estimate is
    kept as by `_estimate` and `_place`. A subclass that is no filter gives `_learn`.

    Args:
        network: Network whose weights are learned.

    Attributes:
        memory: Memory of the network between samples that come one by one; None without.
    """

    _screen: Screen

    def __init__(self, network: Network) -> None:
        self._network, self._stopwatch = network, Stopwatch()
        self.memory = memory_of(network)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.count} samples learned by {self._network!r}>"

    def _repr_html_(self) -> str:
        from patagium.report.page import snippet

        facts = {"samples learned": self.count, "time of an update [s]": self.time_per_update}
        facts |= {name: count for name, count in self.events.items() if count}
        return snippet(type(self).__name__, facts) + self._network._repr_html_()

    @property
    def network(self) -> Network:
        """Network whose weights are learned."""
        return self._network

    @property
    def events(self) -> dict[str, int]:
        """Events of the samples so far, and their number.

        Channels of samples: missing (no number), outliers (down-weighted, or too far off to be
        used), stuck (inputs, while others move). Samples: bad_inputs (no numbers), late,
        duplicates, clock_resets (a clock that went back was believed), blind (no channel left),
        refused (the filter could not be moved by it), changes (the covariance was opened anew),
        covariance_resets (ten samples in a row were refused, and it begins anew). Values of
        sensors: out_of_range (no sensor says that), jumps (an input moved too far in one step),
        reopened (a range was widened to what a sensor kept saying).
        """
        return self._screen.events

    @property
    def count(self) -> int:
        """Number of samples learned."""
        return self._stopwatch.count

    @property
    def time_per_update(self) -> float:
        """Median wall-clock time of an update [s]; NaN before the first."""
        return self._stopwatch.median

    @property
    def found(self) -> dict[str, Any]:
        """Settings that nobody gave, by name: what the rules or the samples so far say."""
        return {}

    def restart_clock(self) -> None:
        """Take the next sample whatever its time stamp: another log begins."""
        self._screen.restart_clock()

    def update(self, x: ArrayLike, y: ArrayLike, time: float | None = None) -> Array:
        """Learn one sample.

        Args:
            x: Input, (n_x,) [units of x].
            y: Measurement, (n_y,) [unit of y]; channels that are no numbers are left out.
            time: Of the sample [s]; None: not known, and it comes after the one before.

        Returns:
            Innovation y - mean, (n_y,); NaN where nothing was learned, as of samples that are
            late, have been there before, or whose input is no number; see `events`.

        Raises:
            ShapeError: If an argument has another shape.
            FilterDiverged: If the new weights are not finite or the covariance is lost; the
                learner is then as it was before.
        """
        started = perf_counter_ns()
        sample, measured = shaped_sample(self._network, x, y)
        kept = self._screen.usable_channels(sample, measured, time)
        if kept is None:
            return np.full(len(measured), np.nan)
        innovation = self._learn(sample, measured, kept)
        self._stopwatch.add(perf_counter_ns() - started)
        return np.where(kept, innovation, np.nan)

    def state(self) -> dict[str, Any]:
        """All that the next samples depend on: arrays and JSON-able values by name."""
        return {
            "count": self.count,
            **self._estimate(),
            **({} if self.memory is None else self.memory.state()),
            **{f"screen_{name}": array.copy() for name, array in self._screen.arrays.items()},
        }

    @checked
    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from a state; wall-clock times of updates begin anew.

        Args:
            state: Of a learner with the same description.

        Raises:
            ParameterError: If something is missing.
            ShapeError: If an array has another shape.
        """
        screen = self._screen.arrays
        newer = {name: screen[name] for name in NEWER} | part(state, "screen_")
        counts = newer.get("counts", screen["counts"])  # events of later releases come last
        newer["counts"] = np.pad(counts, (0, max(len(screen["counts"]) - len(counts), 0)))
        seen = arrays_like(screen, newer)
        stopwatch = Stopwatch(int(state["count"]))
        self._place(state)
        if self.memory is not None:
            self.memory.resume(state)
        self._screen.restore(seen)
        self._stopwatch = stopwatch

    @checked
    def save(self, path: str | Path) -> Path:
        """Keep the learner in a file, from which `load_learner` makes one that goes on alike.

        Args:
            path: File, replaced whole or not at all, in a folder that is there.

        Returns:
            The path.

        Raises:
            OutputError: If it cannot be written; the file is then as it was.
        """
        return write_state(path, self.describe(), self.state())

    def _learn(self, x: Array, y: Array, kept: Bools) -> Array:
        """Innovation of a sample, (n_y,), once its channels kept, (n_y,), are learned."""
        raise NotImplementedError

    def _estimate(self) -> dict[str, Any]:
        """State of the estimate, without counts, memory and screening."""
        raise NotImplementedError

    def _place(self, state: Mapping[str, Any]) -> None:
        """Go on from a state of the estimate; nothing changes where it does not fit."""
        raise NotImplementedError


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
    return real_array("x", x, (network.inputs,))


def shaped_sample(network: Network, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """x, (n_x,), and y, (n_y,), as arrays.

    Raises:
        ShapeError: If one of them has another shape.
    """
    return as_input(network, x), real_array("y", y, (network.outputs,))


def diverged(outcome: Outcome, count: int, x: Array, y: Array) -> FilterDiverged:
    """The exception for an update that failed, naming what was wrong with the sample."""
    for name, values in (("x", x), ("y", y)):
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            return FilterDiverged(
                f"update {count + 1}: {name}[{bad[0]}] is {values[bad[0]]}, expected a finite "
                "number; the learner is as it was before",
                Outcome.NOT_FINITE,
            )
    reason = {
        Outcome.NOT_FINITE: "the network's output or the new weights are not finite",
        Outcome.COVARIANCE_LOST: "the covariance is no longer positive definite",
    }[outcome]
    remedy = {
        Outcome.NOT_FINITE: "lower prior_std or the spread, or scale inputs and outputs",
        Outcome.COVARIANCE_LOST: outcome.remedy,
    }[outcome]
    return FilterDiverged(
        f"update {count + 1}: {reason}; the learner is as it was before; {remedy}", outcome
    )
