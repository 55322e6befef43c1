"""Input of the verbs that learn: a flight, a table with its mapping, or an imported log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from patagium.cli.words import MEANING, existing, flight_file, no_robot, tell
from patagium.errors import ParameterError, command
from patagium.netcdf_file import kind_of

if TYPE_CHECKING:
    import xarray as xr

    from patagium.sensing.logs.record import LogRecord


def record_of(file: Path, mapping: Path | None) -> LogRecord | None:
    """Open imported log; None for any other file. Warnings of the import are printed.

    Raises:
        ParameterError: If a mapping is given for an imported log, which carries its own.
        LogError: If the imported log is damaged.
    """
    from patagium.sensing.logs.record import LogRecord, is_log

    if not is_log(file):
        return None
    if mapping is not None:
        raise ParameterError("--mapping", "none: the imported log carries its own", str(mapping))
    record = LogRecord(file)
    tell_warnings(file, record.findings)
    return record


def tell_warnings(file: Path, findings: Sequence[Mapping[str, Any]]) -> None:
    """Warnings among the findings of an import, on stderr."""
    warnings = [one for one in findings if one["level"] == "warning"]
    if warnings:
        tell(f"{file}: {len(warnings)} finding(s) when it was imported:")
    for one in warnings:
        tell(f"  {one['where']}: {one['kind']}: {one['text']}")


def loaded(file: Path) -> xr.Dataset:
    """Record of a stream, motion, or else a simulated flight."""
    from patagium.sensing.logs.record import LOADED, load_log
    from patagium.simulation import load_flight

    logged = kind_of(file).startswith(LOADED)
    return load_log(file) if logged else load_flight(flight_file(file))


def flight_or_table(file: Path, mapping: Path | None, *, blocks: bool = False) -> tuple[Any, Any]:
    """Flight or table in a file.

    Args:
        file: The flight, imported log, or table.
        mapping: Mapping of a table.
        blocks: Whether a table that is too long for memory is left on the disk.

    Returns:
        The flight and None, or None and the table, or None and the open record of a long one.

    Raises:
        ParameterError: If a mapping is missing, or is given for a file that needs none.
        LogError: If the log cannot be read.
    """
    from patagium.cli.inspect import show_findings
    from patagium.learning.long_log import LONG
    from patagium.sensing.logs.importing.import_log import opened_log

    record = record_of(file, mapping)
    if record is None and file.suffix.lower() == ".nc":
        if mapping is not None:
            raise ParameterError("--mapping", "a table (.csv, .parquet) to go with it", str(file))
        return loaded(file), None
    if record is None:
        if mapping is None:
            meaning = command(MEANING, no_robot(file))
            raise ParameterError("--mapping", f"a YAML file {meaning}", None)
        place = file if file.is_dir() else existing(file)
        record = opened_log(place, existing(mapping), partial(show_findings, err=True))
    if blocks and record.count >= LONG and not record.is_flight:
        return None, record
    with record as log:
        return (log.flight(), None) if log.is_flight else (None, log.table())
