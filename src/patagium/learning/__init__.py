"""Models of the air learned from samples: settings, models, filters, learners, scores, tuning."""

from patagium.learning.identify import evaluate, identify
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.description import learner_from_description
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.file import load_learner, save_learner
from patagium.learning.learners.gradient import GradientLearner
from patagium.learning.learners.linear import LinearLearner
from patagium.learning.model_file import Model, load_model, model_of, save_model
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.flow import FlowNetwork
from patagium.learning.models.grey_box import GreyBox
from patagium.learning.models.hidden import HiddenStripNetwork
from patagium.learning.models.hidden_flow import HiddenFlowNetwork
from patagium.learning.models.network import network_from_description
from patagium.learning.models.strip import StripNetwork
from patagium.learning.refinement import refine
from patagium.learning.result import Identification, load_identification
from patagium.learning.settings import ChangeDetection, LowRank, NoiseEstimation, Screening
from patagium.learning.stream import stream
from patagium.learning.tables import evaluate_table, identify_table, network_for
from patagium.learning.tuning.settings import Settings, load_settings
from patagium.learning.tuning.tune import Tuned, tune

__all__ = [
    "ChangeDetection",
    "CubatureLearner",
    "DenseNetwork",
    "ExtendedLearner",
    "FlowNetwork",
    "GradientLearner",
    "GreyBox",
    "HiddenFlowNetwork",
    "HiddenStripNetwork",
    "Identification",
    "LinearLearner",
    "LowRank",
    "Model",
    "NoiseEstimation",
    "Screening",
    "Settings",
    "StripNetwork",
    "Tuned",
    "evaluate",
    "evaluate_table",
    "identify",
    "identify_table",
    "learner_from_description",
    "load_identification",
    "load_learner",
    "load_model",
    "load_settings",
    "model_of",
    "network_for",
    "network_from_description",
    "refine",
    "save_learner",
    "save_model",
    "stream",
    "tune",
]
