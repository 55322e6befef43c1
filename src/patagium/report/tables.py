"""Tables of results: named columns, rows of numbers and words, and how a number reads."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import TypeAlias

from patagium.errors import ShapeError

Cell: TypeAlias = "str | float | bool | None"


@dataclass(frozen=True)
class Table:
    """Rows under named columns.

    Attributes:
        columns: Heads of the columns, with units: "time per call [ns]".
        rows: One cell a column; numbers are printed to three digits.
        caption: What the table shows, one sentence.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""

    def __init__(
        self, columns: Sequence[str], rows: Sequence[Sequence[Cell]], caption: str = ""
    ) -> None:
        for i, row in enumerate(rows):
            if len(row) != len(columns):
                raise ShapeError(f"row {i} of table {caption!r}", len(columns), len(row))
        object.__setattr__(self, "columns", tuple(columns))
        object.__setattr__(self, "rows", tuple(tuple(row) for row in rows))
        object.__setattr__(self, "caption", caption)

    def texts(self) -> list[list[str]]:
        """Every cell as a reader sees it, row by row."""
        return [[cell_text(cell) for cell in row] for row in self.rows]

    def numeric(self, column: int) -> bool:
        """Whether a column holds numbers only, to be set flush right."""
        cells = [row[column] for row in self.rows if row[column] is not None]
        return bool(cells) and all(_is_number(cell) for cell in cells)


def key_value_table(facts: Mapping[str, Cell], caption: str = "") -> Table:
    """A table of two columns from a mapping of names to values."""
    return Table(("quantity", "value"), list(facts.items()), caption)


def cell_text(value: Cell) -> str:
    """A number to three significant digits, "–" for nothing, "yes"/"no" for a truth.

    Integers up to a million keep all their digits; nan reads "n/a".
    """
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    number = float(value)
    if not _is_number(value):
        return "yes" if number else "no"
    if _is_whole(value) and abs(number) < 1e6:
        return f"{number:.0f}"
    if math.isnan(number):
        return "n/a"
    if math.isinf(number):
        return "∞" if number > 0 else "−∞"
    return _scientific(number) if _far(number) else _plain(number)


def _is_number(value: object) -> bool:
    # NumPy's bool is neither Real nor Integral, so it falls out by itself.
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_whole(value: object) -> bool:
    return isinstance(value, Integral)


def _far(number: float) -> bool:
    return number != 0.0 and not 1e-3 <= abs(number) < 1e5


def _plain(number: float) -> str:
    if number == 0.0:
        return "0"
    decimals = max(0, 2 - math.floor(math.log10(abs(number))))
    return f"{number:.{decimals}f}".replace("-", "−")


def _scientific(number: float) -> str:
    mantissa, exponent = f"{number:.2e}".split("e")
    digits = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}×10{digits}".replace("-", "−")
