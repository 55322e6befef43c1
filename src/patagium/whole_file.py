"""Files written whole or not at all, whatever ends the program or the power while it writes.

A draft in the same folder is written, forced to the disk and renamed; then the folder is
forced too. A draft that a killed program left is removed later. A disk
that reports a write it has not done defeats this.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_ABANDONED = 600.0  # s without a byte written: nobody is at work on such a draft


class Draft:
    """A file beside its place, until it is whole.

    Args:
        path: The place; folders are made.

    Attributes:
        path: The draft, empty and closed.

    Raises:
        OSError: If it cannot be made.
    """

    def __init__(self, path: str | Path) -> None:
        self._file = Path(path)
        folder, name = self._file.parent, self._file.name
        folder.mkdir(parents=True, exist_ok=True)
        _remove_abandoned(self._file)
        handle, draft = tempfile.mkstemp(dir=folder, prefix=f".{name}.", suffix=".part")
        os.close(handle)
        self.path = Path(draft)

    def publish(self) -> Path:
        """Replace the file by the draft; at any moment it holds its old content or the new one.

        Returns:
            The place.

        Raises:
            OSError: If the disk does not take it; the file is then as it was.
        """
        with self.path.open("rb+") as stream:
            os.fsync(stream.fileno())
        umask = os.umask(0)
        os.umask(umask)
        self.path.chmod(0o666 & ~umask)
        self.path.replace(self._file)
        force_folder(self._file.parent)
        return self._file

    def discard(self) -> None:
        """Give it up; nothing once it is published."""
        self.path.unlink(missing_ok=True)


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """A draft to write to, published where the block ends well and discarded where it does not.

    Args:
        path: The file, replaced if it exists; folders are made.

    Raises:
        OSError: If it cannot be written; the file is then as it was.
    """
    draft = Draft(path)
    try:
        yield draft.path
        draft.publish()
    finally:
        draft.discard()


def write_whole(path: str | Path, content: str | bytes) -> Path:
    """Replace a file; at any moment it holds its old content or the new one.

    Args:
        path: The file; folders are made.
        content: All of it; text as UTF-8.

    Returns:
        The path.

    Raises:
        OSError: If it cannot be written; the file is then as it was.
    """
    with whole_file(path) as draft:
        draft.write_bytes(content.encode() if isinstance(content, str) else content)
    return Path(path)


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
