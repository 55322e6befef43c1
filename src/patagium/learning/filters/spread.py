"""Cubature points and linearization: two ways to the mean and covariance of y.

Points W +- kappa S e_i, i = 1..n, and W itself. With y0 = y(W) and, along column i,

    d_i = (y_i+ - y_i-) / 2        slope,
    c_i = (y_i+ + y_i-) / 2 - y0   curvature,

the mean of y is y0 + D, D = sum c_i / kappa^2: the weights 1/(2 kappa^2) of the points
and 1 - n/kappa^2 of the center, exact for every quadratic y(W). Its covariance is
Z Z' + M with Z = d / kappa in all cases; M is what the curvatures add.

- kappa^2 >= n (sqrt(n): the cubature rule, no center): all weights are positive and M
  is the plain weighted sum, M = sum (c_i - D)(c_i - D)' / kappa^2 + (1 - n/kappa^2) D D' + R.
- kappa^2 < n: the center's weight is negative and the plain sum may be indefinite. The
  second-order divided differences (Norgaard, Poulsen & Ravn 2000) are used instead:
  M = sum 2 c_i c_i' / kappa^4 + R, exact for quadratic y(W) without mixed terms, and
  positive definite whatever the curvatures are. At kappa = sqrt(3) it is theirs to the letter.
- kappa -> 0 is the extended Kalman filter with its second-order terms along the columns.

The covariance of W with y is S Z in all cases. Linearized at W, with H = dy/dW, the mean is
y(W), Z = S' H' and M = R. Neglected: mixed second derivatives; linearized, all of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from patagium.arrays import Array
from patagium.learning.filters.numbers import SpreadRule


class Moments(NamedTuple):
    """Moments of y, with S the square root of the covariance of the weights.

    Attributes:
        mean: Mean, (n_y,) [y].
        slopes: Z, (n, n_y) [y]: the covariance of W with y is S Z.
        remainder: M, (n_y, n_y) [y^2]: the covariance of y is Z' Z + M.
    """

    mean: Array
    slopes: Array
    remainder: Array

    @property
    def covariance(self) -> Array:
        """P_yy = Z' Z + M, (n_y, n_y)."""
        return self.slopes.T @ self.slopes + self.remainder


def moments_of(center: Array, plus: Array, minus: Array, noise: Array, rule: SpreadRule) -> Moments:
    """Mean and covariance of y from its values at the points.

    Args:
        center: y(W), (n_y,) [unit of y].
        plus: y(W + kappa S e_i), (n, n_y) [unit of y].
        minus: y(W - kappa S e_i), (n, n_y) [unit of y].
        noise: Variances of the measurement, (n_y,) [y^2].
        rule: The rule that placed them.
    """
    slopes = (plus - minus) / (2 * rule.spread)
    curvatures = (plus - center) / 2 + (minus - center) / 2
    shift = curvatures.sum(axis=0) / rule.spread**2
    curvatures = curvatures - rule.centered * shift
    remainder = rule.curvature_gain * (curvatures.T @ curvatures) + rule.shift_gain * np.outer(
        shift, shift
    )
    return Moments(center + shift, slopes, remainder + np.diag(noise))
