"""Least squares over a whole log: of a linear network the filter's own answer, else better."""

from dataclasses import replace

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError, ShapeError
from patagium.learning.refinement import refine
from patagium.learning.stream import stream

TIME = np.arange(60) * 0.01


def learned(network, x, y, **options):
    learner = pt.ExtendedLearner(network, prior_std=1.0, measurement_std=0.1, **options)
    stream(learner, TIME, x, y, every=2)
    return learner


def test_of_a_linear_network_nothing_changes():
    draw = np.random.default_rng(0)
    network = pt.DenseNetwork(3, (), 2)
    x = draw.normal(size=(60, 3))
    y = draw.normal(size=(60, 2))
    learner = learned(network, x, y)
    model = refine(learner, TIME, x, y, every=2)
    assert np.allclose(model.weights, learner.weights, atol=1e-10)  # rounding
    assert np.allclose(model.covariance, learner.covariance, atol=1e-10)
    y[10, 1] = np.nan
    again = learned(network, x, y)
    assert np.allclose(refine(again, TIME, x, y, every=2).weights, again.weights, atol=1e-10)


def test_the_noise_of_each_measured_force_counts():
    """It was dropped: numbers lay hundreds of their own deviations off where it changes."""
    robot, draw = pt.load_robot("aerobat"), np.random.default_rng(0)
    flight = pt.simulate(robot, pt.QuasiSteady(robot), duration=0.2, time_step=5e-4)
    time, x, y = pt.training_data(flight)
    noisy = np.arange(len(y)) // 50 % 4 == 3
    std = (0.05 * y.std(axis=0) + 1e-6) * np.where(noisy, 30.0, 1.0)[:, None]
    covariance = np.einsum("ki,ij->kij", std**2, np.eye(robot.dof))
    q, v = np.split(x, 2, axis=1)
    parts = q, v, y + std * draw.normal(size=y.shape), covariance, robot, "made"
    forces = pt.sensing.ForceSamples(time, *parts, a=flight["a"].values)
    network = pt.learning.LinearStripNetwork(robot)
    learner = pt.ExtendedLearner(network, measurement_std=1e-3 * y.std(axis=0) + 1e-6)
    pt.identify(forces, learner, every=5)
    model, spread = refine(learner, forces, every=5), np.sqrt(np.diagonal(learner.covariance))
    assert np.abs(model.weights - learner.weights).max() < 1e-3 * spread.max()
    assert (np.abs(model.weights - learner.weights) < 1e-2 * spread).all()
    np.testing.assert_allclose(np.sqrt(np.diagonal(model.covariance)), spread, rtol=1e-2)


def test_outliers_weigh_as_little_as_for_the_learner():
    """`refine` ignored the screening of outliers: spikes moved numbers by 11 deviations."""
    draw = np.random.default_rng(0)
    network = pt.DenseNetwork(3, (), 1)
    teacher = np.array([0.5, -1.0, 0.3, 0.2])
    x = draw.normal(size=(600, 3))
    y = network.evaluate(x, teacher) + 0.1 * draw.normal(size=(600, 1))
    y[::50] += 60 * 0.1
    time = np.arange(600) * 0.01
    learner = pt.ExtendedLearner(
        network, prior_std=1.0, measurement_std=0.1, screening=pt.learning.Screening()
    )
    stream(learner, time, x, y, every=1)
    model = refine(learner, time, x, y)
    spread = np.sqrt(np.diagonal(model.covariance))
    assert (np.abs(model.weights - teacher) < 4 * spread).all()
    assert spread == pytest.approx(np.sqrt(np.diagonal(learner.covariance)), rel=0.02)


def test_of_another_the_cost_is_minimal():
    """No weight nearby explains log and prior better."""
    draw = np.random.default_rng(1)
    network = pt.DenseNetwork(1, (2,), 1, "tanh")
    x = np.linspace(-2, 2, 60)[:, None]
    teacher = np.array([1.0, -0.5, 0.3, 0.8, 1.0, 0.7, 0.1])
    y = network.evaluate(x, teacher) + 0.1 * draw.normal(size=(60, 1))
    learner = learned(network, x, y)
    model = refine(learner, TIME, x, y, every=2)
    first, prior = learner.prior

    def cost(weights):
        error = (network.evaluate(x, weights) - y)[::2]
        return (error**2).sum() / 0.01 + ((weights - first) ** 2 / prior).sum()

    best = cost(model.weights)
    assert best < cost(learner.weights)
    spread = np.sqrt(np.diagonal(model.covariance))
    for shift in np.diag(0.2 * spread):
        assert cost(model.weights + shift) > best < cost(model.weights - shift)
    assert model.measurement_std == pytest.approx([0.1])
    with pytest.raises(ShapeError, match="y"):
        refine(learner, TIME, x, y[:-1])
    with pytest.raises(ShapeError, match="x"):
        refine(learner, TIME, x[:-1], y)


