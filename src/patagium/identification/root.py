"""Square roots of covariances, S S' = P: how a measurement changes them, and how time does.

Neglected: structure of P; it is dense.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cholesky, solve_triangular

from patagium.errors import Outcome

Array = NDArray[np.float64]


class MatrixLost(Exception):
    """A matrix of the filter that is not positive definite or not finite; stays inside.

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


def measured_root(root: Array, slopes: Array, remainder: Array) -> tuple[Array, Array, Array]:
    """S after a measurement whose covariance is P_yy = Z' Z + M, S Z that with the weights.

    P <- P - S Z P_yy^-1 Z' S' as a recursion over the columns from the last to the first,
    each of order n_y (n + n_y). With G G' = (M + sum of z_i z_i' of the columns done)^-1,

        f = G' z_j,  a = 1 + f'f,  e = G f,
        S_j <- (S_j - C e) / sqrt(a),  C <- C + S_j z_j',  G <- G - e f' / (a + sqrt(a)).

    S stays triangular and P positive definite whatever the rounding; nothing of n x n is
    factorized.

    Args:
        root: S, lower triangular, (n, n).
        slopes: Z, (n, n_y).
        remainder: M, (n_y, n_y).

    Returns:
        The new S, (n, n); S Z, (n, n_y); G with G G' = P_yy^-1, (n_y, n_y).

    Raises:
        MatrixLost: If M is not finite or not positive definite.

    References:
        Carlson (1973), Fast triangular formulation of the square root filter, AIAA J. 11(9);
        Potter's update of G: Bierman (1977), Factorization methods, ch. 2.
    """
    lower = lower_factor(remainder)
    inverse = solve_triangular(lower, np.eye(len(lower)), lower=True, check_finite=False).T
    after, cross = np.empty_like(root), np.zeros((len(root), len(lower)), root.dtype)
    for j in reversed(range(len(root))):
        inner = inverse.T @ slopes[j]
        alpha = 1.0 + inner @ inner
        step, size = inverse @ inner, np.sqrt(alpha)
        after[:, j] = (root[:, j] - cross @ step) / size
        cross += np.outer(root[:, j], slopes[j])
        inverse = inverse - np.outer(step, inner) / (alpha + size)
    return after, cross, inverse


def transformed_root(root: Array, slopes: Array, remainder: Array) -> tuple[Array, Array, Array]:
    """The same for any square root, triangular or not, in three products: S - (S Z) B Z'.

    With L L' = P_yy = Z' Z + M and N N' = M, B = L^-T (L + N)^-1 solves
    B + B' - B (Z' Z) B' = P_yy^-1, so that (I - Z B Z')(I - Z B Z')' = I - Z P_yy^-1 Z'.

    Args:
        root: S, (n, n).
        slopes: Z, (n, n_y).
        remainder: M, (n_y, n_y).

    Returns:
        The new S, (n, n), not triangular; S Z, (n, n_y); G with G G' = P_yy^-1, (n_y, n_y).

    Raises:
        MatrixLost: If M or P_yy is not finite or not positive definite.

    References:
        Andrews (1968), A square root formulation of the Kalman covariance equations.
    """
    lower, noise = lower_factor(slopes.T @ slopes + remainder), lower_factor(remainder)
    identity, cross = np.eye(len(lower)), root @ slopes
    inverse = solve_triangular(lower, identity, lower=True, check_finite=False).T
    both = solve_triangular(lower + noise, identity, lower=True, check_finite=False)
    return root - (cross @ (inverse @ both)) @ slopes.T, cross, inverse


def with_noise(root: Array, noise: Array) -> Array:
    """The square root of S S' + diag(noise), (n, n): of order n^3.

    Args:
        root: S, (n, n).
        noise: Variances, (n,).

    Raises:
        MatrixLost: If S S' is not finite or so far from definite that the sum is not.
    """
    covariance = root @ root.T
    covariance[np.diag_indices_from(covariance)] += noise
    return lower_factor(covariance)
