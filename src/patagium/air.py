"""Name space of the air: density, wind and gusts, models of the force, polars, sections.

`patagium.air` holds what a user needs of the layer `patagium.aerodynamics`.
"""

from patagium.aerodynamics import (
    AddedMass,
    Aerodynamics,
    Air,
    DeLaurier,
    DickinsonPolar,
    DrydenGust,
    Indicial,
    LiftingLine,
    MeasuredSection,
    OneMinusCosineGust,
    Polar,
    QuasiSteady,
    RampGust,
    Section,
    SectionFlow,
    SmoothPolar,
    StallDelay,
    StateSpace,
    TablePolar,
    TravelingGust,
    fitted_indicial,
    measured_section,
)

__all__ = [
    "AddedMass",
    "Aerodynamics",
    "Air",
    "DeLaurier",
    "DickinsonPolar",
    "DrydenGust",
    "Indicial",
    "LiftingLine",
    "MeasuredSection",
    "OneMinusCosineGust",
    "Polar",
    "QuasiSteady",
    "RampGust",
    "Section",
    "SectionFlow",
    "SmoothPolar",
    "StallDelay",
    "StateSpace",
    "TablePolar",
    "TravelingGust",
    "fitted_indicial",
    "measured_section",
]
