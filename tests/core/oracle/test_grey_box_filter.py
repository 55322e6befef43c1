"""Weights whose memory is moved along its slopes: the joint filter of weights and memory."""

import numpy as np
import pytest

import patagium as pt
from patagium.learning.models.memory import MemoryState, memory_of, network_inputs

NOISE = 0.02


class JointFilter:
    """Extended Kalman filter of [W, z], its slopes by differences of the grey box itself."""

    def __init__(self, grey, first):
        self.grey, self.n = grey, grey.size
        row = network_inputs(grey, np.zeros(self.n), [0.0], first[None])
        self.state = np.concatenate([np.zeros(self.n), self._lags(row[0])])
        slopes = self._differences(
            lambda w: self._lags(network_inputs(grey, w, [0.0], first[None])[0])
        )
        eye = np.eye(self.n)
        self.covariance = np.block([[eye, slopes.T], [slopes, slopes @ slopes.T]])

    def _lags(self, row):
        return row[2 : 2 + self.grey.model.state_size]

    def _differences(self, function, at=None):
        at = np.zeros(self.n) if at is None else at
        step = 1e-5 * np.eye(len(at))
        return np.transpose([(function(at + h) - function(at - h)) / 2e-5 for h in step])

    def _row(self, x, joint):
        """x as the grey box sees it with lags given, and no slopes of theirs."""
        nothing = np.zeros(len(joint[self.n :]) * self.n)
        return np.concatenate([x, joint[self.n :], nothing, joint[: self.n]])

    def advance(self, before, after, step):
        def moved(joint):
            slopes, memory = np.zeros((len(joint) - self.n, self.n)), memory_of(self.grey)
            weights, lags = joint[: self.n], joint[self.n :]
            memory.last = MemoryState(lags, slopes, weights, before, 0.0)
            row = memory.recall(weights, [step], after[None])
            return np.concatenate([joint[: self.n], self._lags(row[0])])

        transition = self._differences(moved, self.state)
        self.state = moved(self.state)
        self.covariance = transition @ self.covariance @ transition.T

    def update(self, x, y):
        def seen(joint):
            return self.grey(self._row(x, joint), joint[: self.n])

        slope = self._differences(seen, self.state)
        total = slope @ self.covariance @ slope.T + NOISE**2 * np.eye(len(y))
        gain = self.covariance @ slope.T @ np.linalg.inv(total)
        self.state = self.state + gain @ (y - seen(self.state))
        self.covariance = self.covariance - gain @ total @ gain.T


@pytest.fixture(scope="module")
def grey(one_wing):
    model = pt.DeLaurier(one_wing("name: plunge, axis: x"), pt.Air(wind=(-5.0, 0.0, 0.0)))
    return pt.GreyBox(model, {"wing[0].chord": 0.02, "zero_lift_angle": 0.1, "density": 0.3})


def test_it_is_the_extended_filter_of_weights_and_lags(grey):
    """Weights, lags and covariance alike after thirty samples; z's covariance is S P S'."""
    time = np.arange(30) * 0.01
    x = np.column_stack([0.5 * np.sin(25 * time), 12.5 * np.cos(25 * time)])
    truth = np.array([-0.8, 0.6, 0.5])
    y = grey.evaluate(network_inputs(grey, truth, time, x), truth)
    y = y + NOISE * np.random.default_rng(0).normal(size=y.shape)
    learner = pt.ExtendedLearner(grey, measurement_std=NOISE)
    joint, memory = JointFilter(grey, x[0]), memory_of(grey)
    for k in range(len(time)):
        before = learner.weights
        rows = memory.recall(before, time[k : k + 1], x[k : k + 1])
        if k:
            joint.advance(x[k - 1], x[k], 0.01)
        learner.update(rows[0], y[k])
        memory.corrected(learner.weights - before)
        joint.update(x[k], y[k])
    n, slopes = grey.size, memory.last.sensitivity
    # differences of the oracle
    assert np.allclose(learner.weights, joint.state[:n], atol=1e-6)
    assert np.allclose(memory.last.state, joint.state[n:], atol=1e-6)
    assert np.allclose(learner.covariance, joint.covariance[:n, :n], atol=1e-7)
    among = slopes @ learner.covariance @ slopes.T
    assert np.allclose(among, joint.covariance[n:, n:], atol=1e-7)
    assert np.abs(among).max() > 1e-4 and np.abs(learner.weights).max() > 0.3