def test_logs_one_after_the_other_teach_as_much_as_both_at_once():
    """`refine` used the last log alone: standard deviations were 1.6 times too large."""
    draw = np.random.default_rng(2)
    network = pt.DenseNetwork(3, (), 2)
    x, y = draw.normal(size=(120, 3)), draw.normal(size=(120, 2))
    learner = learned(network, x[:60], y[:60])
    first = refine(learner, TIME, x[:60], y[:60], every=2)
    learner.go_on_from(first.weights, first.covariance)
    stream(learner, TIME, x[60:], y[60:], every=2)
    both = learned(network, x[:60], y[:60])
    stream(both, TIME, x[60:], y[60:], every=2)
    found = refine(learner, TIME, x[60:], y[60:], every=2, before=first)
    for one in (found, learner):
        assert np.allclose(one.weights, both.weights, atol=1e-10)  # rounding
        assert np.allclose(one.covariance, both.covariance, atol=1e-10)
    with pytest.raises(ParameterError, match="with a covariance"):
        refine(learner, TIME, x[60:], y[60:], before=replace(first, kept_covariance=None))


def test_a_learner_goes_on_from_what_can_be_its_state_alone():
    """NaN ended the next update as if the prior were wrong; of a larger P a part was taken."""
    learner, weights, plain = pt.ExtendedLearner(pt.DenseNetwork(1, (), 1)), [0.5, -0.6], np.eye(2)
    learner.go_on_from(weights, plain.tolist())
    for wrong, name in (
        (([np.nan, 0.2], plain), "weights: expected finite"),
        ((weights[:1], plain), "weights: expected shape"),
        ((weights, np.diag(plain)), "covariance: expected shape"),
        ((weights, np.eye(3)), "covariance: expected shape"),
        ((weights, -plain), "covariance: expected a symmetric and positive definite"),
        ((weights, plain * np.nan), "covariance: expected finite"),
        ((weights, plain + [[0, 0.9], [0, 0]]), "covariance: expected a symmetric and positive"),
    ):
        with pytest.raises((ParameterError, ShapeError), match=name):
            learner.go_on_from(*wrong)
        assert np.array_equal(learner.weights, weights)
        assert np.allclose(learner.covariance, plain, atol=1e-15)  # rounding


def test_found_noise_is_that_of_the_errors_that_remain():
    """Noise included errors of the first weights: deviations were 3 to 50 times too large."""
    network, noise, time = pt.DenseNetwork(3, (), 2), np.array([0.01, 0.3]), np.arange(100) * 0.01
    far, squares = [], []
    for seed in range(20):
        draw = np.random.default_rng(seed)
        learner = pt.ExtendedLearner(network, prior_std=1.0)
        first, prior = learner.prior
        teacher = first + np.sqrt(prior) * draw.normal(size=len(first))
        x = draw.normal(size=(100, 3))
        y = network.evaluate(x, teacher) + noise * draw.normal(size=(100, 2))
        y[5, 1] = np.nan
        stream(learner, time, x, y, every=1)
        model = refine(learner, time, x, y)
        far.append((model.weights - teacher) / np.sqrt(np.diagonal(model.covariance)))
        squares.append((model.measurement_std / noise) ** 2)
    assert np.mean(squares, axis=0) == pytest.approx([1, 1], abs=0.13)  # 4 (2 / 2000)^(1/2)
    assert np.mean(np.square(far)) == pytest.approx(1, abs=0.45)  # 4 (2 / 160)^(1/2)


def test_correlated_errors_are_told():
    """Deviations are of independent errors; a force that the network lacks is none."""
    network, draw = pt.DenseNetwork(1, (), 1), np.random.default_rng(3)
    time, x = np.arange(200) * 0.01, draw.normal(size=(200, 1))
    white = 0.1 * draw.normal(size=(200, 1))
    for lacking, told in ((0.0, False), (0.3, True)):
        y = x + white + lacking * np.sin(8 * time)[:, None]
        learner = pt.ExtendedLearner(network, prior_std=1.0)
        stream(learner, time, x, y, every=1)
        words = refine(learner, time, x, y).learner["parameter_fit"]
        assert ("too sure of them" in words) is told
