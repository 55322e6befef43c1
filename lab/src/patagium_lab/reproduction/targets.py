"""The targets the reproduction set itself: limit, found, met or not.

Every figure comes from the metrics that the report is made of; nothing is measured here.
Neglected: targets of speed, which are the bench's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from patagium.report import Table
from patagium_lab.reproduction.claims import Metrics, Row, best_strip, run_of, starts_of
from patagium_lab.reproduction.unsteady_report import unsteady_targets
from patagium_lab.verdicts import verdict


def targets(metrics: Metrics) -> list[Row]:
    """What this reproduction set out to reach, and what it reached.

    Args:
        metrics: Of the reproduction.

    Returns:
        One dictionary a target: target, limit, found, worst (of all starts), met.
    """
    rows = []
    for flight, every, limit in (("published", 100, 4e-5), ("published", 10, 5e-6),
                                 ("corrected", 100, 1e-4)):  # fmt: skip
        found = starts_of(metrics, flight, best_strip(flight), every, "nmse_second_half_worst")
        rows.append(
            _below(f"{flight}: strip network, one in {every}, worst force, second half", limit,
                   found)
        )  # fmt: skip
    for key, limit in (("mean", 1.3e-3), ("worst", 6.4e-3)):
        for network, size in (("dense_velocity", 474), ("dense", 850)):
            row = run_of(metrics, "published", network, every=1)
            found = [row[f"nmse_second_half_{key}"]] if row else []
            rows.append(
                _below(f"published: dense, {size} weights, every sample, {key}", limit, found)
            )
    unseen = starts_of(metrics, "corrected", best_strip("corrected"), 100, "unseen_worst")
    rows.append(_below("corrected: strip network frozen, unseen gaits, worst force", 1e-3, unseen))
    for flight in ("published", "corrected"):
        variance = starts_of(metrics, flight, best_strip(flight), 100, "largest_variance")
        rows.append(_below(f"{flight}: strip network, largest variance at the end", 1e-2, variance))
    for flight in ("published", "corrected"):
        share = starts_of(metrics, flight, best_strip(flight), 100, "coverage_second_half")
        rows.append(_between(f"{flight}: strip network, samples in the 95 % interval", share))
    for target, limit, found, below in unsteady_targets(metrics):
        rows.append(_below(target, limit, found) if below else _above(target, limit, found))
    return rows


def targets_table(metrics: Metrics) -> Table:
    """The targets as a table.

    Args:
        metrics: Of the reproduction, `targets` among them.
    """
    rows = [
        [row["target"], row["limit"], row["found"], row["worst"], verdict(row["met"])]
        for row in metrics["targets"]
    ]
    return Table(
        ("target", "limit", "found (median of the starts)", "worst start", "met"),
        rows,
        "Second half of the flights. A target is met by the median of the starts.",
    )


def _below(target: str, limit: float, found: Sequence[float]) -> Row:
    middle = float(np.median(found)) if found else math.nan
    worst = float(max(found)) if found else math.nan
    return {
        "target": target,
        "limit": f"at most {limit:.1e}",
        "found": middle,
        "worst": worst,
        "met": bool(middle <= limit) if found else "not run",
    }


def _above(target: str, limit: float, found: Sequence[float]) -> Row:
    middle = float(np.median(found)) if found else math.nan
    return {
        "target": target,
        "limit": f"at least {limit:.3g}",
        "found": middle,
        "worst": float(min(found)) if found else math.nan,
        "met": bool(middle >= limit) if found else "not run",
    }


def _between(target: str, found: Sequence[float]) -> Row:
    middle = float(np.median(found)) if found else math.nan
    worst = max(found, key=lambda share: abs(share - 0.95)) if found else math.nan
    return {
        "target": target,
        "limit": "0.90 to 0.99",
        "found": middle,
        "worst": worst,
        "met": bool(0.90 <= middle <= 0.99) if found else "not run",
    }
