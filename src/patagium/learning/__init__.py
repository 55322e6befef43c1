"""Models of the air learned from samples: settings, models, filters, learners, scores, tuning.

Names are imported when they are first used, so that the command line reads the settings
without loading what uses them.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from patagium.learning.default_learner import default_learner as default_learner
    from patagium.learning.identify import evaluate as evaluate
    from patagium.learning.identify import identify as identify
    from patagium.learning.learners.cubature import CubatureLearner as CubatureLearner
    from patagium.learning.learners.extended import ExtendedLearner as ExtendedLearner
    from patagium.learning.learners.registry import (
        learner_from_description as learner_from_description,
    )
    from patagium.learning.learners.registry import load_learner as load_learner
    from patagium.learning.model_file import Model as Model
    from patagium.learning.model_file import load_model as load_model
    from patagium.learning.model_file import model_of as model_of
    from patagium.learning.model_file import save_model as save_model
    from patagium.learning.models.dense import DenseNetwork as DenseNetwork
    from patagium.learning.models.grey_box import GreyBox as GreyBox
    from patagium.learning.models.linear_strip import LinearStripNetwork as LinearStripNetwork
    from patagium.learning.models.network import Encoding as Encoding
    from patagium.learning.models.network import Network as Network
    from patagium.learning.models.registry import (
        network_from_description as network_from_description,
    )
    from patagium.learning.models.registry import register_network as register_network
    from patagium.learning.models.strip import StripNetwork as StripNetwork
    from patagium.learning.models.structure import register_blocks as register_blocks
    from patagium.learning.refinement import refine as refine
    from patagium.learning.result import Identification as Identification
    from patagium.learning.result import load_identification as load_identification
    from patagium.learning.settings import ChangeDetection as ChangeDetection
    from patagium.learning.settings import FilterSettings as FilterSettings
    from patagium.learning.settings import Misfit as Misfit
    from patagium.learning.settings import NoiseEstimation as NoiseEstimation
    from patagium.learning.settings import Screening as Screening
    from patagium.learning.stream import stream as stream
    from patagium.learning.table_network import network_for as network_for
    from patagium.learning.tuning.settings_file import Settings as Settings
    from patagium.learning.tuning.settings_file import load_settings as load_settings
    from patagium.learning.tuning.tune import Tuned as Tuned
    from patagium.learning.tuning.tune import tune as tune

_NAMES = {
    "identify": ("evaluate", "identify"),
    "table_network": ("network_for",),
    "default_learner": ("default_learner",),
    "learners.cubature": ("CubatureLearner",),
    "learners.extended": ("ExtendedLearner",),
    "learners.registry": ("learner_from_description", "load_learner"),
    "model_file": ("Model", "load_model", "model_of", "save_model"),
    "models.dense": ("DenseNetwork",),
    "models.grey_box": ("GreyBox",),
    "models.linear_strip": ("LinearStripNetwork",),
    "models.network": ("Encoding", "Network"),
    "models.registry": ("network_from_description", "register_network"),
    "models.strip": ("StripNetwork",),
    "models.structure": ("register_blocks",),
    "refinement": ("refine",),
    "result": ("Identification", "load_identification"),
    "settings": (
        *("ChangeDetection", "FilterSettings", "Misfit", "NoiseEstimation"),
        "Screening",
    ),
    "stream": ("stream",),
    "tuning.settings_file": ("Settings", "load_settings"),
    "tuning.tune": ("Tuned", "tune"),
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names}

__all__ = sorted(_HOMES)


class _Package(ModuleType):
    """Package that imports its names when they are first used."""

    def __getattr__(self, name: str) -> Any:
        if name not in _HOMES:
            from patagium.errors import refuse_removed, unknown_name

            refuse_removed(__name__, name)
            raise unknown_name(__name__, name, __all__)
        value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
        super().__setattr__(name, value)
        return value

    def __setattr__(self, name: str, value: object) -> None:
        if name not in _HOMES or not isinstance(value, ModuleType):  # `identify` is a module, too
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*self.__dict__, *__all__})


sys.modules[__name__].__class__ = _Package
