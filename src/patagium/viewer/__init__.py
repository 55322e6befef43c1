"""Looking at it: the flight of a robot as a page that moves."""

from patagium.names import offer_names

__all__ = offer_names(__name__)
