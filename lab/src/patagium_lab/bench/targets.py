"""Targets of speed, set before anything was measured.

Neglected: the load of the machine, which changes a time, and hardly a ratio of one run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from patagium_lab.bench.orbits import ORBITS
from patagium_lab.comparisons import seconds_text
from patagium_lab.targets import NOT_RUN, Target

UNITS = {"ns": 1e-9, "us": 1e-6, "s": 1.0}
"""Units of time among the figures [s]."""


@dataclass(frozen=True)
class SpeedTarget:
    """A limit of one figure of the bench, or of its ratio to a rival's.

    Attributes:
        group: Group of the bench.
        name: Name of the figure.
        limit: Largest that meets it: a time [s], a number, or a ratio where there is a rival.
        against: Begin of the rival's name; empty where the figure stands alone.
    """

    group: str
    name: str
    limit: float
    against: str = ""


_FULL = "update of full covariance, 874 weights"
_FLIGHT = "compiling a flight with lifting line and added mass"
_PLAIN, _FLOOR = "Algorithm 1, line by line", "arithmetic floor, S square"
_PRODUCTS = "its two dominant matrix products"
_NODE, _STRIP = "dense 28-20-14, one block a neuron", "strip 2-8-8-2, full covariance"
_NOISY = tuple(
    f"{network}, {learner}"
    for network in ("linear 11-12, 144 weights", "strip 2-11-11-2, 189 weights")
    for learner in (
        "full covariance, extended",
        "by layer, extended",
        "full covariance, cubature",
        "by layer, cubature",
    )
)
TARGETS = (
    SpeedTarget("pinocchio", "mass_matrix_and_bias", 0.2, "Pinocchio"),
    SpeedTarget("pinocchio", "forward", 0.25, "Pinocchio"),
    *(
        SpeedTarget("pinocchio", f"{name} batch", 0.05, "Pinocchio")
        for name in ("bias", "mass_matrix_and_bias", "inverse", "forward")
    ),
    SpeedTarget("strips", "lifting line, 16 strips", 15e-6),
    SpeedTarget("update", "update of network dense 8-20-14 (474 weights)", 2.0, _PRODUCTS),
    SpeedTarget("update", "update of network dense 28-20-14 (874 weights)", 2.0, _PRODUCTS),
    SpeedTarget("update", "update of network strip 2-8-8-2 (114 weights)", 100e-6),
    SpeedTarget("update", f"{_FULL}, float64", 1 / 45, _PLAIN),
    SpeedTarget("update", f"{_FULL}, float32", 1 / 100, _PLAIN),
    SpeedTarget("update", f"{_FULL}, float64", 2.5, _FLOOR),
    SpeedTarget("update", f"{_FULL}, float32", 2.5, _FLOOR),
    *(
        SpeedTarget("update", f"update with noise between samples, {name}", 2.0, "without")
        for name in _NOISY
    ),
    SpeedTarget("pipeline", f"{_NODE}: median", 40e-6),
    SpeedTarget("pipeline", f"{_NODE}: 99 % within", 100e-6),
    SpeedTarget("pipeline", f"{_STRIP}: median", 60e-6),
    *(SpeedTarget("orbits", f"trim: {name}", 50e-3) for name in ORBITS),
    SpeedTarget("tick", "whole tick: median", 100e-6),
    SpeedTarget("simulation", "simulation of 1 s of flight", 0.2),
    SpeedTarget("compile", "compiling one robot on a fresh cache", 15.0),
    SpeedTarget("compile", f"{_FLIGHT}, 10 strips", 15.0),
    SpeedTarget("compile", f"{_FLIGHT}, 22 strips", 15.0),
    *(
        SpeedTarget("compile", f"the first trim on a fresh cache, {robot}", 15.0)
        for robot in ("aerobat", "ornithopter", "dragonfly", "hawk")
    ),
)


def speed_targets(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Targets of the groups that were run, and the figures found.

    Args:
        rows: Results of `run`.

    Returns:
        Rows with the keys target, limit, found (as text) and met, which is "not run" where
        the figure is missing.
    """
    groups = {row["group"] for row in rows}
    return [_row(target, rows) for target in TARGETS if target.group in groups]


def figure_text(value: float | None, unit: str) -> str:
    """Text of a figure with its unit, unbroken, times to three digits.

    Args:
        value: The figure, or None.
        unit: Unit of the figure.
    """
    if value is None:
        return "–"
    if unit in UNITS:
        text = seconds_text(value * UNITS[unit])
    else:
        text = f"{value:.3g}" if unit == "1" else f"{value:.3g} {unit}"
    return text.replace(" ", "\u00a0")


def _row(target: SpeedTarget, rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    words = target.name.replace("_", " ")
    if target.against:
        words += f", over {target.against}"
    found = next((row for row in rows if _matches(row, target)), None)
    if found is None:
        limit = f"at most {target.limit:.3g}"
        return {"target": words, "limit": limit, "found": "–", "met": NOT_RUN}
    value = found["ratio"] if target.against else found["value"]
    unit = "times" if target.against else found["unit"]
    limit = f"at most {figure_text(target.limit / UNITS.get(unit, 1.0), unit)}"
    row = Target(words, limit, high=target.limit).row(value * UNITS.get(unit, 1.0))
    return row | {"found": figure_text(value, unit)}


def _matches(row: dict[str, Any], target: SpeedTarget) -> bool:
    if (row["group"], row["name"]) != (target.group, target.name) or row["value"] is None:
        return False
    return not target.against or (row["against"] or "").startswith(target.against)
