"""Parquet tables, read batch by batch.

Neglected: columns of lists; columns of structures are read by dotted path.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from patagium.sensing.logs.files.channels import (
    BLOCK,
    Block,
    Stamps,
    Topic,
    Wanted,
    nanoseconds,
    reading,
)
from patagium.sensing.logs.files.tables import as_numbers, table_topic


class ParquetFile:
    """A Parquet file that is open; see `LogFile`.

    Args:
        path: The file.
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
        topic = table_topic({**stamped_as_text(stamped), **numbers}, count, units,
                            stamped=stamped)  # fmt: skip
        self.topics: dict[str, Topic] = {"": topic}

    def blocks(self, wanted: tuple[Wanted, ...], skip: tuple[int, ...]) -> Iterator[Block]:
        """Rows of what is wanted, one pass for each."""
        for key, one in enumerate(wanted):
            with reading(self.path, "Parquet"):
                yield from self._pass(key, one, skip[key])

    def close(self) -> None:
        """Let the file go."""
        self._file.close()

    def _pass(self, key: int, wanted: Wanted, skip: int) -> Iterator[Block]:
        stamped = (wanted.base.column,) if wanted.base.kind == "column" else ()
        chosen = list(dict.fromkeys((*stamped, *wanted.fields)))
        row = 0
        for batch in self._file.iter_batches(BLOCK, columns=chosen, use_threads=False):
            before, row = row, row + len(batch)
            if row <= skip:
                continue
            kept = batch.slice(max(0, skip - before))
            first = max(skip, before)
            stamps = self._stamps(kept, wanted, first)
            columns = [
                as_numbers(_plain(kept, field), field, str(self.path), first)
                for field in wanted.fields
            ]
            values = np.column_stack(columns) if columns else np.empty((len(kept), 0))
            yield Block(key, stamps, values, row)

    def _stamps(self, batch: Any, wanted: Wanted, row: int) -> Stamps:
        if wanted.base.kind == "rows":
            return np.arange(row, row + len(batch), dtype=np.int64) * 10**9
        column = _plain(batch, wanted.base.column)
        if column.dtype.kind in "iuM":
            return nanoseconds(column, wanted.base.factor)
        numbers = as_numbers(column, wanted.base.column, str(self.path), row)
        return nanoseconds(numbers, wanted.base.factor)


def stamped_as_text(stamped: dict[str, float]) -> dict[str, str]:
    """Types of the columns that hold calendar time."""
    return dict.fromkeys(stamped, "timestamp")


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
