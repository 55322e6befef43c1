"""Targets of a study: a limit, what was found, and whether the limit is met.

Targets of all studies become rows of the same keys: target, limit, found, met.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Rows = Sequence[Mapping[str, Any]]
NOT_RUN = "not run"


@dataclass(frozen=True)
class Target:
    """A range that one figure of a study is meant to lie in.

    Attributes:
        name: What the figure is.
        limit: The range in words.
        low: Smallest figure that meets the target.
        high: Largest figure that meets the target.
        ideal: Best figure; the worst of several starts is the farthest from it.
    """

    name: str
    limit: str
    low: float = -math.inf
    high: float = math.inf
    ideal: float = -math.inf

    def meets(self, found: float) -> bool:
        """Whether a figure meets the target.

        Args:
            found: The figure.
        """
        return bool(self.low <= found <= self.high)

    def row(self, found: float) -> dict[str, Any]:
        """The target beside one figure, with the keys target, limit, found and met.

        Args:
            found: The figure.
        """
        return {"target": self.name, "limit": self.limit, "found": found, "met": self.meets(found)}

    def row_of_starts(self, found: Sequence[float]) -> dict[str, Any]:
        """The target beside the median over several starts; `worst` is the farthest start.

        Args:
            found: The figure of each start; empty where the runs were left out.
        """
        if not found:
            return self.row(math.nan) | {"worst": math.nan, "met": NOT_RUN}
        if math.isfinite(self.ideal):
            worst = max(found, key=lambda one: abs(one - self.ideal))
        else:
            worst = max(found) if self.ideal < 0 else min(found)
        return self.row(float(np.median(found))) | {"worst": float(worst)}


def at_most(name: str, limit: float, digits: str = "g") -> Target:
    """A target that a figure meets from below.

    Args:
        name: What the figure is.
        limit: Largest figure that meets it.
        digits: Format of the limit in words.
    """
    return Target(name, f"at most {limit:{digits}}", high=limit)


def at_least(name: str, limit: float, digits: str = ".3g") -> Target:
    """A target that a figure meets from above.

    Args:
        name: What the figure is.
        limit: Smallest figure that meets it.
        digits: Format of the limit in words.
    """
    return Target(name, f"at least {limit:{digits}}", low=limit, ideal=math.inf)


def between(name: str, low: float, high: float, ideal: float) -> Target:
    """A target that a figure meets within a range.

    Args:
        name: What the figure is.
        low: Smallest figure that meets it.
        high: Largest figure that meets it.
        ideal: Best figure.
    """
    return Target(name, f"{low:.2f} to {high:.2f}", low, high, ideal)


def verdict(met: bool | str) -> str:
    """Whether a target is met, as the cell of a table; a miss is set in bold.

    Args:
        met: True, False, or why it is not known.
    """
    if isinstance(met, str):
        return met
    return "yes" if met else "**no**"


def row_verdict(row: Mapping[str, Any]) -> str:
    """Whether the target of a row is met, as the cell of a table.

    Args:
        row: Row of a target.
    """
    return verdict(row["met"])


def count_met(rows: Rows) -> str:
    """Number of targets that are met, and the names of those that are missed or not run.

    Args:
        rows: Rows of targets.
    """
    met = sum(row["met"] is True for row in rows)
    text = f"**{met} of {len(rows)} targets are met.**"
    missed = [row["target"] for row in rows if row["met"] is False]
    left = [row["target"] for row in rows if isinstance(row["met"], str)]
    if missed:
        text += f" Missed: {'; '.join(missed)}."
    return f"{text} Not run: {'; '.join(left)}." if left else text
