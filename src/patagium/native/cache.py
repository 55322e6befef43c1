"""Cache of compiled libraries: private to its user, checked at every load, bounded in size.

A library is a file named by the SHA-256 of its content. A record is a small text named by
the hash of what it depends on, and begins with a checksum of its name and its text. Both are
checked whenever a process loads them, which detects damage and exchanged files. A checksum
cannot tell who wrote a file: folder and files must therefore belong to the user or to root,
and nobody else may be able to write to them. Whoever can write as the user is not kept out.

`PATAGIUM_CACHE` moves the cache. What was not used for longest goes first when it grows
beyond `BOUND`.
"""

from __future__ import annotations

import atexit
import ctypes
import functools
import hashlib
import importlib
import itertools
import json
import os
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from patagium.errors import OutputError, ParameterError, command
from patagium.whole_file import whole_file

fcntl: Any = importlib.import_module("fcntl") if os.name == "posix" else None
"""Locks of files; not on Windows."""

BOUND = 1_000_000_000
"""Largest size of the cache, to which the first build of a process reduces it [B]."""
_ABANDONED = 3600.0  # s: no build takes as long, so that a killed program left such a file
_KEPT = re.compile(r"[0-9a-f]{64}\.so|[0-9a-f]{32}\.record|(index-|works-)?[0-9a-f]{32}")
"""Libraries and records, and what releases before this one kept: folders, indices."""
_TRANSIENT = re.compile(
    r"building-\w+|making-[0-9a-f]{32}|index-[0-9a-f]{32}\.\d+|\.[0-9a-f]+\.(so|record)\..*\.part"
)
_READ = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
_REMEDIES = {
    "can be written to by others": "run `chmod go-w {}` if it is yours, or ",
    "is not writable": "run `chmod u+w {}` if it is yours, or ",
}
_PLACES = {
    "linux": {"XDG_CACHE_HOME": "patagium", "HOME": ".cache/patagium"},
    "darwin": {"HOME": "Library/Caches/patagium"},
    "win32": {"LOCALAPPDATA": "patagium", "HOME": "patagium"},
}
"""Place of the cache by the system, below the first of these variables that is set."""
TEMPORARY: set[Path] = set()
"""Folders that are removed when the process ends."""
_LOADED: dict[Path, ctypes.CDLL] = {}
_SERIAL = itertools.count(1)


class Item(NamedTuple):
    """File of the cache, or folder of a build.

    Attributes:
        path: Where it is.
        size: Bytes it takes [B].
        used: When it was last loaded or written, as a Unix time [s].
        transient: Whether it belongs to a build that has not ended.
    """

    path: Path
    size: int
    used: float
    transient: bool


class Library(NamedTuple):
    """Compiled library, loaded.

    Attributes:
        handle: Handle of its functions.
        digest: SHA-256 of its content, in hexadecimal.
        facts: What was recorded with it.
    """

    handle: ctypes.CDLL
    digest: str
    facts: Any


@functools.cache
def tell(words: str) -> None:
    """Say something on stderr, once per process."""
    print(f"patagium: {words}", file=sys.stderr)


def short_hash(*texts: str) -> str:
    """Name of a record that depends on all the texts."""
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:32]


def cache_folder() -> Path:
    """Folder of the cache, created when it is missing.

    Returns:
        The folder; where it cannot be trusted or written to, which is told, a private one
        that is removed when the process ends.

    Raises:
        ParameterError: If the environment names a relative path.
    """
    places = {"PATAGIUM_CACHE": "", **_PLACES.get(sys.platform, _PLACES["linux"])}
    named = {**os.environ, "HOME": os.path.expanduser("~")}
    variable = next(name for name in places if named.get(name))
    place = Path(named[variable])
    if not place.is_absolute():
        expected = "an absolute path, such as that of a folder at home"
        raise ParameterError(variable, expected, named[variable])
    return _private(place / places[variable])


