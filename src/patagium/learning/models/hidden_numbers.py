"""Numbers of the air that a network learns, and their code: any real numbers will do.

Logarithms keep rates positive and amplitudes positive with sums below one, whatever a learner
makes of them. Neglected: amplitudes of lift that differ in sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, sin
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from patagium.aerodynamics.indicial import Indicial, fitted_indicial
from patagium.aerodynamics.lag_states import Lags
from patagium.errors import ParameterError

Array = NDArray[np.float64]

_SLOWEST, _FASTEST = 0.05, 0.8  # rates of lags asked for by number [1/semichord]
# of logarithms, for a weight of one; far from stall a step in its numbers changes too much
_REACH = {"lags": 5.0, "lift_slope": 1.0, "stall": 1.5, "stall_width": 0.5}
_STALL_SLOPE = 8.75  # widths of the logistic function in a smooth step of the same slope


@dataclass(frozen=True)
class LearnedAir:
    """Numbers of the air that are learned, as symbols or values.

    Whatever the coded numbers are, rates are positive, amplitudes positive with sums below one.

    Attributes:
        lags: Memory of a section.
        lift_slope: Of attached flow [1/rad].
        stall: sin^2 of the effective incidence at which half of the flow is separated.
        stall_width: How far from there in sin^2 the attached share falls by e.
    """

    lags: Lags
    lift_slope: Any
    stall: Any
    stall_width: Any


def learned_air(coded: Any, lags: int) -> LearnedAir:
    """The numbers behind their code, which may be any real numbers.

    Args:
        coded: Logarithms of the rates, of the circulation's amplitudes over what they leave of
            one, of the lift slope, of the lift's amplitudes likewise, of stall and its width.
        lags: How many a strip.
    """
    rate = [ca.exp(coded[k]) for k in range(lags)]
    circulation = _shares([coded[lags + k] for k in range(lags)])
    lift = _shares([coded[2 * lags + 1 + k] for k in range(lags)])
    slope, stall, width = (ca.exp(coded[k]) for k in (2 * lags, 3 * lags + 1, 3 * lags + 2))
    return LearnedAir(Lags(rate, lift, circulation), slope, stall, width)


def coded_size(lags: int) -> tuple[int, int]:
    """How many coded numbers there are, and on how many of them, the first, memory depends.

    Args:
        lags: How many a strip.
    """
    return 3 * lags + 3, 2 * lags + 1


def coded_start(lags: Indicial, lift_slope: float, stall: tuple[float, float]) -> Array:
    """Code of numbers that are known, (n,).

    Args:
        lags: Memory of a section.
        lift_slope: Of attached flow [1/rad].
        stall: Incidences where it begins and where it is complete [rad].
    """
    low, high = (sin(angle) ** 2 for angle in stall)
    stalled = [log((low + high) / 2), log((high - low) / _STALL_SLOPE)]
    parts = [np.log(lags.rate), _logarithms(lags.circulation), [log(lift_slope)]]
    return np.concatenate([*parts, _logarithms(lags.lift), stalled])


def coded_reach(lags: int) -> Array:
    """What a weight of one adds to each coded number, (n,).

    Args:
        lags: How many a strip.
    """
    of_lags, others = [_REACH["lags"]], [_REACH["stall"], _REACH["stall_width"]]
    return np.array([*of_lags * (2 * lags), _REACH["lift_slope"], *of_lags * lags, *others])


def starting_lags(lags: int | Indicial) -> Indicial:
    """Lags to start from: as given, or so many of evenly spread rates, with fitted amplitudes.

    Args:
        lags: How many, or themselves.

    Raises:
        ParameterError: If there is none, or an amplitude has no code.
    """
    if isinstance(lags, Indicial):
        found = lags
    elif isinstance(lags, int) and lags > 0:
        middle = [(_SLOWEST * _FASTEST) ** 0.5]
        spread = np.geomspace(_SLOWEST, _FASTEST, lags).tolist()
        found = fitted_indicial(middle if lags == 1 else spread)
    else:
        raise ParameterError("lags", "a positive number, or an Indicial", lags)
    amplitudes = (found.lift, found.circulation)
    if not all(part and min(part) > 0 and sum(part) < 1 for part in amplitudes):
        expected = "at least one lag, amplitudes above 0 that sum to less than 1"
        raise ParameterError("lags", expected, found.describe())
    return found


def _shares(logarithms: Sequence[Any]) -> list[Any]:
    """Positive numbers whose sum is below one; what is missing counts as exp(0)."""
    parts = [ca.exp(value) for value in logarithms]
    total = 1.0 + sum(parts)
    return [part / total for part in parts]


def _logarithms(shares: Sequence[float]) -> Array:
    """Of positive numbers over what their sum leaves of one."""
    return np.asarray(np.log(shares) - np.log(1.0 - sum(shares)))
