"""Flights, forces and predictions as recordings of other tools: MCAP and Rerun.

A topic is a variable over time, that of samples, of a controller or of updates. Its names along
the other axes are those of the file, its unit is in the schema; bodies are frames in the world.
Neglected: what is not over time.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from heapq import merge
from importlib import import_module
from itertools import count, product, repeat
from math import isfinite
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from patagium.arrays import Array
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
        time: Their times, (N,) [s].
    """

    name: str
    units: tuple[str, ...]
    labels: tuple[str, ...]
    values: Array
    time: Array


def topics_of(record: xr.Dataset) -> list[Topic]:
    """Quantities over time of a flight, a stream, a motion or predictions.

    Raises:
        LogError: If there is none.
    """
    others = [str(name) for name in record.data_vars if name not in PARTS]
    columns = packet_columns(robot_of(record, late=True), others) if "robot" in record.attrs else ()
    known, clocks = {one.name: one.unit for one in columns}, {*_clocks(record)}
    found = []
    for name, variable in record.data_vars.items():
        if not {*variable.dims[:1]} & clocks or variable.dtype.kind not in "fiub":
            continue
        axes = [map(str, record[dim].to_numpy()) for dim in variable.dims[1:]]  # or their numbers
        labels = tuple("/".join(names) for names in product(*axes)) if axes else ("value",)
        values = variable.to_numpy().reshape(len(variable), -1).astype(float)
        if values.size:
            units, time = _units(record, variable, labels, known), variable[variable.dims[0]]
            found.append(Topic(str(name), units, labels, values, time.to_numpy()))
    if not found:
        raise LogError("file", "quantities over time", "none")
    return found


def _clocks(record: xr.Dataset) -> list[str]:
    """Dimensions of times, such as `time` and `control_time`."""
    return [str(dim) for dim in record.sizes if f"_{dim}".endswith("_time")]


def _units(
    record: xr.Dataset, variable: xr.DataArray, labels: Sequence[str], known: Mapping[str, str]
) -> tuple[str, ...]:
    """Units of a variable's numbers, by label; `known` has those of variables with several."""
    unit = str(variable.attrs.get("units", ""))
    for dim, units in (("output", "unit"), ("lag", "lag_unit")):
        if variable.dims[1:] == (dim,) and units in record:
            return tuple(map(str, record[units].values))
    if "state" in variable.dims and known:  # of a controller: q, then v, as a packet after its time
        return tuple(known.values())[1 : 1 + len(labels)]
    if "component" in variable.dims:  # of a wrench
        return tuple("N m" if "moment_" in label else "N" for label in labels)
    own = known if " or " in unit else {}
    return tuple(own.get(f"{variable.name}.{label}", unit) for label in labels)


def body_frames(record: xr.Dataset) -> dict[str, tuple[Array, Array]]:
    """Position, (N, 3) [m], and quaternion x, y, z, w, (N, 4) [1], of each body of the robot.

    Args:
        record: The file, whose q is finite; without a robot or its q no body has a frame.
    """
    if "q" not in record or "robot" not in record.attrs:
        return {}
    robot = robot_of(record, late=True)
    q = record["q"].to_numpy()
    if not len(q) or q.shape[1] != robot.coordinate_count:
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
    record = record.transpose(*_clocks(record), ...)
    topics = topics_of(record)
    for clock in _clocks(record):
        _check_clock(clock, record[clock].to_numpy())
    if "q" in record and "robot" in record.attrs:  # for frames, at the times that have them
        record = record[["q"]].isel(time=np.isfinite(record["q"].to_numpy()).all(axis=1))
    with whole_file(target) as draft:
        write(library, draft, record, topics)
    return target


def _check_clock(clock: str, time: Array) -> None:
    """Refuse a record whose times are not finite, or whose clock was reset and mixes two parts."""
    if not np.isfinite(time).all():
        raise LogError("file", "times", time[~np.isfinite(time)][0])
    back = np.maximum.accumulate(time) - time
    if back.max(initial=0.0) > _LATE:
        row = int((back > _LATE).argmax())
        raise LogError(
            f"file: expected times that advance, found a clock reset by {back[row]:.3g} s; cut it "
            f"at sample {row}, as with ncks -d {clock},{row},"
        )


def _write_mcap(library: Any, path: Path, record: xr.Dataset, topics: list[Topic]) -> None:
    """Messages in JSON, each with the JSON schema of its topic, in the order of their stamps."""
    first = min(0.0, *(one.time.min() for one in topics))  # stamps of MCAP are no less than zero
    known, streams = [], []
    for one in topics:
        named = zip(one.labels, one.units, strict=True)
        schema = _object(**{k: {"type": "number", "description": unit} for k, unit in named})
        times = _stamps(one.time - first)
        known.append((f"patagium.{one.name}", f"/{one.name}", schema, times, _messages(one)))
    frames, times = body_frames(record), _stamps(record["time"].to_numpy() - first)
    if frames:
        messages = _frame_messages(frames, times)
        known.append(("foxglove.FrameTransforms", "/tf", _FRAMES, times, messages))
    with path.open("wb") as file:
        writer = library.Writer(file)
        writer.start(library=f"patagium {__version__}")
        writer.add_metadata("patagium", {name: str(one) for name, one in record.attrs.items()})
        for name, topic, schema, times, messages in known:
            words = json.dumps(schema).encode()
            kind = writer.register_schema(name=name, encoding="jsonschema", data=words)
            channel = writer.register_channel(topic=topic, message_encoding="json", schema_id=kind)
            streams.append(zip(times, repeat(channel), count(), messages, strict=False))
        for time, channel, number, message in merge(*streams, key=itemgetter(0)):
            writer.add_message(channel, time, message.encode(), time, number)
        writer.finish()


def _stamps(time: Array) -> list[int]:
    """Times [s] in whole nanoseconds."""
    return [round(1e9 * one) for one in time.tolist()]


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


def _frame_messages(frames: dict[str, tuple[Array, Array]], times: list[int]) -> Iterator[str]:
    """Frames of all bodies at each time, in JSON."""
    for k, time in enumerate(times):
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
    for topic in topics:
        words = [f"{k} [{unit}]" for k, unit in zip(topic.labels, topic.units, strict=True)]
        recording.log(topic.name, library.SeriesLines(names=words), static=True)
        columns = library.Scalars.columns(scalars=topic.values)
        time = library.TimeColumn("time", duration=topic.time)
        recording.send_columns(topic.name, indexes=[time], columns=columns)
    time = library.TimeColumn("time", duration=record["time"].to_numpy())
    for name, (place, turn) in body_frames(record).items():
        columns = library.Transform3D.columns(translation=place, quaternion=turn)
        recording.send_columns(f"world/{name}", indexes=[time], columns=columns)
        recording.log(f"world/{name}", library.TransformAxes3D(0.05), static=True)
    recording.flush()
    recording.disconnect()
