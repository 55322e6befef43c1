"""A section that flies into a sharp-edged gust: Kuessner's function."""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics import FOUR_STATE, TWO_STATE
from patagium.aerodynamics.thin_airfoil import kussner_function
from patagium.studies.validation_cases.case import CaseResult, largest_difference
from patagium.studies.validation_cases.wings import (
    INFINITE,
    lifting_line,
    rectangular_wing,
    step_response,
)


def compute() -> list[CaseResult]:
    """Lift of a wing without end in a gust that is uniform in space, as all our gusts are."""
    s = np.linspace(0.0, 20.0, 101)
    wing, expected = rectangular_wing(INFINITE, 3), kussner_function(s)
    lags = {"two states": TWO_STATE, "four states": FOUR_STATE}
    models = {name: step_response(lifting_line(wing, lag), s) for name, lag in lags.items()}
    return [
        CaseResult(
            "Sharp-edged gust",
            "Kuessner (1936), by quadrature",
            "distance travelled [semichords]",
            "lift over its final value [1]",
            s,
            expected,
            models,
            "largest difference [1]",
            largest_difference(expected, models),
            {},
            "Our gusts strike the whole chord at once: the model answers with Wagner's function, "
            "half the lift too much at the first instant. To enter a gust as Kuessner's section "
            "does takes a wind that varies along the chord: its mean weighted toward the trailing "
            "edge drives the lags, and its difference between the edges adds a lift of its own. "
            "Wind at one point of the chord is not enough: taken at three quarters, it leaves out "
            "all lift of the first one and a half semichords. Our models take one wind for the "
            "whole robot. Gusts longer than some chords do not feel it.",
        )
    ]
