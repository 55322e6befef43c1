"""Bags and MCAP files as their own libraries write them, of a robot that rocks and climbs.

The body rolls by 0.5 sin(2 t) rad, climbs at a speed of sin(t) m/s; its IMU is exact. All in ROS
axes, which are ours.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

START = 1_700_000_000_000_000_000  # ns
DELAY = 3_000_000  # ns from the stamp to the log
STEP = 5_000_000  # ns
COUNT = 600


def roll(t: float) -> float:
    return float(0.5 * np.sin(2 * t))


def rolling(t: float) -> float:
    return float(np.cos(2 * t))


def climb(t: float) -> float:
    return float(np.sin(t))


def specific_force(t: float) -> tuple[float, float, float]:
    upward = np.cos(t) + 9.80665
    return 0.0, float(np.sin(roll(t)) * upward), float(np.cos(roll(t)) * upward)


def messages(types: Any, *, ros1: bool = False, tf: bool = True) -> Iterator[tuple[Any, ...]]:
    """Topic, type, stamp of receiving, message; the IMU at 200 Hz, others at 100 Hz."""
    make = types.types
    for k in range(COUNT):
        stamp, t = START + k * STEP, k * STEP * 1e-9
        header = _header(make, stamp, ros1)
        vector, quaternion = make["geometry_msgs/msg/Vector3"], make["geometry_msgs/msg/Quaternion"]
        attitude = quaternion(np.sin(roll(t) / 2), 0.0, 0.0, np.cos(roll(t) / 2))
        imu = make["sensor_msgs/msg/Imu"](
            header=header,
            orientation=attitude,
            orientation_covariance=np.zeros(9),
            angular_velocity=vector(rolling(t), 0.0, 0.0),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=vector(*specific_force(t)),
            linear_acceleration_covariance=np.zeros(9),
        )
        yield "/imu", "sensor_msgs/msg/Imu", stamp + DELAY, imu
        if k % 2:
            continue
        names = ["right_plunge", "left_plunge"] if k % 4 else ["left_plunge", "right_plunge"]
        angles = {"left_plunge": 0.6 * np.sin(30 * t), "right_plunge": -0.2}
        joints = make["sensor_msgs/msg/JointState"](
            header=header,
            name=names,
            position=np.array([angles[name] for name in names]),
            velocity=np.zeros(2),
            effort=np.zeros(0),
        )
        yield "/joints", "sensor_msgs/msg/JointState", stamp + DELAY, joints
        twist = make["geometry_msgs/msg/TwistStamped"](
            header=header,
            twist=make["geometry_msgs/msg/Twist"](
                linear=vector(0.0, 0.0, climb(t)), angular=vector(0.0, 0.0, 0.0)
            ),
        )
        yield "/velocity", "geometry_msgs/msg/TwistStamped", stamp + DELAY, twist
        level = make["std_msgs/msg/Float64MultiArray"](
            layout=make["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0),
            data=np.array([t, 2 * t, 3 * t]),
        )
        yield "/levels", "std_msgs/msg/Float64MultiArray", stamp + DELAY, level
        if tf:
            moved = make["geometry_msgs/msg/TransformStamped"](
                header=header,
                child_frame_id="wing/left",
                transform=make["geometry_msgs/msg/Transform"](
                    translation=vector(t, 0.0, 0.0), rotation=attitude
                ),
            )
            yield "/tf", "tf2_msgs/msg/TFMessage", stamp + DELAY, _transforms(make, moved)


def _header(make: Any, stamp: int, ros1: bool) -> Any:
    time = make["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    more = {"seq": 0} if ros1 else {}
    return make["std_msgs/msg/Header"](stamp=time, frame_id="base", **more)


def _transforms(make: Any, moved: Any) -> Any:
    return make["tf2_msgs/msg/TFMessage"](transforms=[moved])


def write_ros2(
    folder: Path, *, storage: str = "sqlite3", compression: str = "", part: slice = slice(None)
) -> Path:
    """A ROS 2 bag: a folder."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin[storage.upper()])
    if compression:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for topic, kind, stamp, message in list(messages(types))[part]:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=types)
            writer.write(connections[topic], stamp, types.serialize_cdr(message, kind))
    return folder


