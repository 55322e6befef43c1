"""Morphing-wing robots: their equations, their flight, and what the air does to them.

A robot file becomes compiled equations of motion; a gait and a model of the air
become a flight; a flight becomes a learned model of the air. Everything is SI and
radians; x forward, y left, z up.

The names of daily work stand here. Five name spaces hold the rest: `patagium.air`,
`patagium.control`, `patagium.sensing`, `patagium.learning` and `patagium.errors`. Names are
resolved when first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from patagium.version import __version__

if TYPE_CHECKING:
    from patagium import air as air
    from patagium import control as control
    from patagium import errors as errors
    from patagium import learning as learning
    from patagium import sensing as sensing
    from patagium.aerodynamics import AddedMass as AddedMass
    from patagium.aerodynamics import Air as Air
    from patagium.aerodynamics import DeLaurier as DeLaurier
    from patagium.aerodynamics import LiftingLine as LiftingLine
    from patagium.aerodynamics import QuasiSteady as QuasiSteady
    from patagium.control import fly as fly
    from patagium.control import trim as trim
    from patagium.dynamics import Dynamics as Dynamics
    from patagium.errors import PatagiumError as PatagiumError
    from patagium.learning import CubatureLearner as CubatureLearner
    from patagium.learning import DenseNetwork as DenseNetwork
    from patagium.learning import ExtendedLearner as ExtendedLearner
    from patagium.learning import GreyBox as GreyBox
    from patagium.learning import StripNetwork as StripNetwork
    from patagium.learning import evaluate as evaluate
    from patagium.learning import load_learner as load_learner
    from patagium.learning import load_model as load_model
    from patagium.learning import refine as refine
    from patagium.learning.identify import identify as identify
    from patagium.learning.tuning.tune import tune as tune
    from patagium.live import Pipeline as Pipeline
    from patagium.robot import Robot as Robot
    from patagium.robot import load_robot as load_robot
    from patagium.robot import load_urdf as load_urdf
    from patagium.sensing import estimate_motion as estimate_motion
    from patagium.sensing import import_log as import_log
    from patagium.sensing import inverse_dynamics_force as inverse_dynamics_force
    from patagium.sensing import load_log as load_log
    from patagium.sensing import sense as sense
    from patagium.sensing import sensor_log as sensor_log
    from patagium.sensing import sensors as sensors
    from patagium.sensing import training_data as training_data
    from patagium.simulation import cycle_statistics as cycle_statistics
    from patagium.simulation import gaits as gaits
    from patagium.simulation import load_flight as load_flight
    from patagium.simulation import mounts as mounts
    from patagium.simulation import paths as paths
    from patagium.simulation import save_flight as save_flight
    from patagium.simulation.simulator import Simulator as Simulator
    from patagium.simulation.simulator import simulate as simulate
    from patagium.viewer.replay import replay as replay
    from patagium.viewer.replay import still as still

_NAME_SPACES = ("air", "control", "errors", "learning", "sensing")
_HOMES = {
    "errors": ("PatagiumError",),
    "robot": ("Robot", "load_robot", "load_urdf"),
    "dynamics": ("Dynamics",),
    "aerodynamics": ("AddedMass", "Air", "DeLaurier", "LiftingLine", "QuasiSteady"),
    "simulation": (
        "Simulator",
        "cycle_statistics",
        "gaits",
        "load_flight",
        "mounts",
        "paths",
        "save_flight",
        "simulate",
    ),
    "sensing": (
        "estimate_motion",
        "import_log",
        "inverse_dynamics_force",
        "load_log",
        "sense",
        "sensor_log",
        "sensors",
        "training_data",
    ),
    "learning": (
        "CubatureLearner",
        "DenseNetwork",
        "ExtendedLearner",
        "GreyBox",
        "StripNetwork",
        "evaluate",
        "identify",
        "load_learner",
        "load_model",
        "refine",
        "tune",
    ),
    "control": ("fly", "trim"),
    "live": ("Pipeline",),
    "viewer": ("replay", "still"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = ["__version__", *sorted([*_HOME_OF, *_NAME_SPACES])]


def __getattr__(name: str) -> Any:
    if name in _NAME_SPACES:
        return import_module(f"{__name__}.{name}")
    if name not in _HOME_OF:
        from patagium.errors import refuse_removed, unknown_name

        refuse_removed(__name__, name)
        known = dict[str, str]()  # none for importers, which ask for "__path__" and for modules
        for space in () if name[0] == "_" or find_spec(f"{__name__}.{name}") else _NAME_SPACES:
            words = import_module(f"{__name__}.{space}").__all__
            known |= {word: f"{__name__}.{space}.{word}" for word in words}
        raise unknown_name(__name__, name, known | {word: word for word in __all__})
    value = getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)
