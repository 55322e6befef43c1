"""Exact functions of Wagner, Sears and Kussner, with which the lags of the air are compared.

Incompressible potential flow, small motion about a straight path, flat wake. Neglected:
thickness, viscosity, wake roll-up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import i0e, i1e, j0, j1, k0e, k1e

from patagium.aerodynamics.indicial import theodorsen_function
from patagium.arrays import Array

ComplexArray = NDArray[np.complex128]

_LOGARITHM = np.linspace(-25.0, 6.0, 400)


def sears_function(reduced_frequency: ArrayLike) -> ComplexArray:
    """Lift in a sinusoidal gust over its quasi-steady value, gust phase at mid-chord, (N,).

    S = C (J0 - i J1) + i J1.

    Args:
        reduced_frequency: k = angular frequency x semichord / airspeed > 0, (N,) [-].
    """
    k = np.asarray(reduced_frequency, float)
    c = theodorsen_function(k)
    return np.asarray(c * (j0(k) - 1j * j1(k)) + 1j * j1(k))


def wagner_function(semichords: ArrayLike) -> Array:
    """Circulatory lift after a step of incidence, over its final value, (N,).

    phi(s) = 1 - integral over x > 0 of exp(-s x) / (x^2 [(K0 - K1)^2 + pi^2 (I0 + I1)^2]).

    Args:
        semichords: Distance travelled since the step >= 0, (N,) [semichords].
    """
    # trapezoidal rule in log x: the integrand and its derivatives vanish at both ends
    x, step = np.exp(_LOGARITHM), _LOGARITHM[1] - _LOGARITHM[0]
    wake = (k0e(x) - k1e(x)) ** 2 * np.exp(-4 * x) + np.pi**2 * (i0e(x) + i1e(x)) ** 2
    decay = np.exp(-np.outer(np.atleast_1d(semichords), x) - 2 * x)
    return np.asarray(1.0 - step * (decay @ (1.0 / (x * wake))))


def kussner_function(semichords: ArrayLike) -> Array:
    """Lift after the leading edge has met a sharp-edged gust, over its final value, (N,).

    With the gust's front at distance s, its quasi-steady normalwash grows as
    Q'(s) = sqrt(s/(2-s))/pi up to s = 2, so that
    psi(s) = integral of phi(s-r) Q'(r) dr + sqrt(1-(s-1)^2)/pi.

    Args:
        semichords: Distance travelled since the leading edge met it >= 0, (N,) [semichords].
    """
    nodes, weights = np.polynomial.legendre.leggauss(24)
    values = []
    for s in np.atleast_1d(np.asarray(semichords, float)):
        front = min(s, 2.0)
        last = np.arccos(1.0 - front)
        angle = last * (nodes + 1.0) / 2.0
        growth = (1.0 - np.cos(angle)) * weights * last / 2.0
        travelled = np.maximum(s - (1.0 - np.cos(angle)), 0.0)
        circulatory = growth @ wagner_function(travelled)
        values.append((circulatory + np.sqrt(1.0 - (front - 1.0) ** 2)) / np.pi)
    return np.array(values)
