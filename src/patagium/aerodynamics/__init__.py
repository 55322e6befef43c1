"""Aerodynamics: wind and gusts, local flow of the strips, models of their loads."""

from patagium.names import offer_names

__all__ = offer_names(__name__)
