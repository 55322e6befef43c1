"""The dense network of the flow at the wings: what it sees, and where its forces point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat")


@pytest.fixture(scope="module")
def network(robot):
    return pt.learning.FlowNetwork(robot)


def state(robot, rng):
    """A flapping robot at any attitude well above the speed below which V is smoothed."""
    q, v = 0.5 * rng.normal(size=robot.dof), 3.0 * rng.normal(size=robot.dof)
    v[robot.index("x")] += 8.0
    return np.concatenate([q, v])


def rotation(roll, pitch, yaw):
    """From body to world axes, ZYX."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    return np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ about_y @ about_x


def test_it_is_of_the_size_of_the_papers(robot, network):
    assert network.perceptron.widths == (16, 28, 14)
    assert network.size == 882  # 28-20-14 has 874
    assert (network.inputs, network.items) == (2 * robot.dof, 1)
    assert network.output_names == robot.dof_names


def test_position_heading_and_attitude_are_not_seen(robot, network, rng):
    x = state(robot, rng)
    q, v = x[: robot.dof].copy(), x[robot.dof :].copy()
    turn = rotation(*q[3:6])
    rates = q[3:6] + np.array([0.4, -0.7, 2.0])
    other = rotation(*rates)
    # The same motion of the body in its own axes at another attitude.
    linear, angular = turn.T @ v[:3], euler_matrix(q[3:6]) @ v[3:6]
    q[:3], q[3:6] = [5.0, -3.0, 1.0], rates
    v[:3], v[3:6] = other @ linear, np.linalg.solve(euler_matrix(rates), angular)
    moved = network.encode_one(np.concatenate([q, v]))
    here = network.encode_one(x)
    np.testing.assert_allclose(moved.features, here.features, rtol=1e-11, atol=1e-12)
    weights = network.initial(0)
    there, before = network(np.concatenate([q, v]), weights), network(x, weights)
    np.testing.assert_allclose(other.T @ there[:3], turn.T @ before[:3], rtol=1e-10)
    np.testing.assert_allclose(there[6:], before[6:], rtol=1e-10)


def euler_matrix(angles):
    """From rates of roll, pitch and yaw to angular velocity in body axes."""
    roll, pitch, _ = angles
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    return np.array([[1, 0, -sp], [0, cr, sr * cp], [0, -sr, cr * cp]])


def test_its_force_works_on_the_motion_of_the_body(robot, network, rng):
    x = state(robot, rng)
    q, v = x[: robot.dof], x[robot.dof :]
    readout = network.encode_one(x).readout
    pressure = readout[6, 6] / network.lever[6]  # times the scale of the coefficients
    twist = np.concatenate([rotation(*q[3:6]).T @ v[:3], euler_matrix(q[3:6]) @ v[3:6], v[6:]])
    np.testing.assert_allclose(readout.T @ v, pressure * network.lever * twist, rtol=1e-10)


def test_flow_has_a_direction_forces_grow_with_the_square_of_the_speed(robot, network, rng):
    x = state(robot, rng)
    faster = np.concatenate([x[: robot.dof], 3 * x[robot.dof :]])
    one, other = network.encode_one(x), network.encode_one(faster)
    np.testing.assert_allclose(one.features, other.features, rtol=1e-3)  # smoothed below 0.1 m/s
    np.testing.assert_allclose(9 * one.readout, other.readout, rtol=2e-3, atol=1e-12)


def test_mirrored_wings_see_the_same(robot, network):
    q = robot.coordinates(pitch=0.1, left_plunge=0.3, right_plunge=0.3, left_feather=0.2)
    q[robot.index("right_feather")] = 0.2
    v = robot.coordinates(x=4.0, left_plunge=20.0, right_plunge=20.0)
    flow, joints = np.split(network.encode_one(np.concatenate([q, v])).features[0], [8])
    left, right = flow.reshape(2, -1)
    np.testing.assert_allclose(left, right, rtol=1e-12)
    np.testing.assert_allclose(joints[:4], joints[4:], rtol=1e-12)


def test_levers_are_those_of_unit_force_on_each_area(robot, network):
    dynamics, q = pt.Dynamics(robot), np.zeros(robot.dof)
    expected = np.zeros(robot.dof)
    for strip in robot.strips:
        point = dynamics.point(robot.bodies[strip.body].name, strip.quarter_chord)
        expected += strip.chord * strip.width * np.linalg.norm(point.jacobian(q), axis=0)
    np.testing.assert_allclose(network.lever, expected, rtol=1e-12)
    np.testing.assert_allclose(network.force_scale(4.0), 1.225 / 2 * 16.0 * expected, rtol=1e-12)


def test_every_option_moves_its_output(robot, network, rng):
    x, weights = state(robot, rng), network.initial(0)
    base = network(x, weights)
    changed = [
        pt.learning.FlowNetwork(robot, air=pt.Air(density=1.0)),
        pt.learning.FlowNetwork(robot, air=pt.Air(wind=(1.0, 0.0, 0.0))),
        pt.learning.FlowNetwork(robot, activation="tanh"),
        pt.learning.FlowNetwork(robot, coefficient_scale=2.0),
        pt.learning.FlowNetwork(robot.with_parameters({"left_wing[0].chord": 0.08})),
    ]
    for other in changed:
        assert np.abs(other(x, weights) - base).max() > 1e-4
    assert pt.learning.FlowNetwork(robot, (3, 4)).perceptron.widths == (16, 3, 4, 14)


def test_what_it_refuses(robot):
    with pytest.raises(ParameterError, match="coefficient_scale"):
        pt.learning.FlowNetwork(robot, coefficient_scale=0.0)
    with pytest.raises(ParameterError, match="wings"):
        pt.learning.FlowNetwork(replace(robot, strips=()))
