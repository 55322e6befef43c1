"""Flights, forces and predictions as recordings of other tools: MCAP and Rerun.

A topic is a variable over time. Its names along the other axes are those of the file, its unit
is in the schema; bodies are frames in the world. Neglected: what is not over time.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from itertools import product
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from patagium.arrays import Array, Indices
from patagium.dynamics.dynamics import poses_at
from patagium.errors import LogError, ParameterError
from patagium.sensing.force.air_force import PARTS, packet_columns
from patagium.simulation import robot_of
from patagium.version import __version__
from patagium.whole_file import whole_file


class Topic(NamedTuple):
    """Quantity over time.

    Attributes:
        name: Name, such as `aero_force`.
        units: SI unit of each number.
        labels: Names of the numbers, such as `left_plunge` or `left_wing[3]/x`.
        values: Numbers, (N, k) [`units`].
    """

    name: str
    units: tuple[str, ...]
    labels: tuple[str, ...]
    values: Array


def topics_of(record: xr.Dataset) -> list[Topic]:
    """Quantities over time of a flight, a stream, a motion or predictions.

    Raises:
        LogError: If there is none.
    """
    others = [str(name) for name in record.data_vars if name not in PARTS]
    columns = packet_columns(robot_of(record, late=True), others) if "robot" in record.attrs else ()
    known, found = {one.name: one.unit for one in columns}, []
    for name, variable in record.data_vars.items():
        if variable.dims[:1] != ("time",) or variable.dtype.kind not in "fiub":
            continue
        axes = [map(str, record[dim].to_numpy()) for dim in variable.dims[1:]]  # or their numbers
        labels = tuple("/".join(names) for names in product(*axes)) if axes else ("value",)
        values = variable.to_numpy().reshape(len(variable), -1).astype(float)
        if values.shape[1]:
            found.append(Topic(str(name), _units(record, variable, labels, known), labels, values))
    if not found:
        raise LogError("file", "quantities over time", "none")
    return found


def _units(
    record: xr.Dataset, variable: xr.DataArray, labels: Sequence[str], known: Mapping[str, str]
) -> tuple[str, ...]:
    """Units of a variable's numbers, by label; `known` has those of variables with several."""
    unit = str(variable.attrs.get("units", ""))
    for dim, units in (("output", "unit"), ("lag", "lag_unit")):
        if variable.dims[1:] == (dim,) and units in record:
            return tuple(map(str, record[units].values))
    if "component" in variable.dims:  # of a wrench
        return tuple("N m" if "moment_" in label else "N" for label in labels)
    own = known if " or " in unit else {}
    return tuple(own.get(f"{variable.name}.{label}", unit) for label in labels)


def body_frames(record: xr.Dataset) -> dict[str, tuple[Array, Array]]:
    """Position, (N, 3) [m], and quaternion x, y, z, w, (N, 4) [1], of each body of the robot.

    Args:
        record: The file; without a robot or its coordinates no body has a frame.
    """
    if "q" not in record or "robot" not in record.attrs:
        return {}
    robot = robot_of(record, late=True)
    q = record["q"].to_numpy()
    if q.shape[1] != robot.coordinate_count:
        return {}
    origins, axes = poses_at(robot, q)
    turns = Rotation.from_matrix(axes.reshape(-1, 3, 3)).as_quat().reshape(len(q), -1, 4)
    return {body.name: (origins[:, k], turns[:, k]) for k, body in enumerate(robot.bodies)}


def export(record: xr.Dataset, path: str | Path) -> Path:
    """Write a record for Foxglove and PlotJuggler (.mcap) or Rerun (.rrd), whole or not at all.

    Args:
        record: A flight, a stream, a motion or predictions, over time.
        path: The file, replaced if it exists.

    Raises:
        ParameterError: If the kind of file is unknown, or the package that writes it is missing.
        LogError: If nothing in it is over time, or the times are none that advance.
        OutputError: If the file cannot be written.
    """
    target = Path(path)
    ending = target.suffix.lower()
    kinds = {
        ".mcap": ("mcap.writer", "export", _write_mcap),
        ".rrd": ("rerun", "rerun", _write_rerun),
    }
    if ending not in kinds:
        table = "a table, in Python: flight.q.to_pandas().to_csv('q.csv')"
        raise ParameterError("out", f"a file of the kind .mcap or .rrd ({table})", target.name)
    package, extra, write = kinds[ending]
    try:
        library = import_module(package)
    except ImportError:
        expected = f"{package.partition('.')[0]}: pip install 'patagium[{extra}]'"
        raise ParameterError("export", expected, None) from None
    if not record.sizes.get("time"):
        raise LogError("file", "samples", "none")
    record = record.transpose("time", ...)
    topics = topics_of(record)
    _check_clock(record["time"].to_numpy())
    with whole_file(target) as draft:
        write(library, draft, record, topics)
    return target


