"""Robots: bodies, joints, wings and linkages as validated, frozen models."""

from patagium.names import offer_names

__all__ = offer_names(__name__)
