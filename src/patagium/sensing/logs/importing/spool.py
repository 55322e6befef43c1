"""Rows of a log on their way, as raw numbers on disk, so that memory stays small.

One pass through the log puts every stream into a folder: stamps that advance, and the numbers.
A journal beside them says how far the pass came; who was interrupted goes on from there.
Neglected: a loss of power, after which the last rows of the journal may not be on the disk.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import Array, LogFile, Stamps
from patagium.sensing.logs.importing.plan import Plan
from patagium.sensing.logs.importing.survey import StampSurvey, ValueSurvey
from patagium.whole_file import write_whole

Progress = Callable[[int, int], None]

_JOURNAL = "journal.json"
_PERIOD = 2.0  # s between entries of the journal


class Spool:
    """Streams of a log on disk.

    Args:
        folder: Where; gone on from if its journal is of the same log and mapping.
        plan: What to read.
        mark: What tells this log and mapping from others.

    Attributes:
        stamps: What was counted of the stamps of each stream.
        values: What was counted of its numbers.
        resumed: Rows of the log that were read by an earlier run.
    """

    def __init__(self, folder: Path, plan: Plan, mark: str) -> None:
        self.folder, self.plan, self._mark = folder, plan, mark
        self.complete = False
        self._begin()
        self._resume()
        self.resumed = sum(self.consumed)

    def fill(self, log: LogFile, progress: Progress | None) -> None:
        """Read what was not read yet.

        Args:
            log: The log.
            progress: Called now and then with rows read and rows in all.
        """
        if self.complete:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        files = [self._opened(k) for k in range(len(self.plan.wanted))]
        total, told = sum(self.plan.counts), time.monotonic()
        try:
            for block in log.blocks(self.plan.wanted, tuple(self.consumed)):
                k = block.key
                kept = self.stamps[k].add(block.stamps)
                values = np.ascontiguousarray(block.values[kept])
                self.values[k].add(values)
                files[k][0].write(block.stamps[kept].tobytes())
                files[k][1].write(values.tobytes())
                self.consumed[k] = block.consumed
                if progress is not None:
                    done = sum(self.consumed)
                    progress(min(done, max(total, 1)), max(total, done))
                if time.monotonic() - told > _PERIOD:
                    self._write_journal(files)
                    told = time.monotonic()
            self.complete = True
            self._write_journal(files)
        finally:
            for pair in files:
                for file in pair:
                    file.close()

    def rows(self, stream: int) -> int:
        """Rows kept of a stream."""
        return self.stamps[stream].kept

    def stamps_of(self, stream: int) -> Stamps:
        """Stamps of a stream, (N,) [ns], mapped from the disk."""
        if not self.rows(stream):
            return np.empty(0, np.int64)
        return np.memmap(self._path(stream, "stamps"), np.int64, "r", shape=(self.rows(stream),))

    def values_of(self, stream: int, begin: int, end: int) -> Array:
        """Some rows of a stream, (end - begin, n), as in the log."""
        columns = len(self.plan.wanted[stream].fields)
        with self._path(stream, "values").open("rb") as file:
            file.seek(begin * columns * 8)
            content = np.fromfile(file, float, (end - begin) * columns)
        return content.reshape(-1, columns)

    def remove(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _path(self, stream: int, what: str) -> Path:
        return self.folder / f"{stream}.{what}"

    def _opened(self, stream: int) -> tuple[BinaryIO, BinaryIO]:
        columns = len(self.plan.wanted[stream].fields)
        pair = []
        for what, width in (("stamps", 8), ("values", 8 * columns)):
            path = self._path(stream, what)
            path.touch()
            file = path.open("r+b")
            file.truncate(self.rows(stream) * width)
            file.seek(0, 2)
            pair.append(file)
        return pair[0], pair[1]

    def _write_journal(self, files: list[tuple[BinaryIO, BinaryIO]]) -> None:
        for pair in files:
            for file in pair:
                file.flush()
        entry = {
            "mark": self._mark,
            "complete": self.complete,
            "consumed": self.consumed,
            "stamps": [survey.state() for survey in self.stamps],
            "values": [survey.state() for survey in self.values],
        }
        write_whole(self.folder / _JOURNAL, json.dumps(entry).encode())

    def _resume(self) -> None:
        try:
            entry: dict[str, Any] = json.loads((self.folder / _JOURNAL).read_text("utf-8"))
            if entry["mark"] != self._mark:
                raise ValueError("of another log")
            for survey, state in zip(self.stamps, entry["stamps"], strict=True):
                survey.resume(state)
            for counted, state in zip(self.values, entry["values"], strict=True):
                counted.resume(state)
            self.consumed, self.complete = list(entry["consumed"]), bool(entry["complete"])
            self._check_sizes()
        except (OSError, ValueError, KeyError, TypeError):
            if self.folder.exists() and not _is_spool(self.folder):
                raise LogError(
                    f"{self.folder}: expected a folder that an import left, found another; "
                    "move it away"
                ) from None
            self.remove()
            self._begin()

    def _begin(self) -> None:
        self.stamps = [StampSurvey() for _ in self.plan.wanted]
        self.values = [ValueSurvey(len(one.fields)) for one in self.plan.wanted]
        self.consumed = [0 for _ in self.plan.wanted]
        self.complete = False

    def _check_sizes(self) -> None:
        for k, wanted in enumerate(self.plan.wanted):
            for what, width in (("stamps", 8), ("values", 8 * len(wanted.fields))):
                path = self._path(k, what)
                if path.stat().st_size < self.rows(k) * width:
                    raise ValueError("rows are missing")


def mark_of(paths: Iterator[Path], mapping: str) -> str:
    """What tells a log and its mapping from others: names, sizes, times of change, words.

    Args:
        paths: The files of the log.
        mapping: The mapping, in words.
    """
    digest = hashlib.sha256(mapping.encode())
    for path in paths:
        facts = path.stat()
        digest.update(f"{path.name} {facts.st_size} {facts.st_mtime_ns}\n".encode())
    return digest.hexdigest()


def _is_spool(folder: Path) -> bool:
    names = {path.suffix for path in folder.iterdir()}
    return names <= {".json", ".stamps", ".values", ".part", ".nc"}
