"""Lag states of strips: the memory of the wake shed across the span.

Each strip carries a few normalwashes that follow the effective one late, dz/dt = rate (target - z).
Neglected: what `lifting_line` neglects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from patagium.aerodynamics.local_flow import StripMotion, airspeed


@dataclass(frozen=True)
class Lags:
    """Numbers of a section's memory, as symbols or values.

    Attributes:
        rate: b_k, how fast each lag fades [1/semichord].
        lift: a_k, part of the lift that each holds back.
        circulation: g_k, part of the circulation that each holds back.
    """

    rate: Sequence[Any]
    lift: Sequence[Any]
    circulation: Sequence[Any]

    @property
    def first_lift(self) -> Any:
        """phi(0), part of the lift without delay."""
        return 1.0 - sum(self.lift, ca.SX(0))

    @property
    def first_circulation(self) -> Any:
        """Gamma(0), part of the circulation without delay."""
        return 1.0 - sum(self.circulation, ca.SX(0))

    def lagged(self, amplitude: Sequence[Any], state: ca.SX, strip: int) -> ca.SX:
        """Sum over a strip's lags of amplitude times lagged normalwash.

        Args:
            amplitude: Of each lag.
            state: Lags strip by strip, (n_z, 1) [m/s].
            strip: Which one.
        """
        terms = [a * state[strip * len(amplitude) + k] for k, a in enumerate(amplitude)]
        return sum(terms, ca.SX(0))


@dataclass(frozen=True)
class Relaxation:
    """Memory that follows something: dz/dt = rate (target - z), one by one.

    Attributes:
        rate: Never negative, (n_z, 1) [1/s].
        target: What each follows, (n_z, 1), in the unit of z.
    """

    rate: ca.SX
    target: ca.SX

    def derivative(self, state: ca.SX) -> ca.SX:
        """dz/dt, (n_z, 1), in the unit of z a second [1/s].

        Args:
            state: z, (n_z, 1), in the unit of the target.
        """
        return self.rate * (self.target - state)


def lag_relaxation(motions: Sequence[StripMotion], effective: ca.SX, lags: Lags) -> Relaxation:
    """Lagged normalwashes follow the effective ones at 2 U b_k / c.

    Args:
        motions: How each strip moves.
        effective: Normalwash of each strip, (n, 1) [m/s].
        lags: Numbers of the memory.
    """
    rates, targets = [ca.SX(0, 1)], [ca.SX(0, 1)]
    for i, motion in enumerate(motions):
        semichords = 2 * airspeed(motion) / motion.strip.chord
        rates += [semichords * rate for rate in lags.rate]
        targets += [effective[i]] * len(lags.rate)
    return Relaxation(ca.vertcat(*rates), ca.vertcat(*targets))


def lag_step(state: ca.SX, step: Any, before: Relaxation, after: Relaxation) -> ca.SX:
    """Memory one step later by the exponential trapezoid, (n_z, 1).

    z <- e z + (1 - e) (target + target')/2, e = exp(-(rate + rate')/2 step): of second order,
    and a weighted mean at any step, 0 < e <= 1.

    Args:
        state: z at the beginning, (n_z, 1), in the unit of the target.
        step: Length of the step [s].
        before: What z follows at its beginning.
        after: The same at its end.
    """
    keep = ca.exp(-step * (before.rate + after.rate) / 2)
    return keep * state + (1.0 - keep) * (before.target + after.target) / 2
