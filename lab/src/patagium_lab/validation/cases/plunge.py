"""Wings of finite span that begin to sink at once: R. T. Jones' indicial functions."""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics.indicial import TWO_STATE
from patagium.aerodynamics.trailing_vortices import SURFACE_CONSTANT
from patagium_lab.validation.cases.case import CaseResult, ErrorLimit, largest_difference
from patagium_lab.validation.cases.wings import (
    INFINITE,
    elliptic_wing,
    lifting_line,
    rectangular_wing,
    step_response,
)

STRIPS = 24
INDICIAL = {
    3.0: (0.600, ((0.170, 0.540),)),
    6.0: (0.740, ((0.267, 0.381),)),
    INFINITE: (1.000, ((0.165, 0.0455), (0.335, 0.300))),
}
"""Aspect ratio: final lift, and amplitude and rate [1/semichord] of what is held back."""

FINITE_LAGS = "lifting line, lags of a finite span"
FINITE = (
    " The gap is largest after four to six semichords where strips lag as sections without end do: "
    "the lift of Jones' finite wings rises faster, as that of `Indicial.finite_span`. His final "
    "lift is a lifting line's, so that the gain of a surface lies below it."
)
EXACT = ErrorLimit(1e-3, "both are Jones' exponentials")
CLOSE = ErrorLimit(0.02, "Jones' wing of aspect ratio 6 begins .013 off the section's half")


def compute() -> list[CaseResult]:
    """Lift of elliptic wings after a step of sinking speed."""
    return [_case(ratio) for ratio in INDICIAL]


def _case(aspect_ratio: float) -> CaseResult:
    s = np.linspace(0.0, 20.0, 101)
    final, lags = INDICIAL[aspect_ratio]
    expected = final - sum((a * np.exp(-b * s) for a, b in lags), np.zeros(len(s)))
    endless = aspect_ratio == INFINITE
    wing = rectangular_wing(INFINITE, 3) if endless else elliptic_wing(aspect_ratio, STRIPS)
    models = {
        "lifting line": step_response(lifting_line(wing, TWO_STATE), s),
        "with the gain of a surface": step_response(
            lifting_line(wing, TWO_STATE, SURFACE_CONSTANT), s
        ),
    }
    if not endless:
        short = lifting_line(wing, TWO_STATE.finite_span(aspect_ratio))
        models[FINITE_LAGS] = step_response(short, s)
    name = "without end" if endless else f"of aspect ratio {aspect_ratio:g}"
    return CaseResult(
        f"Sudden plunge, wing {name}",
        "Jones (1940), NACA Report 681",
        "distance travelled [semichords at mid-span]",
        "lift over 2-D lift [1]",
        s,
        expected,
        models,
        "largest difference [1]",
        largest_difference(expected, models),
        {},
        "Jones' functions are themselves approximate. Two states, lift of circulation only: "
        "the impulse of the added mass at the first instant is not part of either."
        + ("" if endless else FINITE),
        dict.fromkeys(models, EXACT) if endless else {FINITE_LAGS: CLOSE},
    )
