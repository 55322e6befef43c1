"""Sensors of a flight, presets of real parts, and the log they leave."""

from patagium.names import offer_names

__all__ = offer_names(__name__)
