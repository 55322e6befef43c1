"""The compiled equations: shapes, agreement of their forms, points."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError, ShapeError

PRESETS = ["aerobat", "aerobat-published", "aerobat-beta", "yeo-wing"]
# products of some forty roundings, relative to the largest entry
ROUNDING = 1e-12


def close(ours, theirs):
    scale = max(float(np.abs(theirs).max(initial=0.0)), 1e-30)
    assert float(np.abs(np.asarray(ours) - theirs).max(initial=0.0)) <= ROUNDING * scale


@pytest.fixture(params=PRESETS)
def dyn(request):
    return pt.Dynamics(pt.load_robot(request.param))


@pytest.fixture
def states(dyn, rng):
    return rng.normal(size=(4, 11, dyn.robot.dof))


def test_forms_of_the_equations_agree(dyn, states):
    for q, v, a, f in zip(*states, strict=True):
        mass, bias = dyn.mass_matrix_and_bias(q, v)
        close(mass, dyn.mass_matrix(q))
        close(bias, dyn.bias(q, v))
        close(bias, dyn.coriolis(q, v) + dyn.gravity(q))
        close(dyn.inverse(q, v, a), mass @ a + bias)
        close(mass @ dyn.forward(q, v, f) + bias, f)


def test_prescribed_joints_follow_and_their_forces_close_the_balance(dyn, states, rng):
    robot = dyn.robot
    held, free = list(robot.actuated), list(robot.passive)
    for q, v, _, f in zip(*states, strict=True):
        wanted = rng.normal(size=len(held))
        a, u1 = dyn.forward_prescribed(q, v, wanted, f)
        close(a[held], wanted)
        whole = f.copy()
        whole[held] += u1
        close(dyn.inverse(q, v, a), whole)
        assert a.shape == (robot.dof,)
        assert len(free) + len(held) == robot.dof


def test_batches_equal_single_calls(dyn, states):
    q, v, a, f = states
    wanted = a[:, list(dyn.robot.actuated)]
    calls = {
        "mass_matrix": (q,),
        "coriolis": (q, v),
        "gravity": (q,),
        "bias": (q, v),
        "mass_matrix_and_bias": (q, v),
        "inverse": (q, v, a),
        "forward": (q, v, f),
        "forward_prescribed": (q, v, wanted, f),
        "kinetic_energy": (q, v),
        "potential_energy": (q,),
        "momentum": (q, v),
        "angular_momentum": (q, v),
        "center_of_mass": (q,),
        "coordinate_rates": (q, v),
    }
    assert set(calls) == set(dyn.functions)
    for name, arguments in calls.items():
        whole = getattr(dyn.batch, name)(*arguments)
        for k in range(len(q)):
            one = getattr(dyn, name)(*[argument[k] for argument in arguments])
            pairs = zip(whole, one, strict=True) if isinstance(whole, tuple) else [(whole, one)]
            for many, single in pairs:
                close(many[k], np.asarray(single))


def test_points_move_as_their_jacobian_says(dyn, states):
    q, v = states[0][0], states[1][0]
    name = dyn.robot.bodies[-1].name
    point = dyn.point(name, (0.01, -0.02, 0.03))
    close(point.jacobian(q) @ v, point.velocity(q, v))
    step = 1e-6
    slope = (point.position(q + step * v) - point.position(q - step * v)) / (2 * step)
    # central difference: error of order step^2 times the third derivative
    np.testing.assert_allclose(slope, point.velocity(q, v), atol=1e-8)


def test_a_point_keeps_its_place_when_the_array_that_named_it_changes(dyn, states):
    offset = np.array([0.01, -0.02, 0.03])
    point = dyn.point(dyn.robot.bodies[-1].name, offset)
    before = point.position(states[0][0])
    offset[:] = 0.0
    assert np.array_equal(point.position(states[0][0]), before)


def test_a_robot_that_differs_in_values_shares_the_compiled_code(rng):
    robot = pt.load_robot("aerobat")
    heavy = robot.with_parameters({"left_plate.mass": 2 * robot.bodies[2].mass})
    q = rng.normal(size=robot.dof)
    assert heavy.structure == robot.structure
    one, other = pt.Dynamics(robot), pt.Dynamics(heavy)
    assert one.functions["mass_matrix"].address == other.functions["mass_matrix"].address
    assert other.mass_matrix(q)[0, 0] == pytest.approx(one.mass_matrix(q)[0, 0] + 0.004)
    with pytest.raises(ParameterError, match="a parameter of robot"):
        robot.with_parameters({"left_plate.maas": 1.0})


def test_wrong_shapes_are_named():
    dyn = pt.Dynamics(pt.load_robot("aerobat"))
    with pytest.raises(ShapeError, match=r"q: expected shape \(14,\), found \(13,\)"):
        dyn.mass_matrix(np.zeros(13))
    with pytest.raises(ShapeError, match=r"\(`batch` takes many\), found \(5, 14\)"):
        dyn.mass_matrix(np.zeros((5, 14)))
    with pytest.raises(ParameterError, match="one of body"):
        dyn.point("tail")
    with pytest.raises(ShapeError, match="offset"):
        dyn.point("body", (0.0, 1.0))


def test_without_a_compiler_the_numbers_are_the_same(monkeypatch, rng):
    robot = pt.load_robot("aerobat")
    compiled = pt.Dynamics(robot)
    monkeypatch.setenv("PATAGIUM_COMPILER", "none")
    interpreted = pt.Dynamics(robot)
    q, v, a = rng.normal(size=(3, 5, robot.dof))
    for k in range(5):
        close(interpreted.mass_matrix(q[k]), compiled.mass_matrix(q[k]))
        close(interpreted.inverse(q[k], v[k], a[k]), compiled.inverse(q[k], v[k], a[k]))
    close(interpreted.batch.forward(q, v, a), compiled.batch.forward(q, v, a))


PENDULUM = """
name: pendulum
gravity: 9.81
bodies:
  rod:
    joints: [{name: swing, type: revolute, axis: y}]
    mass: 2
    center_of_mass: [0, 0, -0.5]
    inertia: {xx: 0.01, yy: 0.02, zz: 0.03}
