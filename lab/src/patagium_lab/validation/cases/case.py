"""Result of a case of the validation: expected values, values of the models, and their errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from patagium.arrays import Array
from patagium.errors import ParameterError, ShapeError


@dataclass(frozen=True)
class ErrorLimit:
    """Limit of the error of a model.

    Attributes:
        limit: Largest error that meets the target, in the unit of the case's measure.
        reason: Source of the limit.
    """

    limit: float
    reason: str


@dataclass(frozen=True)
class CaseResult:
    """Result of one case.

    Attributes:
        name: Short name, one word or a few.
        source: Source of the expected values.
        abscissa: Quantity that varies, with its unit.
        ordinate: Quantity that is compared, with its unit.
        x: Values of the abscissa, (N,) [unit of the abscissa].
        expected: Expected values of the ordinate, (N,) [unit of the ordinate].
        models: Values of the ordinate by each model, (N,) [unit of the ordinate], by the model's
            name.
        measure: Measure of the error, with its unit.
        errors: Error of each model, by its name.
        known: Errors that others reached on the same case, by name; empty where none is known.
        note: What to look for, and why a target is missed if one is.
        targets: Limit of each model's error, by its name; other models are for comparison.
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
    targets: Mapping[str, ErrorLimit] = field(default_factory=dict)

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
