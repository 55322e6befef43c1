"""Dynamics: equations of motion as expressions and as compiled functions."""

from patagium.dynamics.dynamics import Dynamics, Point

__all__ = ["Dynamics", "Point"]
