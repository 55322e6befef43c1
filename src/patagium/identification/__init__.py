"""What we learn: networks, learners, training data, the online stream and its scores."""

from patagium.identification.autosave import AutoSave
from patagium.identification.change import ChangeDetection
from patagium.identification.clocks import Shifts, estimate_shifts
from patagium.identification.cubature import CubatureLearner
from patagium.identification.dense import DenseNetwork
from patagium.identification.extended import ExtendedLearner
from patagium.identification.flow import FlowNetwork
from patagium.identification.force_samples import ForceSamples
from patagium.identification.force_sources import (
    cell_wrench,
    inverse_dynamics_force,
    load_cell_force,
    motor_forces,
)
from patagium.identification.gradient import GradientLearner
from patagium.identification.grey_box import GreyBox
from patagium.identification.hidden import HiddenStripNetwork
from patagium.identification.hidden_flow import HiddenFlowNetwork
from patagium.identification.identify import evaluate, identify
from patagium.identification.importing.inspection import inspect_log
from patagium.identification.importing.run import import_log
from patagium.identification.learner_description import learner_from_description
from patagium.identification.learner_file import load_learner, save_learner
from patagium.identification.linear import LinearLearner
from patagium.identification.log_record import load_log
from patagium.identification.logs import evaluate_table, identify_table, network_for
from patagium.identification.mapping import TableMapping, load_mapping
from patagium.identification.model_file import Model, load_model, model_of, save_model
from patagium.identification.momentum_observer import MomentumObserver, momentum_force
from patagium.identification.motion import estimate_motion
from patagium.identification.motion_tracker import MotionTracker
from patagium.identification.network import network_from_description
from patagium.identification.pipeline import Pipeline
from patagium.identification.refinement import refine
from patagium.identification.result import Identification, load_identification
from patagium.identification.screening import NoiseEstimation, Screening
from patagium.identification.settings import Settings, load_settings
from patagium.identification.smoothers import Kalman, SavitzkyGolay, Spline
from patagium.identification.stream import stream
from patagium.identification.strip import StripNetwork
from patagium.identification.structure import LowRank
from patagium.identification.table import Table, read_table
from patagium.identification.training_data import training_data
from patagium.identification.tune import Tuned, tune

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
