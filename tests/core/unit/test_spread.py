"""Mean and covariance from points: exact where promised, definite always."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from patagium.errors import ParameterError
from patagium.learning.filters.numbers import spread_rule
from patagium.learning.filters.spread import moments_of
from patagium.learning.settings import FilterSettings

SIZE = 6


def quadratic(rng, outputs=3, mixed=False):
    """y(w) = a + B w + 1/2 w' H w, its exact mean and covariance for w ~ N(0, 1)."""
    a, b = rng.normal(size=outputs), rng.normal(size=(outputs, SIZE))
    h = np.array([np.diag(rng.normal(size=SIZE)) for _ in range(outputs)])
    if mixed:
        full = rng.normal(size=(outputs, SIZE, SIZE))
        h = full + full.transpose(0, 2, 1)

    def y(w):
        return a + w @ b.T + 0.5 * np.einsum("...i,kij,...j->...k", w, h, w)

    mean = a + 0.5 * np.trace(h, axis1=1, axis2=2)
    covariance = b @ b.T + 0.5 * np.einsum("kij,lji->kl", h, h)
    return y, mean, covariance


def moments(y, spread, noise):
    rule = spread_rule(SIZE, spread)
    steps = rule.spread * np.eye(SIZE)
    return moments_of(y(np.zeros(SIZE)), y(steps), y(-steps), noise, rule)


@pytest.mark.parametrize("spread", [None, 0.1, 1.0, 3**0.5, 2.0, 5.0])
def test_the_mean_of_a_quadratic_is_exact(spread, rng):
    y, mean, _ = quadratic(rng, mixed=True)
    np.testing.assert_allclose(moments(y, spread, np.zeros(3)).mean, mean, atol=1e-9)


@pytest.mark.parametrize("spread", [0.3, 1.0, 3**0.5, 2.4])
def test_below_the_cubature_rule_separable_quadratics_are_exact(spread, rng):
    y, _, covariance = quadratic(rng)
    found = moments(y, spread, np.zeros(3))
    np.testing.assert_allclose(found.covariance, covariance, atol=1e-9)


def test_at_sqrt_n_the_sum_is_the_plain_one(rng):
    y, _, _ = quadratic(rng, mixed=True)
    points = np.sqrt(SIZE) * np.vstack([np.eye(SIZE), -np.eye(SIZE)])
    values = y(points)
    for spread in (None, np.sqrt(SIZE)):
        found = moments(y, spread, np.zeros(3))
        np.testing.assert_allclose(found.mean, values.mean(axis=0), atol=1e-12)
        np.testing.assert_allclose(found.covariance, np.cov(values.T, bias=True), atol=1e-12)


def test_beyond_sqrt_n_the_sum_is_weighted(rng):
    y, _, _ = quadratic(rng, mixed=True)
    spread = 4.0
    points = np.vstack([np.zeros(SIZE), spread * np.eye(SIZE), -spread * np.eye(SIZE)])
    weights = np.full(len(points), 1 / (2 * spread**2))
    weights[0] = 1 - SIZE / spread**2
    found, values = moments(y, spread, np.zeros(3)), y(points)
    np.testing.assert_allclose(found.mean, weights @ values, atol=1e-12)
    off = values - found.mean
    np.testing.assert_allclose(found.covariance, off.T @ (weights[:, None] * off), atol=1e-12)


@given(st.floats(0.05, 50.0), st.integers(0, 1000))
def test_the_covariance_is_never_indefinite(spread, seed):
    y, _, _ = quadratic(np.random.default_rng(seed), mixed=True)
    found = moments(y, spread, np.full(3, 1e-6))
    assert np.linalg.eigvalsh(found.remainder).min() > 0
    assert np.linalg.eigvalsh(found.covariance).min() > 0


@pytest.mark.parametrize("spread", [0.0, -1.0, 1e-300, 1e300, float("nan"), float("inf")])
def test_a_spread_is_a_number_whose_powers_are_numbers(spread):
    with pytest.raises(ParameterError, match="at least 1e-06 and at most 1e"):
        FilterSettings(spread=spread)
