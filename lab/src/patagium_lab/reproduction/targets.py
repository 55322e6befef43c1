"""Targets of the reproduction.

Every figure comes from the metrics of the page; nothing is measured here. Targets of speed belong
to the bench.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from patagium.report import Table
from patagium_lab.reproduction.claims import best_strip, scores_of_starts, scores_of_trial
from patagium_lab.reproduction.unsteady_page import unsteady_targets
from patagium_lab.study import Columns, Metrics, table_of
from patagium_lab.targets import at_most, between, row_verdict

COVERAGE = (0.90, 0.99)
"""Share of samples in the 95 % interval that counts as calibrated."""


def targets(metrics: Metrics) -> list[dict[str, Any]]:
    """Rows of the targets, with the keys target, limit, found, worst (of all starts) and met.

    Args:
        metrics: Metrics of the reproduction.
    """
    rows = []
    for flight, every, limit in (
        ("published", 100, 4e-5),
        ("published", 10, 5e-6),
        ("corrected", 100, 1e-4),
    ):
        found = scores_of_starts(
            metrics, flight, best_strip(flight), every, "nmse_second_half_worst"
        )
        name = f"{flight}: strip network, one in {every}, worst force, second half"
        rows.append(at_most(name, limit, ".1e").row_of_starts(found))
    for key, limit in (("mean", 1.3e-3), ("worst", 6.4e-3)):
        for network, size in (("dense_velocity", 474), ("dense", 850)):
            row = scores_of_trial(metrics, "published", network, every=1)
            found = [row[f"nmse_second_half_{key}"]] if row else []
            name = f"published: dense, {size} weights, every sample, {key}"
            rows.append(at_most(name, limit, ".1e").row_of_starts(found))
    found = scores_of_starts(metrics, "corrected", best_strip("corrected"), 100, "unseen_worst")
    name = "corrected: strip network frozen, unseen gaits, worst force"
    rows.append(at_most(name, 1e-3, ".1e").row_of_starts(found))
    for key in ("largest_variance", "coverage_second_half"):
        for flight in ("published", "corrected"):
            found = scores_of_starts(metrics, flight, best_strip(flight), 100, key)
            words = f"{flight}: strip network, "
            if key == "largest_variance":
                target = at_most(f"{words}largest variance at the end", 1e-2, ".1e")
            else:
                target = between(f"{words}samples in the 95 % interval", *COVERAGE, ideal=0.95)
            rows.append(target.row_of_starts(found))
    return rows + [target.row_of_starts(found) for target, found in unsteady_targets(metrics)]


def targets_table(metrics: Mapping[str, Any]) -> Table:
    """Table of the targets.

    Args:
        metrics: Metrics of the reproduction, `targets` among them.
    """
    columns: Columns = {
        "target": "target",
        "limit": "limit",
        "median of the starts [1]": "found",
        "worst start [1]": "worst",
        "met": row_verdict,
    }
    caption = (
        "Second half of the flights: errors as normalized mean squares, shares of samples, "
        "variances, ratios. A target is met by the median of the starts."
    )
    return table_of(columns, metrics["targets"], caption)
