"""Learners given samples of a known network or robot find it again, as surely as they say."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt


def teacher(rng, network, prior):
    return network.initial(0) + prior * rng.normal(size=network.size) / np.sqrt(network.fan_in)


@pytest.mark.parametrize("kind", ["cubature", "sqrt3", "extended"])
def test_teachers_within_the_prior_are_found_within_the_covariance(kind, rng):
    # A prior narrow enough for the network to be nearly linear over it.
    network, prior, noise = pt.DenseNetwork(2, (4,), 2), 0.1, 0.05
    setting = {"prior_std": prior, "measurement_std": noise}
    squares, distances, errors = [], [], []
    for _ in range(6):
        truth = teacher(rng, network, prior)
        if kind == "extended":
            learner = pt.ExtendedLearner(network, **setting)
        else:
            spread = 3**0.5 if kind == "sqrt3" else None
            learner = pt.CubatureLearner(network, spread=spread, **setting)
        for _ in range(150):
            x = rng.normal(size=2)
            y = network(x, truth) + noise * rng.normal(size=2)
            mean, covariance = learner.predict(x)
            squares.append((y - mean) @ np.linalg.solve(covariance, y - mean) / 2)
            learner.update(x, y)
        off = learner.weights - truth
        distances.append(off @ np.linalg.solve(learner.covariance, off) / network.size)
        x = rng.normal(size=(200, 2))
        errors.append(network.evaluate(x, learner.weights) - network.evaluate(x, truth))
    assert 0.89 < np.mean(squares) < 1.11  # 1 +- 3.3 deviations of the mean of 900 chi^2(2)/2
    assert 0.6 < np.mean(distances) < 1.5  # 1 +- 4 deviations of 6 chi^2(22)/22
    assert np.sqrt(np.mean(np.square(errors))) < noise / 2


def test_a_strip_network_learns_the_air_of_gaits_it_never_saw(rng):
    robot = pt.load_robot("aerobat")
    aero, n = pt.QuasiSteady(robot), robot.dof
    network = pt.StripNetwork(robot)

    def flapping(count, plunge_rate, speed):
        q = 0.05 * rng.normal(size=(count, n))
        v = 0.1 * rng.normal(size=(count, n))
        v[:, robot.index("x")] += speed
        for side in ("left", "right"):
            q[:, robot.index(f"{side}_plunge")] = rng.uniform(-0.8, 0.8, count)
            v[:, robot.index(f"{side}_plunge")] = rng.uniform(-plunge_rate, plunge_rate, count)
        return np.hstack([q, v]), aero.batch.generalized_force(q, v)

    x, y = flapping(400, 15.0, 4.0)
    learner = pt.CubatureLearner(
        network,
        prior_std=0.1 * np.sqrt(network.fan_in),
        measurement_std=1e-3 * y.std(axis=0),
        spread=3**0.5,
    )
    for row, force in zip(x, y, strict=True):
        learner.update(row, force)
    x, y = flapping(1000, 10.0, 5.0)
    error = network.evaluate(x, learner.weights) - y
    nmse = np.mean(error**2, axis=0) / y.var(axis=0)
    assert nmse.max() < 1e-3
    assert np.diag(learner.covariance).max() < 1.001e-2


@pytest.mark.parametrize("option", [{"forgetting_factor": 0.97}, {"process_std": 0.01}])
def test_a_teacher_that_changes_is_followed(option, rng):
    network, noise = pt.DenseNetwork(2, (), 1), 0.02
    truth = np.array([0.5, -0.7, 0.3])
    setting = {"prior_std": 1.0, "measurement_std": noise}
    still = pt.CubatureLearner(network, **setting)
    following = pt.CubatureLearner(network, **option, **setting)
    for k in range(600):
        x = rng.normal(size=2)
        y = network(x, truth if k < 400 else -truth) + noise * rng.normal(size=1)
        still.update(x, y)
        following.update(x, y)
    assert np.abs(still.weights + truth).max() > 0.5  # averages both
    assert np.abs(following.weights + truth).max() < 5 * noise
