"""Exact functions of Theodorsen, Wagner, Sears and Kussner, and lags fitted to them.

Incompressible potential flow, small motion about a straight path, flat wake. Neglected:
thickness, viscosity, wake roll-up.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import hankel2, i0e, i1e, j0, j1, k0e, k1e

from patagium.aerodynamics.indicial import Indicial
from patagium.arrays import Array

ComplexArray = NDArray[np.complex128]

_LOGARITHM = np.linspace(-25.0, 6.0, 400)


def theodorsen_function(reduced_frequency: ArrayLike) -> ComplexArray:
    """Circulatory lift over its quasi-steady value in harmonic motion, C(k), (N,).

    C = H1 / (H1 + i H0), Hankel functions of the second kind.

    Args:
        reduced_frequency: k = angular frequency x semichord / airspeed > 0, (N,) [-].
    """
    k = np.asarray(reduced_frequency, float)
    return np.asarray(hankel2(1, k) / (hankel2(1, k) + 1j * hankel2(0, k)))


def circulation_function(reduced_frequency: ArrayLike) -> ComplexArray:
    """Bound circulation over its quasi-steady value in harmonic motion, (N,).

    (2 i / (pi k)) exp(-i k) / (H1 + i H0), Hankel functions of the second kind.

    Args:
        reduced_frequency: k = angular frequency x semichord / airspeed > 0, (N,) [-].
    """
    k = np.asarray(reduced_frequency, float)
    wake = hankel2(1, k) + 1j * hankel2(0, k)
    return np.asarray(2j / (np.pi * k) * np.exp(-1j * k) / wake)


def fitted_indicial(rate: Sequence[float]) -> Indicial:
    """Amplitudes of given rates by linear least squares on the exact functions.

    Lift on Theodorsen's function at 200 reduced frequencies from .01 to 10, its sum
    held at Wagner's phi(0) = 1/2; circulation on its exact transfer function from .01 to 2.

    Args:
        rate: Rates [1/semichord].
    """
    low, high = np.geomspace(0.01, 10.0, 200), np.geomspace(0.01, 2.0, 200)
    rates = np.asarray(rate, float)
    lift = _amplitudes(low, theodorsen_function(low), rates, total=0.5)
    circulation = _amplitudes(high, circulation_function(high), rates, total=None)
    return Indicial(tuple(rates), tuple(lift), tuple(circulation))


def _amplitudes(k: Array, transfer: ComplexArray, rate: Array, total: float | None) -> Array:
    basis, wanted = 1j * k[:, None] / (1j * k[:, None] + rate), 1.0 - transfer
    matrix = np.vstack([basis.real, basis.imag])
    right = np.append(wanted.real, wanted.imag)
    if total is None:
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0])
    # the sum is held exactly: the last amplitude is what the others leave of it
    free = matrix[:, :-1] - matrix[:, -1:]
    others = np.linalg.lstsq(free, right - total * matrix[:, -1], rcond=None)[0]
    return np.append(others, total - others.sum())


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