def _private(folder: Path) -> Path:
    """The folder, made when missing; a private temporary one where that is refused."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        fault = _fault(folder.stat()) or ("" if os.access(folder, os.W_OK) else "is not writable")
    except OSError as error:
        fault = f"cannot be used ({error.strerror})"
    return _in_its_place(folder, fault) if fault else folder


@functools.cache
def _in_its_place(folder: Path, fault: str) -> Path:
    """Private temporary folder instead of one that cannot be used; a message says so."""
    fallback = Path(tempfile.mkdtemp(prefix="patagium-"))
    TEMPORARY.add(fallback)
    atexit.register(_remove_own, fallback, os.getpid())
    tell(
        f"the cache {folder} {fault}: builds go to {fallback} and are removed at the end; "
        f"{command(_REMEDIES.get(fault, ''), folder)}let PATAGIUM_CACHE name another folder"
    )
    return fallback


def _remove_own(folder: Path, process: int) -> None:
    if os.getpid() == process:  # a fork leaves the folder to its parent
        shutil.rmtree(folder, ignore_errors=True)


def _fault(status: os.stat_result) -> str:
    """Reason, in words, to distrust a file or folder; empty if there is none."""
    if os.name != "posix":
        return ""
    if status.st_uid not in (0, os.geteuid()):
        return f"belongs to another user ({status.st_uid})"
    return "can be written to by others" if status.st_mode & 0o022 else ""


def load_library(name: str) -> Library | None:
    """Library that a record names, checked once per process.

    Returns:
        The library; None where there is none that can be trusted and loaded, which is told.
    """
    record = cache_folder() / f"{name}.record"
    sealed = _trusted_bytes(record, lambda text: text[:64] == _digest(name.encode() + text[64:]))
    if sealed is None:
        return None
    digest, facts = json.loads(sealed[64:])
    file = record.with_name(f"{digest}.so")
    if file not in _LOADED:
        content = _trusted_bytes(file, lambda content: _digest(content) == digest.encode())
        if content is None:
            return None
        try:
            _LOADED[file] = _opened(file, content)
        except OSError as error:
            tell(f"the cached library {file} cannot be loaded ({error})")
            return None
    return Library(_LOADED[file], digest, facts)


def record_library(name: str, digest: str, facts: Any) -> None:
    """Keep a record that names a library.

    Args:
        name: Hash of what record and library depend on.
        digest: SHA-256 of the library's content, in hexadecimal.
        facts: What is kept with it, as JSON can hold.

    Raises:
        OutputError: If the disk does not take it.
    """
    text = json.dumps([digest, facts]).encode()
    _keep(cache_folder() / f"{name}.record", _digest(name.encode() + text) + text)


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()


def _opened(file: Path, content: bytes) -> ctypes.CDLL:
    """Library of content that was read from a file; on Linux, a copy of it in memory.

    What was checked is then what is run, whatever happens to the file. The linker takes a path
    that it has seen for the same library: each gets one of its own, its number written in
    binary with "./" and "/".
    """
    serial = "".join(("/", "./")[bit == "1"] for bit in f"{next(_SERIAL):b}")
    with suppress(OSError, AttributeError):  # no such files here, or none that may be run
        with open(os.memfd_create(file.name), "wb") as copy:
            copy.write(content)
            copy.flush()
            return ctypes.CDLL(f"/proc/self/fd/{serial}{copy.fileno()}")
    return ctypes.CDLL(str(file))


def keep_library(content: bytes) -> str:
    """Keep a library; the first one of a process reduces the cache to its bound.

    Returns:
        SHA-256 of its content, in hexadecimal.

    Raises:
        OutputError: If the disk does not take it.
    """
    digest, folder = _digest(content).decode(), cache_folder()
    _keep(folder / f"{digest}.so", content)
    _tidy_once(folder)
    return digest


@functools.cache
def _tidy_once(folder: Path) -> None:  # thousands of files take a second
    tidy()


def _keep(file: Path, content: bytes) -> None:
    with suppress(OSError):
        status = file.lstat()
        if not stat.S_ISREG(status.st_mode) or _fault(status):
            file.unlink()  # a link would be followed, and another owner be kept
    with whole_file(file) as draft:  # others may read and keep the same at the same time
        draft.write_bytes(content)
        draft.chmod(0o600)


def _trusted_bytes(file: Path, sound: Callable[[bytes], bool] = bool) -> bytes | None:
    """Content of a file that passes a check and that only the user can write; otherwise None."""
    try:
        with open(os.open(file, _READ), "rb") as stream:
            status = os.fstat(stream.fileno())
            fault = _fault(status) if stat.S_ISREG(status.st_mode) else "is no plain file"
            content = b"" if fault else stream.read()
            fault = fault or ("" if sound(content) else "is damaged")
    except FileNotFoundError:
        return None
    except OSError as error:
        fault = f"cannot be read ({error.strerror})"
    if fault:
        tell(f"{file} in the cache {fault}: it is not used but built again")
        return None
    with suppress(OSError):
        os.utime(file)  # what was not used for longest is removed first
    return content


@contextmanager
def build_lock(name: str) -> Iterator[None]:
    """Lock of a record: other processes that would make it wait until it exists.

    Where files cannot be locked nobody waits, and the same may be made twice.
    """
    file, lock = cache_folder() / f"making-{name}", None
    with suppress(OSError):  # no locks here
        lock = _locked(file)
    try:
        yield
    finally:
        if lock is not None:
            file.unlink(missing_ok=True)
            os.close(lock)


def _locked(file: Path) -> int | None:
    """Handle of a file that this process alone holds; None where the system has no locks."""
    while fcntl is not None:
        lock = os.open(file, _READ | os.O_CREAT, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if os.path.samestat(os.fstat(lock), file.stat()):
                return lock
        except FileNotFoundError:
            pass  # taken away by who held it before
        except OSError:
            os.close(lock)
            raise
        os.close(lock)
    return None


@contextmanager
def building_folder() -> Iterator[Path]:
    """Folder for a build, locked while it is used and removed after it.

    Raises:
        OutputError: If the disk does not take it, or the build.
    """
    place, handle = cache_folder(), None
    try:
        with tempfile.TemporaryDirectory(
            dir=place, prefix="building-", ignore_cleanup_errors=True
        ) as folder:
            if fcntl is not None:
                handle = os.open(folder, os.O_RDONLY)
                with suppress(OSError):
                    fcntl.flock(handle, fcntl.LOCK_EX)
            yield Path(folder)
    except OSError as problem:
        raise OutputError(place, problem) from None
    finally:
        if handle is not None:
            os.close(handle)


def items() -> list[Item]:
    """All that the cache holds, what was not used for longest first."""
    found = []
    for entry in os.scandir(cache_folder()):
        transient = _TRANSIENT.fullmatch(entry.name) is not None
        if transient or _KEPT.fullmatch(entry.name):
            with suppress(OSError):  # removed by another process meanwhile
                status = entry.stat(follow_symlinks=False)
                within = os.scandir(entry) if stat.S_ISDIR(status.st_mode) else ()
                size = status.st_size + sum(
                    file.stat(follow_symlinks=False).st_size for file in within
                )
                found.append(Item(Path(entry), size, status.st_mtime, transient))
    return sorted(found, key=lambda item: item.used)


def tidy(bound: int = BOUND) -> list[Item]:
    """Remove what killed programs left, and what was not used for longest beyond a size.

    Args:
        bound: Size that may stay [B]; with 0 nothing stays but what a build is using.

    Returns:
        What was removed.
    """
    held = items()
    size = sum(item.size for item in held)
    removed = []
    for item in held:
        if item.transient:
            old = time.time() - item.used > _ABANDONED
            superfluous = (old or bound == 0) and not _in_use(item.path)
        else:
            superfluous = size > bound or bound == 0
        if superfluous:
            with suppress(OSError):
                whole = item.path.is_dir() and not item.path.is_symlink()
                shutil.rmtree(item.path) if whole else item.path.unlink()
                size -= item.size
                removed.append(item)
    return removed


def _in_use(path: Path) -> bool:
    """Whether another process, or another thread, holds the lock of a file or folder."""
    with suppress(OSError):
        handle = os.open(path, _READ)
        try:
            if fcntl is not None:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        finally:
            os.close(handle)
    return False
