"""Sensor logs as netCDF4 files with one group for each sensor, without the truth.

A file is written whole or not at all.
"""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import netCDF4
import xarray as xr

from patagium.errors import LogError, PatagiumError
from patagium.robot import load_robot_text
from patagium.sensing.sensors.imu import Imu
from patagium.sensing.sensors.joints import Encoder, MotorCurrent
from patagium.sensing.sensors.load_cell import LoadCell
from patagium.sensing.sensors.motion_capture import MotionCapture
from patagium.sensing.sensors.sense import SensorLog
from patagium.sensing.sensors.sensor import Sensor
from patagium.whole_file import whole_file

_KINDS: dict[str, type[Sensor]] = {
    kind.__name__: kind for kind in (Imu, Encoder, MotorCurrent, LoadCell, MotionCapture)
}


def save_sensor_log(log: SensorLog, path: str | Path) -> Path:
    """Write the measurements of a sensor log as netCDF4, whole or not at all.

    Args:
        log: The log; its truth is not written.
        path: The file, replaced if it exists; folders are created.

    Returns:
        Path of the file.

    Raises:
        LogError: If the file cannot be written.
    """
    origin = {"robot": log.robot.source, "robot_name": log.robot.name, "mount": log.mount}
    try:
        with whole_file(path) as draft:
            xr.Dataset(attrs=origin).to_netcdf(draft, mode="w", engine="netcdf4")
            for label, reading in log.readings.items():
                known = json.dumps(log.sensors[label].describe())
                described = reading.assign_attrs(sensor=known)
                described.to_netcdf(draft, mode="a", group=label, engine="netcdf4")
    except OSError as error:
        raise LogError(f"{path}: cannot be written: {error.strerror or error}") from None
    return Path(path)


def load_sensor_log(path: str | Path) -> SensorLog:
    """Sensor log from a file that `save_sensor_log` wrote.

    Args:
        path: The file.

    Returns:
        The log in memory, without any truth.

    Raises:
        LogError: If there is no such file, or the file is no sensor log.
    """
    path = Path(path)
    if not path.exists():
        raise LogError(f"{path}: no such file")
    try:
        with netCDF4.Dataset(str(path)) as whole:
            labels = list(whole.groups)
            origin = {name: str(whole.getncattr(name)) for name in whole.ncattrs()}
        readings = {label: _group(path, label) for label in labels}
        robot = load_robot_text(origin["robot"], origin["robot_name"])
        sensors = {label: _sensor(readings[label].attrs.pop("sensor")) for label in labels}
    except (OSError, KeyError, ValueError, TypeError, PatagiumError) as error:
        raise LogError(f"{path}: expected a sensor log, found: {error}") from None
    return SensorLog(readings, sensors, {}, robot, origin.get("mount", ""))


def _group(path: Path, label: str) -> xr.Dataset:
    with xr.open_dataset(path, group=label, engine="netcdf4", decode_times=False) as opened:
        reading = opened.load()
    for variable in reading.variables.values():
        variable.encoding.clear()
    return reading


def _sensor(text: str) -> Sensor:
    known: dict[str, Any] = json.loads(text)
    kind = _KINDS[known.pop("kind")]
    accepted = {entry.name for entry in fields(kind)}
    # files of the release before call a standard deviation "deviation"
    named = {name.replace("deviation", "std"): _frozen(value) for name, value in known.items()}
    return kind(**{name: value for name, value in named.items() if name in accepted})


def _frozen(value: Any) -> Any:
    return tuple(_frozen(part) for part in value) if isinstance(value, list) else value
