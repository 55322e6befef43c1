"""Reader of MATLAB files up to version 7, by SciPy; fields of structures by dotted path.

Arrays of two dimensions are columns `name[0]`, `name[1]` ...; the longer side is time. A file is
read whole. Objects such as timetables, and version 7.3, which is HDF5, are not read.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import Block, Request, Topic, reading
from patagium.sensing.logs.files.tables import column_blocks, table_topic

_MOST_COLUMNS = 64


class MatFile:
    """MATLAB file in memory; see `LogFile`.

    Args:
        path: The file.

    Raises:
        LogError: If the file cannot be read, is of version 7.3, or holds no arrays of numbers.
    """

    format = "MAT"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        with reading(path, "MAT"):
            with path.open("rb") as file:
                if b"7.3 MAT" in file.read(16):
                    raise LogError(
                        f"{path}: MATLAB 7.3 files are not read; save it again with "
                        "save('log.mat', ..., '-v7')"
                    )
            from scipy.io import loadmat

            held = loadmat(path, squeeze_me=True, struct_as_record=False)
            self._columns: dict[str, Any] = {}
            for name, value in held.items():
                if not name.startswith("__"):
                    self._columns.update(_columns(name, value))
        lengths = Counter(len(column) for column in self._columns.values())
        if not lengths:
            raise LogError(f"{path}: expected arrays of numbers, found none")
        if len(lengths) > 1:
            described = ", ".join(f"{n} of {rows} rows" for rows, n in lengths.most_common(4))
            self.notes.append(f"arrays of several lengths: {described}; each needs its own stamp")
        types = {name: str(column.dtype) for name, column in self._columns.items()}
        self.topics: dict[str, Topic] = {"": table_topic(types, lengths.most_common(1)[0][0])}

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows, one request after the other."""
        for key, one in enumerate(wanted):
            yield from column_blocks(key, one, self._columns, str(self.path))

    def close(self) -> None:
        """Release the memory."""
        self._columns = {}


def _columns(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    fields = getattr(value, "_fieldnames", None)  # of SciPy's mat_struct
    if fields is not None:
        for inner in fields:
            yield from _columns(f"{name}.{inner}", getattr(value, inner))
        return
    array = np.asarray(value)
    if array.dtype.kind not in "fiub" or array.ndim not in (1, 2) or array.size < 2:
        return
    if array.ndim == 1:
        yield name, array
        return
    tall = array if array.shape[0] >= array.shape[1] else array.T
    for k in range(min(tall.shape[1], _MOST_COLUMNS)):
        yield f"{name}[{k}]", np.ascontiguousarray(tall[:, k])
