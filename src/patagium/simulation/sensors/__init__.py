"""Sensors of a flight, presets of real parts, and the log they leave."""

from patagium.simulation.sensors import presets
from patagium.simulation.sensors.imu import Imu
from patagium.simulation.sensors.joints import Encoder, MotorCurrent
from patagium.simulation.sensors.load_cell import LoadCell
from patagium.simulation.sensors.log_file import load_sensor_log, save_sensor_log
from patagium.simulation.sensors.motion_capture import (
    MotionCapture,
    as_quaternion,
    from_quaternion,
)
from patagium.simulation.sensors.sense import SensorLog, sense
from patagium.simulation.sensors.sensor import Sensor

__all__ = [
    "Encoder",
    "Imu",
    "LoadCell",
    "MotionCapture",
    "MotorCurrent",
    "Sensor",
    "SensorLog",
    "as_quaternion",
    "from_quaternion",
    "load_sensor_log",
    "presets",
    "save_sensor_log",
    "sense",
]
