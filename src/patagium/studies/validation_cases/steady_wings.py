"""Steady wings of finite span: lift and induced drag in closed form or by Fourier series."""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics import NO_STATE
from patagium.studies.validation_cases.case import CaseResult, largest_relative_difference
from patagium.studies.validation_cases.wings import (
    elliptic_wing,
    lifting_line,
    rectangular_wing,
    steady_coefficients,
)

STRIPS = 40
RECTANGULAR = {4.0: (4.0279, 1.3280), 6.0: (4.5299, 1.1413), 8.0: (4.8372, 0.9940)}
"""Aspect ratio: lift over angle, induced drag over its square (Glauert's series, 200 terms)."""


def compute() -> list[CaseResult]:
    """Lift slope and induced drag of elliptic and rectangular wings."""
    ratios = np.array([4.0, 6.0, 20.0])
    slope = 2 * np.pi / (1 + 2 / ratios)
    elliptic = (slope, slope**2 / (np.pi * ratios))
    given = np.array(list(RECTANGULAR.values())).T
    rectangular = (given[0], given[1])
    cases = []
    for name, wing, x, expected, source in (
        ("Elliptic", elliptic_wing, ratios, elliptic, "Prandtl (1918), closed form"),
        (
            *("Rectangular", rectangular_wing, np.array(list(RECTANGULAR)), rectangular),
            "Glauert (1926), Fourier series",
        ),
    ):
        found = [steady_coefficients(lifting_line(wing(a, STRIPS), NO_STATE)) for a in x]
        for k, quantity in enumerate(("lift over angle", "induced drag over its square")):
            models = {f"{STRIPS} strips": np.array([pair[k] for pair in found])}
            cases.append(
                CaseResult(
                    f"{name} wing, {quantity.split(' over ')[0]}",
                    source,
                    "aspect ratio [1]",
                    f"{quantity} [1]",
                    x,
                    expected[k],
                    models,
                    "largest relative difference [1]",
                    largest_relative_difference(expected[k], models),
                    {},
                    "The gain of a lifting surface over a lifting line is off.",
                )
            )
    return cases
