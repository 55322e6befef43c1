"""What of a learner may be tuned, and over which range: one table.

A knob turns coordinates between 0 and 1 into the value of a keyword, as plain as a file holds
it; `made` turns that into what the learner takes. Numbers have three digits: more would be
noise. Neglected: ranges that depend on each other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from patagium.errors import ParameterError
from patagium.learning.settings import NoiseEstimation, structure_from

Array = NDArray[np.float64]
LearnerKind = Literal["cubature", "extended"]
BOTH: tuple[LearnerKind, ...] = ("cubature", "extended")


@dataclass(frozen=True)
class Level:
    """A number, tried over a range of magnitudes.

    Attributes:
        name: Keyword of the learner.
        low: Least value.
        high: Largest value.
        below_one: Whether the value is one minus the number that is drawn.
        off: Value that switches it off, tried half of the time; None: it is never off.
        unit: What the number is multiplied by: one number, or one for each output, (n_y,).
        learners: Which learners have it.
        made: From the plain value to the keyword's.
    """

    name: str
    low: float
    high: float
    below_one: bool = False
    off: float | None = None
    unit: tuple[float, ...] = (1.0,)
    learners: tuple[LearnerKind, ...] = BOTH
    made: Callable[[Any], Any] = field(default=lambda plain: plain)

    def check(self, value: Any) -> None:
        """Refuse what is neither a number, nor a list of numbers, nor what switches it off.

        Raises:
            ParameterError: If it is not.
        """
        numbers = value if isinstance(value, list) and value else [value]
        if not all(type(one) in (int, float) for one in numbers) and value is not self.off:
            raise ParameterError(self.name, "a number such as 3.0e-4, or a list of numbers", value)

    @property
    def axes(self) -> tuple[bool, ...]:
        """Of each coordinate, whether it chooses; the others are magnitudes."""
        return (False,) if self.off is None else (False, True)

    def value(self, coordinates: Sequence[float]) -> Any:
        """The plain value at coordinates between 0 and 1."""
        if self.off is not None and coordinates[1] < 0.5:
            return self.off
        number = self.low * (self.high / self.low) ** coordinates[0]
        if self.below_one:
            return 1.0 - _rounded(number)
        found = [_rounded(number * one) for one in self.unit]
        return found[0] if len(found) == 1 else found


@dataclass(frozen=True)
class Choice:
    """One of several values.

    Attributes:
        name: Keyword of the learner.
        values: What it may be, plain.
        learners: Which learners have it.
        made: From the plain value to the keyword's.
    """

    name: str
    values: tuple[Any, ...]
    learners: tuple[LearnerKind, ...] = BOTH
    made: Callable[[Any], Any] = field(default=lambda plain: plain)

    def check(self, value: Any) -> None:
        """Refuse what the learner cannot take.

        Raises:
            ParameterError: If it cannot.
        """
        try:
            self.made(value)
        except TypeError:
            like = f"one like {', '.join(map(repr, self.values))}"
            raise ParameterError(self.name, like, value) from None

    @property
    def axes(self) -> tuple[bool, ...]:
        """Of each coordinate, whether it chooses; none where there is no choice."""
        return (True,) if len(self.values) > 1 else ()

    def value(self, coordinates: Sequence[float]) -> Any:
        """The plain value at a coordinate between 0 and 1."""
        if not self.axes:
            return self.values[0]
        return self.values[min(int(coordinates[0] * len(self.values)), len(self.values) - 1)]


Knob = Level | Choice


def _noise_estimation(plain: dict[str, Any] | None) -> NoiseEstimation | None:
    return None if plain is None else NoiseEstimation(**plain)


KNOBS: tuple[Knob, ...] = (
    Level("prior_std", 0.03, 3.0),
    Level("measurement_std", 1e-5, 1.0),
    Level("spread", 0.3, 4.0, learners=("cubature",)),
    Level("forgetting_factor", 1e-5, 0.1, below_one=True, off=1.0),
    Level("prior_share", 1e-7, 0.01, off=0.0),
    Choice("covariance", ("full", "layer", "node"), made=structure_from),
    Choice("noise_estimation", (None, {"memory": 50}, {"memory": 200}), made=_noise_estimation),
)
"""All of them. The measurement deviation is in deviations of the outputs."""


def knobs_for(
    learner: LearnerKind,
    unit: Sequence[float],
    structures: Sequence[Any],
) -> tuple[Knob, ...]:
    """The knobs of a learner.

    Args:
        learner: Its kind.
        unit: Of the measurement deviation: one number, or one for each output.
        structures: Covariances to try, plain.
    """
    changed: dict[str, dict[str, Any]] = {
        "measurement_std": {"unit": tuple(unit)},
        "covariance": {"values": tuple(structures)},
    }
    return tuple(
        replace(knob, **changed.get(knob.name, {})) for knob in KNOBS if learner in knob.learners
    )


def values_at(knobs: Sequence[Knob], point: Array) -> dict[str, Any]:
    """Plain values of all knobs.

    Args:
        knobs: The knobs.
        point: Coordinates between 0 and 1, those of the first knob first, (d,).
    """
    values, start = {}, 0
    for knob in knobs:
        end = start + len(knob.axes)
        values[knob.name] = knob.value(point[start:end].tolist())
        start = end
    return values


def keywords(values: Mapping[str, Any]) -> dict[str, Any]:
    """Keywords of a learner from plain values.

    Args:
        values: By name of the knob; others stay as they are.
    """
    made = {knob.name: knob.made for knob in KNOBS}
    return {name: made[name](value) if name in made else value for name, value in values.items()}


def _rounded(number: float) -> float:
    return float(f"{number:.3g}")
