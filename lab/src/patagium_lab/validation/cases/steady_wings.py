"""Steady wings of finite span: lift and induced drag in closed form or by Fourier series."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from patagium.aerodynamics.indicial import NO_STATE
from patagium.robot import Robot
from patagium_lab.validation.cases.case import (
    CaseResult,
    ErrorLimit,
    largest_relative_difference,
)
from patagium_lab.validation.cases.wings import (
    elliptic_wing,
    lifting_line,
    rectangular_wing,
    steady_coefficients,
)

STRIPS = 40
MANY = {4.0: 40, 6.0: 40, 20.0: 100}
"""Strips of the finest of the three elliptic wings that give the limit, by aspect ratio."""
RECTANGULAR = {4.0: (4.0279, 1.3280), 6.0: (4.5299, 1.1413), 8.0: (4.8372, 0.9940)}
"""Aspect ratio: lift over angle, induced drag over its square (Glauert's series, 200 terms)."""


TARGETS = {
    f"{STRIPS} strips": ErrorLimit(0.01, "1 %: a wing's own numbers are known no better"),
    "limit of many strips": ErrorLimit(1e-4, "1e-4 of the closed form"),
}


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
        limits = [limit(wing, a) for a in x] if wing is elliptic_wing else []
        for k, quantity in enumerate(("lift over angle", "induced drag over its square")):
            models = {f"{STRIPS} strips": np.array([pair[k] for pair in found])}
            if limits:
                models["limit of many strips"] = np.array([pair[k] for pair in limits])
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
                    NOTE,
                    {name: TARGETS[name] for name in models},
                )
            )
    return cases


NOTE = (
    "The gain of a lifting surface over a lifting line is off. The error of strips of equal "
    "width falls with the power 3/2 of it: two steps of Richardson's extrapolation, of the "
    "orders 3/2 and 2, give the limit."
)


def limit(wing: Callable[[float, int], Robot], aspect_ratio: float) -> tuple[float, float]:
    """Lift over angle and drag over its square of a wing in the limit of many strips.

    Args:
        wing: Function that gives the wing of an aspect ratio and a number of strips.
        aspect_ratio: Key of `MANY`.
    """
    counts = [MANY[aspect_ratio] // division for division in (4, 2, 1)]
    values = np.array(
        [steady_coefficients(lifting_line(wing(aspect_ratio, n), NO_STATE)) for n in counts]
    )
    for order in (1.5, 2.0):
        values = values[1:] + (values[1:] - values[:-1]) / (2.0**order - 1.0)
    return float(values[0, 0]), float(values[0, 1])
