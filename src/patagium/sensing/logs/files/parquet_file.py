"""Reader of Parquet files, batch by batch.

Columns of structures are read by dotted path; columns of lists are not read.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from patagium.sensing.logs.files.channels import BLOCK, Block, Request, Topic, reading
from patagium.sensing.logs.files.tables import columns_of, table_block, table_topic


class ParquetFile:
    """Open Parquet file; see `LogFile`.

    Args:
        path: The file.

    Raises:
        LogError: If the file cannot be read.
    """

    format = "Parquet"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        with reading(path, "Parquet"):
            from pyarrow import parquet, types

            self._file = parquet.ParquetFile(path)
            leaves = list(_leaves(self._file.schema_arrow, types))
        numbers = {name: str(kind) for name, kind, _ in leaves if not types.is_timestamp(kind)}
        stamped = {name: 1.0 for name, kind, _ in leaves if types.is_timestamp(kind)}
        units = {name: unit for name, _, unit in leaves if unit}
        count = int(self._file.metadata.num_rows)
        types_by_name = {**dict.fromkeys(stamped, "timestamp"), **numbers}
        topic = table_topic(types_by_name, count, units, stamped=stamped)
        self.topics: dict[str, Topic] = {"": topic}

    def blocks(self, wanted: tuple[Request, ...]) -> Iterator[Block]:
        """Requested rows, one pass through the file for each request."""
        for key, one in enumerate(wanted):
            with reading(self.path, "Parquet"):
                row, names = 0, columns_of(one)
                for batch in self._file.iter_batches(BLOCK, columns=names, use_threads=False):
                    columns = {name: _plain(batch, name) for name in names}
                    yield table_block(key, one, columns, row, len(batch), str(self.path))
                    row += len(batch)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _plain(batch: Any, path: str) -> Any:
    if path in batch.schema.names:
        return batch.column(path).to_numpy(zero_copy_only=False)
    head, _, rest = path.partition(".")
    column = batch.column(head)
    for part in rest.split("."):
        column = column.field(part)
    return column.to_numpy(zero_copy_only=False)


def _leaves(schema: Any, types: Any) -> Iterator[tuple[str, Any, str]]:
    for field in schema:
        yield from _leaf(field, field.name, types)


def _leaf(field: Any, path: str, types: Any) -> Iterator[tuple[str, Any, str]]:
    kind = field.type
    if types.is_struct(kind):
        for inner in kind:
            yield from _leaf(inner, f"{path}.{inner.name}", types)
    elif (
        types.is_integer(kind)
        or types.is_floating(kind)
        or types.is_boolean(kind)
        or types.is_decimal(kind)
        or types.is_timestamp(kind)
    ):
        words = field.metadata or {}
        unit = words.get(b"unit", words.get(b"units", b""))
        yield path, kind, unit.decode("utf-8", "replace")
