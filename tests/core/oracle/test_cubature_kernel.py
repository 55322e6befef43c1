"""The compiled filter against its readable twin, and its activations against long doubles."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

import patagium as pt
from patagium.learning.filters.block_kernel import structure_and_kernel
from patagium.learning.filters.blocks import blocks_in
from patagium.learning.filters.numbers import filter_numbers
from patagium.learning.filters.weight_covariance import scattered
from patagium.learning.filters.weight_filter import WeightFilter
from patagium.learning.settings import FilterSettings
from patagium.native import compiler_name, load_kernel

AGREEMENT = 1e-12  # design.md, decision 4


@pytest.fixture(params=["float64", "float32"])
def kernel(request):
    single = request.param == "float32"
    defines = {"REAL": "float" if single else "double", "SINGLE": int(single)}
    library = load_kernel("cubature", defines)
    if library is None:
        pytest.skip("no C compiler here")
    return request.param, library


def setting_of(network, *, spread=None, dtype="float64", process=0.0, forgetting=1.0):
    settings = FilterSettings(
        prior_std=1.0,
        measurement_std=0.1,
        process_std=process,
        spread=spread,
        dtype=dtype,
        forgetting_factor=forgetting,
    )
    return filter_numbers(network, settings, "cubature")


def start(network, rng):
    return network.initial(0), rng.uniform(0.2, 0.6, network.size)


def kept_of(one):
    return scattered(one.kept(), blocks_in(one.numbers))


def filter_pair(network, rng, **options):
    setting = setting_of(network, **options)
    if compiler_name() is None:
        pytest.skip("no C compiler here")
    mean, std = start(network, rng)
    return [
        WeightFilter(setting, structure_and_kernel(setting, compiled), mean, std)
        for compiled in (True, False)
    ]


@pytest.mark.parametrize("activation", ["softplus", "tanh"])
@pytest.mark.parametrize(
    ("inputs", "hidden", "outputs"),
    [
        (1, (), 1),
        (3, (5,), 2),
        (2, (8, 8), 2),
        (5, (4, 3, 2), 9),
        (4, (3,), 16),
        (6, (11,), 17),
        (31, (), 1),
        (8, (20,), 14),
    ],
)
@pytest.mark.parametrize(
    "options",
    [{}, {"spread": 3**0.5}, {"spread": 25.0, "forgetting": 0.97}, {"process": 0.01}],
    ids=["cubature", "sqrt3", "wide", "noise"],
)
def test_kernel_is_its_twin(activation, inputs, hidden, outputs, options, rng):
    network = pt.DenseNetwork(inputs, hidden, outputs, activation, output_center=0.3)
    fast, plain = filter_pair(network, rng, **options)
    for _ in range(4):
        x, y = rng.normal(size=inputs), rng.normal(size=outputs)
        for one, other in zip(fast.predict(x), plain.predict(x), strict=True):
            np.testing.assert_allclose(one, other, rtol=AGREEMENT, atol=AGREEMENT)
        outcome, guess = fast.update(x, y)
        assert (outcome, 0) == (plain.update(x, y)[0], outcome)
        np.testing.assert_allclose(fast.mean, plain.mean, rtol=AGREEMENT, atol=AGREEMENT)
        np.testing.assert_allclose(kept_of(fast), kept_of(plain), rtol=AGREEMENT, atol=AGREEMENT)
        assert "process" in options or (np.triu(kept_of(fast), 1) == 0).all()


@pytest.mark.parametrize(
    ("inputs", "hidden", "outputs"), [(3, (5,), 2), (8, (20,), 14), (6, (11,), 17), (4, (3,), 33)]
)
def test_single_precision_is_its_twin_to_single_rounding(inputs, hidden, outputs, rng):
    network = pt.DenseNetwork(inputs, hidden, outputs)
    fast, _ = filter_pair(network, rng, dtype="float32", spread=3**0.5)
    plain = WeightFilter(
        setting_of(network, spread=3**0.5),
        structure_and_kernel(setting_of(network, spread=3**0.5), False),
        fast.mean,
    )
    plain.resume(fast.state())
    for _ in range(3):
        x, y = rng.normal(size=inputs), rng.normal(size=outputs)
        fast.update(x, y)
        plain.update(x, y)
    # 6e-8 a number, times gains of ten and sums of some hundred of them
    np.testing.assert_allclose(fast.mean, plain.mean, atol=1e-4)
    np.testing.assert_allclose(kept_of(fast), kept_of(plain), atol=1e-4)


def test_kernel_calls_the_compiled_encoder_of_a_strip_network(rng):
    robot = pt.load_robot("aerobat")
    network = pt.StripNetwork(robot)
    fast, plain = filter_pair(network, rng, spread=3**0.5)
    assert network.compiled_encoder() is not None
    for _ in range(5):
        x, y = rng.normal(size=2 * robot.dof), rng.normal(size=robot.dof)
        fast.update(x, y)
        plain.update(x, y)
    np.testing.assert_allclose(fast.mean, plain.mean, rtol=1e-9, atol=1e-9)  # five samples on
    np.testing.assert_allclose(kept_of(fast), kept_of(plain), rtol=1e-9, atol=1e-9)


def test_single_precision_follows_double(rng):
    network = pt.DenseNetwork(3, (8,), 2)
    learners = [
        pt.CubatureLearner(network, prior_std=0.5, measurement_std=0.05, spread=3**0.5, dtype=dtype)
        for dtype in ("float64", "float32")
    ]
    x = rng.normal(size=(400, 3))
    y = np.sin(x[:, :2]) + 0.05 * rng.normal(size=(400, 2))
    for row, measured in zip(x, y, strict=True):
        for learner in learners:
            learner.update(row, measured)
    errors = [np.mean((network.evaluate(x, one.weights) - y) ** 2) for one in learners]
    assert errors[1] == pytest.approx(errors[0], rel=0.02)  # 400 samples of 1e-7 each
    assert np.linalg.eigvalsh(learners[1].covariance).min() > 0


@pytest.mark.parametrize("activation", ["softplus", "tanh"])
def test_activations_to_three_units_in_the_last_place(kernel, activation, rng):
    dtype, library = kernel
    reach = 85.0 if dtype == "float32" else 700.0
    z = np.concatenate(
        [
            rng.normal(size=4000),
            rng.uniform(-40, 40, 4000),
            rng.uniform(-reach, reach, 4000),
            10.0 ** rng.uniform(-12, 1, 4000) * rng.choice([-1, 1], 4000),
            np.zeros(16),
        ]
    ).astype(dtype)
    result = apply(library, activation, z)
    wide = z.astype(np.longdouble)
    decay = np.exp(-np.abs(wide))
    if activation == "tanh":
        exact = np.tanh(wide)
    else:
        exact = np.maximum(wide, 0) + np.log1p(decay)
    unit = np.spacing(np.abs(exact).astype(dtype)).astype(np.longdouble)
    assert (np.abs(result - exact) / unit).max() < 3


def test_activations_of_what_is_not_a_number(kernel):
    dtype, library = kernel
    odd = np.zeros(16, dtype)
    odd[:5] = [np.nan, 1e4, -1e4, np.inf, -0.0]
    softplus, tanh = (apply(library, name, odd) for name in ("softplus", "tanh"))
    assert np.isnan(softplus[0]) and np.isnan(tanh[0])
    assert softplus[1] == dtype_of(dtype, 1e4) and 0 <= softplus[2] < 1e-37
    assert tanh[1] == 1 and tanh[2] == -1 and softplus[3] == np.inf and tanh[4] == 0


def dtype_of(dtype, value):
    return np.dtype(dtype).type(value)


def apply(library, name, z):
    result = z.copy()
    function = library.cubature_activate
    function.argtypes, function.restype = [ctypes.c_int, ctypes.c_int, ctypes.c_void_p], None
    function({"softplus": 0, "tanh": 1}[name], len(result), result.ctypes.data)
    return result


def test_without_a_compiler_the_twin_takes_over(monkeypatch, rng):
    network = pt.DenseNetwork(3, (4,), 2)
    mean, std = start(network, rng)
    compiled = WeightFilter(
        setting_of(network), structure_and_kernel(setting_of(network)), mean, std
    )
    monkeypatch.setenv("PATAGIUM_COMPILER", "none")
    plain = WeightFilter(setting_of(network), structure_and_kernel(setting_of(network)), mean, std)
    assert plain.compiled is None
    x, y = rng.normal(size=3), rng.normal(size=2)
    compiled.update(x, y)
    plain.update(x, y)
    np.testing.assert_allclose(plain.mean, compiled.mean, rtol=AGREEMENT, atol=AGREEMENT)
