"""NetCDF files written whole or not at all, on a disk that may fail at any write; and read.

HDF5, below netCDF, ends the whole program where a write fails as it closes a file. So all is
forced to the disk first, where a failure is an exception. What closing still writes goes to memory:
of it only the head of the file is new, that it was closed, and is written from there; the rest
repeats what is on the disk. Without memory files (not Linux) closing writes itself.

Whatever the libraries raise for a damaged file is one error, and its size is bounded. The last
line of a file is a checksum of all bytes before it, because a flipped bit may give a wrong number
or an endless loop in HDF5. HDF5 does not read this line, and removes it when it changes the file.
"""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import netCDF4

from patagium.errors import OutputError, PatagiumError, Unreadable, command
from patagium.limits import free_memory, in_bytes
from patagium.reading import regular_file
from patagium.whole_file import Draft

if TYPE_CHECKING:
    import xarray as xr

_GROWTH, _SPARE = 1000, 100_000_000
"""Bytes of memory for a byte of a file (compression), and besides that [B]."""
_PIECE, _COLUMN = 2048, 16384  # samples that are compressed at once: of all columns, of one
_HEAD = 4096  # B, of which HDF5's superblock takes 48 or 96
_BLOCK = 1 << 20  # B that are read at once
_MARK = b"patagium crc32 "


