"""Plan of the validation: which cases are computed."""

from __future__ import annotations

from dataclasses import dataclass

from patagium.errors import ParameterError

CASES = (
    "wagner",
    "theodorsen",
    "gust",
    "steady_wings",
    "plunge",
    "thrust",
    "measured_wing",
    "pitching_section",
    "bent_wing",
    "folding_tip",
    "hover",
    "robotic_fly",
    "hover_modes",
    "monarch",
    "monarch_feedback",
)
"""Modules of the package `cases` in reading order; `compute()` of each gives its results."""


@dataclass(frozen=True)
class ValidationPlan:
    """Cases that are computed.

    Attributes:
        cases: Names out of `CASES`.

    Raises:
        ParameterError: If there is no case of a name.
    """

    cases: tuple[str, ...] = CASES

    def __post_init__(self) -> None:
        for name in self.cases:
            if name not in CASES:
                raise ParameterError("case", f"one of {', '.join(CASES)}", name)
