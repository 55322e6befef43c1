"""Air with memory is learned by strips that remember, and not by strips that do not."""

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.learning import stream
from patagium.learning.models.memory import measured_inputs, network_inputs
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


def with_accelerations(time, state):
    """[q, v, a], (N, 3n)."""
    half = state.shape[1] // 2
    return np.hstack([state, np.gradient(state[:, half:], time, axis=0)])


def nmse(y, guess):
    heard = y.var(axis=0) > 1e-9 * y.var(axis=0).max()
    return (((guess - y)[:, heard] ** 2).mean(0) / y[:, heard].var(0)).max()


def test_a_lifting_line_is_learned_by_a_network_with_lags_and_not_without(robot):
    """Truth: two lags; the pupil has one, of another rate. It holds for a gait it never met."""
    truth, pupil = pt.LiftingLine(robot), pt.learning.LinearStripNetwork(robot, attached=True)
    static = pt.StripNetwork(robot, (8, 8), activation="tanh", rotation=True)
    time = np.arange(0.0, 2.0, 2e-3)
    state = flapping(robot, time)
    y = flown(truth, time, state)
    seen, worst = with_accelerations(time, state), {}
    for network in (pupil, static):
        learner, x = pt.ExtendedLearner(network), seen[:, : measured_inputs(network)]
        guess = stream(learner, time, x, y, every=5).prediction["prediction"].values
        worst[network.kind] = nmse(y[500:], guess[500:])
        if network is pupil:
            weights = learner.weights
    assert worst["linear_strip"] < 1e-3
    assert worst["linear_strip"] < worst["strip"] / 5
    other = flapping(robot, time[:400], beat=2 * np.pi * 4.0, feather=0.15)
    x = network_inputs(pupil, weights, time[:400], with_accelerations(time[:400], other))
    assert nmse(flown(truth, time[:400], other)[50:], pupil.evaluate(x, weights)[50:]) < 1e-2
