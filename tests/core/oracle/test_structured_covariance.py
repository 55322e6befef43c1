"""Blocks against the full filter where they must agree, and kernels against twins."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError
from patagium.learning.filters.block_kernel import structure_and_kernel
from patagium.learning.filters.blocks import blocks_in
from patagium.learning.filters.numbers import filter_numbers
from patagium.learning.filters.weight_covariance import scattered
from patagium.learning.filters.weight_filter import WeightFilter
from patagium.learning.models.structure import blocks_of
from patagium.learning.settings import FilterSettings, checked_structure
from patagium.native import compiler_name

AGREEMENT = 1e-12  # design.md, decision 4
ROUNDING = 1e-9  # some thirty samples, two ways of doing the same
TOLD = {"prior_std": 0.5, "measurement_std": 0.05}


def learned(network, rng, learner=pt.CubatureLearner, count=30, **options):
    one = learner(network, **{**TOLD, **options})
    mixing = rng.normal(size=(network.inputs, network.outputs))
    for x in rng.normal(size=(count, network.inputs)):
        one.update(x, np.sin(x @ mixing))
    return one


def same(one, other, tolerance=ROUNDING):
    np.testing.assert_allclose(one.weights, other.weights, atol=tolerance)
    np.testing.assert_allclose(one.covariance, other.covariance, atol=tolerance)
    np.testing.assert_allclose(one.variances, np.diag(one.covariance), atol=tolerance)
    assert one.nis == pytest.approx(other.nis, rel=1e-6)


DRIFTS = [{}, {"forgetting_factor": 0.97}, {"process_std": 0.02, "prior_share": 0.05}]


@pytest.mark.parametrize("drift", DRIFTS, ids=["still", "forgets", "wanders"])
@pytest.mark.parametrize("spread", [None, 3**0.5])
@pytest.mark.parametrize("structure", ["layer", "node"])
def test_one_neuron_is_one_block(structure, spread, drift, rng):
    network = pt.DenseNetwork(6, (), 1)
    seed = rng.integers(1 << 30)
    one, full = (
        learned(network, np.random.default_rng(seed), covariance=kept, spread=spread, **drift)
        for kept in (structure, "full")
    )
    same(one, full)


@pytest.mark.parametrize("learner", [pt.CubatureLearner, pt.ExtendedLearner])
@pytest.mark.parametrize("drift", DRIFTS, ids=["still", "forgets", "wanders"])
def test_outputs_that_share_no_weight_are_blocks_by_themselves(learner, drift, rng):
    network = pt.DenseNetwork(4, (), 5, output_scale=[1, 2, 3, 4, 5])
    one, full = (
        learned(network, np.random.default_rng(7), learner, covariance=kept, **drift)
        for kept in ("node", "full")
    )
    same(one, full)


def test_layers_of_one_neuron_are_neurons(rng):
    network = pt.DenseNetwork(3, (1, 1), 1, "tanh")
    one, other = (
        learned(network, np.random.default_rng(3), covariance=kept, spread=3**0.5)
        for kept in ("node", "layer")
    )
    same(one, other)


def test_blocks_forget_what_lies_between_them_and_nothing_else(rng):
    network = pt.DenseNetwork(3, (4,), 2)
    one, full = (
        learned(network, np.random.default_rng(5), count=1, covariance=kept, spread=3**0.5)
        for kept in ("node", "full")
    )
    whole, kept = full.covariance, np.zeros((network.size,) * 2)
    for block in blocks_of(network.perceptron, "node"):
        kept[np.ix_(block, block)] = whole[np.ix_(block, block)]
    np.testing.assert_allclose(one.weights, full.weights, atol=ROUNDING)
    np.testing.assert_allclose(one.covariance, kept, atol=ROUNDING)
    assert abs(whole - kept).max() > 1e-4


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("structure", ["full", "layer", "node"])
def test_covariance_stays_definite_with_hardly_any_noise(structure, dtype, rng):
    network = pt.DenseNetwork(3, (6,), 2)
    one = learned(
        network,
        rng,
        count=300,
        covariance=structure,
        dtype=dtype,
        spread=3**0.5,
        measurement_std=1e-3,
    )
    covariance = one.covariance
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-12)
    smallest, largest = np.linalg.eigvalsh(covariance)[[0, -1]]
    assert smallest > -1e-15 * largest if dtype == "float64" else smallest > 0
    assert (one.variances > 0).all()
    assert largest <= 0.25 * (1 + 1e-6)  # the prior's


@pytest.mark.parametrize("structure", ["full", "layer", "node"])
def test_a_copy_goes_on_as_the_learner_and_a_refused_sample_changes_nothing(structure, rng):
    network = pt.DenseNetwork(3, (6,), 2)
    one = learned(network, rng, covariance=structure, spread=3**0.5, prior_share=0.01)
    before = one.weights, one.covariance
    assert np.isnan(one.update(np.ones(3), [1e200, -1e200])).all()
    assert one.events["blind"] == 1 and one.events["out_of_range"] == 2
    np.testing.assert_array_equal(one.weights, before[0])
    np.testing.assert_array_equal(one.covariance, before[1])
    other = copy.deepcopy(one)
    for each in (one, other):
        each.predict(np.zeros(3))
        each.update(np.ones(3), np.zeros(2))
    np.testing.assert_array_equal(one.weights, other.weights)
    assert one.describe() == other.describe()


@pytest.mark.parametrize("activation", ["softplus", "tanh"])
@pytest.mark.parametrize(
    ("inputs", "hidden", "outputs"),
    [
        (1, (), 1),
        (3, (5,), 2),
        (5, (4, 3, 2), 9),
        (6, (11,), 17),
        (8, (20,), 14),
        (3, (9, 17), 3),
        (2, (3, 2), 1),
    ],
)
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"spread": 3**0.5, "noise": 0.001, "forgetting": 0.97},
        {"spread": 25.0, "forgetting": 0.97},
    ],
    ids=["cubature", "sqrt3-noise", "wide"],
)
@pytest.mark.parametrize("structure", ["node", "layer"])
def test_kernel_of_blocks_is_its_twin(structure, activation, inputs, hidden, outputs, options, rng):
    network = pt.DenseNetwork(inputs, hidden, outputs, activation, output_center=0.3)
    fast, plain = filter_pair(network, rng, structure=structure, **options)
    for _ in range(4):
        x, y = rng.normal(size=inputs), rng.normal(size=outputs)
        for one, other in zip(fast.predict(x), plain.predict(x), strict=True):
            np.testing.assert_allclose(one, other, rtol=AGREEMENT, atol=AGREEMENT)
        assert fast.update(x, y)[0] == plain.update(x, y)[0] == 0
        np.testing.assert_allclose(fast.mean, plain.mean, rtol=AGREEMENT, atol=AGREEMENT)
        np.testing.assert_allclose(root_of(fast), root_of(plain), rtol=AGREEMENT, atol=AGREEMENT)
        assert fast.nis == pytest.approx(plain.nis, rel=1e-9)


@pytest.mark.parametrize("structure", ["node", "layer"])
def test_kernel_of_blocks_calls_the_compiled_encoder_of_a_strip_network(structure, rng):
    robot = pt.load_robot("aerobat")
    fast, plain = filter_pair(pt.StripNetwork(robot), rng, structure=structure, spread=3**0.5)
    for _ in range(3):
        x, y = rng.normal(size=2 * robot.dof), rng.normal(size=robot.dof)
        fast.update(x, y)
        plain.update(x, y)
    np.testing.assert_allclose(fast.mean, plain.mean, rtol=1e-9, atol=1e-9)  # three samples on
    np.testing.assert_allclose(root_of(fast), root_of(plain), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("hidden", [(8,), (8, 5)])
def test_single_precision_follows_double(hidden, rng):
    network = pt.DenseNetwork(3, hidden, 2)
    single, double = (
        learned(network, np.random.default_rng(2), covariance="node", spread=3**0.5, dtype=dtype)
        for dtype in ("float32", "float64")
    )
    np.testing.assert_allclose(single.weights, double.weights, atol=1e-3)  # 30 samples of 1e-7
    np.testing.assert_allclose(single.covariance, double.covariance, atol=1e-4)


def filter_pair(network, rng, *, structure="node", spread=None, noise=0.0, forgetting=1.0):
    settings = FilterSettings(
        prior_std=1.0,
        measurement_std=0.1,
        process_std=noise**0.5,
        spread=spread,
        forgetting_factor=forgetting,
        covariance=structure,
    )
    setting = filter_numbers(network, settings, "cubature")
    if compiler_name() is None:
        pytest.skip("no C compiler here")
    std, mean = rng.uniform(0.2, 0.6, network.size), network.initial(0)
    return [
        WeightFilter(setting, structure_and_kernel(setting, compiled), mean, std)
        for compiled in (True, False)
    ]


def root_of(one):
    return scattered(one.kept(), blocks_in(one.numbers))


def test_structures_are_refused_and_described():
    network = pt.DenseNetwork(2, (3,), 1)
    for wrong in ("diagonal", 3, None, {"rank": 4}):
        with pytest.raises(ParameterError, match="covariance"):
            pt.CubatureLearner(network, covariance=wrong, **TOLD)
    with pytest.raises(ParameterError, match="cholesky"):
        pt.CubatureLearner(network, covariance="node", square_root="cholesky", **TOLD)
    for structure in ("full", "layer", "node"):
        described = FilterSettings(covariance=structure).describe()["covariance"]
        assert checked_structure(described) == structure
    for structure in ("full", "layer", "node"):
        blocks = blocks_of(network.perceptron, structure)
        np.testing.assert_array_equal(np.sort(np.concatenate(blocks)), np.arange(network.size))
