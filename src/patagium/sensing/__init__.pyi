from patagium.sensing import sensors as sensors
from patagium.sensing.force.air_force import training_data as training_data
from patagium.sensing.force.measured_force import ForceSamples as ForceSamples
from patagium.sensing.force.measured_force import cell_wrench as cell_wrench
from patagium.sensing.force.measured_force import inverse_dynamics_force as inverse_dynamics_force
from patagium.sensing.force.measured_force import load_cell_force as load_cell_force
from patagium.sensing.force.measured_force import motor_forces as motor_forces
from patagium.sensing.logs.importing.import_log import import_log as import_log
from patagium.sensing.logs.importing.import_log import read_table as read_table
from patagium.sensing.logs.importing.inspection import inspect_log as inspect_log
from patagium.sensing.logs.mapping import TableMapping as TableMapping
from patagium.sensing.logs.mapping import load_mapping as load_mapping
from patagium.sensing.logs.record import load_log as load_log
from patagium.sensing.logs.sensor_log import sensor_log as sensor_log
from patagium.sensing.logs.table import LogTable as LogTable
from patagium.sensing.motion.clock_shifts import Shifts as Shifts
from patagium.sensing.motion.clock_shifts import estimate_shifts as estimate_shifts
from patagium.sensing.motion.estimate_motion import estimate_motion as estimate_motion
from patagium.sensing.motion.motion_tracker import MotionTracker as MotionTracker
from patagium.sensing.sensors import SensorLog as SensorLog
from patagium.sensing.sensors import load_sensor_log as load_sensor_log
from patagium.sensing.sensors import save_sensor_log as save_sensor_log
from patagium.sensing.sensors import sense as sense

__all__: list[str]
