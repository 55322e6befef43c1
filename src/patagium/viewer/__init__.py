"""Looking at it: the flight of a robot as a page that moves."""

from patagium.viewer.replay import replay, still

__all__ = ["replay", "still"]
