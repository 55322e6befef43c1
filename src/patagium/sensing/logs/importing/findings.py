"""Findings about a log, made from its statistics before any other use.

Each finding says what was expected, what was found, and what to do. The rules compare sizes: a
body at rest or in steady flight feels 1 g, no gyroscope turns faster than 2,300 deg/s, rooms are
smaller than 500 m. Mistakes that sizes cannot show are found by `consistency`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from patagium.sensing.logs.files.channels import Array
from patagium.sensing.logs.importing.survey import SECOND, StampSurvey, ValueSurvey
from patagium.sensing.logs.mapping import conversion

GRAVITY = 9.80665
_FASTEST = 40.0  # rad/s
_FARTHEST = 500.0  # m
_QUICKEST = 150.0  # m/s
_CLOSE = 1.35
"""Ratio below which two sizes are alike."""


@dataclass(frozen=True)
class Finding:
    """Fact that a user should know before the log is used.

    Attributes:
        level: "warning", or "note" if no action is needed.
        where: Topic or quantity.
        kind: One or two words: "gap", "duplicate stamps", "unit" ...
        text: Description of what was found, and of what to do about it.
    """

    level: str
    where: str
    kind: str
    text: str

    def plain(self) -> dict[str, Any]:
        """Finding as a dict for JSON."""
        return asdict(self)


def stamp_findings(where: str, stamps: StampSurvey, gap: float, *, column: bool) -> list[Finding]:
    """Findings about the stamps of a stream.

    Args:
        where: Name of the stream.
        stamps: Statistics of its stamps.
        gap: Length from which a step is a gap, in median steps.
        column: Whether the stamps come from a column, whose unit a person wrote down.
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
    """Size of a quantity in SI units.

    Attributes:
        unit: Unit as written in the mapping or the file.
        si: SI unit of the same dimension.
        factor: Factor from the unit to the SI unit.
        mean: Mean of each component, (n,) [si].
        rms: Root mean square of each component, (n,) [si].
        largest: Largest magnitude of any component [si].
    """

    unit: str
    si: str
    factor: float
    mean: Array
    rms: Array
    largest: float


def sizes_of(values: ValueSurvey, places: Sequence[int], unit: str, offset: float = 0.0) -> Sizes:
    """Size of a quantity.

    Args:
        values: Statistics of the stream that holds it.
        places: Its components among the numbers of the stream.
        unit: Unit of the numbers.
        offset: Zero of the sensor, in that unit.

    Raises:
        LogError: If the unit is unknown, or does not only scale.
    """
    factor, si = conversion(unit, None, "unit")
    chosen = list(places)
    ends = np.array([values.low[chosen], values.high[chosen]]) - offset
    return Sizes(
        unit,
        si,
        factor,
        (values.mean[chosen] - offset) * factor,
        values.rms[chosen] * abs(factor),
        float(np.abs(ends).max()) * abs(factor),
    )


def unit_findings(where: str, sizes: Sizes) -> list[Finding]:
    """Finding that a quantity does not have the size that its unit suggests.

    Args:
        where: Name of the quantity.
        sizes: Its size.
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


def missing_findings(where: str, values: ValueSurvey, places: Sequence[int]) -> list[Finding]:
    """Finding that numbers of a quantity are missing or not finite.

    Args:
        where: Name of the quantity.
        values: Statistics of the stream that holds it.
        places: Its components among the numbers of the stream.
    """
    missing = values.missing[list(places)]
    lost = int(np.max(missing, initial=0))
    if not lost:
        return []
    total = int(np.max(values.count[list(places)] + missing))
    text = f"{lost} of {total} rows are no finite number; not used"
    return [Finding("warning", where, "missing numbers", text)]


def constant_findings(where: str, values: ValueSurvey, places: Sequence[int]) -> list[Finding]:
    """Finding that a quantity never changes.

    Args:
        where: Name of the quantity.
        values: Statistics of the stream that holds it.
        places: Its components among the numbers of the stream.
    """
    chosen = list(places)
    low, high = values.low[chosen], values.high[chosen]
    if not chosen or not ((values.count[chosen] > 1) & (low == high)).all():
        return []
    text = f"never changes from {', '.join(f'{v:.6g}' for v in low)}"
    return [Finding("warning", where, "constant", text)]


def _is(sizes: Sizes, factor: float) -> bool:
    return abs(sizes.factor / factor - 1.0) < 1e-6
