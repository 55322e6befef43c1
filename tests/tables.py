"""Tables for tests, read from a file as a person's are."""

import tempfile
from pathlib import Path
from typing import Any

import pandas as pd

from patagium.sensing import LogTable, read_table
from patagium.sensing.logs.mapping import parse_mapping


def table_of(frame: pd.DataFrame, words: dict[str, Any]) -> LogTable:
    """Table of the columns of a CSV file, by a mapping's words."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        frame.to_csv(path, index=False)
        return read_table(path, parse_mapping(words))
