"""Small valid logs of every kind that the program reads, of a body that rocks and climbs.

Tables are written by pandas and SciPy, bags and MCAP by their own libraries, ULog and DataFlash
here, by the layouts of their loggers.
"""

from __future__ import annotations

import json
import struct
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

Words = dict[str, Any]

COUNT = 40
STEP = 5_000_000
"""Time between two samples [ns]."""
START = 1_700_000_000_000_000_000  # ns
TABLE: Words = {
    "time": {"column": "t", "unit": "ms"},
    "inputs": [{"column": ["gx", "gy", "gz"], "unit": "deg/s", "frame": "frd", "name": "rate"}],
    "outputs": [{"column": "fz", "unit": "g_0", "name": "lift", "range": [0, 2]}],
}
"""Mapping of the table."""
ROS: Words = {
    "time": {"rate": "100 Hz"},
    "inputs": [
        {"topic": "/imu", "field": "angular_velocity", "frame": "flu", "unit": "rad/s"},
    ],
    "outputs": [{"topic": "/imu", "field": "linear_acceleration.z", "unit": "m/s^2"}],
}
"""Mapping of a bag."""
JSON: Words = {
    "channels": [
        {"topic": "sample", "field": "force", "frame": "frd", "unit": "N"},
        {"topic": "sample", "field": "angles[1]", "unit": "1"},
    ]
}
"""Mapping of an MCAP file of JSON messages."""
ULOG: Words = {
    "inputs": [{"topic": "imu", "field": "gyro", "frame": "frd", "unit": "rad/s"}],
    "outputs": [{"topic": "imu", "field": "accel", "frame": "frd", "unit": "m/s^2"}],
}
"""Mapping of a ULog file."""
DATAFLASH: Words = {
    "time": {"rate": "100 Hz"},
    "channels": [
        {"topic": "IMU", "field": ["GyrX", "GyrY", "GyrZ"], "frame": "frd", "unit": "rad/s",
         "name": "rate"},
        {"topic": "ATT", "field": "Roll", "unit": "deg", "name": "roll"},
    ],
}  # fmt: skip
"""Mapping of a DataFlash log."""


def table() -> pd.DataFrame:
    """Table of a rocking body: t [ms], rates [deg/s], force [g]."""
    k = np.arange(COUNT)
    return pd.DataFrame(
        {
            "t": 2.0 * k,
            "gx": 10 * np.sin(0.05 * k),
            "gy": 5 + 0.01 * k,
            "gz": np.cos(0.1 * k),
            "fz": 1 + 0.1 * np.sin(0.2 * k),
        }
    )


def recordings(folder: Path) -> dict[str, tuple[Path, Words]]:
    """Log of each kind and its mapping, by the name of the kind.

    Args:
        folder: Folder to write to.
    """
    for name, content, _ in _contents().values():
        (folder / name).write_bytes(content)
    return {kind: (folder / name, words) for kind, (name, _, words) in _contents().items()}


@cache
def _contents() -> dict[str, tuple[str, bytes, Words]]:
    """Name and content of the log of each kind, and its mapping."""
    with tempfile.TemporaryDirectory(prefix="patagium-") as folder:
        made = _made(Path(folder))
        return {kind: (path.name, path.read_bytes(), words) for kind, (path, words) in made.items()}


def _made(folder: Path) -> dict[str, tuple[Path, Words]]:
    table().to_csv(folder / "log.csv", index=False)
    table().to_csv(folder / "log.csv.gz", index=False)
    table().to_parquet(folder / "log.parquet")
    from scipy.io import savemat

    savemat(folder / "log.mat", {name: column.to_numpy() for name, column in table().items()})
    return {
        "CSV": (folder / "log.csv", TABLE),
        "gzipped CSV": (folder / "log.csv.gz", TABLE),
        "Parquet": (folder / "log.parquet", TABLE),
        "MAT": (folder / "log.mat", TABLE),
        "ROS 1 bag": (_bag(folder / "log.bag"), ROS),
        "ROS 2 bag": (_bag_folder(folder / "ros2"), ROS),
        "MCAP": (_mcap(folder / "log.mcap"), JSON),
        "ULog": (_ulog(folder / "log.ulg"), ULOG),
        "DataFlash": (_dataflash(folder / "log.BIN"), DATAFLASH),
    }


