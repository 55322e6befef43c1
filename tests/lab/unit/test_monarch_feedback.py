"""Monarch butterfly under the public program's feedback: the law, and flights that are back."""

from __future__ import annotations

import numpy as np
import pytest
from tests.validation_page import errors_of_the_page

from patagium_lab.validation.cases.monarch import published
from patagium_lab.validation.cases.monarch_feedback import (
    BACK,
    REACH,
    Butterfly,
    _answer,
    demanded,
    spiral,
)


@pytest.mark.parametrize("weight", [0.0, 0.1])
@pytest.mark.parametrize("pushed", [True, False])
def test_the_changes_give_the_force_that_is_demanded(weight, pushed):
    law = published()["feedback"]
    slopes = np.array([[np.resize(one, 2) for one in law[axis]] for axis in ("forward", "down")])
    answer = _answer(slopes, weight, pushed, np.array([-1.0, 2.0]))
    used = slopes[:, :, 0 if pushed else 1].copy()
    used[:, 2] = slopes[0, 2, 1], slopes[1, 2, 0]  # the abdomen pushes back and down
    np.testing.assert_allclose(used @ answer, np.eye(2), atol=1e-12)
    assert (np.abs(answer[2]) < 1e-9).all() == (weight == 0)  # [rad/N]: it swings as it did


def test_the_force_of_the_abdomen_is_that_of_its_joint():
    """Another way to the same force: the thorax pushed by an abdomen that is swung alone."""
    fly = Butterfly()
    still = fly.rows.copy()
    place = np.flatnonzero(fly.ways[0, 2].any(axis=0))
    still[:, 1:, place] = 0.0  # held in its place
    moved = fly.acceleration(np.zeros((100, 2)), fly.rows, in_air=False)
    pushed = moved - fly.acceleration(np.zeros((100, 2)), still, in_air=False)
    # but for half of the Coriolis force of the thorax's rate, as the program has it: a hundredth
    share = 0.1092e-3 * 8.69e-3 / fly.mass
    np.testing.assert_allclose(pushed, share * fly.abdomen, atol=0.03 * np.abs(pushed).max())


def test_starts_lie_evenly():
    away = np.hypot(*spiral(1000).T)
    assert np.quantile(away, [0.25, 0.5, 0.75]) == pytest.approx(
        REACH * np.array([1, 2, 3]) / 4, abs=0.01
    )
    assert np.abs(spiral(1000).mean(axis=0)).max() < 0.01


def test_near_starts_are_back_and_the_abdomen_brings_more_of_them():
    """Within half a meter and one meter; after 30 beats of the published 100."""
    starts = spiral(24)
    with_it, without = (demanded(starts, weight, 30) for weight in (0.1, 0.0))
    assert (with_it[:8] < BACK).all() and (without[:4] < BACK).all()
    assert (with_it < BACK).sum() > (without < BACK).sum()


def test_the_page_shows_shares_within_a_point():
    errors = errors_of_the_page()
    assert errors["Monarch butterfly under feedback", "with the program's errors"] <= 0.01
