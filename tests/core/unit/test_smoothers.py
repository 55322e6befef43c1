"""Chains of integrators: exact where they must be, honest about their noise."""

from __future__ import annotations

import numpy as np
import pytest

from patagium.errors import LogError, ParameterError, ShapeError
from patagium.sensing.motion.smoothers import (
    added_covariance,
    likely_density,
    merged_times,
    smooth_chain,
    smooth_series,
    transition,
)


def walk(rng: np.random.Generator, time: np.ndarray, count: int, order: int, density: float):
    """Chains driven by white noise, (N, count, order)."""
    state = np.zeros((len(time), count, order))
    for k in range(1, len(time)):
        step = time[k] - time[k - 1]
        root = np.linalg.cholesky(density * added_covariance(order, step))
        noise = rng.standard_normal((count, order)) @ root.T
        state[k] = state[k - 1] @ transition(order, step).T + noise
    return state


@pytest.mark.parametrize("order", [2, 3, 4])
def test_the_smoother_is_the_gaussian_conditional(order, rng) -> None:
    time = np.array([0.0, 0.1, 0.25, 0.3, 0.55, 0.6])
    density, noise = 0.7, 0.2
    values = rng.standard_normal((len(time), 1))
    values[2] = np.nan  # not measured there
    found = smooth_chain(time, values, np.full_like(values, noise), np.full(1, density), order)
    # the same as one Gaussian over all states, with the start it takes for granted
    spread = [np.abs(np.diff(values[np.isfinite(values)])).max(initial=0.0)]
    wide = (3.0 * (spread[0] + noise)) ** 2
    unit = float(np.median(np.diff(time[np.isfinite(values[:, 0])])))
    scale = unit ** -np.arange(order, dtype=float)
    n = len(time) * order
    mean, prior = np.zeros(n), np.zeros((n, n))
    mean[0] = values[0, 0]
    prior[:order, :order] = wide * np.diag(scale**2)
    for k in range(1, len(time)):
        step = time[k] - time[k - 1]
        here, before = slice(k * order, (k + 1) * order), slice((k - 1) * order, k * order)
        move = transition(order, step)
        mean[here] = move @ mean[before]
        prior[here, : k * order] = move @ prior[before, : k * order]
        prior[: k * order, here] = prior[here, : k * order].T
        prior[here, here] = move @ prior[before, before] @ move.T
        prior[here, here] += density * added_covariance(order, step)
    seen = np.flatnonzero(np.isfinite(values[:, 0]))
    pick = np.zeros((len(seen), n))
    pick[np.arange(len(seen)), seen * order] = 1.0
    gain = np.linalg.solve(pick @ prior @ pick.T + noise**2 * np.eye(len(seen)), pick @ prior).T
    expected = mean + gain @ (values[seen, 0] - pick @ mean)
    covariance = prior - gain @ pick @ prior
    np.testing.assert_allclose(found.state[:, 0].ravel(), expected, rtol=1e-8, atol=1e-8)
    for k in range(len(time)):
        block = covariance[k * order : (k + 1) * order, k * order : (k + 1) * order]
        np.testing.assert_allclose(found.covariance[k, 0], block, rtol=1e-6, atol=1e-8)


def test_its_errors_are_as_large_as_it_says_and_the_density_is_found(rng) -> None:
    time, order, density, noise = np.arange(400) * 1e-3, 4, 1e11, 1e-3
    truth = walk(rng, time, 8, order, density)
    values = truth[:, :, 0] + noise * rng.standard_normal(truth.shape[:2])
    std = np.full_like(values, noise)
    likely = likely_density(time, values, std, order)
    assert np.abs(np.log10(likely / density)).max() < 0.5  # 400 samples: 0.15 is one deviation
    found = smooth_chain(time, values, std, np.full(8, density), order)
    error = found.state - truth
    squared = np.einsum("nbi,nbij,nbj->nb", error, np.linalg.inv(found.covariance), error)
    assert 0.85 < squared.mean() / order < 1.15  # some 8 x 50 independent stretches


