"""What we learn: networks, learners, training data, the online stream and its scores."""

from patagium.identification.filters.change import ChangeDetection
from patagium.identification.filters.screening import NoiseEstimation, Screening
from patagium.identification.forces.momentum_observer import MomentumObserver, momentum_force
from patagium.identification.forces.samples import ForceSamples
from patagium.identification.forces.sources import (
    cell_wrench,
    inverse_dynamics_force,
    load_cell_force,
    motor_forces,
)
from patagium.identification.forces.training_data import training_data
from patagium.identification.identify import evaluate, identify
from patagium.identification.learners.cubature import CubatureLearner
from patagium.identification.learners.description import learner_from_description
from patagium.identification.learners.extended import ExtendedLearner
from patagium.identification.learners.file import load_learner, save_learner
from patagium.identification.learners.gradient import GradientLearner
from patagium.identification.learners.linear import LinearLearner
from patagium.identification.live.autosave import AutoSave
from patagium.identification.live.pipeline import Pipeline
from patagium.identification.logs.importing.inspection import inspect_log
from patagium.identification.logs.importing.run import import_log
from patagium.identification.logs.log import evaluate_table, identify_table, network_for
from patagium.identification.logs.mapping import TableMapping, load_mapping
from patagium.identification.logs.record import load_log
from patagium.identification.logs.table import Table, read_table
from patagium.identification.model_file import Model, load_model, model_of, save_model
from patagium.identification.motion.clocks import Shifts, estimate_shifts
from patagium.identification.motion.estimate import estimate_motion
from patagium.identification.motion.smoothers import Kalman, SavitzkyGolay, Spline
from patagium.identification.motion.tracker import MotionTracker
from patagium.identification.networks.dense import DenseNetwork
from patagium.identification.networks.flow import FlowNetwork
from patagium.identification.networks.grey_box import GreyBox
from patagium.identification.networks.hidden import HiddenStripNetwork
from patagium.identification.networks.hidden_flow import HiddenFlowNetwork
from patagium.identification.networks.network import network_from_description
from patagium.identification.networks.strip import StripNetwork
from patagium.identification.networks.structure import LowRank
from patagium.identification.refinement import refine
from patagium.identification.result import Identification, load_identification
from patagium.identification.stream import stream
from patagium.identification.tuning.settings import Settings, load_settings
from patagium.identification.tuning.tune import Tuned, tune

__all__ = [
    "AutoSave",
    "ChangeDetection",
    "CubatureLearner",
    "DenseNetwork",
    "ExtendedLearner",
    "FlowNetwork",
    "ForceSamples",
    "GradientLearner",
    "GreyBox",
    "HiddenFlowNetwork",
    "HiddenStripNetwork",
    "Identification",
    "Kalman",
    "LinearLearner",
    "LowRank",
    "Model",
    "MomentumObserver",
    "MotionTracker",
    "NoiseEstimation",
    "Pipeline",
    "SavitzkyGolay",
    "Screening",
    "Settings",
    "Shifts",
    "Spline",
    "StripNetwork",
    "Table",
    "TableMapping",
    "Tuned",
    "cell_wrench",
    "estimate_motion",
    "estimate_shifts",
    "evaluate",
    "evaluate_table",
    "identify",
    "identify_table",
    "import_log",
    "inspect_log",
    "inverse_dynamics_force",
    "learner_from_description",
    "load_cell_force",
    "load_identification",
    "load_learner",
    "load_log",
    "load_mapping",
    "load_model",
    "load_settings",
    "model_of",
    "momentum_force",
    "motor_forces",
    "network_for",
    "network_from_description",
    "read_table",
    "refine",
    "save_learner",
    "save_model",
    "stream",
    "training_data",
    "tune",
]
