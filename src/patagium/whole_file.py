"""Files written whole or not at all, whatever ends the program or the power while it writes.

A draft in the same folder is written, forced to the disk and renamed; then the folder is
forced too. Links stay, and the file behind them is replaced; mode and owner of a file stay.
Devices, pipes and descriptors such as /dev/stdout are written to and never replaced. A draft
that a killed program left is removed later. A disk that reports a write it has not done
defeats this; a second hard link keeps the old content.
"""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Self

from patagium.errors import OutputError, ParameterError, PatagiumError

_ABANDONED = 600.0  # s without a byte written: abandoned, unless HDF5 locks the draft
_MOST_LINKS = 40  # as many as Linux follows


class Draft:
    """A draft in the folder of its file, until it is whole.

    Args:
        path: The place, in a folder that is there.

    Attributes:
        target: The place.
        path: The draft, empty and closed.

    Raises:
        OutputError: If it cannot be made.
    """

    def __init__(self, path: str | Path) -> None:
        self.target = Path(path)
        with _told_of(self.target):
            self._place, former, self._replaces = _behind(self.target)
            if self._replaces:
                self.path = _new_draft(self._place, former)
            else:
                handle, name = tempfile.mkstemp(prefix="patagium-", suffix=".part")
                os.close(handle)
                self.path = Path(name)

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Block that writes the draft; its failures to write are told by the name of the place.

        Raises:
            OutputError: If the system or the library netCDF does not write.
        """
        try:
            yield
        except PatagiumError:
            raise
        except (OSError, RuntimeError) as problem:
            named, folder = getattr(problem, "filename", None), self.path.parent
            elsewhere = named is not None and folder not in (Path(named), Path(named).parent)
            of_netcdf = "NetCDF" in str(problem)
            if not of_netcdf and (elsewhere or isinstance(problem, RuntimeError)):
                raise  # of what is read meanwhile
            raise OutputError(self.target, _cause(self.path) or problem) from problem

    @contextmanager
    def whole(self) -> Iterator[Self]:
        """Block that writes the draft: published where it ends well, discarded where it does not.

        Raises:
            OutputError: If it cannot be written; the file is then as it was.
        """
        try:
            with self.writing():
                yield self
            self.publish()
        finally:
            self.discard()

    def publish(self) -> Path:
        """Replace the file by the draft; at any moment it holds its old content or the new one.

        Returns:
            The place.

        Raises:
            OutputError: If the disk does not take it; the file is then as it was.
        """
        with _told_of(self.target):
            if not self._replaces:
                _pour(self.path, self._place)
                self.discard()
                return self.target
            with self.path.open("rb+") as stream:
                os.fsync(stream.fileno())
            self.path.replace(self._place)
            force_folder(self._place.parent)
        return self.target

    def discard(self) -> None:
        """Give it up; nothing once it is published."""
        with suppress(OSError):
            self.path.unlink()


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """A draft to write to, published where the block ends well and discarded where it does not.

    Args:
        path: The file, replaced if it exists, in a folder that is there.

    Raises:
        OutputError: If it cannot be written; the file is then as it was.
    """
    with Draft(path).whole() as draft:
        yield draft.path


def write_whole(path: str | Path, content: str | bytes) -> Path:
    """Replace a file; at any moment it holds its old content or the new one.

    Args:
        path: The file, in a folder that is there.
        content: All of it; text as UTF-8.

    Raises:
        OutputError: If it cannot be written; the file is then as it was.
        ParameterError: If a character is none that UTF-8 has.
    """
    try:
        whole = content.encode() if isinstance(content, str) else content
    except UnicodeEncodeError as problem:
        found = problem.object[max(0, problem.start - 20) : problem.end]
        expected = "characters that UTF-8 has (no lone surrogates)"
        raise ParameterError(f"text of {path}", expected, found) from None
    with whole_file(path) as draft:
        draft.write_bytes(whole)
    return Path(path)


def make_folder(path: str | Path) -> Path:
    """A folder, made where it is not there yet; the folder above it must be.

    Raises:
        OutputError: If it cannot be made.
    """
    with _told_of(path):
        Path(path).mkdir(exist_ok=True)
    return Path(path)


def placed(path: str | Path) -> None:
    """Refuse an output that its folder does not take, or that is one, before long work for it.

    Args:
        path: The file, which need not exist.

    Raises:
        OutputError: If it cannot be written there.
    """
    with _told_of(path):
        place, _, replaced = _behind(Path(path))
        if replaced and not os.access(place.parent, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


@contextmanager
def locked(path: str | Path) -> Iterator[None]:
    """Block that one process at a time enters, by a lock beside a file; a killed one leaves it.

    Args:
        path: The file, in a folder that is there; a device or a pipe has no lock.

    Raises:
        OutputError: If another process is in such a block; which one is told.
    """
    import fcntl

    with _told_of(path):
        place, _, replaced = _behind(Path(path))
    if not replaced:
        yield
        return
    name = place.with_name(f".{place.name}.lock")
    with _told_of(path):
        while True:
            lock = name.open("a+")
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                with lock:
                    lock.seek(0)
                    raise BlockingIOError(errno.EAGAIN, f"{lock.read()} uses it") from None
            with suppress(FileNotFoundError):  # taken away by who held it before
                if os.path.samestat(os.fstat(lock.fileno()), name.stat()):
                    break
            lock.close()
    try:
        with suppress(OSError):  # a full disk locks as well
            lock.truncate(0)
            lock.write(f"process {os.getpid()} ({' '.join(sys.argv)[:200]})")
            lock.flush()
        yield
    finally:
        with suppress(OSError):
            name.unlink()
        with suppress(OSError):
            lock.close()


def force_folder(folder: Path) -> None:
    """Bring a folder's names to the disk, where the system can."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def _told_of(path: str | Path) -> Iterator[None]:
    try:
        yield
    except OSError as problem:
        raise OutputError(path, problem) from problem


