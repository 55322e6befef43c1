"""The time separation takes: two lags a strip between incidence and stall.

Pressure at the leading edge follows the lift late, and separation follows that pressure
late, both as first-order lags in semichords travelled. Neglected: the vortex that leaves
the leading edge in deep dynamic stall, and its lift while it travels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

from patagium.aerodynamics.named_descriptions import check_keys
from patagium.errors import ParameterError


@dataclass(frozen=True)
class StallDelay:
    """Lags of separation behind the effective incidence.

    With W the normalwash that the lift answers to, s_0 the share of separated flow in
    steady flow, U the airspeed and c the chord,

        dp/dt = 2U/c (W - p) / pressure,      ds/dt = 2U/c (s_0(p) - s) / separation,

    and s takes the place of s_0(W). It stays between 0 and 1 as s_0 does.

    Args:
        pressure: T_p, lag of the pressure behind the lift [semichords].
        separation: T_f, lag of the separation behind the pressure [semichords].

    Raises:
        ParameterError: If one is not positive and finite.

    References:
        Leishman & Beddoes (1989), A semi-empirical model for dynamic stall, J. American
        Helicopter Society 34, 3-17 (T_p = 1.7, T_f = 3.0, NACA 0012 at low speed).
        Hansen, Gaunaa & Madsen (2004), Risoe-R-1354 (as states).
    """

    pressure: float = 1.7
    separation: float = 3.0

    def __post_init__(self) -> None:
        for name in DELAYS:
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise ParameterError(f"stall delay {name}", "a positive number", value)

    def describe(self) -> dict[str, Any]:
        """Description from which the object can be made again, as JSON-able values."""
        return {name: getattr(self, name) for name in DELAYS}


DELAYS = ("pressure", "separation")


def stall_delay_from_description(description: Mapping[str, Any]) -> StallDelay:
    """The delay of `describe()`.

    Raises:
        ParameterError: If a key is missing or unknown.
    """
    check_keys("stall delay", description, DELAYS)
    return StallDelay(**description)
