"""Sensors of a flight, presets of real parts, and the log they leave."""

from patagium.errors import suggest_names
from patagium.sensing.sensors import presets
from patagium.sensing.sensors.imu import Imu
from patagium.sensing.sensors.joints import Encoder, MotorCurrent
from patagium.sensing.sensors.load_cell import LoadCell
from patagium.sensing.sensors.motion_capture import MotionCapture, as_quaternion, from_quaternion
from patagium.sensing.sensors.sense import SensorLog, load_sensor_log, save_sensor_log, sense
from patagium.sensing.sensors.sensor import Reading, Sensor, Signal, noise, stepped

__all__ = [
    "Encoder",
    "Imu",
    "LoadCell",
    "MotionCapture",
    "MotorCurrent",
    "Reading",
    "Sensor",
    "SensorLog",
    "Signal",
    "as_quaternion",
    "from_quaternion",
    "load_sensor_log",
    "noise",
    "presets",
    "save_sensor_log",
    "sense",
    "stepped",
]
suggest_names(__name__)
