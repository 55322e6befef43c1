"""Morphing-wing robots: their equations, their flight, and what the air does to them.

A robot file becomes compiled equations of motion; a gait and a model of the air
become a flight; a flight becomes a learned model of the air. Everything is SI and
radians; x forward, y left, z up. Names are resolved when first used, so that
importing the package costs nothing.
"""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import TYPE_CHECKING, Any

from patagium.plugins import OLD_NAMES, plugin
from patagium.version import __version__

if TYPE_CHECKING:
    from patagium.aerodynamics import AddedMass as AddedMass
    from patagium.aerodynamics import Air as Air
    from patagium.aerodynamics import DeLaurier as DeLaurier
    from patagium.aerodynamics import DrydenGust as DrydenGust
    from patagium.aerodynamics import Indicial as Indicial
    from patagium.aerodynamics import LiftingLine as LiftingLine
    from patagium.aerodynamics import OneMinusCosineGust as OneMinusCosineGust
    from patagium.aerodynamics import QuasiSteady as QuasiSteady
    from patagium.aerodynamics import RampGust as RampGust
    from patagium.aerodynamics import Section as Section
    from patagium.aerodynamics import StallDelay as StallDelay
    from patagium.aerodynamics import TablePolar as TablePolar
    from patagium.aerodynamics import TravelingGust as TravelingGust
    from patagium.aerodynamics import measured_section as measured_section
    from patagium.dynamics import Dynamics as Dynamics
    from patagium.errors import CompilerError as CompilerError
    from patagium.errors import FilterDiverged as FilterDiverged
    from patagium.errors import FlightError as FlightError
    from patagium.errors import LogError as LogError
    from patagium.errors import Outcome as Outcome
    from patagium.errors import ParameterError as ParameterError
    from patagium.errors import PatagiumError as PatagiumError
    from patagium.errors import PathError as PathError
    from patagium.errors import RobotFileError as RobotFileError
    from patagium.errors import RobotFileWarning as RobotFileWarning
    from patagium.errors import ShapeError as ShapeError
    from patagium.errors import SimulationFailed as SimulationFailed
    from patagium.learning import ChangeDetection as ChangeDetection
    from patagium.learning import CubatureLearner as CubatureLearner
    from patagium.learning import DenseNetwork as DenseNetwork
    from patagium.learning import ExtendedLearner as ExtendedLearner
    from patagium.learning import FlowNetwork as FlowNetwork
    from patagium.learning import GradientLearner as GradientLearner
    from patagium.learning import GreyBox as GreyBox
    from patagium.learning import HiddenFlowNetwork as HiddenFlowNetwork
    from patagium.learning import HiddenStripNetwork as HiddenStripNetwork
    from patagium.learning import LinearLearner as LinearLearner
    from patagium.learning import LowRank as LowRank
    from patagium.learning import NoiseEstimation as NoiseEstimation
    from patagium.learning import Screening as Screening
    from patagium.learning import StripNetwork as StripNetwork
    from patagium.learning import evaluate as evaluate
    from patagium.learning import load_learner as load_learner
    from patagium.learning import refine as refine
    from patagium.learning.identify import identify as identify
    from patagium.live import Pipeline as Pipeline
    from patagium.robot import Robot as Robot
    from patagium.robot import load_robot as load_robot
    from patagium.robot import load_urdf as load_urdf
    from patagium.sensing import ForceSamples as ForceSamples
    from patagium.sensing import Kalman as Kalman
    from patagium.sensing import MomentumObserver as MomentumObserver
    from patagium.sensing import MotionTracker as MotionTracker
    from patagium.sensing import SavitzkyGolay as SavitzkyGolay
    from patagium.sensing import SensorLog as SensorLog
    from patagium.sensing import Spline as Spline
    from patagium.sensing import cell_wrench as cell_wrench
    from patagium.sensing import estimate_motion as estimate_motion
    from patagium.sensing import estimate_shifts as estimate_shifts
    from patagium.sensing import import_log as import_log
    from patagium.sensing import inspect_log as inspect_log
    from patagium.sensing import inverse_dynamics_force as inverse_dynamics_force
    from patagium.sensing import load_cell_force as load_cell_force
    from patagium.sensing import load_log as load_log
    from patagium.sensing import load_sensor_log as load_sensor_log
    from patagium.sensing import momentum_force as momentum_force
    from patagium.sensing import motor_forces as motor_forces
    from patagium.sensing import save_sensor_log as save_sensor_log
    from patagium.sensing import sense as sense
    from patagium.sensing import sensors as sensors
    from patagium.sensing import training_data as training_data
    from patagium.simulation import cycle_statistics as cycle_statistics
    from patagium.simulation import gaits as gaits
    from patagium.simulation import load_flight as load_flight
    from patagium.simulation import mounts as mounts
    from patagium.simulation import paths as paths
    from patagium.simulation import save_flight as save_flight
    from patagium.simulation.simulate import simulate as simulate
    from patagium.viewer.replay import replay as replay
    from patagium.viewer.still import still as still

_HOMES = {
    "errors": (
        "CompilerError",
        "FilterDiverged",
        "FlightError",
        "LogError",
        "Outcome",
        "ParameterError",
        "PatagiumError",
        "PathError",
        "RobotFileError",
        "RobotFileWarning",
        "ShapeError",
        "SimulationFailed",
    ),
    "robot": (
        "Robot",
        "load_robot",
        "load_urdf",
    ),
    "dynamics": ("Dynamics",),
    "aerodynamics": (
        "AddedMass",
        "Air",
        "DeLaurier",
        "DrydenGust",
        "Indicial",
        "LiftingLine",
        "OneMinusCosineGust",
        "QuasiSteady",
        "RampGust",
        "Section",
        "StallDelay",
        "TablePolar",
        "TravelingGust",
        "measured_section",
    ),
    "simulation": (
        "cycle_statistics",
        "gaits",
        "load_flight",
        "mounts",
        "paths",
        "save_flight",
        "simulate",
    ),
    "sensing": (
        "ForceSamples",
        "Kalman",
        "MomentumObserver",
        "MotionTracker",
        "SavitzkyGolay",
        "SensorLog",
        "Spline",
        "cell_wrench",
        "estimate_motion",
        "estimate_shifts",
        "import_log",
        "inspect_log",
        "inverse_dynamics_force",
        "load_cell_force",
        "load_log",
        "load_sensor_log",
        "momentum_force",
        "motor_forces",
        "save_sensor_log",
        "sense",
        "sensors",
        "training_data",
    ),
    "learning": (
        "ChangeDetection",
        "CubatureLearner",
        "DenseNetwork",
        "ExtendedLearner",
        "FlowNetwork",
        "GradientLearner",
        "GreyBox",
        "HiddenFlowNetwork",
        "HiddenStripNetwork",
        "LinearLearner",
        "LowRank",
        "NoiseEstimation",
        "Screening",
        "StripNetwork",
        "evaluate",
        "identify",
        "load_learner",
        "refine",
    ),
    "live": ("Pipeline",),
    "viewer": (
        "replay",
        "still",
    ),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = ["__version__", *sorted(_HOME_OF)]


def __getattr__(name: str) -> Any:
    home = _HOME_OF.get(name)
    if home is None:
        moved = None if name.startswith("_") else plugin(OLD_NAMES, name)
        if moved is not None:
            warnings.warn(
                f"patagium.{name} is now {moved.__module__}.{name}",
                DeprecationWarning,
                stacklevel=2,
            )
            return moved
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
