"""Networks: sizes, scales, what a strip network knows, and what it refuses."""

from __future__ import annotations

import copy
import json
import pickle

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError, ShapeError
from patagium.learning import network_from_description


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat")


def states(robot, count, seed=1):
    draw = np.random.default_rng(seed)
    x = 0.4 * draw.normal(size=(count, 2 * robot.dof))
    x[:, robot.dof] += 4.0
    return x


def networks(robot):
    dense = pt.DenseNetwork(
        3, (5, 4), ["lift", "drag"], "tanh", input_center=[1, 2, 3], output_scale=2.0
    )
    yield dense
    air = pt.Air(density=1.1, wind=(-1.0, 0.5, 0.3))
    yield pt.StripNetwork(robot, (5,), air, "tanh", measured=("x", "z"), chord_fraction=0.5)
    yield pt.StripNetwork(robot, (3,), measured=np.ones((1, 3 * len(robot.strips))), rotation=True)


@pytest.mark.parametrize(
    ("shape", "size"),
    [((28, (20,), 14), 874), ((8, (20,), 14), 474), ((2, (8, 8), 2), 114), ((3, (), 2), 8)],
)
def test_sizes_are_those_of_the_paper_and_of_the_science(shape, size):
    network = pt.DenseNetwork(*shape)
    assert network.size == len(network.initial(0)) == len(network.fan_in) == size


def test_a_strip_network_shares_its_weights_among_strips(robot):
    network = pt.StripNetwork(robot)
    assert (network.size, network.items) == (114, len(robot.strips))
    assert (network.inputs, network.outputs) == (2 * robot.dof, robot.dof)
    assert network.output_names == robot.dof_names


def test_one_many_and_described_are_the_same(robot):
    for network in networks(robot):
        x = states(robot, 5)[:, : network.inputs]
        weights = network.initial(3)
        many = network.evaluate(x, weights)
        for k, row in enumerate(x):
            np.testing.assert_allclose(network(row, weights), many[k], rtol=1e-12, atol=1e-14)
            one, batch = network.encode_one(row), network.encode(x)
            np.testing.assert_allclose(one.features, batch.features[k], rtol=1e-12, atol=1e-14)
            np.testing.assert_allclose(one.readout, batch.readout[k], rtol=1e-12, atol=1e-14)
        text = json.dumps(network.describe())
        twins = [network_from_description(json.loads(text)), copy.deepcopy(network)]
        for twin in (*twins, pickle.loads(pickle.dumps(network))):
            assert type(twin) is type(network)
            np.testing.assert_array_equal(twin.evaluate(x, weights), many)
            assert twin.output_names == network.output_names


def test_scales_belong_to_the_network(rng):
    plain = pt.DenseNetwork(2, (4,), 2)
    scaled = pt.DenseNetwork(
        2,
        (4,),
        2,
        input_center=[1, 2],
        input_scale=[3, 4],
        output_center=[5, 6],
        output_scale=[7, 8],
    )
    x, w = rng.normal(size=(10, 2)), plain.initial(0)
    expected = [5, 6] + np.array([7, 8]) * plain.evaluate((x - [1, 2]) / [3, 4], w)
    np.testing.assert_allclose(scaled.evaluate(x, w), expected, rtol=1e-13)


