"""LogTable of a log file in one call: plain columns directly, all else through an import."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from patagium.errors import LogError
from patagium.sensing.logs.importing.import_log import import_log
from patagium.sensing.logs.mapping import TableMapping, load_mapping
from patagium.sensing.logs.record import LogRecord
from patagium.sensing.logs.table import LogTable, table_from_frame


def read_table(
    path: str | Path,
    mapping: TableMapping | str | Path,
    tell: Callable[[Any], None] | None = None,
) -> LogTable:
    """Checked table of a CSV or Parquet file, or of another log through `import_log`.

    A header may carry its unit as `name [unit]`; it must then agree with the mapping. If the
    mapping names more than plain columns (topics, axes, a time base), the log is imported in a
    temporary folder first.

    Args:
        path: A `.csv` (also `.csv.gz`) or `.parquet` file with named columns, or another log.
        mapping: Meaning of the columns, or the YAML file that states it.
        tell: Called with the findings of an import.

    Raises:
        LogError: If the file cannot be read, a column is missing or not numeric, a number
            is missing or infinite, time does not advance, or a unit does not fit.
    """
    file = Path(path)
    words = mapping if isinstance(mapping, TableMapping) else load_mapping(mapping)
    if words.is_plain and file.name.lower().endswith((".csv", ".csv.gz", ".parquet")):
        return table_from_frame(_frame(file), words, str(file))
    with tempfile.TemporaryDirectory() as folder:
        found = import_log(file, mapping, Path(folder) / "log.nc", tell=tell)
        with LogRecord(found.path) as record:
            return replace(record.table(), source=str(file))


def _frame(file: Path) -> pd.DataFrame:
    try:
        if file.suffix == ".parquet":
            return pd.read_parquet(file)
        return pd.read_csv(file, encoding="utf-8-sig")
    except FileNotFoundError as problem:
        raise LogError(f"{file}: no such file") from problem
    except (OSError, ValueError, ImportError) as problem:
        raise LogError(f"{file}: expected a CSV or Parquet table, found: {problem}") from problem