def _check_clock(time: Array) -> None:
    """Refuse a record whose times are not finite, or whose clock was reset and mixes two parts."""
    if not np.isfinite(time).all():
        raise LogError("file", "times", time[~np.isfinite(time)][0])
    back = np.maximum.accumulate(time) - time
    if back.max(initial=0.0) > _LATE:
        row = int((back > _LATE).argmax())
        raise LogError(
            f"file: expected times that advance, found a clock reset by {back[row]:.3g} s; cut it "
            f"at sample {row}, as with ncks -d time,{row},"
        )


def _write_mcap(library: Any, path: Path, record: xr.Dataset, topics: list[Topic]) -> None:
    """Messages in JSON, each with the JSON schema of its topic."""
    times = (record["time"].to_numpy() * 1e9).round().astype(np.int64)
    times = times - min(0, int(times.min(initial=0)))  # stamps of MCAP are no less than zero
    with path.open("wb") as file:
        writer = library.Writer(file)
        writer.start(library=f"patagium {__version__}")
        writer.add_metadata("patagium", {name: str(one) for name, one in record.attrs.items()})
        streams = []
        for one in topics:
            named = zip(one.labels, one.units, strict=True)
            schema = _object(**{k: {"type": "number", "description": unit} for k, unit in named})
            channel = _registered(writer, f"patagium.{one.name}", f"/{one.name}", schema)
            streams.append((channel, _messages(one)))
        frames = body_frames(record)
        if frames:
            channel = _registered(writer, "foxglove.FrameTransforms", "/tf", _FRAMES)
            streams.append((channel, _frame_messages(frames, times)))
        for number, time in enumerate(times.tolist()):
            for channel, messages in streams:
                writer.add_message(channel, time, next(messages).encode(), time, number)
        writer.finish()


def _registered(writer: Any, name: str, topic: str, schema: dict[str, Any]) -> int:
    words = json.dumps(schema).encode()
    known = writer.register_schema(name=name, encoding="jsonschema", data=words)
    return int(writer.register_channel(topic=topic, message_encoding="json", schema_id=known))


def _messages(topic: Topic) -> Iterator[str]:
    """Numbers of each time by name, in JSON, to 12 digits; null for those that are not finite."""
    heads = [json.dumps(label).replace("%", "%%") for label in topic.labels]
    mixed, plain = (
        "{" + ", ".join(f"{head}: {form}" for head in heads) + "}" for form in ("%s", "%.12g")
    )
    lost = set(np.flatnonzero(~np.isfinite(topic.values).all(axis=1)).tolist())
    for k, row in enumerate(topic.values.tolist()):
        if k not in lost:
            yield plain % tuple(row)
        else:
            yield mixed % tuple(repr(one) if isfinite(one) else "null" for one in row)


def _frame_messages(frames: dict[str, tuple[Array, Array]], times: Indices) -> Iterator[str]:
    """Frames of all bodies at each time, in JSON."""
    for k, time in enumerate(times.tolist()):
        seconds, rest = divmod(time, 10**9)
        stamp = {"sec": seconds, "nsec": rest}
        found = []
        for name, (place, turn) in frames.items():
            one = {"timestamp": stamp, "parent_frame_id": "world", "child_frame_id": name}
            one["translation"] = dict(zip("xyz", place[k].tolist(), strict=True))
            one["rotation"] = dict(zip("xyzw", turn[k].tolist(), strict=True))
            found.append(one)
        yield json.dumps({"transforms": found})


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


_LATE = 1.0  # s by which packets may come in another order
_NUMBER = {"type": "number"}
_FRAMES = _object(
    transforms={
        "type": "array",
        "items": _object(
            timestamp=_object(sec={"type": "integer"}, nsec={"type": "integer"}),
            parent_frame_id={"type": "string"},
            child_frame_id={"type": "string"},
            translation=_object(**dict.fromkeys("xyz", _NUMBER)),
            rotation=_object(**dict.fromkeys("xyzw", _NUMBER)),
        ),
    }
)


def _write_rerun(library: Any, path: Path, record: xr.Dataset, topics: list[Topic]) -> None:
    """Scalars of each topic, and the frames of the bodies, over time."""
    recording = library.RecordingStream("patagium")
    recording.save(path)
    time = library.TimeColumn("time", duration=record["time"].to_numpy())
    for topic in topics:
        words = [f"{k} [{unit}]" for k, unit in zip(topic.labels, topic.units, strict=True)]
        recording.log(topic.name, library.SeriesLines(names=words), static=True)
        columns = library.Scalars.columns(scalars=topic.values)
        recording.send_columns(topic.name, indexes=[time], columns=columns)
    for name, (place, turn) in body_frames(record).items():
        columns = library.Transform3D.columns(translation=place, quaternion=turn)
        recording.send_columns(f"world/{name}", indexes=[time], columns=columns)
        recording.log(f"world/{name}", library.TransformAxes3D(0.05), static=True)
    recording.flush()
    recording.disconnect()
