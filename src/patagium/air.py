"""Name space of the air: density, wind and gusts, models of the force, polars, sections.

`patagium.air` holds what a user needs of the layer `patagium.aerodynamics`.
"""

from patagium.aerodynamics import (  # isort: skip
    AddedMass, Aerodynamics, Air, DeLaurier, DickinsonPolar, DrydenGust, Indicial, Inflow,
    LearnedAir, LiftingLine, MeasuredSection, OneMinusCosineGust, Polar, PolarTable,
    QuasiSteady, RampGust, Section, SectionFlow, SmoothPolar, StallDelay, StateSpace,
    TablePolar, TravelingGust, WindShear, fitted_indicial, measured_section, read_polar,
    register_polar, section_history,
)  # fmt: skip
from patagium.errors import suggest_names

__all__ = [
    "AddedMass",
    "Aerodynamics",
    "Air",
    "DeLaurier",
    "DickinsonPolar",
    "DrydenGust",
    "Indicial",
    "Inflow",
    "LearnedAir",
    "LiftingLine",
    "MeasuredSection",
    "OneMinusCosineGust",
    "Polar",
    "PolarTable",
    "QuasiSteady",
    "RampGust",
    "Section",
    "SectionFlow",
    "SmoothPolar",
    "StallDelay",
    "StateSpace",
    "TablePolar",
    "TravelingGust",
    "WindShear",
    "fitted_indicial",
    "measured_section",
    "read_polar",
    "register_polar",
    "section_history",
]
suggest_names(__name__)