class NetcdfDraft(Draft):
    """A netCDF4 draft in the folder of its file, until it is whole.

    Args:
        path: The place, in a folder that is there.

    Attributes:
        file: The open file.

    Raises:
        OutputError: If it cannot be made.
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        try:
            with self.writing():
                self.file = netCDF4.Dataset(self.path, "w", format="NETCDF4")
        except UnicodeEncodeError:
            super().discard()
            raise OutputError(self.target, ValueError("its name is no text in UTF-8")) from None
        except BaseException:
            super().discard()
            raise

    def add(self, dataset: xr.Dataset, group: str | None = None, **encoding: Any) -> None:
        """Store a dataset, names as characters: HDF5 crashes at strings of a file open twice.

        Args:
            dataset: What is stored.
            group: Group that is made for it; None: the root.
            encoding: How variables are stored, by their names.
        """
        from xarray.backends import NetCDF4DataStore

        names = {name: {"dtype": "S1"} for name in _texts(dataset)}
        store: Any = NetCDF4DataStore
        place = store(self.file if group is None else self.file.createGroup(group))
        dataset.dump_to_store(place, encoding={**encoding, **names})

    def publish(self) -> Path:
        """Close the file and put it in its place; see `Draft.publish`."""
        with self.writing():
            self.file.sync()
            with self.path.open("rb") as stream:
                head = stream.read(_HEAD)
            with _diverted(self.path) as memory:
                if memory is not None:
                    os.pwrite(memory, head, 0)
                self.file.close()
                last = b"" if memory is None else os.pread(memory, len(head), 0)
            with self.path.open("rb+") as stream:
                stream.write(last)
                stream.seek(0)
                stream.write(_checksum_line(stream, self.path.stat().st_size))
        return super().publish()

    def discard(self) -> None:
        """Give it up; nothing once it is published."""
        if self.file.isopen():
            with _diverted(self.path), suppress(RuntimeError):
                self.file.close()
        super().discard()


def write_netcdf(
    path: str | Path,
    dataset: xr.Dataset,
    groups: Mapping[str, xr.Dataset] | None = None,
    *,
    compressed: bool = False,
    single: Collection[str] = (),
) -> Path:
    """Replace a netCDF4 file; at any moment it holds its old content or the new one.

    Args:
        path: The file, in a folder that is there.
        dataset: Content of the root.
        groups: Content of groups by name.
        compressed: Whether numbers of the root are compressed (zlib, which every reader has).
        single: Variables of the root that are stored in single precision.

    Returns:
        The path.

    Raises:
        OutputError: If it cannot be written; the file is then as it was.
    """
    with NetcdfDraft(path).whole() as draft:
        encoding: dict[str, Any] = {name: {"dtype": "float32"} for name in single}
        if compressed:
            for name, one in dataset.variables.items():
                if one.dtype.kind == "f" and one.size and one.ndim:
                    encoding.setdefault(str(name), {}).update(_compression(one))
        draft.add(dataset, **encoding)
        for name, content in (groups or {}).items():
            draft.add(content, name)
    return draft.target


def _compression(one: xr.Variable) -> dict[str, Any]:
    """Encoding of numbers: the fastest zlib, in pieces that a processor's cache holds.

    Coordinates have little in common: each by itself is smaller, and is read faster.
    """
    rows, *columns = one.shape
    apart = one.dims[1:] == ("dof",) and rows > _PIECE and bool(one.values.any())
    pieces = (min(_COLUMN, rows), 1) if apart else (min(_PIECE, rows), *columns)
    return {"zlib": True, "complevel": 1, "shuffle": True, "chunksizes": pieces}


_KINDS = {
    "patagium model": "a learned model, which `pt.load_model` and the option --model take",
    "patagium learner": "a learner's state, which `pt.load_learner` and the option --state take",
    "patagium log": "an imported log, which `pt.load_log` reads",
    "patagium stream": "a record of `patagium stream`, which `pt.load_log` reads",
    "scores": "predictions, which `patagium view --predictions` takes",
    "force_std": "a motion with forces, for `patagium identify` and `pt.load_log`",
    "aero": "a flight, which `pt.load_flight` reads",
}
"""Kinds of files by their format, else by what only they hold."""
_FORMAT = re.compile(rb"(?:\{\s*\"format\": \")?(patagium (?:model|learner)) ")
_SETTINGS = re.compile(rb"^(every|network|learner):", re.MULTILINE)
_MAPPING = re.compile(rb"^(inputs|outputs|channels|time):", re.MULTILINE)


def kind_of(path: str | Path) -> str:
    """Kind of a file of this program, with what takes it, for messages; empty where unknown."""
    file, kinds, head = Path(path), set[str](), b""
    with suppress(OSError, ValueError), open(file if file.is_file() else "", "rb") as stream:
        head = stream.read(_BLOCK)  # a pipe would wait
    if file.suffix.lower() in (".yaml", ".yml", ".urdf"):
        if _MAPPING.search(head):
            return "a mapping, which the option --mapping takes"
        if _SETTINGS.search(head):
            return "settings of a learner, which the option --settings takes"
        return command("a robot; fly it first: patagium simulate {}", path)
    if head.startswith(b"\x89HDF"):
        with suppress(OSError, RuntimeError, PatagiumError), open_netcdf(file) as opened:
            known = str(getattr(opened, "format", "")).rpartition(" ")[0]
            kinds = {known, *opened.ncattrs(), *opened.variables}
    elif found := _FORMAT.match(head):
        kinds = {found[1].decode()}
    return next((words for kind, words in _KINDS.items() if kind in kinds), "")


@contextmanager
def netcdf_content(path: str | Path, error: type[PatagiumError], expected: str) -> Iterator[None]:
    """Block that reads a netCDF file, its failures told as one error.

    Args:
        path: The file.
        error: Kind of the error.
        expected: Noun of what the file should hold, with its article.

    Yields:
        Nothing.

    Raises:
        PatagiumError: Of the kind `error`, if the file cannot be read or holds something else.
    """
    try:
        yield
    except error:
        raise
    except PatagiumError as problem:
        raise error(str(problem)) from problem
    except Exception as problem:  # of the libraries, in many kinds
        if isinstance(problem, OSError) and problem.strerror:  # of the C library, path included
            said = kind_of(path) or "other or damaged content"
        else:
            said = (str(problem) or type(problem).__name__)[:200]
        raise error(f"{path}: expected {expected}, found {said}") from problem


def loaded_dataset(
    path: str | Path, error: type[PatagiumError], expected: str, group: str | None = None
) -> xr.Dataset:
    """Whole netCDF file or group in memory, the file closed, nothing kept of how it was stored.

    Args:
        path: The file.
        error: Kind of the error.
        expected: Noun of what the file should hold, with its article.
        group: Group in the file; None: all outside of groups.

    Raises:
        PatagiumError: Of the kind `error`, if the file cannot be read, would take far more memory
            than its bytes hold or than is free, or holds complex numbers, dates or records.
    """
    import xarray as xr

    with netcdf_content(path, error, expected):
        file = _undamaged(path)
        options = {"group": group, "engine": "netcdf4", "decode_times": False}
        with xr.open_dataset(file, **options) as opened:  # type: ignore[arg-type]
            most = min(_GROWTH * file.stat().st_size + _SPARE, free_memory() // 2)
            if opened.nbytes > most:
                found = f"{in_bytes(opened.nbytes)}; cut it, as with ncks -d time,0,1000000"
                raise Unreadable(path, "", f"at most {in_bytes(most)}", found)
            for name, one in opened.variables.items():
                if one.dtype.kind in "cMmV":
                    raise Unreadable(path, str(name), "real numbers or names", f"{one.dtype}")
            dataset = opened.load()
    names = _texts(dataset)
    dataset = dataset.assign({name: one.astype(str) for name, one in names.items()})
    for variable in dataset.variables.values():
        variable.encoding.clear()
    dataset.encoding.clear()
    return dataset


def _texts(dataset: xr.Dataset) -> dict[str, xr.Variable]:
    variables = dataset.variables.items()
    return {str(name): one for name, one in variables if one.dtype.kind in "OUT"}


def open_netcdf(path: str | Path) -> netCDF4.Dataset:
    """NetCDF file open for reading, after its checksum was compared.

    Raises:
        Unreadable: If it is no file, or was damaged since it was written.
        OSError: If it is no netCDF file.
    """
    return netCDF4.Dataset(_undamaged(path))


def _undamaged(path: str | Path) -> Path:
    """Path of a file whose checksum is right, or that has none; compared once while it is there."""
    file = regular_file(path)
    state = file.stat()
    _compare_checksum(file, state.st_ino, state.st_size, state.st_mtime_ns)
    return file


@lru_cache(maxsize=100)
def _compare_checksum(file: Path, inode: int, size: int, changed: int) -> None:
    """Refuse a damaged file; inode and time of change tell a later state of it from this one."""
    content = max(0, size - len(_MARK) - 9)
    with file.open("rb") as stream:
        stream.seek(content)
        kept = stream.read(size - content)
        stream.seek(0)
        if kept.startswith(_MARK) and kept != _checksum_line(stream, content):
            found = "others: it is damaged, so take it from a copy or make it anew"
            raise Unreadable(file, "", "the bytes that were written", found)


def _checksum_line(stream: BinaryIO, size: int) -> bytes:
    """Last line of a netCDF file: the checksum of the next `size` bytes of a stream."""
    checksum = 0
    for start in range(0, size, _BLOCK):
        checksum = zlib.crc32(stream.read(min(_BLOCK, size - start)), checksum)
    return _MARK + b"%08x\n" % checksum


@contextmanager
def _diverted(path: Path) -> Iterator[int | None]:
    """Memory that takes what is written to an open file from now on; None where there is none."""
    if not hasattr(os, "memfd_create"):
        yield None
        return
    memory = os.memfd_create(path.name[:200])
    try:
        for handle in os.listdir("/proc/self/fd"):
            with suppress(OSError):
                if os.readlink(f"/proc/self/fd/{handle}").removesuffix(" (deleted)") == str(path):
                    os.dup2(memory, int(handle))
        yield memory
    finally:
        os.close(memory)
