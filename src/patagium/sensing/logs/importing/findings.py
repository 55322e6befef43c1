"""What is suspicious about a log before anything is computed from it.

Each finding says what was expected, what was found, and what to do. Rules look at sizes: a body
at rest or in steady flight feels 1 g, no gyroscope turns faster than 2,300 deg/s, rooms are
smaller than 500 m. Neglected: slips too small to show in sizes; `consistency` has the others.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.sensing.logs.files.channels import Array
from patagium.sensing.logs.importing.survey import SECOND, StampSurvey

Counts = NDArray[np.int64]

GRAVITY = 9.80665
_FASTEST = 40.0  # rad/s
_FARTHEST = 500.0  # m
_QUICKEST = 150.0  # m/s
_CLOSE = 1.35
"""Two sizes are alike when their ratio is below this."""


@dataclass(frozen=True)
class Finding:
    """Something to know before a log is used.

    Attributes:
        level: "warning", or "note" for what needs no action.
        where: Topic or quantity.
        kind: A word or two: "gap", "duplicate stamps", "unit" ...
        text: What was found, and what to do about it.
    """

    level: str
    where: str
    kind: str
    text: str

    def plain(self) -> dict[str, Any]:
        """As a dict for JSON."""
        return asdict(self)


def stamp_findings(where: str, stamps: StampSurvey, gap: float, *, column: bool) -> list[Finding]:
    """What the stamps of a stream tell.

    Args:
        where: The stream.
        stamps: What was counted.
        gap: A step longer than this many medians is a gap.
        column: Whether they come from a column, whose unit somebody wrote down.
    """
    found = []
    for count, kind, what in (
        (stamps.missing, "missing stamps", "without a stamp; left out"),
        (stamps.duplicates, "duplicate stamps", "with the stamp of the one before; left out"),
        (
            stamps.backwards,
            "backward stamps",
            f"stamped before an earlier one, by up to {stamps.furthest_back / SECOND:.4g} s; "
            "left out",
        ),
        (stamps.near_duplicates, "near-duplicate stamps", "less than a tenth of the median step "
         "after the one before; kept"),
    ):  # fmt: skip
        if count:
            found.append(Finding("warning", where, kind, f"{count} of {stamps.rows} rows {what}"))
    gaps = stamps.gaps(gap)
    if gaps:
        at = (stamps.longest_at - (stamps.first or 0)) / SECOND
        found.append(
            Finding(
                "warning",
                where,
                "gap",
                f"{gaps} step(s) longer than {gap:g} times the median of {stamps.median:.4g} s, "
                f"the longest {stamps.longest / SECOND:.4g} s at {at:.6g} s; not bridged",
            )
        )
    median = stamps.median
    if column and not 2e-6 <= median <= 5.0 and math.isfinite(median):
        fit = next((u for u, f in (("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9), ("s", 1e3), ("s", 1e6))
                    if 2e-6 <= median * f <= 1.0), "another")  # fmt: skip
        text = f"a median step of {median:.4g} s; is its unit {fit}?"
        found.append(Finding("warning", where, "unit of time", text))
    return found


@dataclass(frozen=True)
class Sizes:
    """How large a quantity is, in SI.

    Attributes:
        unit: As written in the mapping.
        si: SI unit.
        factor: From one to the other.
        mean: Of each component, (n,).
        rms: Of each component, (n,).
        largest: Largest magnitude of any component.
    """

    unit: str
    si: str
    factor: float
    mean: Array
    rms: Array
    largest: float


def unit_findings(where: str, sizes: Sizes) -> list[Finding]:
    """Whether a quantity has the size its unit suggests.

    Args:
        where: The quantity.
        sizes: How large it is.
    """
    written = sizes.largest / sizes.factor
    guess = ""
    if sizes.si == "m/s^2":
        guess = _acceleration_guess(sizes)
    elif sizes.si == "rad/s":
        if sizes.largest > _FASTEST:
            guess = "deg/s"
        elif _is(sizes, math.radians(1)) and 0.3 < written < 6.5:
            guess = "rad/s"
    elif sizes.si == "rad":
        if _is(sizes, 1.0) and sizes.largest > 2 * math.pi * 1.01:
            guess = "deg"
        elif _is(sizes, math.radians(1)) and 0.2 < written < 3.3:
            guess = "rad"
    elif sizes.si == "m":
        if sizes.largest > _FARTHEST:
            guess = "mm"
        elif _is(sizes, 1e-3) and 0.02 < written < 20.0:
            guess = "m"
    elif sizes.si == "m/s" and sizes.largest > _QUICKEST:
        guess = "mm/s"
    if not guess:
        return []
    size = float(np.linalg.norm(sizes.rms)) / sizes.factor
    text = f"in {sizes.unit} it reaches {written:.4g} (rms {size:.4g}); is it in {guess}?"
    return [Finding("warning", where, "unit", text)]


def _acceleration_guess(sizes: Sizes) -> str:
    vector = len(sizes.rms) == 3
    size = float(np.linalg.norm(sizes.rms)) if vector else abs(float(sizes.mean[0]))
    if not size or (size > 0.5 * GRAVITY and size < 3.0 * GRAVITY):
        return ""
    written = size / sizes.factor
    for unit, one in (("m/s^2", GRAVITY), ("g_0", 1.0), ("mm/s^2", 1e3 * GRAVITY), ("mg_0", 1e3)):
        if 1 / _CLOSE < written / one < _CLOSE:
            return unit
    return ""


def value_findings(
    where: str, count: Counts, missing: Counts, low: Array, high: Array
) -> list[Finding]:
    """Missing numbers, and channels that never move.

    Args:
        where: The quantity.
        count: Finite numbers of each component, (n,).
        missing: Others, (n,).
        low: Lowest of each, (n,).
        high: Highest of each, (n,).
    """
    found = []
    lost = int(np.max(missing, initial=0))
    if lost:
        total = int(np.max(count + missing))
        text = f"{lost} of {total} rows are no finite number; not used"
        found.append(Finding("warning", where, "missing numbers", text))
    still = (count > 1) & (low == high)
    if still.all() and len(still):
        text = f"never changes from {', '.join(f'{v:.6g}' for v in low)}"
        found.append(Finding("warning", where, "constant", text))
    return found


def _is(sizes: Sizes, factor: float) -> bool:
    return abs(sizes.factor / factor - 1.0) < 1e-6
