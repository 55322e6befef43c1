"""Plugins of installed packages: verbs, models of the air.

A package adds something by an entry point of one of the groups below. The laboratory in `lab/`
adds the authors' verbs and the published air this way. Neglected: versions of plugins.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from typing import Any

VERBS = "patagium.verbs"
"""Verbs of `patagium study`: `WORD = module`, whose function of the module's name does the work."""
AIR_MODELS = "patagium.air_models"
"""Functions `(robot, air, description) -> Aerodynamics` by the model's name."""


def plugins(group: str) -> dict[str, EntryPoint]:
    """Entry points of a group by name."""
    return {point.name: point for point in entry_points(group=group)}


def plugin(group: str, name: str) -> Any:
    """Object behind an entry point; None if no installed package has it."""
    point = plugins(group).get(name)
    return None if point is None else point.load()
