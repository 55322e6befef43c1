"""Information about control points: the same as dense algebra, with a compiler and without."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from patagium.errors import FilterDiverged
from patagium.sensing.motion.banded import SEEN, Information, Knots


@pytest.fixture(params=["compiled", "plain"], autouse=True)
def engine(request: pytest.FixtureRequest) -> None:
    if request.param == "plain":
        request.getfixturevalue("interpreted")


def test_the_weights_are_those_of_a_spline(rng: np.random.Generator) -> None:
    knots = Knots(0.2, 1.7, 0.13)
    times = rng.uniform(0.2, 1.7, 40)
    places = knots.begin + knots.step * np.arange(-5, knots.count + 1)
    whole = BSpline(places, np.eye(knots.count), 5)
    weights, span = knots.weights(times, 5), knots.span_of(times)
    for level in range(5):
        expected = whole.derivative(level)(times) if level else whole(times)
        found = np.zeros_like(expected)
        for j in range(SEEN):
            found[np.arange(40), span + j] = weights[:, level, j]
        np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_solution_and_covariance_are_those_of_dense_algebra(rng: np.random.Generator) -> None:
    points, width = 14, 2
    wide = SEEN * width
    information = Information(points, width)
    span = rng.integers(0, points - 5, 60)
    rows, residual = rng.normal(size=(60, 3, wide)), rng.normal(size=(60, 3))
    matrix, vector = np.zeros((points * width,) * 2), np.zeros(points * width)
    information.add(span, rows, residual)
    alike = np.diag(np.arange(1.0, 7.0)) + 0.5
    scale = rng.uniform(1.0, 2.0, (points - 5, 1))
    information.add_alike(alike, scale, slice(1, 2))
    for n, first in enumerate(span * width):
        here = slice(first, first + wide)
        matrix[here, here] += rows[n].T @ rows[n]
        vector[here] += rows[n].T @ residual[n]
    for s in range(points - 5):
        places = np.arange(s, s + 6) * width + 1
        matrix[np.ix_(places, places)] += scale[s] * alike
    change, covariance = information.solve()
    inverse = np.linalg.inv(matrix)
    np.testing.assert_allclose(change.ravel(), inverse @ vector, rtol=1e-9)
    for s, block in enumerate(covariance.of_spans(np.arange(points - 5))):
        here = slice(s * width, s * width + wide)
        np.testing.assert_allclose(block, inverse[here, here], rtol=1e-9, atol=1e-12)
    variance = covariance.variance(span, rows)
    expected = [[row @ inverse[f : f + wide, f : f + wide] @ row for row in rows[n]]
                for n, f in enumerate(span * width)]  # fmt: skip
    np.testing.assert_allclose(variance, expected, rtol=1e-9)
    trace = covariance.trace(alike, points - 5)
    places = np.arange(3, 9) * width + 1
    np.testing.assert_allclose(trace[3, 1], np.sum(alike * inverse[np.ix_(places, places)]))


def test_points_that_nothing_sees_are_refused() -> None:
    with pytest.raises(FilterDiverged, match="singular"):
        Information(8, 1).solve()


def test_a_long_gap_does_not_hide_what_lies_beside_it() -> None:
    """Estimates next to a long gap equal those next to a short one; the matrix is near singular."""

    def ends(points: int) -> tuple[np.ndarray, np.ndarray]:
        information = Information(points, 1)
        tie = np.array([1.0, -4.0, 6.0, -4.0, 1.0, 0.0])
        information.add_alike(np.outer(tie, tie), np.ones((points - 5, 1)), slice(0, 1))
        for seen in (slice(0, 20), slice(-20, None)):
            information.diagonal[seen] += 0.1
            information.gradient[seen] = 0.1
        change, covariance = information.solve()
        return change[:20], np.sqrt(covariance.matrix[:10, -1])

    for near, far in zip(ends(140), ends(1040), strict=True):
        np.testing.assert_allclose(far, near, rtol=1e-3)  # of what the other end tells
