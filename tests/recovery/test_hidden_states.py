"""Air with memory is learned by strips that remember, and not by strips that do not."""

import numpy as np

import patagium as pt
from patagium.identification import stream
from patagium.robot import load_robot_text


def test_a_wing_with_lags_is_learned_by_a_network_with_lags():
    """Teacher: normal coefficient of a thin section with Jones' lags, phi(0) = 1/2."""
    robot = load_robot_text(pt.load_robot("aerobat").source.replace("strips: 5", "strips: 2"))
    teacher = pt.HiddenStripNetwork(robot, (), (0.0455, 0.3))
    pupil = pt.HiddenStripNetwork(robot, (4,))  # its rates are others
    static = pt.StripNetwork(robot, (8, 8), activation="tanh", rotation=True)
    weights = np.zeros(teacher.size)
    inputs = teacher.perceptron.widths[0]
    # c_n = 2 pi (w/2 + .165 xi_1 + .335 xi_2)/U, of features 1.5 w/U and 3 xi/U, scale 4
    weights[inputs + 2 : inputs + 5] = 2 * np.pi / 4 * np.array([0.5 / 1.5, 0.165 / 3, 0.335 / 3])
    time, dof = np.linspace(0.0, 2.0, 2000), robot.dof
    state, beat = np.zeros((len(time), 2 * dof)), 2 * np.pi * 4.0
    state[:, dof] = 4.0 + 0.5 * np.sin(3 * time)
    for side in ("left", "right"):
        for joint, size, phase in (("plunge", 0.5, 0.0), ("feather", 0.2, 1.4)):
            k = robot.index(f"{side}_{joint}")
            state[:, k] = size * np.sin(beat * time + phase)
            state[:, dof + k] = size * beat * np.cos(beat * time + phase)
    y = teacher.evaluate(teacher.recall(weights, time, state)[0], weights)
    heard = y.var(axis=0) > 1e-9 * y.var(axis=0).max()
    worst = {}
    for network in (pupil, static):
        learner = pt.CubatureLearner(
            network,
            prior_deviation=0.3,
            measurement_deviation=1e-3 * y.std(axis=0) + 1e-6,
            spread=np.sqrt(3.0),
        )
        guess = stream(learner, time, state, y, every=10).prediction["prediction"].values
        error = ((guess - y)[1000:, heard] ** 2).mean(0) / y[1000:, heard].var(0)
        worst[network.kind] = error.max()
    assert worst["hidden_strip"] < 1e-3
    assert worst["hidden_strip"] < worst["strip"] / 5