@pytest.mark.parametrize("wind", [(0.0, 0.0, 0.0), (-1.0, 0.5, 0.3)])
def test_with_the_right_coefficients_it_is_the_blade_element_model(robot, wind):
    air = pt.Air(density=1.1, wind=wind)
    aero, n = pt.QuasiSteady(robot, air), robot.dof
    forces = np.eye(3 * len(robot.strips))
    in_world = pt.StripNetwork(robot, air=air, measured=forces)
    in_coordinates = pt.StripNetwork(robot, air=air)
    for x in states(robot, 10):
        truth = aero.strips(x[:n], x[n:])["strip_force"].ravel()
        readout = in_world.encode_one(x).readout
        coefficients, *_ = np.linalg.lstsq(readout, truth, rcond=None)
        np.testing.assert_allclose(readout @ coefficients, truth, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(
            in_coordinates.encode_one(x).readout @ coefficients,
            aero.generalized_force(x[:n], x[n:]),
            rtol=1e-9,
            atol=1e-12,
        )


def test_chosen_components_are_rows_of_the_whole(robot):
    x, whole = states(robot, 6), pt.StripNetwork(robot)
    chosen = pt.StripNetwork(robot, measured=("z", "left_plunge"))
    weights = whole.initial(1)
    rows = [robot.index("z"), robot.index("left_plunge")]
    assert chosen.output_names == ("z", "left_plunge")
    np.testing.assert_allclose(
        chosen.evaluate(x, weights), whole.evaluate(x, weights)[:, rows], rtol=1e-12, atol=1e-14
    )


def test_a_symmetric_motion_gives_mirrored_features(robot):
    q = robot.coordinates(pitch=0.1, left_plunge=0.3, right_plunge=0.3, left_feather=0.2)
    q[robot.index("right_feather")] = 0.2
    v = robot.coordinates(x=4.0, left_plunge=20.0, right_plunge=20.0)
    features = pt.StripNetwork(robot).encode_one(np.concatenate([q, v])).features
    mirrored = [strip.mirrored for strip in robot.strips]
    left, right = features[np.logical_not(mirrored)], features[mirrored]
    np.testing.assert_allclose(left, right, rtol=1e-12)


def test_features_depend_on_direction_forces_on_speed_squared(robot):
    network = pt.StripNetwork(robot)
    x = np.concatenate([robot.coordinates(pitch=0.2), robot.coordinates(x=4.0, z=1.0)])
    faster = np.concatenate([x[: robot.dof], 3 * x[robot.dof :]])
    one, other = network.encode_one(x), network.encode_one(faster)
    np.testing.assert_allclose(one.features, other.features, rtol=1e-12)
    np.testing.assert_allclose(9 * one.readout, other.readout, rtol=1e-12, atol=1e-14)


def test_every_option_of_a_strip_network_moves_its_output(robot):
    x, weights = states(robot, 4), pt.StripNetwork(robot).initial(0)
    base = pt.StripNetwork(robot).evaluate(x, weights)
    changed = [
        pt.StripNetwork(robot, air=pt.Air(density=1.0)),
        pt.StripNetwork(robot, air=pt.Air(wind=(1.0, 0.0, 0.0))),
        pt.StripNetwork(robot, activation="tanh"),
        pt.StripNetwork(robot, chord_fraction=0.5),
        pt.StripNetwork(robot, coefficient_scale=2.0),
        pt.StripNetwork(robot.with_parameters({"left_wing[0].chord": 0.08})),
    ]
    for network in changed:
        assert np.abs(network.evaluate(x, weights) - base).max() > 1e-4


def test_what_a_network_refuses(robot):
    with pytest.raises(ParameterError, match="activation"):
        pt.DenseNetwork(2, (3,), 1, "relu")
    with pytest.raises(ParameterError, match="widths"):
        pt.DenseNetwork(2, (0,), 1)
    with pytest.raises(ParameterError, match="outputs"):
        pt.DenseNetwork(2, (3,), ["a", "a"])
    with pytest.raises(ParameterError, match="input_scale"):
        pt.DenseNetwork(2, (3,), 1, input_scale=[1.0, 0.0])
    with pytest.raises(ShapeError, match="output_center"):
        pt.DenseNetwork(2, (3,), 1, output_center=[1.0, 0.0])
    with pytest.raises(ParameterError, match="coordinate"):
        pt.StripNetwork(robot, measured=("lift",))
    with pytest.raises(ShapeError, match="measured"):
        pt.StripNetwork(robot, measured=np.ones((2, 5)))
    for kind in (pt.StripNetwork, pt.learning.LinearStripNetwork):
        for names in (["z", "z"], []):
            with pytest.raises(ParameterError, match="measured: expected different names"):
                kind(robot, measured=names)
    with pytest.raises(ParameterError, match="chord_fraction"):
        pt.StripNetwork(robot, chord_fraction=1.5)
    with pytest.raises(ParameterError, match="coefficient_scale"):
        pt.StripNetwork(robot, coefficient_scale=0.0)
    network = pt.DenseNetwork(2, (3,), 1)
    with pytest.raises(ShapeError, match="x"):
        network(np.ones(3), network.initial(0))
    with pytest.raises(ShapeError, match="weights"):
        network(np.ones(2), np.ones(3))
    with pytest.raises(ParameterError, match="kind"):
        network_from_description({"kind": "magic"})
    with pytest.raises(ParameterError, match="keys"):
        network_from_description({**network.describe(), "hiden": 3})
