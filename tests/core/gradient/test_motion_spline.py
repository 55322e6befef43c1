"""Slopes of a motion with respect to its control points are its differences, in any attitude."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from patagium.sensing.motion.banded import SEEN, Knots
from patagium.sensing.motion.motion_spline import MotionSpline

TURN = np.array([3, 4, 5])


@pytest.fixture(scope="module")
def spline() -> MotionSpline:
    """A tumble with several turns about all axes."""
    knots = Knots(0.0, 1.0, 0.02)
    time = knots.centers
    angles = np.column_stack([6 * time + np.sin(9 * time), np.sin(7 * time), 2 * np.cos(5 * time)])
    turns = Rotation.from_euler("ZYX", angles).as_quat()
    sign = np.sign(np.einsum("ij,ij->i", turns[1:], turns[:-1]))
    turns[1:] *= np.cumprod(sign)[:, None]
    points = np.zeros((knots.count, 6))
    points[:, :3] = np.sin(np.outer(time, [3, 4, 5]))
    return MotionSpline(knots, points, TURN, turns)


def test_rates_are_those_of_the_attitude(spline: MotionSpline) -> None:
    times, step = np.linspace(0.05, 0.95, 40), 1e-5
    before, now, after = (spline.at(times + k * step) for k in (-1, 0, 1))
    assert before.attitude is not None and after.attitude is not None
    spin = (before.attitude.inv() * after.attitude).as_rotvec() / (2 * step)
    spin_rate = (after.levels[:, 1] - before.levels[:, 1])[:, TURN] / (2 * step)
    # central differences over 10 us of turns at some 16 rad/s
    np.testing.assert_allclose(now.levels[:, 1, TURN], spin, atol=1e-6)
    np.testing.assert_allclose(now.levels[:, 2, TURN], spin_rate, atol=1e-4)


def test_slopes_are_differences(spline: MotionSpline) -> None:
    times = np.linspace(0.05, 0.95, 40)
    wave = np.sin(np.outer(spline.knots.centers, [20, 30, 40, 25, 35, 45]))
    change = 1e-6 * wave
    now, moved = spline.at(times), spline.moved(change).at(times)
    assert now.attitude is not None and moved.attitude is not None
    whole = np.broadcast_to(np.eye(18).reshape(1, 18, 3, 6), (40, 18, 3, 6))
    seen = change[now.span[:, None] + np.arange(SEEN)].reshape(40, -1)
    found = np.einsum("nkc,nc->nk", spline.rows(now, whole), seen).reshape(40, 3, 6)
    expected = moved.levels - now.levels
    expected[:, 0, TURN] = (now.attitude.inv() * moved.attitude).as_rotvec()
    for level, tolerance in ((0, 1e-6), (1, 1e-5), (2, 1e-2)):
        # the third leaves out how the length of the sum of quaternions changes
        size = np.abs(expected[:, level]).max(axis=0)
        assert (np.abs(found - expected)[:, level].max(axis=0) < tolerance * size).all()


def test_steady_turns_are_driven_by_nothing() -> None:
    knots = Knots(0.0, 1.0, 0.05)
    half = np.outer(5.0 * knots.centers, np.array([0.6, 0.0, 0.8]))
    points = np.zeros((knots.count, 3))
    turning = MotionSpline(knots, points, np.arange(3), Rotation.from_rotvec(half).as_quat())
    value, _ = turning.driven(np.linspace(0.1, 0.9, 7), 4)
    # of (w/2)^4 = 39 1/s^4, as the spline of 20 points a second follows the turn
    assert np.abs(value).max() < 1e-2
