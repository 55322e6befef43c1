"""Control: exact derivatives of a wingbeat, periodic orbits, stability, feedback, closed loops."""

from patagium.names import offer_names

__all__ = offer_names(__name__)
