"""File of a stream: its packets and their predictions, in a netCDF file that grows.

Written in pieces to a draft next to its place, and renamed when it is closed, so that memory is
bounded and readers never see half of it. Nothing is compressed: 14 coordinates and
channels at 10 kHz take about 8 MB/s.
"""

from __future__ import annotations

import errno
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from patagium.arrays import Array
from patagium.errors import LogError
from patagium.live.pipeline import Pipeline, Records
from patagium.netcdf_file import NetcdfDraft
from patagium.reading import json_ready
from patagium.sensing.force.air_force import PARTS, packet_parts
from patagium.simulation import quantities
from patagium.version import __version__

FORMAT = "patagium stream 1"
_AT_ONCE = 4096
_CACHE = 1 << 20  # B of each variable; the default of netCDF4 is many times that
_RESERVE = 64 << 20  # B, or a twentieth of the disk: left free for the state and the model
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
        path: The file, replaced if it exists, in a folder that is there.
        pipeline: Pipeline whose packets and records are kept.

    Attributes:
        path: The file.
        written: Number of packets in the file.
        sound: Whether all writes were done; only then can the file be closed.

    Raises:
        OutputError: If it cannot be written.
    """

    def __init__(self, path: str | Path, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self._parts = (*PARTS, *pipeline.form.carried)
        self._waiting: list[tuple[Array, Records]] = []
        self._held, self.written, self.sound = 0, 0, True
        self.path = Path(path)
        self._draft = NetcdfDraft(path)
        self._file = self._draft.file
        try:
            with self._draft.writing():
                self._lay_out()
        except BaseException:
            self.discard()
            raise

    def append(self, packets: Array, records: Records) -> None:
        """Keep packets, (k, columns), and their records.

        Raises:
            OutputError: If the disk does not take them.
        """
        self._waiting.append((packets, records))
        self._held += len(packets)
        if self._held >= _AT_ONCE:
            with self._draft.writing():
                if not self._has_room():
                    raise OSError(errno.ENOSPC, "the disk is nearly full")
                self._write()

    def close(self, facts: Mapping[str, Any]) -> Path:
        """Write the remaining packets, if the disk has room, and put the file in its place.

        Args:
            facts: Summary of the stream, kept as its attribute `summary`.

        Returns:
            The file.

        Raises:
            OutputError: If the disk does not take it; what was there is then as it was.
            LogError: If it has no packets; nothing is written then.
        """
        with self._draft.writing():
            if self._has_room():
                self._write()
            if not self.written:
                raise LogError(self.path, "packets to record", "none; nothing is written")
            self._file.summary = json.dumps(json_ready({**facts, "recorded": self.written}))
        return self._draft.publish()

    def discard(self) -> None:
        """Give the file up, unless it is closed already."""
        self._draft.discard()

    def _lay_out(self) -> None:
        """Write the head of the record: robot, air, learner, names and empty variables."""
        file, robot, network = self._file, self._pipeline.robot, self._pipeline.learner.network
        file.format, file.patagium_version = FORMAT, __version__
        file.robot, file.robot_name = robot.source, robot.name
        air = getattr(getattr(network, "model", network), "air", None)
        file.air = json.dumps({} if air is None else air.describe())
        file.learner = json.dumps(json_ready(self._pipeline.learner.describe()))
        names = {"dof": [*robot.dof_names], "output": [*network.output_names]}
        of_part = {part: quantities(robot)[part] for part in self._parts}
        names |= {of_part["q"].dims[0]: [*robot.coordinate_names]}
        file.createDimension("time", None)
        self._variable("time", "f8", (), "s", "time stamp of the packet")
        self._draft.add(xr.Dataset(coords=names))
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
        made.set_var_chunk_cache(_CACHE)
        made.units, made.long_name = units, meaning

    def _has_room(self) -> bool:
        """Whether the disk takes more and has room left for the learner."""
        disk = shutil.disk_usage(self._draft.path.parent)
        return disk.free > min(_RESERVE, disk.total // 20)

    def _write(self) -> None:
        if not self._waiting:
            return
        self.sound = False
        packets = np.concatenate([packets for packets, _ in self._waiting])
        records = Records(np.concatenate([records.rows for _, records in self._waiting]))
        place = slice(self.written, self.written + len(packets))
        parts = dict(zip(self._parts, packet_parts(packets, self._pipeline.robot), strict=True))
        parts |= {name: getattr(records, name) for name in (*_MEANING, "outcome", "duration")}
        for name, values in (("time", packets[:, 0]), *parts.items()):
            self._file.variables[name][place] = values
        self.written += len(packets)
        self._waiting, self._held, self.sound = [], 0, True