"""


@pytest.mark.parametrize("choice", ["", "none"])
def test_a_robot_of_one_coordinate_keeps_its_axes(choice, monkeypatch):
    from patagium.robot import load_robot_text

    monkeypatch.setenv("PATAGIUM_COMPILER", choice)
    dyn = pt.Dynamics(load_robot_text(PENDULUM, "pendulum"))
    q, v = np.array([0.3]), np.array([1.2])
    inertia = 2 * 0.5**2 + 0.02
    np.testing.assert_allclose(dyn.mass_matrix(q), [[inertia]], rtol=1e-14)
    np.testing.assert_allclose(dyn.gravity(q), [2 * 9.81 * 0.5 * np.sin(0.3)], rtol=1e-13)
    np.testing.assert_allclose(dyn.coriolis(q, v), [0.0], atol=1e-15)
    assert dyn.kinetic_energy(q, v) == pytest.approx(inertia * 1.2**2 / 2)
    a, u1 = dyn.forward_prescribed(q, v, [0.7], [0.0])
    np.testing.assert_allclose(u1, dyn.inverse(q, v, a), rtol=1e-13)
    assert dyn.batch.mass_matrix(np.zeros((5, 1))).shape == (5, 1, 1)
    assert dyn.batch.inverse(*np.zeros((3, 5, 1))).shape == (5, 1)
    assert dyn.momentum(q, v).shape == (3,)
    jacobian = dyn.point("rod", (0.0, 0.0, -0.5)).jacobian(q)  # was (3,)
    np.testing.assert_allclose(jacobian[:, 0], [-0.5 * np.cos(0.3), 0, 0.5 * np.sin(0.3)])


@pytest.mark.parametrize("again", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_dynamics_and_points_go_to_other_processes(dyn, states, again):
    q, v = states[0][0], states[1][0]
    point = dyn.point(dyn.robot.bodies[-1].name, (0.01, 0.02, 0.03))
    np.testing.assert_array_equal(again(dyn).bias(q, v), dyn.bias(q, v))
    np.testing.assert_array_equal(again(point).velocity(q, v), point.velocity(q, v))
