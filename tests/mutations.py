"""Seeded mutations of files and texts for the tests and for long campaigns.

Each mutator takes content and a NumPy generator and returns other content; none knows a format
beyond what is needed to reach its readers behind their checksums.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

HOSTILE = (
    *("", "null", "[]", "{}", "-1", "0", "1e308", "1e-320", "nan", "inf", "true", "9" * 400),
    *('"\\ud800"', '"$\\\\frac{$"', '"\\u0000"', "[" * 200, "1e99999", '"x"', "[1, [2]]"),
)
"""Words that take the place of a value."""
_VALUE = re.compile(r'"(?:[^"\\]|\\.)*"|-?\d[\w.+-]*|\b(?:true|false|null)\b')
_WORD = re.compile(r"[^\s:,{}\[\]]+")


def mutated_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    """Content with some bytes changed, cut out or doubled."""
    held = bytearray(content)
    for _ in range(int(rng.integers(1, 8))):
        if not held:
            break
        place, kind = int(rng.integers(len(held))), int(rng.integers(4))
        span = int(rng.integers(1, 64))
        if kind == 0:
            held[place] = int(rng.integers(256))
        elif kind == 1:
            del held[place : place + span]
        elif kind == 2:
            held[place:place] = held[place : place + span]
        else:
            held[place : place + 8] = rng.integers(0, 256, 8, np.uint8).tobytes()
    return bytes(held)


def mutated_text(text: str, rng: np.random.Generator, pattern: re.Pattern[str] = _WORD) -> str:
    """Text with one to three of its words replaced by hostile ones."""
    for _ in range(int(rng.integers(1, 4))):
        found = list(pattern.finditer(text))
        if not found:
            break
        match = found[int(rng.integers(len(found)))]
        word = HOSTILE[int(rng.integers(len(HOSTILE)))]
        text = text[: match.start()] + word + text[match.end() :]
    return text


def mutated_json(text: str, rng: np.random.Generator) -> str:
    """JSON with one to three of its values replaced by hostile ones."""
    return mutated_text(text, rng, _VALUE)


def mutated_attributes(attributes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Attributes of a netCDF file, one of which is missing, hostile, or mutated."""
    name = list(attributes)[int(rng.integers(len(attributes)))]
    kind, held = int(rng.integers(4)), dict(attributes)
    if kind == 0:
        del held[name]
    elif kind == 1:
        held[name] = HOSTILE[int(rng.integers(len(HOSTILE)))]
    elif kind == 2:
        held[name] = rng.normal(size=3)
    else:
        held[name] = mutated_json(str(held[name]), rng)
    return held
