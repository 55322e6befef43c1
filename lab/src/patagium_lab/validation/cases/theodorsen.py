"""A section in harmonic motion: Theodorsen's function at five reduced frequencies."""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics import Indicial
from patagium.aerodynamics.indicial import FOUR_STATE, ONE_STATE, TWO_STATE
from patagium.arrays import Array
from patagium_lab.validation.cases.case import CaseResult, ErrorLimit
from patagium_lab.validation.cases.wings import (
    AIRSPEED,
    INFINITE,
    lifting_line,
    rectangular_wing,
)
from patagium_lab.validation.exact_functions import theodorsen_function

REDUCED_FREQUENCY = np.array([0.05, 0.1, 0.2, 0.5, 1.0])


def compute() -> list[CaseResult]:
    """Lift of a wing without end in harmonic motion, over its quasi-steady value."""
    expected = theodorsen_function(REDUCED_FREQUENCY)
    lags = {"one state": ONE_STATE, "two states": TWO_STATE, "four states": FOUR_STATE}
    models = {name: section_transfer(lag, REDUCED_FREQUENCY) for name, lag in lags.items()}
    return [
        CaseResult(
            "Theodorsen",
            "Theodorsen (1935), NACA TR 496",
            "reduced frequency [1]",
            "|lift| over quasi-steady [1]",
            REDUCED_FREQUENCY,
            np.abs(expected),
            {name: np.abs(values) for name, values in models.items()},
            "largest difference, phase included [1]",
            {name: float(np.abs(values - expected).max()) for name, values in models.items()},
            {"Jones (1940), two exponentials": 0.014},
            "The error counts the phase too, which the figure does not show.",
            {
                "two states": ErrorLimit(0.015, "Jones' own error, rounded up"),
                "four states": ErrorLimit(0.005, "a third of Jones'"),
            },
        )
    ]


def section_transfer(lags: Indicial, reduced_frequency: Array) -> Array:
    """Lift of a wing without end in harmonic motion over its quasi-steady value, complex, (N,).

    Args:
        lags: Memory of its strips.
        reduced_frequency: (N,) [-].
    """
    model = lifting_line(rectangular_wing(INFINITE, 3), lags)
    system = model.state_space(np.zeros(6), [AIRSPEED, 0, 0, 0, 0, 0])
    strip, unit = model.robot.strips[1], np.eye(len(system.a))
    steady = np.pi * model.air.density * AIRSPEED * strip.chord * strip.width
    values = []
    for k in reduced_frequency:
        omega = k * AIRSPEED / (strip.chord / 2)
        lift = system.c @ np.linalg.solve(1j * omega * unit - system.a, system.b) + system.d
        values.append(lift[1].sum() / steady)
    return np.array(values)
