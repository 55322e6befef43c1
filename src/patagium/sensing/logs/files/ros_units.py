"""Units of the numbers in common ROS messages, by the message definitions."""

from __future__ import annotations

_BY_TYPE = {
    "Imu": (
        ("linear_acceleration_covariance", ""),
        ("angular_velocity_covariance", ""),
        ("linear_acceleration", "m/s^2"),
        ("angular_velocity", "rad/s"),
    ),
    "MagneticField": (("magnetic_field.", "T"),),
    "FluidPressure": (("fluid_pressure", "Pa"),),
    "Temperature": (("temperature", "degC"),),
    "Range": (("range", "m"),),
}
_BY_PATH = (
    ("orientation", "1"),
    ("rotation", "1"),
    ("linear_acceleration", "m/s^2"),
    ("angular_velocity", "rad/s"),
    ("position.", "m"),
    ("translation.", "m"),
    ("point.", "m"),
    ("linear.", "m/s"),
    ("angular.", "rad/s"),
    ("force.", "N"),
    ("torque.", "N m"),
)
_SHARED = ("geometry_msgs", "nav_msgs", "sensor_msgs", "tf2_msgs", "tf")


def unit_in_message(kind: str, path: str) -> str:
    """Unit of a number of a message; empty where the definition states none.

    Args:
        kind: Type of the message, such as `sensor_msgs/msg/Imu`.
        path: Path of the number.
    """
    package, _, name = kind.rpartition("/")
    if package.partition("/")[0] not in _SHARED or "covariance" in path:
        return ""
    for start, unit in _BY_TYPE.get(name, ()):
        if path.startswith(start):
            return unit
    if name.startswith("Accel"):
        return {"l": "m/s^2", "a": "rad/s^2"}.get(path.rpartition(".")[0][-6:][:1], "")
    if name == "JointState":
        return "rad" if path.startswith("position") else "rad/s" if path[:3] == "vel" else "N m"
    words = path if "." in path else ""
    return next((unit for part, unit in _BY_PATH if part in words), "")
