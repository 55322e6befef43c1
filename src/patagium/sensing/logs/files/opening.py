"""Registry of log formats: the reader of a file, by its first bytes or its ending."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from patagium.arguments import of_kind
from patagium.errors import LogError, ParameterError
from patagium.netcdf_file import kind_of
from patagium.reading import check_room, regular_file
from patagium.sensing.logs.files import table_files
from patagium.sensing.logs.files.ardupilot_files import ArdupilotFile
from patagium.sensing.logs.files.channels import LogFile, first_bytes
from patagium.sensing.logs.files.message_files import BagFile, McapFile

_SINGLE: dict[str, Callable[[Path], LogFile]] = {
    ".csv": table_files.csv_file,
    ".parquet": table_files.ParquetFile,
    ".ulg": table_files.UlogFile,
    ".mat": table_files.MatFile,
    ".h5": table_files.Hdf5File,
    ".bin": ArdupilotFile,
}
_PARTED: dict[str, Callable[[list[Path]], LogFile]] = {
    ".bag": BagFile,
    ".db3": BagFile,
    ".mcap": McapFile,
}
"""Readers of formats whose recordings may have several parts."""
_AT_ONCE = (".mat", ".h5", ".ulg")
"""Formats whose libraries read a whole file into memory."""
_MAGIC = {
    b"#ROSBAG V": ".bag",
    b"\x89MCAP0\r\n": ".mcap",
    b"ULog\x01\x12\x35": ".ulg",
    b"PAR1": ".parquet",
    b"\xa3\x95\x80\x80": ".bin",
    b"MATLAB 5.0 MAT": ".mat",
    b"MATLAB 7.3 MAT": ".mat",
    b"SQLite format 3": ".db3",
    b"\x89HDF\r\n": ".h5",
}
_TEXT = (".csv", ".txt", ".tsv", ".lvm", ".csv.gz", ".txt.gz", ".tsv.gz")
_OWN = {*_SINGLE, *_PARTED, *_TEXT}
_SUMMED_UP = (
    "a CSV, Parquet, MAT, HDF5, ULog (.ulg), ArduPilot (.BIN), ROS bag (.bag, .db3, its folder) "
    "or MCAP file"
)


def open_log(paths: str | Path | Sequence[str | Path], *, skip_rows: int | None = None) -> LogFile:
    """Open log file of any known format.

    Args:
        paths: A file; a folder of a ROS 2 bag, or of the parts of one recording; or the parts.
        skip_rows: Number of lines before the line of names of a CSV file; found if None.

    Returns:
        The log, which the caller closes.

    Raises:
        LogError: If the log cannot be read, or is of no known format.
    """
    parts = parts_of(paths)
    kinds = {_kind(part) for part in parts}
    if len(kinds) > 1:
        raise LogError(parts[0], "parts of one format", ", ".join(sorted(kinds)))
    kind = kinds.pop()
    if skip_rows is not None:
        if kind != ".csv" or len(parts) > 1:
            found = f"{len(parts)} of {kind}; leave it out"
            raise LogError(f"{parts[0]}: skip_rows", "one CSV file, whose lines it counts", found)
        return table_files.CsvFile(parts[0], skip_rows)
    if kind in _PARTED:
        return _PARTED[kind](parts)
    if kind == ".h5" and (own := kind_of(parts[0])):
        raise LogError(parts[0], _SUMMED_UP, own)
    if len(parts) > 1:
        raise LogError(parts[0], "one file", f"{len(parts)}: only bags have parts")
    if kind in _AT_ONCE:
        check_room(parts[0], parts[0].stat().st_size)
    return _SINGLE[kind](parts[0])


def register_reader(ending: str, reader: Callable[[Path], LogFile], magic: bytes = b"") -> None:
    """Make `open_log`, `inspect_log` and `import_log` of this process read one more format.

    Args:
        ending: Ending of the file names, such as ".tdms", in small letters or capitals.
        reader: Function or class that opens a file; see `LogFile` for what it returns.
        magic: First bytes of every such file; empty if they are not fixed.

    Raises:
        ParameterError: If the ending is not one suffix, or patagium reads such files itself.
    """
    of_kind("ending", ending, str)
    ending = ending.lower()
    if ending not in Path(f"log{ending}").suffixes or ending in _OWN:
        raise ParameterError("ending", f"one suffix, none of {' '.join(sorted(_OWN))}", ending)
    _SINGLE[ending] = reader
    if magic:
        _MAGIC[magic] = ending


def parts_of(paths: str | Path | Sequence[str | Path]) -> list[Path]:
    """Files of a log, or the folders of ROS 2 bags; see `open_log`.

    Raises:
        LogError: If there is none.
    """
    given = [paths] if isinstance(paths, str | Path) else list(paths)
    if not given:
        raise LogError(f"expected {_SUMMED_UP}, found none")
    return [part for one in given for part in _parts(Path(one))]


def _parts(path: Path) -> list[Path]:
    if not os.path.isdir(path):
        return [regular_file(path)]
    files = [regular_file(one) for one in sorted(path.iterdir()) if not one.is_dir()]
    if path / "metadata.yaml" in files:
        return [path]
    for ending in _PARTED:
        if found := [one for one in files if one.suffix == ending]:
            return found
    raise LogError(f"{path}: expected a bag's folder, or one with .bag, .mcap or .db3 files")


def _kind(path: Path) -> str:
    """Ending of the format of a file, by its first bytes or by its name."""
    if path.is_dir():
        return ".db3"
    try:
        head = first_bytes(path, 16)
    except OSError as problem:
        raise LogError(f"{path}: cannot be read: {problem.strerror}") from problem
    if not head:
        raise LogError(path, _SUMMED_UP, "an empty file")
    for magic, ending in _MAGIC.items():
        if head.startswith(magic):
            return ending
    ending = "".join(path.suffixes[-2:]).lower()
    if path.name.lower().endswith(_TEXT):
        return ".csv"
    if path.suffix.lower() in {**_SINGLE, **_PARTED}:
        return path.suffix.lower()  # its reader says what is wrong with it
    if head.startswith(b"FMT,"):
        convert = f"mavlogdump.py --format mat --mat_file log.mat {path.name}"
        raise LogError(path, _SUMMED_UP, f"ArduPilot's log as text; convert it: {convert}")
    raise LogError(path, _SUMMED_UP, f"a name that ends in {ending or 'nothing'!r}")
