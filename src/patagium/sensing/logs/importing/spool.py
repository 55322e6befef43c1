"""Rows of a log in temporary files between reading and resampling, so that memory stays small.

The files have no name: the system removes them when the program ends, however it ends.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from patagium.sensing.logs.files.channels import Array, LogFile, Stamps
from patagium.sensing.logs.importing.plan import Plan
from patagium.sensing.logs.importing.survey import Progress, StreamSurvey, survey_streams


class Spool:
    """Streams of a log on disk, each with the rows whose stamps advance.

    Args:
        log: The open log; it is read once, from start to end.
        plan: Streams to read.
        folder: Folder whose disk takes the rows, eight bytes a number.
        progress: Called now and then with the rows read and the rows in all.

    Attributes:
        plan: Streams that were read.
        surveys: Statistics of each stream.

    Raises:
        LogError: If the log is damaged, or a column holds text.
        OSError: If the disk does not take the rows.
    """

    def __init__(
        self, log: LogFile, plan: Plan, folder: Path, progress: Progress | None = None
    ) -> None:
        self.plan = plan
        with ExitStack() as stack:
            self._stamps, self._values = (
                [stack.enter_context(TemporaryFile(dir=folder)) for _ in plan.wanted]
                for _ in ("stamps", "values")
            )
            self.surveys: tuple[StreamSurvey, ...] = survey_streams(
                log, plan.wanted, sum(plan.counts), keep=self._keep, progress=progress
            )
            for file in (*self._stamps, *self._values):
                file.flush()
            self._files = stack.pop_all()

    def __enter__(self) -> Spool:
        return self

    def __exit__(self, *_: object) -> None:
        self._files.close()

    def stamps_of(self, stream: int) -> Stamps:
        """Stamps of a stream, increasing, (N,) [ns], as a map of its file."""
        return np.memmap(self._stamps[stream], np.int64, "r")

    def values_of(self, stream: int, begin: int, end: int) -> Array:
        """Numbers of some rows of a stream, (end - begin, n) in the units of the log."""
        columns, file = len(self.plan.wanted[stream].fields), self._values[stream]
        file.seek(begin * columns * 8)
        content = np.fromfile(file, float, (end - begin) * columns)
        return content.reshape(-1, columns)

    def _keep(self, stream: int, stamps: Stamps, values: Array) -> None:
        self._stamps[stream].write(stamps.tobytes())
        self._values[stream].write(values.tobytes())
