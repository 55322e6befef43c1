"""Table of the settings of all learners, for settings.md: `python docs/settings_table.py`."""

from __future__ import annotations

from dataclasses import Field, fields
from typing import Any

from patagium.learning.settings import Alternatives, FilterSettings, LogRange, Meaning, leaves

COLUMNS = ("setting", "meaning", "unit", "range", "default", "learners", "tuned over")


def settings_table() -> str:
    """Settings of all learners as a table in Markdown, one row each."""
    rows = [_row(path, one) for path, one in leaves()]
    lines = [COLUMNS, tuple("---" for _ in COLUMNS), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def search_text(space: LogRange | Alternatives | None) -> str:
    """Values that `tune` tries, in words.

    Args:
        space: Search space of a setting; None: it is not tuned.
    """
    if space is None:
        return ""
    if isinstance(space, Alternatives):
        return ", ".join(_alternative(value) for value in space.values)
    low, high = space.low, space.high
    if space.one_minus:
        low, high = 1 - high, 1 - low
    words = f"{low:g} to {high:g}"
    if space.per_output:
        words += ", times the standard deviation of each output"
    return words if space.off is None else f"{words}, or {space.off:g}"


def _row(path: str, one: Field[Any]) -> tuple[str, ...]:
    """Cells of a setting."""
    meaning: Meaning = one.metadata["meaning"]
    group = path.partition(".")[0] if "." in path else ""
    outer = {field.name: field for field in fields(FilterSettings)}.get(group)
    space = meaning.search if outer is None else outer.metadata["meaning"].search
    default = "off" if outer is not None else meaning.found
    if one.default is not None:
        value = f"{one.default:g}" if isinstance(one.default, float) else str(one.default)
        default = f"off; {value}" if outer is not None else value
    numeric = one.type not in ("Structure", "str")
    return (
        f"`{path}`",
        meaning.text,
        meaning.unit,
        meaning.range if numeric or meaning.choices else "",
        default,
        ", ".join(meaning.learners),
        search_text(space),
    )


def _alternative(value: Any) -> str:
    if value is None:
        return "off"
    if isinstance(value, dict):
        return ", ".join(str(one) for one in value.values())
    return str(value)


if __name__ == "__main__":
    print(settings_table(), end="")
