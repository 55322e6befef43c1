"""Sensors, logs, clocks, motion, and the aerodynamic force from measurements."""

from patagium.names import offer_names

__all__ = offer_names(__name__)
