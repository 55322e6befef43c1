"""Dynamics: equations of motion as expressions and as compiled functions."""

from patagium.names import offer_names

__all__ = offer_names(__name__)
