"""The compiled filter of low rank against its readable twin."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import patagium as pt
from patagium.learning.filters.block_kernel import structure_and_kernel
from patagium.learning.filters.numbers import filter_numbers
from patagium.learning.filters.weight_filter import WeightFilter
from patagium.learning.settings import FilterSettings
from patagium.native import compiler_name

AGREEMENT = 1e-11  # of the largest: six samples of 1e-15, points thirty deviations away
needs_compiler = pytest.mark.skipif(compiler_name() is None, reason="needs a C compiler")


def filter_pair(
    network, rng, rank, *, spread=3**0.5, process=0.0, forgetting=1.0, linear=False, dtype="float64"
):
    settings = FilterSettings(
        prior_std=1.0,
        measurement_std=0.1,
        process_std=process,
        spread=spread,
        dtype=dtype,
        forgetting_factor=forgetting,
        covariance=pt.learning.LowRank(rank),
    )
    numbers = filter_numbers(network, settings, "extended" if linear else "cubature")
    std = rng.uniform(4, 30, network.size) ** -0.5
    mean = network.initial(0)
    return [
        WeightFilter(numbers, structure_and_kernel(numbers, compiled), mean, std)
        for compiled in (True, False)
    ]


def assert_close(one, other, tolerance=AGREEMENT):
    np.testing.assert_allclose(one, other, rtol=0, atol=tolerance * (1 + np.abs(other).max()))


def assert_same(fast, plain, tolerance=AGREEMENT):
    assert_close(fast.mean, plain.mean, tolerance)
    assert_close(fast.covariance().dense(), plain.covariance().dense(), tolerance)
    assert_close(fast.variances(), plain.variances(), tolerance)


@needs_compiler
@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize(
    ("hidden", "outputs", "rank", "activation"),
    [
        ((), 1, 1, "tanh"),
        ((5, 4), 2, 3, "tanh"),
        ((3,), 9, 4, "softplus"),
        ((20,), 14, 10, "softplus"),
        ((3,), 2, 100, "softplus"),
        ((17, 33), 8, 2, "tanh"),
    ],
)
@pytest.mark.parametrize(
    "options",
    [{}, {"spread": None}, {"forgetting": 0.97}, {"process": 0.01}],
    ids=["sqrt3", "cubature", "forgetting", "noise"],
)
def test_kernel_is_its_twin(hidden, outputs, rank, activation, options, linear, rng):
    network = pt.DenseNetwork(6, hidden, outputs, activation, output_scale=2.0, output_center=0.3)
    fast, plain = filter_pair(network, rng, rank, linear=linear, **options)
    for _ in range(6):
        x, y = rng.normal(size=6), rng.normal(size=outputs)
        for one, other in zip(fast.predict(x), plain.predict(x), strict=True):
            assert_close(one, other)
        assert (fast.update(x, y)[0], plain.update(x, y)[0]) == (0, 0)
        assert fast.nis == pytest.approx(plain.nis, rel=1e-8)  # of a near-singular P_yy
    assert_same(fast, plain)
    fast.drift(0.9, np.full(network.size, 1e-3))
    plain.drift(0.9, np.full(network.size, 1e-3))
    x, y = rng.normal(size=6), rng.normal(size=outputs)
    fast.update(x, y)
    plain.update(x, y)
    assert_same(fast, plain)


@needs_compiler
def test_networks_of_many_items(rng):
    robot = pt.load_robot("aerobat")
    network = pt.StripNetwork(robot)
    fast, plain = filter_pair(network, rng, 6)
    for _ in range(5):
        x, y = rng.normal(size=2 * robot.dof), rng.normal(size=robot.dof)
        fast.update(x, y)
        plain.update(x, y)
    assert_same(fast, plain, 1e-7)  # what y sees is a difference of numbers 1e6 times as large


@needs_compiler
def test_single_precision_is_kept_in_single_precision(rng):
    network = pt.DenseNetwork(6, (8,), 3)
    fast, plain = filter_pair(network, rng, 4, dtype="float32")
    for _ in range(20):
        x, y = rng.normal(size=6), rng.normal(size=3)
        fast.update(x, y)
        plain.update(x, y)
    assert_same(fast, plain, 1e-4)  # twenty samples of 6e-8, gains of 1e2
    assert {part.dtype.name for part in fast.kept()} == {"float32"}


@needs_compiler
def test_a_sample_beyond_all_numbers_changes_nothing(rng):
    network = pt.DenseNetwork(6, (8,), 3)
    fast, _ = filter_pair(network, rng, 4)
    fast.update(rng.normal(size=6), rng.normal(size=3))
    before = fast.mean.copy(), fast.covariance().dense(), fast.nis
    assert fast.update(np.full(6, 1e200), rng.normal(size=3))[0] != 0
    assert fast.update(rng.normal(size=6), np.full(3, 1e200))[0] != 0
    after = fast.mean, fast.covariance().dense(), fast.nis
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one, other)


@needs_compiler
def test_a_pickled_filter_goes_on(rng):
    network = pt.DenseNetwork(6, (8,), 3)
    fast, _ = filter_pair(network, rng, 4, forgetting=0.99)
    fast.update(rng.normal(size=6), rng.normal(size=3))
    again = pickle.loads(pickle.dumps(fast))
    x, y = rng.normal(size=6), rng.normal(size=3)
    fast.update(x, y)
    again.update(x, y)
    np.testing.assert_array_equal(fast.mean, again.mean)


@needs_compiler
@pytest.mark.parametrize("linear", [False, True])
def test_without_a_compiler_the_twin_takes_over(linear, monkeypatch, rng):
    network = pt.DenseNetwork(2, (3,), 1)
    fast, plain = filter_pair(network, rng, 2, linear=linear)
    monkeypatch.setenv("PATAGIUM_COMPILER", "none")
    other = WeightFilter(plain.numbers, structure_and_kernel(plain.numbers), plain.mean)
    other.resume(plain.state())
    for one in (fast, plain, other):
        one.update(np.ones(2), np.ones(1))
    np.testing.assert_array_equal(other.mean, plain.mean)
    assert_same(fast, plain)


@pytest.mark.parametrize("compiled", [True, False])
def test_what_the_columns_know_alone_keeps_its_digits(compiled, monkeypatch, rng):
    # Forgetting takes U below all numbers where the columns say everything, and 1 / U with it.
    if not compiled:
        monkeypatch.setenv("PATAGIUM_COMPILER", "none")
    learner = pt.CubatureLearner(
        pt.DenseNetwork(1, (), 1),
        covariance=pt.learning.LowRank(6),
        forgetting_factor=0.9,
        prior_std=0.5,
        measurement_std=0.05,
    )
    for x in rng.normal(size=(1000, 1)):
        learner.update(x, 2 * x + 1)
        if learner.count > 200:  # the prior is forgotten
            np.testing.assert_allclose(learner.weights, [2, 1], atol=1e-9)
