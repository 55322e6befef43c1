"""A case of the validation: what is expected, what the model gives, how far apart they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from patagium.errors import ParameterError, ShapeError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Target:
    """How small an error is meant to be.

    Attributes:
        limit: Largest error that meets it, in the unit of the case's measure.
        reason: Where the limit comes from.
    """

    limit: float
    reason: str


@dataclass(frozen=True)
class CaseResult:
    """One case, computed.

    Attributes:
        name: Short name, one word or a few.
        source: Where the expected values come from.
        abscissa: What varies, with its unit.
        ordinate: What is compared, with its unit.
        x: Values of the abscissa, (N,).
        expected: (N,).
        models: By name, each (N,).
        measure: How the error is measured, with its unit.
        errors: By name of a model.
        known: Error that others reached on the same case, by name; empty where none is known.
        note: What to look for, and why a target is missed if one is.
        targets: By name of a model; a model without one is there to be compared with.
    """

    name: str
    source: str
    abscissa: str
    ordinate: str
    x: Array
    expected: Array
    models: Mapping[str, Array]
    measure: str
    errors: Mapping[str, float]
    known: Mapping[str, float]
    note: str
    targets: Mapping[str, Target] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, values in {"expected": self.expected, **self.models}.items():
            if values.shape != self.x.shape:
                raise ShapeError(name, self.x.shape, values.shape)
        for name in self.targets:
            if name not in self.errors:
                raise ParameterError("target", f"one of {', '.join(self.errors)}", name)


def largest_difference(expected: Array, models: Mapping[str, Array]) -> dict[str, float]:
    """Largest absolute difference of each model."""
    return {name: float(np.abs(values - expected).max()) for name, values in models.items()}


def largest_relative_difference(expected: Array, models: Mapping[str, Array]) -> dict[str, float]:
    """Largest difference of each model over the expected value."""
    return {name: float(np.abs(v / expected - 1.0).max()) for name, v in models.items()}


def mean_difference(expected: Array, models: Mapping[str, Array]) -> dict[str, float]:
    """Mean absolute difference of each model."""
    return {name: float(np.abs(values - expected).mean()) for name, values in models.items()}
