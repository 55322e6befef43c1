"""The noise that the spectrum of samples shows."""

from __future__ import annotations

import numpy as np
import pytest

from patagium.sensing.motion.first_motion import spectral_noise

STEP = 0.01


def test_noise_is_told_where_steps_are_a_little_longer_than_most(rng: np.random.Generator) -> None:
    """A run of as many samples as a spectrum takes, but for the last of equal steps, gave none."""
    steps = np.full(127, STEP)
    steps[::3] *= 0.9
    time = np.concatenate([[0.0], np.cumsum(steps)])
    values = np.sin(2 * np.pi * time)[:, None] + 0.01 * rng.standard_normal((128, 3))
    found = spectral_noise(time, values, 4)
    assert found.std == pytest.approx(0.01, rel=0.3)  # four deviations of some 240 frequencies


@pytest.mark.parametrize("color", [0.0, 0.6])
def test_noise_between_stamps_that_jitter_keeps_its_correlation(
    color: float, rng: np.random.Generator
) -> None:
    time = STEP * (np.arange(1000) + 0.2 * rng.standard_normal(1000))
    smooth = np.sin(2 * np.pi * np.outer(time, [1.0, 1.5, 2.0]))
    noise = 0.01 * rng.standard_normal((1000, 3))
    for k in range(1, 1000):
        noise[k] = color * noise[k - 1] + np.sqrt(1 - color**2) * noise[k]
    known = spectral_noise(time, smooth, 4, noise).correlation
    assert known == pytest.approx(color, abs=0.1)  # half of the step between what is tried