def write_ros1(file: Path, *, compression: str = "", part: slice = slice(None)) -> Path:
    """A ROS 1 bag."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    writer = Writer(file)
    if compression:
        writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        connections: dict[str, Any] = {}
        for topic, kind, stamp, message in list(messages(types, ros1=True, tf=False))[part]:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=types)
            writer.write(connections[topic], stamp, types.serialize_ros1(message, kind))
    return file


def write_json(file: Path, *, finish: bool = True) -> Path:
    """An MCAP file of JSON messages with Foxglove's time; one not finished has no index."""
    from mcap.writer import CompressionType, Writer

    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.LZ4, chunk_size=4096)
        writer.start()
        schema = writer.register_schema(name="Sample", encoding="jsonschema", data=b"{}")
        channel = writer.register_channel(topic="sample", message_encoding="json", schema_id=schema)
        for k in range(400):
            stamp, t = START + k * STEP, k * STEP * 1e-9
            words = {
                "timestamp": {"sec": stamp // 10**9, "nsec": stamp % 10**9},
                "force": {"x": t, "y": 2 * t, "z": 3 * t},
                "angles": [t, -t],
            }
            writer.add_message(
                channel, log_time=stamp + DELAY, publish_time=stamp, data=json.dumps(words).encode()
            )
        if finish:
            writer.finish()
    return file


def write_ros1_mcap(file: Path) -> Path:
    """An MCAP file with the IMU as ROS 1 serializes it."""
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    definition, _ = types.generate_msgdef("sensor_msgs/msg/Imu")
    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros1")
        schema = writer.register_schema("sensor_msgs/Imu", "ros1msg", definition.encode())
        channel = writer.register_channel("/imu", "ros1", schema)
        for topic, kind, stamp, message in list(messages(types, ros1=True, tf=False))[:300]:
            if topic == "/imu":
                content = bytes(types.serialize_ros1(message, kind))
                writer.add_message(channel, stamp, content, stamp)
        writer.finish()
    return file


def write_idl(file: Path) -> Path:
    """An MCAP file with vectors (t, 0, 0) that .idl files describe, as rosbag2 writes them."""
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    held = {
        "geometry_msgs/msg/Vector3Stamped": (
            "std_msgs::msg::Header header; geometry_msgs::msg::Vector3 vector;",
            "geometry_msgs/msg/Vector3",
            "std_msgs/msg/Header",
        ),
        "geometry_msgs/msg/Vector3": ("double x; double y; double z;",),
        "std_msgs/msg/Header": (
            "builtin_interfaces::msg::Time stamp; string frame_id;",
            "builtin_interfaces/msg/Time",
        ),
        "builtin_interfaces/msg/Time": ("int32 sec; uint32 nanosec;",),
    }
    text = ""
    for kind, (fields, *others) in held.items():
        package, _, name = kind.split("/")
        text += f"{'=' * 80}\nIDL: {kind}\n// a comment\n"
        text += "".join(f'#include "{other}.idl"\n' for other in others)
        text += f"module {package} {{ module msg {{ struct {name} {{ {fields} }}; }}; }};\n"
    kind, make = next(iter(held)), types.types
    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema(kind, "ros2idl", text.encode())
        channel = writer.register_channel("v", "cdr", schema)
        for k in range(100):
            header = _header(make, START + k * STEP, ros1=False)
            vector = make["geometry_msgs/msg/Vector3"](k * STEP * 1e-9, 0.0, 0.0)
            content = bytes(types.serialize_cdr(make[kind](header, vector), kind))
            writer.add_message(channel, START + k * STEP + DELAY, content, START)
        writer.finish()
    return file


def write_protobuf(file: Path) -> Path:
    """An MCAP file with points (t, 2 t, 3 t) as Protobuf."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap.writer import Writer

    number, message = 1, 11  # of FieldDescriptorProto.Type: double, message
    described = descriptor_pb2.FileDescriptorProto(name="p.proto", package="p", syntax="proto3")
    inner = described.message_type.add(name="Point")
    for index, name in enumerate("xyz", 1):
        inner.field.add(name=name, number=index, type=number, label=1)
    outer = described.message_type.add(name="Sample")
    outer.field.add(name="point", number=1, type=message, label=1, type_name=".p.Point")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(described)
    make = message_factory.GetMessageClass(pool.FindMessageTypeByName("p.Sample"))
    files = descriptor_pb2.FileDescriptorSet(file=[described])
    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("p.Sample", "protobuf", files.SerializeToString())
        channel = writer.register_channel("v", "protobuf", schema)
        for k in range(100):
            t = k * STEP * 1e-9
            content = make(point={"x": t, "y": 2 * t, "z": 3 * t}).SerializeToString()
            writer.add_message(channel, START + k * STEP, content, START)
        writer.finish()
    return file


def write_ulog(file: Path, count: int = 300, step: int = STEP) -> Path:
    """A ULog file with a topic `imu`, at 200 Hz: the body's rates and specific force, z down."""
    fields = b"imu:uint64_t timestamp;float[3] gyro;float[3] accel;"
    content = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)]
    content.append(_part("B", bytes(40)))
    content.append(_part("F", fields))
    content.append(_part("A", struct.pack("<BH", 0, 0) + b"imu"))
    for k in range(count):
        t = k * step * 1e-9
        x, y, z = specific_force(t)
        row = struct.pack("<HQ6f", 0, k * step // 1000, rolling(t), 0.0, 0.0, x, -y, -z)
        content.append(_part("D", row))
    file.write_bytes(b"".join(content))
    return file


def _part(kind: str, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), ord(kind)) + content