def _imu(types: Any, k: int, ros1: bool) -> Any:
    """Message of the IMU at sample k."""
    make, stamp = types.types, START + k * STEP
    time = make["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    more = {"seq": k} if ros1 else {}
    vector = make["geometry_msgs/msg/Vector3"]
    return make["sensor_msgs/msg/Imu"](
        header=make["std_msgs/msg/Header"](stamp=time, frame_id="base", **more),
        orientation=make["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        orientation_covariance=np.zeros(9),
        angular_velocity=vector(float(np.cos(0.1 * k)), 0.0, 0.0),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(0.0, float(np.sin(0.1 * k)), 9.81),
        linear_acceleration_covariance=np.zeros(9),
    )


def _bag(file: Path) -> Path:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types, kind = get_typestore(Stores.ROS1_NOETIC), "sensor_msgs/msg/Imu"
    with Writer(file) as writer:
        topic = writer.add_connection("/imu", kind, typestore=types)
        for k in range(COUNT):
            content = types.serialize_ros1(_imu(types, k, ros1=True), kind)
            writer.write(topic, START + k * STEP, content)
    return file


def _bag_folder(folder: Path) -> Path:
    """Database of a ROS 2 bag."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types, kind = get_typestore(Stores.ROS2_HUMBLE), "sensor_msgs/msg/Imu"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection("/imu", kind, typestore=types)
        for k in range(COUNT):
            content = types.serialize_cdr(_imu(types, k, ros1=False), kind)
            writer.write(topic, START + k * STEP, content)
    return next(folder.glob("*.db3"))


def _mcap(file: Path) -> Path:
    from mcap.writer import CompressionType, Writer

    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.LZ4, chunk_size=4096)
        writer.start()
        schema = writer.register_schema(name="Sample", encoding="jsonschema", data=b"{}")
        channel = writer.register_channel(topic="sample", message_encoding="json", schema_id=schema)
        for k in range(COUNT):
            stamp, t = START + k * STEP, k * STEP * 1e-9
            force = {"x": t, "y": 2 * t, "z": 3 * t}
            words = {"timestamp": {"sec": stamp // 10**9, "nsec": stamp % 10**9}, "force": force}
            content = json.dumps({**words, "angles": [t, -t]}).encode()
            writer.add_message(channel, log_time=stamp, publish_time=stamp, data=content)
        writer.finish()  # type: ignore[no-untyped-call]
    return file


def _ulog(file: Path) -> Path:
    def part(kind: str, content: bytes) -> bytes:
        return struct.pack("<HB", len(content), ord(kind)) + content

    fields = b"imu:uint64_t timestamp;float[3] gyro;float[3] accel;"
    content = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), part("B", bytes(40))]
    content += [part("F", fields), part("A", struct.pack("<BH", 0, 0) + b"imu")]
    for k in range(COUNT):
        numbers = (np.cos(0.1 * k), 0.0, 0.0, 0.0, np.sin(0.1 * k), -9.81)
        content.append(part("D", struct.pack("<HQ6f", 0, k * STEP // 1000, *numbers)))
    file.write_bytes(b"".join(content))
    return file


def _dataflash(file: Path) -> Path:
    formats = [
        (128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", "<BB4s16s64s"),
        (131, "IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", "<QB6f"),
        (132, "ATT", "QcN", "TimeUS,Roll,Mode", "<Qh16s"),
    ]
    packed = {kind: struct.Struct(layout) for kind, *_, layout in formats}

    def message(kind: int, *numbers: Any) -> bytes:
        return b"\xa3\x95" + bytes([kind]) + packed[kind].pack(*numbers)

    content = [
        message(128, kind, packed[kind].size + 3, name.encode(), letters.encode(), columns.encode())
        for kind, name, letters, columns, _ in formats
    ]
    for k in range(COUNT):
        numbers = (np.cos(0.1 * k), 0.0, 0.0, 0.0, np.sin(0.1 * k), -9.81)
        content.append(message(131, k * STEP // 1000, 0, *numbers))
        content.append(message(132, k * STEP // 1000, round(100 * np.sin(0.1 * k)), b"LOITER"))
    file.write_bytes(b"".join(content))
    return file
