"""Scorer of a learner over any number of blocks of samples, from sums that can be saved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.learning.scores import (
    NOMINAL,
    ErrorSums,
    InnovationSums,
    IntervalSums,
    mean_heard,
    span_scores,
)

Array = NDArray[np.float64]
Chosen = NDArray[np.bool_]


class Scorer:
    """Scorer of predictions made before their samples were used.

    Args:
        names: Names of the outputs, n_y.
        horizons: Label and length [s] of the spans predicted with frozen weights.

    Attributes:
        samples: Number of samples predicted.
        checks: Number of samples at which the predicted interval was checked.
        windows: Number of windows of each horizon.
        lengths: Number of samples in a window of each horizon.
    """

    def __init__(self, names: Sequence[str], horizons: Mapping[str, float] | None = None) -> None:
        self.names, self.horizons = tuple(names), dict(horizons or {})
        outputs = len(self.names)
        self.samples, self.checks = 0, 0
        self.windows = dict.fromkeys(self.horizons, 0)
        self.lengths = dict.fromkeys(self.horizons, 0)
        spans = ("", *(f"horizon_{label}" for label in self.horizons))
        self._errors = {f"{s}{half}": ErrorSums(outputs) for s in spans for half in _HALVES}
        self._intervals = {half: IntervalSums(outputs) for half in _HALVES}
        self._innovations = InnovationSums(outputs)

    @property
    def silent(self) -> Chosen:
        """Outputs that have not moved so far, (n_y,); none before a sample."""
        if not self.samples:
            return np.zeros(len(self.names), bool)
        return self._errors[_WHOLE].silent

    def add_predictions(self, y: Array, prediction: Array, held: Array, late: Chosen) -> None:
        """Count samples.

        Args:
            y: Measurement, (N, n_y) [unit of y]; NaN where it was not measured.
            prediction: yhat, (N, n_y) [unit of y].
            held: Persistence, (N, n_y) [unit of y].
            late: Samples of the second half, (N,) of bool.
        """
        self._add("", y, prediction, held, late)
        self.samples += len(y)

    def add_windows(
        self, label: str, length: int, arrays: tuple[Array, Array, Array], late: Chosen
    ) -> None:
        """Count windows of a horizon.

        Args:
            label: Name of the horizon.
            length: Number of samples in a window.
            arrays: Measurement, prediction and persistence in the windows, (W length, n_y) each.
            late: Samples of the second half, (W length,).
        """
        self.lengths[label] = length
        self.windows[label] += len(arrays[0]) // length
        self._add(f"horizon_{label}", *arrays, late)

    def add_checks(self, error: Array, std: Array, late: Chosen) -> None:
        """Count checks of the predicted interval.

        Args:
            error: y - yhat, (M, n_y) [unit of y].
            std: Predicted standard deviation, (M, n_y) [unit of y].
            late: Checks in the second half, (M,) of bool.
        """
        self._intervals[_WHOLE].add(error, std)
        self._intervals[_LATE].add(error[late], std[late])
        self.checks += len(error)

    def add_updates(self, innovation: Array, std: Array, nis: Array) -> None:
        """Count updates; outputs silent so far are no channels.

        Args:
            innovation: (U, n_y) [unit of y].
            std: Predicted standard deviation of it, (U, n_y) [unit of y].
            nis: Normalized innovation squared, (U,).
        """
        self._innovations.add(innovation, std, nis, ~self.silent)

    def error_scores(self) -> dict[str, Any]:
        """Silent outputs, and NMSE of prediction and persistence, whole and second half."""
        muted = zip(self.names, self.silent, strict=True)
        scores: dict[str, Any] = {"silent": [name for name, silent in muted if silent]}
        if self.samples < 2:
            return scores
        return scores | self._ratios("", "nmse") | self._ratios("", "persistence")

    def horizon_scores(self) -> dict[str, Any]:
        """Scores of each horizon, `horizon_<label>_nmse` and so on."""
        scores: dict[str, Any] = {}
        for label, duration in self.horizons.items():
            key = f"horizon_{label}"
            scores |= {
                f"{key}_seconds": duration,
                f"{key}_samples": self.lengths[label],
                f"{key}_windows": self.windows[label],
            }
            if self.windows[label]:
                scores |= self._ratios(key, f"{key}_nmse")
                scores |= self._ratios(key, f"{key}_persistence")
        return scores

    def interval_scores(self) -> dict[str, Any]:
        """Coverage and reliability of the predicted intervals."""
        heard = ~self.silent
        each, late = (sums.coverage(heard) for sums in self._intervals.values())
        within = self._intervals[_WHOLE].reliability(heard)
        return {
            "coverage": mean_heard(each),
            "coverage_second_half": mean_heard(late),
            "coverage_by_output": dict(zip(self.names, each.tolist(), strict=True)),
            "coverage_checks": self.checks,
            "reliability": dict(zip(map(str, NOMINAL), within, strict=True)),
        }

    def innovation_scores(self) -> dict[str, Any]:
        """Calibration of the filter by its innovations; see `InnovationSums.scores`."""
        return self._innovations.scores(self.names, ~self.silent)

    def scores(self) -> dict[str, Any]:
        """All scores by name."""
        return {
            **self.error_scores(),
            **self.horizon_scores(),
            **self.interval_scores(),
            **self.innovation_scores(),
        }

    def state(self) -> dict[str, Array]:
        """All sums as arrays by name."""
        counts = [self.samples, self.checks, *self.windows.values(), *self.lengths.values()]
        return {
            "counts": np.array([*counts, *(sums.unknown for sums in self._intervals.values())]),
            **{f"errors {name}": sums.sums for name, sums in self._errors.items()},
            **{f"intervals {name}": sums.counts for name, sums in self._intervals.items()},
            **{f"innovations {name}": value for name, value in vars(self._innovations).items()},
        }

    def resume(self, state: Mapping[str, Array]) -> None:
        """Go on from sums.

        Args:
            state: As `state` gave it, of the same outputs and horizons.

        Raises:
            KeyError: If a sum is missing.
        """
        counts = iter(state["counts"].tolist())
        self.samples, self.checks = next(counts), next(counts)
        self.windows = {label: next(counts) for label in self.windows}
        self.lengths = {label: next(counts) for label in self.lengths}
        for name, intervals in self._intervals.items():
            intervals.unknown, intervals.counts = next(counts), state[f"intervals {name}"].copy()
        for name, errors in self._errors.items():
            errors.sums = state[f"errors {name}"].copy()
        for name in vars(self._innovations):
            setattr(self._innovations, name, state[f"innovations {name}"].copy())

    def _add(self, span: str, y: Array, prediction: Array, held: Array, late: Chosen) -> None:
        self._errors[f"{span}{_WHOLE}"].add(y, prediction, held)
        self._errors[f"{span}{_LATE}"].add(y[late], prediction[late], held[late])

    def _ratios(self, span: str, key: str) -> dict[str, Any]:
        part = "persistence" if key.endswith("persistence") else "nmse"
        scores: dict[str, Any] = {}
        for half in _HALVES:
            values = getattr(self._errors[f"{span}{half}"], part)
            scores |= span_scores(values, self.names, f"{key}{half}")
        return scores


_WHOLE, _LATE = "", "_second_half"
_HALVES = (_WHOLE, _LATE)
