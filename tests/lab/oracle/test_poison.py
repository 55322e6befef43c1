"""Poison in bursts through learners, beside twins that were spared."""

from __future__ import annotations

from typing import Any

import pytest

import patagium as pt
from patagium_lab.attack.poison import NOISE, NOISE_MODELS, network, poisoned


@pytest.mark.parametrize(
    "options",
    [
        NOISE_MODELS["EM"],
        {"covariance": "node", "dtype": "float32", **NOISE_MODELS["Misfit"]},
    ],
)
def test_a_learner_is_soon_as_good_as_its_twin(options: dict[str, Any]) -> None:
    """Within 100 clean samples, within 1.5 times of the error of the twin."""
    learner = pt.CubatureLearner(
        network(),
        prior_share=1e-4,
        screening=pt.learning.Screening(stuck_samples=10),
        **options,
    )
    found = poisoned(learner, seed=2, count=8000)
    assert not found.crash and found.uncounted == 0
    assert sum(found.bursts.values()) > 15 and not any(found.beyond.values())


@pytest.mark.parametrize("spread", [None, network().size ** 0.5])
def test_near_points_keep_a_clean_learner_at_the_noise(spread: float | None) -> None:
    """With a prior share, a spread of sqrt(n) biases the predicted mean; the default, 1, does not.

    Measured at 5 to 6 s: three to four times the noise, and less than one and a half times.
    """
    learner = pt.CubatureLearner(network(), prior_share=1e-4, spread=spread, **NOISE_MODELS["EM"])
    assert spread is not None or learner.spread == 1.0
    last = poisoned(learner, seed=2, count=6000).clean[-1]
    assert (last < 2 * NOISE) == (spread is None)