def write_dataflash(file: Path, count: int = 300) -> Path:
    """A DataFlash log with two instances of IMU at 200 Hz, z down, and angles in centidegrees.

    Its formats are those of ArduPilot's logger: FMT describes itself first.
    """
    formats = [
        (128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", "<BB4s16s64s"),
        (129, "UNIT", "QbZ", "TimeUS,Id,Label", "<Qb64s"),
        (130, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "<QB16s16s"),
        (131, "IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", "<QB6f"),
        (132, "ATT", "QcCN", "TimeUS,Roll,Yaw,Mode", "<QhH16s"),
    ]
    packed = {kind: struct.Struct(layout) for kind, *_, layout in formats}

    def message(kind: int, *numbers: Any) -> bytes:
        return b"\xa3\x95" + bytes([kind]) + packed[kind].pack(*numbers)

    content = [
        message(128, kind, packed[kind].size + 3, name.encode(), letters.encode(), columns.encode())
        for kind, name, letters, columns, _ in formats
    ]
    units = {"s": "s", "E": "rad/s", "o": "m/s/s", "#": "instance", "d": "deg",
             "h": "degheading"}  # fmt: skip
    content += [message(129, 0, ord(key), label.encode()) for key, label in units.items()]
    content.append(message(130, 0, 131, b"s#EEEooo", b"F-000000"))
    content.append(message(130, 0, 132, b"sdh-", b"FBB-"))
    for k in range(count):
        t = k * STEP * 1e-9
        x, y, z = specific_force(t)
        for instance in (0, 1):
            numbers = (rolling(t) + instance, 0.0, 0.0, x, -y, -z)
            content.append(message(131, k * STEP // 1000, instance, *numbers))
        if k % 4 == 0:
            degrees = round(1e2 * float(np.degrees(roll(t))))
            yaw = round(1e2 * ((4 * t - 3) % 360))  # by north
            content.append(message(132, k * STEP // 1000, degrees, yaw, b"LOITER"))
    file.write_bytes(b"".join(content))
    return file


class Recordings(NamedTuple):
    """Writers of logs, and what the robot in them did."""

    ros1: Callable[..., Path] = write_ros1
    ros2: Callable[..., Path] = write_ros2
    json: Callable[..., Path] = write_json
    ulog: Callable[..., Path] = write_ulog
    dataflash: Callable[..., Path] = write_dataflash
    ros1_mcap: Callable[..., Path] = write_ros1_mcap
    idl: Callable[..., Path] = write_idl
    protobuf: Callable[..., Path] = write_protobuf
    roll: Callable[[float], float] = roll
    rolling: Callable[[float], float] = rolling
    climb: Callable[[float], float] = climb
    specific_force: Callable[[float], tuple[float, float, float]] = specific_force
    count: int = COUNT


@pytest.fixture(scope="session")
def recordings() -> Recordings:
    """Writers of logs by the libraries of their formats."""
    pytest.importorskip("rosbags", reason="bags need the extra patagium[logs]")
    pytest.importorskip("mcap", reason="MCAP needs the extra patagium[logs]")
    pytest.importorskip("pyulog", reason="ULog needs the extra patagium[logs]")
    return Recordings()
