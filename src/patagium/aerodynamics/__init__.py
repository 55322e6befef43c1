"""How air pushes: wind and gusts, local flow of the strips, models of their loads."""

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.description import aero_from_description
from patagium.aerodynamics.gusts import DrydenGust, OneMinusCosineGust
from patagium.aerodynamics.loads import AeroExpressions
from patagium.aerodynamics.local_flow import LocalFlow, strip_flow, strip_points
from patagium.aerodynamics.model import Aerodynamics
from patagium.aerodynamics.polars import DickinsonPolar, SmoothPolar
from patagium.aerodynamics.published import PUBLISHED_ERRORS, Published
from patagium.aerodynamics.quasi_steady import QuasiSteady

__all__ = [
    "PUBLISHED_ERRORS",
    "AeroExpressions",
    "Aerodynamics",
    "Air",
    "DickinsonPolar",
    "DrydenGust",
    "LocalFlow",
    "OneMinusCosineGust",
    "Published",
    "QuasiSteady",
    "SmoothPolar",
    "aero_from_description",
    "strip_flow",
    "strip_points",
]
