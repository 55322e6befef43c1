"""File of a stream: its packets and their predictions, in a netCDF file that grows.

Written in pieces beside its place and renamed into it when it is closed, so that memory is
bounded and readers never see half of it. Nothing is compressed: 14 coordinates and
channels at 10 kHz take about 8 MB/s.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from patagium.errors import FlightError
from patagium.learning.scores import json_ready
from patagium.live.pipeline import Pipeline, Records
from patagium.sensing.force.air_force import PARTS, packet_parts
from patagium.simulation import quantities
from patagium.version import __version__
from patagium.whole_file import Draft

Array = NDArray[np.float64]

FORMAT = "patagium stream 1"
_AT_ONCE = 4096
_FORCE = "N or N m"
_MEANING = {
    "measurement": ("f8", _FORCE, "force of the air by inverse dynamics"),
    "prediction": ("f8", _FORCE, "prediction of the measurement before it was learned"),
    "std": ("f8", _FORCE, "standard deviation of measurement less prediction"),
    "left_out": ("i1", "1", "1 where a channel was not learned from"),
}


class StreamFile:
    """NetCDF file of packets and records: a flight as sensed, and as predicted.

    Variables over time and dof are q, v, a and u1, as in a flight (with a quaternion q is over
    time and coordinate); over time and output
    measurement, prediction, std, left_out; over time outcome and duration.

    Args:
        path: The file, replaced if it exists; folders are made.
        pipeline: What is recorded.

    Raises:
        FlightError: If it cannot be written.
    """

    def __init__(self, path: str | Path, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self._parts = (*PARTS, *pipeline.form.carried)
        self._waiting: list[tuple[Array, Records]] = []
        self._held, self._written = 0, 0
        try:
            self._draft = Draft(path)
        except OSError as error:
            raise FlightError(f"{path}: cannot be written: {error.strerror}") from None
        self._file = netCDF4.Dataset(self._draft.path, "w", format="NETCDF4")
        self._lay_out()

    def append(self, packets: Array, records: Records) -> None:
        """Keep packets, (k, columns), and their records."""
        self._waiting.append((packets, records))
        self._held += len(packets)
        if self._held >= _AT_ONCE:
            self._write()

    def close(self, facts: Mapping[str, Any]) -> Path:
        """Write the remaining packets and put the file in its place.

        Args:
            facts: Summary of the stream, kept as its attribute `summary`.

        Returns:
            The file.
        """
        self._write()
        self._file.summary = json.dumps(json_ready(facts))
        self._file.close()
        return self._draft.publish()

    def discard(self) -> None:
        """Give the file up, unless it is closed already."""
        if self._file.isopen():
            self._file.close()
        self._draft.discard()

    def _lay_out(self) -> None:
        file, robot, network = self._file, self._pipeline.robot, self._pipeline.learner.network
        file.format, file.patagium_version = FORMAT, __version__
        file.robot, file.robot_name = robot.source, robot.name
        file.learner = json.dumps(json_ready(self._pipeline.learner.describe()))
        names = {"dof": robot.dof_names, "output": network.output_names}
        of_part = {part: quantities(robot)[part] for part in self._parts}
        names |= {of_part["q"].dims[0]: robot.coordinate_names}
        file.createDimension("time", None)
        self._variable("time", "f8", (), "s", "time stamp of the packet")
        for dimension, words in names.items():
            file.createDimension(dimension, len(words))
            file.createVariable(dimension, str, (dimension,))[:] = np.array(words, object)
        for part in self._parts:
            self._variable(part, "f8", of_part[part].dims, of_part[part].units, "as sensed")
        for name, (kind, units, meaning) in _MEANING.items():
            self._variable(name, kind, ("output",), units, meaning)
        self._variable("outcome", "i1", (), "1", "0: learned; else why not, errors.Outcome")
        self._variable("duration", "f4", (), "s", "wall-clock time of the call")

    def _variable(
        self, name: str, kind: str, dims: tuple[str, ...], units: str, meaning: str
    ) -> None:
        shape = [_AT_ONCE, *(len(self._file.dimensions[dim]) for dim in dims)]
        made = self._file.createVariable(name, kind, ("time", *dims), chunksizes=shape)
        made.units, made.long_name = units, meaning

    def _write(self) -> None:
        if not self._waiting:
            return
        packets = np.concatenate([packets for packets, _ in self._waiting])
        records = Records(np.concatenate([records.rows for _, records in self._waiting]))
        place = slice(self._written, self._written + len(packets))
        parts = dict(zip(self._parts, packet_parts(packets, self._pipeline.robot), strict=True))
        parts |= {name: getattr(records, name) for name in (*_MEANING, "outcome", "duration")}
        for name, values in (("time", packets[:, 0]), *parts.items()):
            self._file.variables[name][place] = values
        self._written += len(packets)
        self._waiting, self._held = [], 0
