"""Aerodynamics: wind and gusts, local flow of the strips, models of their loads."""

from patagium.aerodynamics.added_mass import AddedMass
from patagium.aerodynamics.air import Air
from patagium.aerodynamics.delaurier import DeLaurier
from patagium.aerodynamics.gusts import DrydenGust, OneMinusCosineGust, RampGust, TravelingGust
from patagium.aerodynamics.indicial import FOUR_STATE, Indicial, fitted_indicial
from patagium.aerodynamics.inflow import Inflow
from patagium.aerodynamics.learned_air import LearnedAir
from patagium.aerodynamics.lifting_line import LiftingLine, StateSpace
from patagium.aerodynamics.model import Aerodynamics
from patagium.aerodynamics.polar_files import PolarTable, read_polar
from patagium.aerodynamics.polars import (
    DickinsonPolar,
    Polar,
    ReynoldsPolar,
    SectionFlow,
    SmoothPolar,
    TablePolar,
    register_polar,
)
from patagium.aerodynamics.quasi_steady import QuasiSteady
from patagium.aerodynamics.section_history import section_history
from patagium.aerodynamics.sections import (
    MeasuredSection,
    Section,
    StallDelay,
    measured_section,
)
from patagium.aerodynamics.wind_shear import WindShear

__all__ = [
    "AddedMass",
    "Aerodynamics",
    "Air",
    "DeLaurier",
    "DickinsonPolar",
    "DrydenGust",
    "FOUR_STATE",
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
    "ReynoldsPolar",
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
