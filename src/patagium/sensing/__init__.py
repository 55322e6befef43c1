"""Sensors, logs, clocks, motion, and the aerodynamic force from measurements."""

from patagium.errors import suggest_names
from patagium.sensing import sensors
from patagium.sensing.force.air_force import training_data
from patagium.sensing.force.measured_force import (
    ForceSamples,
    cell_wrench,
    inverse_dynamics_force,
    load_cell_force,
    motor_forces,
)
from patagium.sensing.logs.importing.import_log import import_log, read_table
from patagium.sensing.logs.importing.inspection import inspect_log
from patagium.sensing.logs.mapping import TableMapping, load_mapping
from patagium.sensing.logs.record import load_log
from patagium.sensing.logs.sensor_log import sensor_log
from patagium.sensing.logs.table import LogTable
from patagium.sensing.motion.clock_shifts import Shifts, estimate_shifts
from patagium.sensing.motion.estimate_motion import estimate_motion
from patagium.sensing.motion.motion_tracker import MotionTracker
from patagium.sensing.sensors import SensorLog, load_sensor_log, save_sensor_log, sense

__all__ = [
    "ForceSamples",
    "MotionTracker",
    "SensorLog",
    "Shifts",
    "LogTable",
    "TableMapping",
    "cell_wrench",
    "estimate_motion",
    "estimate_shifts",
    "import_log",
    "inspect_log",
    "inverse_dynamics_force",
    "load_cell_force",
    "load_log",
    "load_mapping",
    "load_sensor_log",
    "motor_forces",
    "read_table",
    "save_sensor_log",
    "sense",
    "sensor_log",
    "sensors",
    "training_data",
]
suggest_names(__name__)
