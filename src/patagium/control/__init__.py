"""Control: exact derivatives of a wingbeat, periodic orbits, their stability, feedback."""

from patagium.control.floquet import Floquet, Mode, floquet
from patagium.control.gait_family import GaitFamily, gait_family
from patagium.control.lqr import LinearRegulator
from patagium.control.orbit import NoOrbit, Orbit
from patagium.control.predictive import PredictiveController, RealTimeIteration
from patagium.control.quadratic_program import ProgramStatus, QuadraticProgram
from patagium.control.trimming import free_parameters, trim
from patagium.control.wingbeat import FlightMap, PrescribedRows, Segments

__all__ = [
    "FlightMap",
    "Floquet",
    "GaitFamily",
    "LinearRegulator",
    "Mode",
    "NoOrbit",
    "Orbit",
    "PredictiveController",
    "PrescribedRows",
    "ProgramStatus",
    "QuadraticProgram",
    "RealTimeIteration",
    "Segments",
    "floquet",
    "free_parameters",
    "gait_family",
    "trim",
]
