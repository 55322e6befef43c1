"""Square roots of dense covariances, S S' = P, and what a measurement makes of them."""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cholesky
from scipy.linalg.lapack import dtrtri

from patagium.arrays import Array
from patagium.errors import Outcome


class MatrixLost(Exception):
    """Matrix of the filter that is not positive definite or not finite; stays inside.

    Args:
        outcome: Which of the two.
    """

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.name)
        self.outcome = outcome


def lower_factor(matrix: Array) -> Array:
    """L with L L' = matrix, lower triangular, (m, m).

    Raises:
        MatrixLost: If the matrix is not finite or not positive definite.
    """
    if not np.isfinite(matrix).all():
        raise MatrixLost(Outcome.NOT_FINITE)
    try:
        return np.asarray(cholesky(matrix, lower=True, check_finite=False))
    except LinAlgError:
        raise MatrixLost(Outcome.COVARIANCE_LOST) from None


def inverse_root(matrix: Array) -> Array:
    """G with G G' = matrix^-1, upper triangular, (m, m); by `dtrtri`, for `dtrtrs` starts threads.

    Raises:
        MatrixLost: If the matrix is not finite or not positive definite.
    """
    inverse, _ = dtrtri(lower_factor(matrix), lower=True)
    return np.asarray(inverse.T)


def transformed_root(root: Array, slopes: Array, remainder: Array) -> tuple[Array, Array]:
    """S after a measurement whose covariance is P_yy = Z' Z + M, S Z that with the weights.

    With L L' = P_yy and N N' = M, B = L^-T (L + N)^-1 solves B + B' - B (Z' Z) B' = P_yy^-1,
    so that (I - Z B Z')(I - Z B Z')' = I - Z P_yy^-1 Z': three products of n x n x n_y give
    S <- S - (S Z) B Z', and P = S S' is the Kalman filter's, definite whatever the rounding.

    Args:
        root: Any square root S of P, (n, n) [1].
        slopes: Z, (n, n_y) [unit of y].
        remainder: M, (n_y, n_y) [y^2].

    Returns:
        The new S, (n, n), not triangular; S Z, (n, n_y).

    Raises:
        MatrixLost: If M or P_yy is not finite or not positive definite, or S is not finite.

    References:
        Andrews (1968), A square root formulation of the Kalman covariance equations.
    """
    total = slopes.T @ slopes + remainder
    lower, noise, inverse = lower_factor(total), lower_factor(remainder), inverse_root(total)
    cross, (both, _) = root @ slopes, dtrtri(lower + noise, lower=True)
    after = root - (cross @ (inverse @ both)) @ slopes.T
    if not np.isfinite(after).all():
        raise MatrixLost(Outcome.NOT_FINITE)
    return after, cross


def measured_root(root: Array, slopes: Array, remainder: Array) -> tuple[Array, Array]:
    """Cholesky factor of the covariance after a measurement.

    A rotation from the right, S Q' with Q from the QR factors of S', changes no P; of order
    n^3. The compiled kernel reaches the same S in order n^2 n_y, column by column.

    Args:
        root: Any square root S of P, (n, n) [1].
        slopes: Z, (n, n_y) [unit of y].
        remainder: M, (n_y, n_y) [y^2].

    Returns:
        The new S, (n, n), with a diagonal of at least zero; S Z, (n, n_y).

    Raises:
        MatrixLost: If M or P_yy is not finite or not positive definite, or S is not finite.
    """
    after, cross = transformed_root(root, slopes, remainder)
    return triangular(after), cross


def triangular(root: Array) -> Array:
    """Lower triangular square root of the same covariance, its diagonal at least zero.

    Args:
        root: Any square root S of P, (n, n) [1].
    """
    upper = np.asarray(np.linalg.qr(root.T, mode="r"))
    signs = np.where(np.diag(upper) < 0, -1.0, 1.0)
    return upper.T * signs
