"""A section that takes up an incidence at once: Wagner's function."""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics.indicial import FOUR_STATE, ONE_STATE, TWO_STATE
from patagium_lab.validation.cases.case import CaseResult, ErrorLimit, largest_difference
from patagium_lab.validation.cases.wings import (
    INFINITE,
    lifting_line,
    rectangular_wing,
    step_response,
)
from patagium_lab.validation.exact_functions import wagner_function


def compute() -> list[CaseResult]:
    """Lift of a wing without end after a step of incidence."""
    s = np.linspace(0.0, 100.0, 401)
    wing, expected = rectangular_wing(INFINITE, 3), wagner_function(s)
    lags = {"one state": ONE_STATE, "two states": TWO_STATE, "four states": FOUR_STATE}
    models = {name: step_response(lifting_line(wing, lag), s) for name, lag in lags.items()}
    return [
        CaseResult(
            "Wagner step",
            "Wagner (1925), by quadrature",
            "distance travelled [semichords]",
            "lift over its final value [1]",
            s,
            expected,
            models,
            "largest difference [1]",
            largest_difference(expected, models),
            {"Jones (1940), two exponentials": 0.0096},
            "Two states are Jones' exponentials themselves; one state is a compromise.",
            {
                "two states": ErrorLimit(0.010, "Jones' own error, rounded up"),
                "four states": ErrorLimit(0.005, "half of Jones'"),
            },
        )
    ]
