"""Morphing-wing robots: their equations, their flight, and what the air does to them.

A robot file becomes compiled equations of motion; a gait and a model of the air
become a flight; a flight becomes a learned model of the air. Everything is SI and
radians; x forward, y left, z up.

The names of daily work stand here. Five name spaces hold the rest: `patagium.air`,
`patagium.control`, `patagium.sensing`, `patagium.learning` and `patagium.errors`. Names are
resolved when first used, so that importing the package costs nothing.
"""

from patagium.names import offer_names

__all__ = offer_names(__name__)
