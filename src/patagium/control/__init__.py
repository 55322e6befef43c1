"""Control: exact derivatives of a wingbeat, periodic orbits, stability, feedback, closed loops."""

from patagium.control.adaptation import AdaptiveController, AirWeights
from patagium.control.continuation import Bifurcation, Branch, continue_orbit
from patagium.control.estimators import Estimate, NoisyState, TrackedState, Truth, driving_noise
from patagium.control.events import (
    Event,
    GustEvent,
    PayloadEvent,
    PolarEvent,
    StuckEvent,
    WingLossEvent,
    off_nominal,
)
from patagium.control.floquet import Floquet, Mode, floquet
from patagium.control.gait_family import GaitFamily, gait_family
from patagium.control.loop import fly
from patagium.control.lqr import LinearRegulator
from patagium.control.optimal_gait import OptimalGait, optimize, power_front
from patagium.control.orbit import NoOrbit, Orbit
from patagium.control.predictive import PredictiveController, RealTimeIteration
from patagium.control.quadratic_program import ProgramStatus, QuadraticProgram
from patagium.control.trimming import free_parameters, trim
from patagium.control.wingbeat import FlightMap, PrescribedRows, Segments
from patagium.errors import suggest_names

__all__ = [
    "AdaptiveController",
    "AirWeights",
    "Bifurcation",
    "Branch",
    "Estimate",
    "Event",
    "FlightMap",
    "Floquet",
    "GaitFamily",
    "GustEvent",
    "LinearRegulator",
    "Mode",
    "NoOrbit",
    "NoisyState",
    "OptimalGait",
    "Orbit",
    "PayloadEvent",
    "PolarEvent",
    "PredictiveController",
    "PrescribedRows",
    "ProgramStatus",
    "QuadraticProgram",
    "RealTimeIteration",
    "Segments",
    "StuckEvent",
    "TrackedState",
    "Truth",
    "WingLossEvent",
    "continue_orbit",
    "driving_noise",
    "floquet",
    "fly",
    "free_parameters",
    "gait_family",
    "off_nominal",
    "optimize",
    "power_front",
    "trim",
]
suggest_names(__name__)
