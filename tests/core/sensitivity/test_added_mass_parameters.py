"""Every parameter of added mass moves the force, in proportion; so do chord and width."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt


@pytest.fixture(scope="module")
def state():
    robot = pt.load_robot("aerobat")
    return robot, *np.random.default_rng(3).normal(size=(3, robot.dof))


def forces(model, q, v, a):
    return np.concatenate([model.generalized_force(q, v, a), model.circulatory_force(q, v)])


def test_factor_and_density_scale_it(state):
    robot, *motion = state
    one = forces(pt.AddedMass(robot), *motion)
    assert np.abs(one).max() > 1e-4
    np.testing.assert_allclose(forces(pt.AddedMass(robot, factor=0.85), *motion), 0.85 * one)
    denser = pt.AddedMass(robot, pt.Air(density=2 * 1.225))
    np.testing.assert_allclose(forces(denser, *motion), 2 * one)


@pytest.mark.parametrize(("name", "power"), [("width", 1), ("chord", 2)])
def test_a_strip_carries_its_width_times_its_chord_squared(state, name, power):
    robot = state[0]
    key = f"left_wing[0].{name}"
    before = robot.parameters[robot.parameter_names.index(key)]
    grown = robot.with_parameters({key: 1.1 * before})
    a = robot.coordinates(z=1.0)
    rest = np.zeros(robot.dof)
    lift = [-pt.AddedMass(r).generalized_force(rest, rest, a)[2] for r in (robot, grown)]
    strip = robot.strips[0]
    one = np.pi * 1.225 * strip.chord**2 / 4 * strip.width
    assert lift[1] - lift[0] == pytest.approx(one * (1.1**power - 1), rel=1e-9)


def test_the_factor_moves_the_flight(state):
    robot = state[0]
    ends = [
        pt.simulate(
            robot,
            pt.QuasiSteady(robot),
            pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5),
            duration=0.01,
            time_step=2e-4,
            v=robot.coordinates(x=4.0),
            added_mass=pt.AddedMass(robot, factor=factor),
        ).added_mass_work.values[-1]
        for factor in (0.5, 1.0)
    ]
    assert abs(ends[1]) > 1.5 * abs(ends[0]) > 0
