"""Memory of the air as a few exponentials: lift and circulation after a step.

    phi(s)   = 1 - sum_k a_k exp(-beta_k s)       lift (Wagner's function)
    Gamma(s) = 1 - sum_k g_k exp(-beta_k s)       bound circulation

in s semichords travelled, with the same rates beta for both. A section then
carries one lagged normalwash a rate, d z_k/ds = beta_k (w - z_k), and the
effective normalwashes are phi(0) w + sum a_k z_k and Gamma(0) w + sum g_k z_k.
They stand for incompressible potential flow, small motion about a straight path, flat wake.
Neglected: thickness, viscosity, wake roll-up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.local_flow import StripMotion, airspeed
from patagium.arguments import check_fields
from patagium.arrays import Array, real_array
from patagium.errors import ParameterError, positive

ComplexArray = NDArray[np.complex128]


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
class Indicial(Lags):
    """Rates and amplitudes of the lags of a section.

    Args:
        rate: beta, how fast each lag fades [1/semichord].
        lift: a, part of the lift that each lag holds back.
        circulation: g, part of the circulation that each lag holds back.

    Raises:
        ShapeError: If the three differ in length.
        ParameterError: If a rate is not positive, a number is not finite, or the response
            to a step would begin below zero or above one.
    """

    rate: tuple[float, ...]
    lift: tuple[float, ...]
    circulation: tuple[float, ...]

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("rate", "lift", "circulation"):
            values = real_array(name, getattr(self, name), (len(self.rate),))
            object.__setattr__(self, name, tuple(values.tolist()))
        if min(self.rate, default=1.0) <= 0:
            raise ParameterError("rate", "positive rates [1/semichord]", self.rate)
        for name in ("lift", "circulation"):
            total = sum(getattr(self, name))
            if not 0 <= total <= 1:
                raise ParameterError(name, "amplitudes that sum to 0..1", total)

    @property
    def size(self) -> int:
        """Number of lags a section carries."""
        return len(self.rate)

    def lift_response(self, semichords: ArrayLike) -> Array:
        """phi(s): lift after a step, over its final value, (N,).

        Args:
            semichords: Distance travelled since the step, (N,) [semichords].
        """
        s = np.atleast_1d(real_array("semichords", semichords))
        return np.asarray(1.0 - np.exp(-np.outer(s, self.rate)) @ np.asarray(self.lift, float))

    def lift_transfer(self, reduced_frequency: ArrayLike) -> ComplexArray:
        """Lift over its quasi-steady value in harmonic motion, in place of C(k), (N,).

        Args:
            reduced_frequency: k = angular frequency x semichord / airspeed, (N,) [-].
        """
        given = real_array("reduced_frequency", reduced_frequency)
        frequency = 1j * np.atleast_1d(given)[:, None]
        basis = np.asarray(frequency / (frequency + np.asarray(self.rate, float)))
        return np.asarray(1.0 - basis @ np.asarray(self.lift, float))

    def finite_span(self, aspect_ratio: float) -> Indicial:
        """Lags of the strips of a finite wing, whose shed vortices act over half of its span.

        beta -> sqrt(beta^2 + 1/A^2): memory fades within A semichords, which are half a span, and
        faster lags hardly change. In a lifting line they give R. T. Jones' functions of wings of
        aspect ratio 3 and 6 (1940, NACA Report 681), which those of a section miss by .05, to .02.

        Args:
            aspect_ratio: A, span over mean chord of the wing, with its mirror image [1].

        Raises:
            ParameterError: If it is not positive.
        """
        positive("aspect_ratio", aspect_ratio)
        return replace(self, rate=tuple(float(np.hypot(b, 1 / aspect_ratio)) for b in self.rate))


NO_STATE = Indicial(rate=(), lift=(), circulation=())
"""No lag: air without memory, the classic lifting line at every instant."""

ONE_STATE = Indicial(rate=(0.25,), lift=(0.5,), circulation=(0.8,))
"""One lag a section; Izraelevitz, Zhu and Triantafyllou (2017)."""

TWO_STATE = Indicial(rate=(0.0455, 0.3), lift=(0.165, 0.335), circulation=(0.1469, 0.6133))
"""R. T. Jones' two lags for the lift; the circulation's amplitudes by least squares from the exact
function."""

FOUR_STATE = Indicial(
    rate=(0.02, 0.1, 0.3, 1.0),
    lift=(0.0551, 0.1847, 0.2202, 0.04),
    circulation=(0.0527, 0.2316, 0.3084, 0.2674),
)
"""Four lags, all amplitudes by least squares from Theodorsen's function and that of circulation."""


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
