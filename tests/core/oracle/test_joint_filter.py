"""Weights with lags moved along their slopes are the joint filter of weights and lags."""

import numpy as np


def test_lags_moved_along_their_slopes_are_those_of_the_augmented_filter():
    """z <- a z + (1 - a) u, a = 1/(1 + exp(-w)), y = g z: [g, w] with S = dz/dW, or [g, w, z].

    No noise on z: the covariance of z with the weights is S P, and both filters are one.
    """
    random, noise = np.random.default_rng(0), 0.01
    weights, covariance = np.array([1.0, 0.3]), np.diag([0.2, 0.4])
    state, slope = 0.0, np.zeros(2)
    joint, whole = np.append(weights, state), np.zeros((3, 3))
    whole[:2, :2] = covariance
    for u in random.standard_normal(50):
        keep = 1 / (1 + np.exp(-weights[1]))
        along = keep * (1 - keep) * (state - u)
        slope, state = keep * slope + [0.0, along], keep * state + (1 - keep) * u
        keep = 1 / (1 + np.exp(-joint[1]))
        step = np.eye(3)
        step[2] = [0.0, keep * (1 - keep) * (joint[2] - u), keep]
        joint[2], whole = keep * joint[2] + (1 - keep) * u, step @ whole @ step.T
        if random.random() < 0.5:
            continue  # a sample that is not used: both only remember
        y = 1.5 * state + noise * random.standard_normal()
        h = np.array([state, 0.0]) + weights[0] * slope
        gain = covariance @ h / (h @ covariance @ h + noise**2)
        change = gain * (y - weights[0] * state)
        covariance = covariance - np.outer(gain, h @ covariance)
        weights, state = weights + change, state + slope @ change
        h = np.array([joint[2], 0.0, joint[0]])
        gain = whole @ h / (h @ whole @ h + noise**2)
        joint, whole = joint + gain * (y - joint[0] * joint[2]), whole - np.outer(gain, h @ whole)
        assert np.allclose([*weights, state], joint, rtol=1e-8, atol=1e-10)  # rounding
        assert np.allclose(slope @ covariance, whole[2, :2], rtol=1e-6, atol=1e-12)
