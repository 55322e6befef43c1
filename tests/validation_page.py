"""Errors that docs/validation.md shows, for the tests that compute them again."""

from __future__ import annotations

import re
from pathlib import Path

_PAGE = Path(__file__).parents[1] / "docs" / "validation.md"
_ROW = re.compile(r"^\| ([^|]+) \| ([−\d.×⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+) \|", re.MULTILINE)


def errors_of_the_page() -> dict[tuple[str, str], float]:
    """Errors that the page shows, by case and model."""
    shown = {}
    for part in _PAGE.read_text("utf-8").split("\n## ")[1:]:
        case = part.split("\n")[0]
        shown |= {(case, model): _number(value) for model, value in _ROW.findall(part)}
    return shown


def _number(text: str) -> float:
    """Number as a table prints it."""
    digits = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")
    mantissa, _, exponent = text.partition("×10")
    return float(mantissa) * 10.0 ** int(exponent.translate(digits) or 0)
