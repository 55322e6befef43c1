"""Arrays for the samples of a long flight: in memory, or in a file on the disk without a name.

The file is in TMPDIR, else in /var/tmp, and ends with the last array, however the program ends.
"""

from __future__ import annotations

import mmap
import os
import shutil
import tempfile
from collections.abc import Mapping
from math import prod
from typing import Any

import numpy as np

from patagium.arrays import Array
from patagium.errors import ParameterError
from patagium.limits import DISK_SHARE, MEMORY_SHARE, free_memory, in_bytes


def room_for(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Array]:
    """Arrays without content; on the disk where they would take much of the free memory.

    Args:
        shapes: Shape of each by name, samples first.

    Raises:
        ParameterError: If the disk has no room for them.
    """
    sizes = {name: 8 * prod(shape) for name, shape in shapes.items()}
    whole = sum(sizes.values())
    if whole <= MEMORY_SHARE * free_memory():
        return {name: np.empty(shape) for name, shape in shapes.items()}
    folder = os.environ.get("TMPDIR") or "/var/tmp"  # noqa: S108 - a file without a name
    folder = folder if os.path.isdir(folder) else tempfile.gettempdir()
    most = DISK_SHARE * shutil.disk_usage(folder).free
    if whole > most:
        samples = max(shape[0] for shape in shapes.values())
        raise ParameterError(
            "duration",
            f"a flight of at most {in_bytes(most)}, for which {folder} has room (shorten it, "
            "lengthen the time step, or set TMPDIR to a larger disk)",
            f"{samples:,} samples of {in_bytes(whole)}",
        )
    with tempfile.TemporaryFile(dir=folder) as file:
        os.posix_fallocate(file.fileno(), 0, max(whole, 1))  # a full disk is told now, not later
        found, place = {}, 0
        for name, shape in shapes.items():
            found[name] = np.asarray(np.memmap(file, np.float64, "r+", place, shape))
            place += sizes[name]
    return found


def release(array: Array) -> bool:
    """Take the pages of an array on the disk out of memory; they are read again where needed.

    Args:
        array: Any array [any unit].

    Returns:
        Whether it is on the disk.
    """
    base: Any = array
    while isinstance(base, np.ndarray):
        base = base.base
    if not isinstance(base, mmap.mmap):
        return False
    base.madvise(mmap.MADV_DONTNEED)
    return True