def _behind(path: Path) -> tuple[Path, os.stat_result | None, bool]:
    """Place behind the links of a path, what is there, if anything, and whether it is replaced."""
    place = path
    for _ in range(_MOST_LINKS):
        folder = place.parent.resolve(strict=True)
        place = folder / place.name
        if _is_of_descriptors(folder) or not place.is_symlink():
            break
        place = folder / place.readlink()
    try:
        former = place.stat()
    except FileNotFoundError:
        return place, None, True
    except ValueError as problem:  # a name that no system has
        raise OSError(problem) from problem
    if stat.S_ISDIR(former.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if _is_of_descriptors(folder):  # whatever it is, its reader holds it by another name
        return place, former, False
    if not os.access(place, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    return place, former, stat.S_ISREG(former.st_mode)


def _is_of_descriptors(folder: Path) -> bool:
    return folder.is_relative_to("/proc") or folder == Path("/dev/fd")


def _new_draft(place: Path, former: os.stat_result | None) -> Path:
    """Empty draft next to a file, with the mode and owner of that file."""
    _remove_abandoned(place)
    draft = place.with_name(f".{place.name}.{secrets.token_hex(4)}.part")
    os.close(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    if former is not None:
        for user, group in ((-1, former.st_gid), (former.st_uid, -1)):
            with suppress(OSError):  # who is not the owner cannot give files away
                os.chown(draft, user, group)
        draft.chmod(former.st_mode & 0o777)
    return draft


def _pour(draft: Path, place: Path) -> None:
    """Write a draft to a device, a pipe or a descriptor."""
    own = place.parent in (Path(f"/proc/{os.getpid()}/fd"), Path("/dev/fd"))
    if own:
        sys.stdout.flush()
    handle = os.dup(int(place.name)) if own else os.open(place, os.O_WRONLY | os.O_APPEND)
    with os.fdopen(handle, "wb") as target, draft.open("rb") as content:
        shutil.copyfileobj(content, target)


def _cause(draft: Path) -> OSError | None:
    """Reason why a draft does not grow, which the library netCDF keeps to itself."""
    if not draft.exists():
        return None
    try:
        with draft.open("rb+") as stream:
            stream.seek(0, os.SEEK_END)
            stream.write(bytes(1 << 16))
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as problem:
        return problem
    return None


def _remove_abandoned(file: Path) -> None:
    for name in os.listdir(file.parent):
        if name.startswith(f".{file.name}.") and name.endswith(".part"):
            draft = file.parent / name
            with suppress(OSError, ImportError):
                if time.time() - draft.stat().st_mtime > _ABANDONED:
                    import fcntl

                    with draft.open("rb+") as stream:
                        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
                        draft.unlink()
