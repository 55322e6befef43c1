"""Simulation: gaits, mounts, integration, and the record of a flight."""

from patagium.names import offer_names

__all__ = offer_names(__name__)
