"""Targets against what was found, said alike on every page.

Neglected: how near a miss is; the rows tell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Rows = Sequence[Mapping[str, Any]]


def verdict(met: bool | str) -> str:
    """Whether a target is met, as a table's cell: a miss stands out.

    Args:
        met: True, False, or why it is not known.
    """
    if isinstance(met, str):
        return met
    return "yes" if met else "**no**"


def count_met(rows: Rows) -> str:
    """How many targets are met, and which are not.

    Args:
        rows: One a target, with `target` and `met`.
    """
    met = sum(row["met"] is True for row in rows)
    text = f"**{met} of {len(rows)} targets are met.**"
    missed = [row["target"] for row in rows if row["met"] is False]
    left = [row["target"] for row in rows if isinstance(row["met"], str)]
    if missed:
        text += f" Missed: {'; '.join(missed)}."
    return f"{text} Not run: {'; '.join(left)}." if left else text
