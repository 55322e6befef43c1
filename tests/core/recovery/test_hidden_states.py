"""Air with memory is learned by strips that remember, and not by strips that do not."""

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.indicial import TWO_STATE
from patagium.learning import stream
from patagium.learning.models.hidden_strip import coded_start
from patagium.learning.models.memory import network_inputs
from patagium.robot import load_robot_text


@pytest.fixture(scope="module")
def robot():
    return load_robot_text(pt.load_robot("aerobat").source.replace("strips: 5", "strips: 2"))


def flapping(robot, time, beat=2 * np.pi * 5.0, feather=0.25):
    """States of a robot that flies forward, not quite evenly, and flaps, (N, 2n)."""
    dof = robot.dof
    state = np.zeros((len(time), 2 * dof))
    state[:, dof] = 4.5 + 0.4 * np.sin(3 * time)
    state[:, dof + robot.index("z")] = 0.5 * np.sin(5 * time)
    for side in ("left", "right"):
        for joint, size, phase in (("plunge", 0.6, 0.0), ("feather", feather, 1.4)):
            k = robot.index(f"{side}_{joint}")
            state[:, k] = size * np.sin(beat * time + phase)
            state[:, dof + k] = size * beat * np.cos(beat * time + phase)
    return state


def flown(model, time, state, lags=None):
    """Force of a model's air along a motion, its lags by Runge-Kutta, from none, (N, n)."""
    n, size = model.robot.dof, model.state_size
    q, v, z = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("z", size)
    constants = ca.SX(ca.DM(model.parameters))
    air = model.expressions(model.robot, q, v, z, ca.SX.zeros(3), constants)
    rate = ca.Function("rate", [q, v, z], [air.state_derivative])
    force = ca.Function("force", [q, v, z], [air.generalized_force])
    y, lags = [], ca.DM.zeros(size) if lags is None else ca.DM(lags)
    for k, now in enumerate(state):
        y.append(force(now[:n], now[n:], lags).full().ravel())
        if k + 1 < len(state):
            h, middle, after = time[k + 1] - time[k], (now + state[k + 1]) / 2, state[k + 1]
            a = rate(now[:n], now[n:], lags)
            b = rate(middle[:n], middle[n:], lags + h / 2 * a)
            c = rate(middle[:n], middle[n:], lags + h / 2 * b)
            d = rate(after[:n], after[n:], lags + h * c)
            lags = lags + h / 6 * (a + 2 * b + 2 * c + d)
    return np.array(y)


def nmse(y, guess):
    heard = y.var(axis=0) > 1e-9 * y.var(axis=0).max()
    return (((guess - y)[:, heard] ** 2).mean(0) / y[:, heard].var(0)).max()


class Elsewhere(pt.learning.HiddenStripNetwork):
    """The same network, whose lift slope starts at 5.5."""

    def initial(self, seed):
        weights = super().initial(seed)
        weights[4] = np.log(5.5 / (2 * np.pi)) / self._reach[4]  # behind two rates, two amplitudes
        return weights


def test_a_lifting_line_is_learned_by_a_network_with_lags_and_not_without(robot):
    """Truth: Jones' lags, a section that stalls from 13 to 27 degrees; the pupil starts elsewhere.

    What it learned holds for a gait it never met, and its numbers went toward the truth.
    """
    truth = pt.LiftingLine(robot, lags=TWO_STATE)
    pupil = Elsewhere(robot)
    static = pt.StripNetwork(robot, (8, 8), activation="tanh", rotation=True)
    time = np.arange(0.0, 2.0, 2e-3)
    state = flapping(robot, time)
    y = flown(truth, time, state)
    worst = {}
    for network in (pupil, static):
        learner = pt.ExtendedLearner(
            network, prior_std=0.1, measurement_std=0.01 * np.abs(y).max(axis=0) + 1e-6
        )
        guess = stream(learner, time, state, y, every=5).prediction["prediction"].values
        worst[network.kind] = nmse(y[500:], guess[500:])
        if network is pupil:
            weights = learner.weights
    assert worst["hidden_strip"] < 1e-3
    assert worst["hidden_strip"] < worst["strip"] / 5
    other = flapping(robot, time[:400], beat=2 * np.pi * 4.0, feather=0.15)
    unseen = pupil.evaluate(network_inputs(pupil, weights, time[:400], other), weights)
    assert nmse(flown(truth, time[:400], other)[50:], unseen[50:]) < 1e-2
    before, after = pupil.constants(pupil.initial(0)), pupil.constants(weights)
    assert before["section.lift_slope"] == pytest.approx(5.5)
    assert abs(after["section.lift_slope"] - 2 * np.pi) < abs(5.5 - 2 * np.pi)


def test_attached_air_with_the_true_numbers_is_that_of_the_lifting_line(robot):
    """No profile drag, no stall; the lags of the network's second order against Runge-Kutta."""
    section = pt.aerodynamics.Section(profile_drag=0.0, stall_begins=1.5, stall_complete=1.55)
    truth = pt.LiftingLine(robot, lags=TWO_STATE, section=section)
    network = pt.learning.HiddenStripNetwork(robot, (2,), TWO_STATE)
    weights = np.zeros(network.size)
    late = coded_start(TWO_STATE, 2 * np.pi, (1.5, 1.55)) - network._prior
    weights[: len(late)] = late / network._reach
    weights[-8] = 1.0  # the whole lift, and nothing else
    error = []
    for steps in (200, 400):
        time = np.linspace(0.0, 0.4, steps + 1)
        state = flapping(robot, time)
        x = network_inputs(network, weights, time, state)
        lags = x[0, 2 * robot.dof :][: truth.state_size]
        y = flown(truth, time, state, lags)
        error.append(np.abs(network.evaluate(x, weights) - y).max() / np.abs(y).max())
    assert error[1] < 1e-3
    assert error[0] / error[1] == pytest.approx(4.0, rel=0.2)  # second order
