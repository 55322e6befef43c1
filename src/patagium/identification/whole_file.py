"""Files written whole or not at all, whatever ends the program or the power while it writes.

A draft in the same folder is written, forced to the disk and renamed; then the folder is
forced too. A draft that a killed program left is removed later. Neglected: disks that lie
about what they have written.
"""

from __future__ import annotations

import os
import tempfile
import time
from contextlib import suppress
from pathlib import Path

_ABANDONED = 600.0  # s without a byte written: nobody is at work on such a draft


def write_whole(path: str | Path, content: bytes) -> Path:
    """Replace a file; at any moment it holds its old content or the new one.

    Args:
        path: The file; folders are made.
        content: All of it.

    Returns:
        The path.

    Raises:
        OSError: If it cannot be written; the file is then as it was.
    """
    file = Path(path)
    file.parent.mkdir(parents=True, exist_ok=True)
    _remove_abandoned(file)
    handle, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.", suffix=".part")
    draft = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        draft.chmod(0o644)
        draft.replace(file)
    finally:
        draft.unlink(missing_ok=True)
    force_folder(file.parent)
    return file


def force_folder(folder: Path) -> None:
    """Bring a folder's names to the disk, where the system can."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _remove_abandoned(file: Path) -> None:
    for name in os.listdir(file.parent):
        if name.startswith(f".{file.name}.") and name.endswith(".part"):
            draft = file.parent / name
            with suppress(OSError):
                if time.time() - draft.stat().st_mtime > _ABANDONED:
                    draft.unlink()
