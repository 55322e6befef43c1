"""Other programs' filters over our networks' weights give our numbers where they must."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError
from patagium_lab.rivals.filterpy_cubature import FilterpyCubature
from patagium_lab.rivals.stonesoup_cubature import StoneSoupCubature
from patagium_lab.rivals.weight_rival import WeightRival

NETWORK = pt.DenseNetwork(
    3, (4,), 2, input_center=0.2, input_scale=1.5, output_center=[1, -1], output_scale=[2, 3]
)
ASSUMED = {"prior_std": 0.5, "measurement_std": [0.1, 0.2], "forgetting_factor": 0.98}


def samples(rng, count=8):
    x = rng.normal(size=(count, 3))
    return list(zip(x, x @ rng.normal(size=(3, 2)), strict=True))


def agree(rival: WeightRival, learner, rng, tolerance: float) -> None:
    for x, y in samples(rng):
        expected = np.sqrt(np.diagonal(learner.predict(x)[1]))
        np.testing.assert_allclose(rival.std(x), expected, rtol=tolerance)
        learner.update(x, y)
        rival.update(x, y)
        np.testing.assert_allclose(rival.weights, learner.weights, atol=tolerance)
        np.testing.assert_allclose(rival.covariance, learner.covariance, atol=tolerance)
        np.testing.assert_allclose(
            rival.predict(x[None])[0], NETWORK(x, learner.weights), atol=10 * tolerance
        )  # an output moves by its scale with a weight


def test_filterpy_cubature_filter_is_ours(rng):
    pytest.importorskip("filterpy", reason="filterpy comes with the extra `bench`")
    agree(FilterpyCubature(NETWORK, **ASSUMED), pt.CubatureLearner(NETWORK, **ASSUMED), rng, 1e-8)


def test_stone_soup_cubature_updater_is_ours(rng):
    pytest.importorskip("stonesoup", reason="Stone Soup comes with the extra `bench`")
    agree(StoneSoupCubature(NETWORK, **ASSUMED), pt.CubatureLearner(NETWORK, **ASSUMED), rng, 1e-8)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of its own imports
def test_dynamax_extended_filter_is_ours(rng):
    pytest.importorskip("dynamax", reason="dynamax (JAX, half a gigabyte) is installed by hand")
    from patagium_lab.rivals.dynamax_extended import DynamaxExtended

    # it adds 1e-9 to the diagonal of the innovation's covariance before it solves
    agree(DynamaxExtended(NETWORK, **ASSUMED), pt.ExtendedLearner(NETWORK, **ASSUMED), rng, 1e-6)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of its own imports
def test_rebayes_low_rank_filter_is_ours_while_its_rank_suffices(rng):
    pytest.importorskip("rebayes_mini", reason="rebayes-mini is installed by hand")
    from patagium_lab.rivals.rebayes_low_rank import RebayesLowRank

    assumed = {**ASSUMED, "forgetting_factor": 1.0}
    rival = RebayesLowRank(NETWORK, rank=4, **assumed)
    learner = pt.ExtendedLearner(NETWORK, **assumed)
    for x, y in samples(rng, 2):  # two samples of two outputs fill four columns
        expected = np.sqrt(np.diagonal(learner.predict(x)[1]))
        np.testing.assert_allclose(rival.std(x), expected, rtol=1e-8)
        learner.update(x, y)
        rival.update(x, y)
        np.testing.assert_allclose(rival.weights, learner.weights, atol=1e-8)


PYTAGI = """
import numpy as np, patagium as pt
from patagium_lab.rivals.pytagi_network import PytagiNetwork
rng = np.random.default_rng(0)
network = pt.DenseNetwork(3, (8,), 2, output_scale=[2, 3])
rival = PytagiNetwork(network, gain=1.0, measurement_std=[0.1, 0.2])
x = rng.normal(size=(400, 3))
y = x @ rng.normal(size=(3, 2))
before = np.mean((rival.predict(x) - y) ** 2)
for one, measured in zip(x, y):
    rival.update(one, measured)
assert np.mean((rival.predict(x) - y) ** 2) < before / 5
assert rival.std(x[0]).shape == (2,) and (rival.std(x[0]) > [0.099, 0.199]).all()
"""


def test_pytagi_learns():
    pytest.importorskip("pytagi", reason="pytagi has no wheel for every platform")
    # in a process of its own: its batches may corrupt memory
    done = subprocess.run([sys.executable, "-c", PYTAGI], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_only_dense_networks_are_given_to_other_programs():
    robot = pt.load_robot("aerobat")
    with pytest.raises(ParameterError, match="a dense network"):
        FilterpyCubature(pt.StripNetwork(robot), **ASSUMED)  # type: ignore[arg-type]
