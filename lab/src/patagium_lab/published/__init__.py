"""The published experiment's air and stepping, with its errors, for comparison only."""

from patagium_lab.published.aerodynamics import PUBLISHED_ERRORS, Published
from patagium_lab.published.stepping import simulate_published

__all__ = ["PUBLISHED_ERRORS", "Published", "simulate_published"]
