"""Reader of ArduPilot's DataFlash logs (.BIN), whose messages pymavlink finds and describes.

Messages of one type are a topic, named as in the log: `IMU`, and `IMU/1` for the second instance.
pymavlink finds the messages, their formats and units; NumPy takes their numbers. Its objects for
single messages are not used: they take 50 times as long. Neglected: the time of day, which GPS
messages give; the stamps are the microseconds since the start of the autopilot.
"""

from __future__ import annotations

import io
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import Channel, StampSource, Topic, reading
from patagium.sensing.logs.files.table_files import ColumnsFile

_CLOCKS = {"TimeUS": 1e3, "TimeMS": 1e6}
"""Columns of stamps and their units [ns]."""
_DEFINITIONS = ("FMT", "FMTU", "UNIT", "MULT")
_TEXT = "nNZ"
_ARRAY = "a"
_ARRAY_SIZE = 32
_HEADER = 3  # B before the content of a message
_PADDING = 528
"""Most bytes that fill the last page of a whole log."""


class ArdupilotFile(ColumnsFile):
    """Open DataFlash log."""

    format = "ArduPilot DataFlash"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        convert = f"or convert it: mavlogdump.py --format mat --mat_file log.mat {path.name}"
        with (
            reading(path, self.format, extra="ardupilot", otherwise=convert),
            redirect_stdout(io.StringIO()),
            redirect_stderr(io.StringIO()),
        ):
            self._reader = _opened(path)
            self._content = np.memmap(path, np.uint8, "r")
            self._places: dict[str, tuple[int, int | None]] = {}
            self.topics = {}
            for kind, found in sorted(self._reader.formats.items(), key=lambda one: one[1].name):
                if found.name in _DEFINITIONS or not len(self._reader.offsets[kind]):
                    continue
                try:
                    self._add(kind, found)
                except (LogError, ValueError) as problem:  # NumPy's of a damaged format
                    count = len(self._reader.offsets[kind])
                    lost = Topic(found.name, self.format, count, problem=str(problem))
                    self.topics[found.name] = lost
        other = len(self._content) - sum(
            len(places) * self._reader.formats[kind].len
            for kind, places in enumerate(self._reader.offsets)
            if kind in self._reader.formats
        )
        if other > _PADDING:
            self.notes.append(f"the file is damaged: {other} bytes are no message, and left out")
        if not self.topics:
            self.close()
            raise LogError(f"{path}: cannot be read as {self.format}: it holds no messages")

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def _add(self, kind: int, found: Any) -> None:
        """Add the topics of a type of messages, one for each instance."""
        rows = self._rows(kind)
        clock = next((name for name in _CLOCKS if name in found.columns), "")
        base = StampSource("column", clock, _CLOCKS[clock]) if clock else StampSource("rows")
        channels, unplaced = {}, {}
        for name, code in zip(found.columns, found.format, strict=False):
            if code in _TEXT:
                unplaced[name] = "text"
                continue
            size = _ARRAY_SIZE if code == _ARRAY else 0
            for path in [f"{name}[{k}]" for k in range(size)] or [name]:
                unit = (found.get_unit(name) or "").replace("m/s/s", "m/s^2")
                channels[path] = Channel(path, str(rows.dtype[name].base), _plain(unit))
        counts: dict[int | None, int] = {None: len(rows)}
        if found.instance_field is not None:
            counts = dict(sorted(Counter(rows[found.instance_field].tolist()).items()))
        for instance, held in counts.items():
            name = f"{found.name}/{instance}" if instance else found.name
            self._places[name] = (kind, instance)
            self.topics[name] = Topic(name, self.format, held, channels, base, unplaced=unplaced)

    def _rows(self, kind: int) -> NDArray[Any]:
        """Messages of a type as they are stored, (N,), but for one that the end cuts off."""
        found = self._reader.formats[kind]
        dtype = _layout(found)
        if dtype.itemsize != found.len - _HEADER:
            expected = f"{dtype.itemsize + _HEADER} bytes as their format says"
            raise LogError(f"messages {found.name}", expected, found.len)
        places = np.asarray(self._reader.offsets[kind], np.int64) + _HEADER
        places = places[places + dtype.itemsize <= len(self._content)]
        windows = np.lib.stride_tricks.sliding_window_view(self._content, dtype.itemsize)
        return np.ascontiguousarray(windows[places]).view(dtype)[:, 0]

    def _columns(self, topic: str) -> dict[str, NDArray[Any]]:
        kind, instance = self._places[topic]
        found, rows = self._reader.formats[kind], self._rows(kind)
        if instance is not None:
            rows = rows[rows[found.instance_field] == instance]
        columns: dict[str, NDArray[Any]] = {}
        for name, factor in zip(found.columns, found.msg_mults, strict=False):
            values = rows[name]
            if values.ndim > 1:
                columns |= {f"{name}[{k}]": values[:, k] for k in range(values.shape[1])}
            elif values.dtype.kind != "S":
                columns[name] = values if factor is None else values / (1.0 / factor)
        return columns


def _opened(path: Path) -> Any:
    """Log as pymavlink opens it, without the search for the time of day in all messages."""
    from pymavlink.DFReader import DFReader_binary

    class Indexed(DFReader_binary):  # type: ignore[misc]
        def __init__(self) -> None:
            try:
                super().__init__(str(path))
            except BaseException:  # which leaves the file open
                self.close()
                raise

        def init_arrays_fast(self, progress_callback: Any = None) -> None:
            """Index by Python, whose complaints about damage can be caught; C's go to stderr."""
            self.formats = _Formats(self.formats)  # type: ignore[has-type]
            self.init_arrays(progress_callback)

        def init_clock(self) -> None:
            """Leave the time of day unknown."""

        def close(self) -> None:
            """Close the file; its map may still be held by the error that a reader raised."""
            with suppress(BufferError, AttributeError):
                self.data_map.close()
            self.filehandle.close()

    return Indexed()


class _Formats(dict[int, Any]):
    """Formats of messages by type; one without a length would be read for ever."""

    def __setitem__(self, kind: int, found: Any) -> None:
        if found.len < _HEADER:
            raise ValueError(f"expected messages of {_HEADER} bytes at least, found {found.len}")
        super().__setitem__(kind, found)


def _layout(found: Any) -> np.dtype[Any]:
    """Layout of the numbers of a message, from the format that the log gives."""
    from pymavlink.DFReader import FORMAT_TO_STRUCT

    fields: list[Any] = []
    for name, code in zip(found.columns, found.format, strict=False):
        stored = FORMAT_TO_STRUCT[code][0]
        if code == _ARRAY:
            fields.append((name, "<i2", (_ARRAY_SIZE,)))
        else:
            fields.append((name, f"S{stored[:-1]}" if code in _TEXT else f"<{stored}"))
    return np.dtype(fields)


def _plain(unit: str) -> str:
    """Unit of ArduPilot as ours; empty for those that are none, and of places on the globe."""
    none = ("UNKNOWN", "instance", "-", "?", "deglatitude", "deglongitude")
    return "" if unit.endswith(none) else unit.replace("degheading", "deg")
