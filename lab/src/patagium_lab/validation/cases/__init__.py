"""Cases of the validation, one module each: `compute()` gives its results.

A new case is a new module here, named in `CASES`.
"""

CASES = (
    "wagner",
    "theodorsen",
    "gust",
    "steady_wings",
    "plunge",
    "measured_wing",
    "pitching_section",
)
"""Modules of the cases, in reading order."""
