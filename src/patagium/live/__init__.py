"""The loop of a running robot: packets, streams, and the pipeline from a packet to an update."""

from patagium.live.autopilot import Autopilot, Ticks
from patagium.live.autosave import AutoSave
from patagium.live.pipeline import Pipeline

__all__ = [
    "AutoSave",
    "Autopilot",
    "Pipeline",
    "Ticks",
]
