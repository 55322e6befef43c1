from patagium.sensing.sensors import presets as presets
from patagium.sensing.sensors.imu import Imu as Imu
from patagium.sensing.sensors.joints import Encoder as Encoder
from patagium.sensing.sensors.joints import MotorCurrent as MotorCurrent
from patagium.sensing.sensors.load_cell import LoadCell as LoadCell
from patagium.sensing.sensors.motion_capture import MotionCapture as MotionCapture
from patagium.sensing.sensors.motion_capture import as_quaternion as as_quaternion
from patagium.sensing.sensors.motion_capture import from_quaternion as from_quaternion
from patagium.sensing.sensors.sense import SensorLog as SensorLog
from patagium.sensing.sensors.sense import load_sensor_log as load_sensor_log
from patagium.sensing.sensors.sense import save_sensor_log as save_sensor_log
from patagium.sensing.sensors.sense import sense as sense
from patagium.sensing.sensors.sensor import Reading as Reading
from patagium.sensing.sensors.sensor import Sensor as Sensor
from patagium.sensing.sensors.sensor import Signal as Signal
from patagium.sensing.sensors.sensor import noise as noise
from patagium.sensing.sensors.sensor import stepped as stepped

__all__: list[str]