@pytest.mark.parametrize("order", [4, 3])
def test_noise_comes_through_as_stated(order, rng) -> None:
    time, noise = np.arange(300) * 1e-3, 2e-3
    truth = 0.3 * np.sin(2 * np.pi * 5 * time)[:, None] * np.ones(8)
    rates = [truth, np.gradient(truth[:, 0], time)[:, None], -((2 * np.pi * 5) ** 2) * truth]
    values = truth + noise * rng.standard_normal(truth.shape)
    values[50:53, ::2] = np.nan
    found = smooth_series(time, values, noise, time, order=order)
    inner = slice(20, -20)
    for level in (0, 2):
        error = (found.state[inner, :, level] - rates[level][inner]) ** 2
        ratio = error.mean() / found.covariance[inner, :, level, level].mean()
        # it allows for a motion livelier than a sine
        assert 0.1 < ratio < 1.4, (order, level, ratio)


def test_the_acceleration_converges_as_noise_falls(rng) -> None:
    time = np.arange(400) * 1e-3
    truth = np.sin(2 * np.pi * 5 * time)[:, None]
    errors = []
    for noise in (1e-2, 1e-3, 1e-4):
        measured = truth + noise * rng.standard_normal(truth.shape)
        found = smooth_series(time, measured, noise, time)
        error = found.state[50:-50, :, 2] + (2 * np.pi * 5) ** 2 * truth[50:-50]
        errors.append(np.sqrt(np.mean(error**2)) / (2 * np.pi * 5) ** 2)
    assert errors[0] < 0.1 and errors[1] < 0.4 * errors[0] and errors[2] < 0.4 * errors[1]


@pytest.mark.parametrize(("rate", "gap", "noise"), [(10, 0.0, 1e-5), (50, 0.4, 1e-6)])
def test_output_between_few_samples_of_little_noise(rate, gap, noise, rng) -> None:
    """The first covariance grew with the output rate: LinAlgError, or negative variances."""
    time = np.arange(0, 4, 1 / rate)
    time = time[(time < 2) | (time > 2 + gap)]
    at = np.arange(0, 3500) * 1e-3
    values = np.sin(time)[:, None] + noise * rng.standard_normal((len(time), 1))
    found = smooth_series(time, values, noise, at)
    variance = np.einsum("nbii->nbi", found.covariance)
    truth = np.stack([np.sin(at), np.cos(at), -np.sin(at)], axis=-1)
    assert (variance > 0).all()
    squared = (found.state[:, 0] - truth) ** 2 / variance[:, 0]
    assert squared.mean() < 4  # it allows for a motion livelier than a sine


def test_times_of_two_sensors_meet_on_one_axis() -> None:
    grid, places = merged_times(np.array([0.0, 0.1, 0.2]), np.array([0.1 + 1e-11, 0.15]))
    np.testing.assert_array_equal(grid, [0.0, 0.1, 0.15, 0.2])
    np.testing.assert_array_equal(places, [1, 2])


def test_samples_and_times_that_are_none_are_refused() -> None:
    time, values = np.arange(300) * 1e-3, np.zeros((300, 2))
    given = {"time": time, "values": values, "std": 1e-3, "at": time}
    smooth_series(**given)
    for name, one, error in (
        ("time", time[:-1], ShapeError),
        ("values", values[:, 0], ShapeError),
        ("values", np.full_like(values, np.nan), LogError),
        ("values", np.where(np.arange(300)[:, None] == 7, values, np.nan), LogError),
        ("values", values[:5], ShapeError),
        ("values", "all", ParameterError),
        ("std", np.nan, ParameterError),
        ("std", 0.0, ParameterError),
        ("at", 0.1, ShapeError),
        ("at", [], ParameterError),
        ("at", [np.inf], ParameterError),
        ("order", 2, ParameterError),  # has no acceleration
        ("order", 7, ParameterError),
    ):
        with pytest.raises(error, match=name):
            smooth_series(**(given | {name: one}))
    for one in (time[::-1], np.zeros((300, 2))):
        with pytest.raises(LogError, match="to advance"):
            smooth_series(**(given | {"time": one}))
