"""Tables of named columns from a log, in SI units.

Gaps in time are counted and passed on, never bridged. Neglected: drift of clocks, delays between
columns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, Indices, brief, median_step, selected


@dataclass(frozen=True)
class LogTable:
    """Samples of a log in the units that a model sees.

    Attributes:
        time: Time from the first sample, (N,) [s].
        x: Inputs, (N, n_x) [`input_units`].
        y: Outputs, (N, n_y) [`output_units`].
        input_names: Names of the inputs.
        output_names: Names of the outputs.
        input_units: Units of the inputs.
        output_units: Units of the outputs.
        input_range: Lowest and highest expected input, (n_x, 2) [`input_units`]; NaN if not stated.
        output_range: Lowest and highest expected output, (n_y, 2) [`output_units`]; NaN if not
            stated.
        gaps: Index of the first sample after each gap, (n_gaps,) [1].
        gap: Length from which a time step is a gap, in median steps.
        source: File from which the samples came.
    """

    time: Array
    x: Array
    y: Array
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    input_range: Array
    output_range: Array
    gaps: Indices
    gap: float
    source: str
    __repr__ = brief

    def where(self, kept: slice | ArrayLike) -> LogTable:
        """LogTable of some of the samples with their times; left-out samples become gaps.

        Args:
            kept: Slice, increasing indices, or a bool for each sample.

        Raises:
            ParameterError: If it is something else.
        """
        chosen = selected(kept, len(self.time))
        time = self.time[chosen]
        step = median_step(self.time)
        gaps = np.flatnonzero(np.diff(time) > self.gap * step) + 1
        return replace(self, time=time, x=self.x[chosen], y=self.y[chosen], gaps=gaps)

    def describe_gaps(self) -> str:
        """Description of the gaps in one sentence."""
        step = median_step(self.time)
        if not len(self.gaps):
            return f"no gap longer than {self.gap:g} times the median step of {step:.4g} s"
        before = self.time[self.gaps - 1]
        lengths = self.time[self.gaps] - before
        return (
            f"{len(self.gaps)} gap(s) longer than {self.gap:g} times the median step of "
            f"{step:.4g} s, the longest {lengths.max():.4g} s at t = "
            f"{before[lengths.argmax()]:.6g} s"
        )
