"""Spline of degree five on equal steps, and least squares for its control points.

A time sees six control points, so that the information matrix is banded. Its inverse is computed
within the band alone: that is the covariance of the control points that a time sees.

References:
    Takahashi, Fagan & Chin (1973), Formation of a sparse bus impedance matrix.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from math import perm

import numpy as np
from scipy.interpolate import BSpline, PPoly
from scipy.linalg import cho_solve_banded, cholesky_banded

from patagium.arrays import Array, Indices
from patagium.errors import FilterDiverged, Outcome
from patagium.native import load_kernel
from patagium.native.function import as_c

DEGREE = 5
SEEN = DEGREE + 1
"""Control points that a time sees."""
_DAMPING = 0.0, 1e-14, 1e-12
"""Shares of the largest information, added in turn to the diagonal until it has a factor."""


class Knots:
    """Equally spaced knots of a spline of degree five.

    Args:
        begin: Begin of the spline [s].
        end: End of the spline [s].
        step: Longest time between knots [s].

    Attributes:
        spans: Number of spans between knots.
        count: Number of control points.
        step: Time between knots [s].
    """

    def __init__(self, begin: float, end: float, step: float) -> None:
        self.begin = begin
        self.spans = max(1, int(np.ceil((end - begin) / step - 1e-9)))
        self.step = (end - begin) / self.spans
        self.count = self.spans + DEGREE

    @property
    def centers(self) -> Array:
        """Times about which the control points act, (K,) [s]."""
        return np.asarray(self.begin + self.step * (np.arange(self.count) - 0.5 * (DEGREE - 1)))

    def span_of(self, times: Array) -> Indices:
        """Span that holds each time, (N,)."""
        span = np.floor((times - self.begin) / self.step).astype(np.int64)
        return np.asarray(np.clip(span, 0, self.spans - 1))

    def weights(self, times: Array, levels: int = 3) -> Array:
        """Weights of the six control points of a time in the value and its derivatives.

        Args:
            times: Times within the spline, (N,) [s].
            levels: Number of levels: the value and `levels` - 1 derivatives.

        Returns:
            (N, levels, 6) in powers of [1/s].
        """
        inside = (times - self.begin) / self.step - self.span_of(times)
        powers = np.zeros((len(times), levels, SEEN))
        for level in range(levels):
            for p in range(level, SEEN):
                factor = perm(p, level) / self.step**level
                powers[:, level, p] = factor * inside ** (p - level)
        return powers @ _pieces()


@cache
def _pieces() -> Array:
    """Coefficients of the powers 0 to 5 in the weight of each of the six points, (6, 6)."""
    basic = PPoly.from_spline(BSpline.basis_element(np.arange(SEEN + 1)))
    first = int(np.searchsorted(basic.x, 0.0))
    return np.ascontiguousarray(basic.c[::-1, first : first + SEEN][:, ::-1])


class Information:
    """Information about the control points of a spline: a banded matrix, and a gradient.

    Args:
        points: Number of control points.
        width: Number of unknowns of a control point.

    Attributes:
        matrix: Information matrix by rows, of row i the columns i - b to i with b = 6 width - 1,
            (points width, 6 width).
        gradient: Weighted residuals by unknown, (points width,).
    """

    def __init__(self, points: int, width: int) -> None:
        self.width = width
        self.matrix = np.zeros((points * width, SEEN * width))
        self.gradient = np.zeros(points * width)

    @property
    def diagonal(self) -> Array:
        """Diagonal of the matrix by point and unknown, (points, width), a view."""
        return self.matrix[:, -1].reshape(-1, self.width)

    def add(self, span: Indices, rows: Array, residual: Array) -> None:
        """Add measurements of unit variance.

        Args:
            span: Span of each sample, (N,) [-].
            rows: Slopes of each sample over its standard deviation, (N, k, 6 width) [1/unit].
            residual: Residuals over their standard deviation, (N, k) [-].
        """
        first, count, values, wide = span * self.width, *rows.shape
        library = load_kernel("banded")
        if library is not None:
            arrays = (self.matrix, self.gradient, *map(np.ascontiguousarray, (rows, residual)))
            library.banded_add(*as_c(*arrays, first, count, values, wide))
            return
        i, j = np.tril_indices(wide)
        for n in range(count):
            self.matrix[first[n] + i, j - i + wide - 1] += (rows[n].T @ rows[n])[i, j]
            self.gradient[first[n] : first[n] + wide] += rows[n].T @ residual[n]

    def add_alike(self, product: Array, scale: Array, columns: slice) -> None:
        """Add the same matrix for each span, times a factor, to unknowns that are alike.

        Args:
            product: Symmetric matrix of the six points that a span sees, (6, 6) [1].
            scale: Factor of each span and unknown, (spans, n).
            columns: The n unknowns.
        """
        for i, j, entries in _entries(self.matrix, self.width):
            entries[i : i + len(scale), columns] += product[i, j] * scale

    def solve(self) -> tuple[Array, BandedCovariance]:
        """Change of the control points, (points, width), and their covariance.

        Raises:
            FilterDiverged: If the information is singular or not finite.
        """
        for share in _DAMPING:
            self.diagonal[:] += share * self.diagonal.max(axis=0)
            found = banded_inverse(self.matrix, self.gradient)
            if found is not None:
                break
        else:
            raise FilterDiverged(
                "motion: the information about the motion is singular; state the noise of the "
                "sensors (std)",
                Outcome.COVARIANCE_LOST,
            )
        change, inverse = found
        return change.reshape(-1, self.width), BandedCovariance(self.width, inverse)


class BandedCovariance:
    """Covariance of the control points of a spline, within six points of each other.

    Args:
        width: Number of unknowns of a control point.
        matrix: The covariance by rows, as that of `Information`, (points width, 6 width).
    """

    def __init__(self, width: int, matrix: Array) -> None:
        self.width, self.matrix = width, matrix

    def variance(self, span: Indices, rows: Array) -> Array:
        """Variance of linear functions of the points, (N, k).

        Args:
            span: Span of each sample, (N,) [-].
            rows: Slopes of each sample over its standard deviation, (N, k, 6 width) [1/unit].
        """
        library = load_kernel("banded")
        if library is None:
            carried = rows @ self.of_spans(span)
            return np.asarray(np.einsum("nkc,nkc->nk", carried, rows))
        first, (count, values, wide) = span * self.width, rows.shape
        found = np.empty((count, values))
        arrays = (self.matrix, np.ascontiguousarray(rows), first, found)
        library.banded_variance(*as_c(*arrays, count, values, wide))
        return found

    def of_spans(self, span: Indices) -> Array:
        """Covariance of the six points of spans, (N, 6 width, 6 width)."""
        wide = SEEN * self.width
        rows, columns = np.tril_indices(wide)
        found = np.empty((len(span), wide, wide))
        first = span[:, None] * self.width
        found[:, rows, columns] = self.matrix[first + rows, columns - rows + wide - 1]
        found[:, columns, rows] = found[:, rows, columns]
        return found

    def trace(self, product: Array, spans: int) -> Array:
        """Sum of the covariance of six points times a symmetric matrix (6, 6), (spans, width)."""
        found = np.zeros((spans, self.width))
        for i, j, entries in _entries(self.matrix, self.width):
            found += product[i, j] * (2 - (i == j)) * entries[i : i + spans]
        return found


def _entries(matrix: Array, width: int) -> Iterator[tuple[int, int, Array]]:
    """Places i, j of two points that a span sees, and views of their entries, (points, width)."""
    held = matrix.reshape(-1, width, SEEN * width)
    for i in range(SEEN):
        for j in range(i + 1):
            yield i, j, held[:, :, (SEEN + j - i) * width - 1]


def banded_inverse(matrix: Array, vector: Array) -> tuple[Array, Array] | None:
    """Solution of a banded system, and the inverse within the band; None if it is not definite.

    Args:
        matrix: Symmetric matrix A by rows, of row i the columns i - b to i, (size, b + 1).
        vector: Right side, (size,).
    """
    library = load_kernel("banded")
    if library is None:
        return _inverse_in_python(matrix, vector)
    band = matrix.shape[1] - 1
    inverse, solution = np.array(matrix), np.array(vector)
    memory = np.zeros_like(inverse), np.zeros(2 * (band + 1))
    failed = library.banded_inverse(*as_c(inverse, solution, *memory, len(vector), band))
    return None if failed else (solution, inverse)


def _inverse_in_python(matrix: Array, vector: Array) -> tuple[Array, Array] | None:
    """Kernel `banded_inverse` without a compiler: the same by columns of the factor."""
    size, wide = matrix.shape
    try:
        diagonals = [np.pad(matrix[k:, wide - 1 - k], (0, k)) for k in range(wide)]
        lower = cholesky_banded(np.array(diagonals), lower=True)
    except (np.linalg.LinAlgError, ValueError):
        return None
    solution = cho_solve_banded((lower, True), vector)
    square = np.zeros((size + wide, size + wide))
    for j in range(size - 1, -1, -1):
        here, pivot = slice(j + 1, j + wide), lower[0, j]
        below = np.zeros(wide - 1)
        count = min(wide, size - j) - 1
        below[:count] = lower[1 : count + 1, j] / pivot
        column = -square[here, here] @ below
        square[here, j] = square[j, here] = column
        square[j, j] = pivot**-2 - below @ column
    inverse = np.zeros_like(matrix)
    for k in range(wide):
        inverse[k:, wide - 1 - k] = np.diagonal(square[:size, :size], k)
    return solution, inverse
