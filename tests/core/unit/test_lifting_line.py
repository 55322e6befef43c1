"""The unsteady lifting line as an object: chains, kernel, matrices, descriptions, refusals."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable
from typing import cast

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics import Air, LiftingLine, Section, SmoothPolar
from patagium.aerodynamics.description import aero_from_description
from patagium.aerodynamics.indicial import NO_STATE, ONE_STATE, TWO_STATE
from patagium.aerodynamics.model import aero_functions, compile_aero
from patagium.aerodynamics.polars import section_flow
from patagium.aerodynamics.trailing_vortices import horseshoe_function
from patagium.errors import ParameterError, ShapeError
from patagium.native import load_functions
from patagium.robot import Robot, load_robot
from patagium.robot.strip_chains import strip_chains


@pytest.fixture(scope="module")
def aerobat() -> Robot:
    return load_robot("aerobat")


@pytest.fixture(scope="module")
def aero(aerobat: Robot) -> LiftingLine:
    return LiftingLine(aerobat, Air(wind=(-3.0, 0.0, 0.0)), lags=ONE_STATE)


def test_wings_that_meet_share_legs_and_wings_apart_do_not(aerobat: Robot) -> None:
    assert [chain.strips for chain in strip_chains(aerobat)] == [(0, 1, 2, 3, 4), (5, 6, 7, 8, 9)]
    (whole,) = strip_chains(load_robot("yeo-wing"))
    assert whole.strips == (*range(11, -1, -1), *range(12, 24))
    assert set(whole.right) == {1}  # from the left tip to the right one
    (beta,) = strip_chains(load_robot("aerobat-beta"))  # 5 cm of body carry the lift across
    assert len(beta.strips) == 14
    assert whole.reverse.reverse == whole


@pytest.mark.parametrize(("sizes", "images"), [((3, 9, 1), False), ((3, 1, 3, 1), True)])
def test_the_kernel_is_the_symbolic_function(
    sizes: tuple[int, ...], images: bool, rng: np.random.Generator
) -> None:
    function = horseshoe_function(sizes, images)
    inputs = [ca.SX.sym(n, *function.size_in(k)) for k, n in enumerate(function.name_in())]
    outer = ca.Function("outer", inputs, function(*inputs), function.name_in(), ["c", "u"])
    compiled = load_functions(f"test {sizes}", lambda: [outer], label="horseshoes")["outer"]
    count, legs = sum(sizes), sum(sizes) + len(sizes)
    for _ in range(5):
        shapes = [(3, count), (3, count), (3, legs), (3, legs), (legs,), (count,), (count,), ()]
        values = [rng.normal(size=shape) for shape in shapes]
        values[4] = np.abs(values[4]) * 10.0 ** rng.integers(-4, 1)
        values[5] *= 0.1
        expected = [np.array(x) for x in function(*values)]
        circulation, velocity = compiled(*values)
        assert np.allclose(circulation, expected[0].ravel(), rtol=1e-10, atol=1e-10)
        assert np.allclose(velocity, expected[1], rtol=1e-10, atol=1e-9)


def test_compiled_code_is_the_virtual_machine_and_batch_is_one_by_one(
    aero: LiftingLine, rng: np.random.Generator
) -> None:
    n = aero.robot.dof
    q, v = rng.normal(scale=0.4, size=(11, n)), rng.normal(scale=3.0, size=(11, n))
    z, wind = rng.normal(size=(11, aero.state_size)), rng.normal(size=(11, 3))
    constants = aero.robot.parameters, aero.parameters
    compiled = compile_aero(aero)
    for function in aero_functions(aero):
        many = compiled[function.name()].batch(q, v, z, wind, *constants)
        many = many if isinstance(many, tuple) else (many,)
        for k in range(11):
            one = function.call([q[k], v[k], z[k], wind[k], *constants])
            for got, want in zip(many, one, strict=True):
                want = np.array(want)
                want = want.ravel() if want.shape[1] == 1 else want
                assert np.allclose(got[k], want.reshape(got[k].shape), rtol=1e-11, atol=1e-11)


def pickled(one: LiftingLine) -> LiftingLine:
    return cast(LiftingLine, pickle.loads(pickle.dumps(one)))


@pytest.mark.parametrize("again", [copy.deepcopy, pickled])
def test_a_model_that_was_used_goes_to_another_process(
    aero: LiftingLine, again: Callable[[LiftingLine], LiftingLine]
) -> None:
    # The functions that were compiled on the way could not be pickled.
    q = np.full((2, 14), 0.1)
    force, forces = aero.generalized_force(q[0], q[0]), aero.batch.generalized_force(q, q)
    twin = again(aero)
    assert np.array_equal(twin.generalized_force(q[0], q[0]), force)
    assert np.array_equal(twin.batch.generalized_force(q, q), forces)
    many = pickle.loads(pickle.dumps(aero.batch.generalized_force))  # a pool maps such a method
    assert np.array_equal(many(q, q), forces)


def test_methods_give_circulation_and_downwash_of_every_strip(aero: LiftingLine) -> None:
    q, v = np.zeros(14), np.zeros(14)
    v[2] = -0.5  # sinking at 3 m/s: lifting
    strips = aero.strips(q, v)
    assert aero.state_size == 10
    assert aero.state_derivative(q, v).shape == (10,)
    assert (strips["circulation"] > 0).all()
    assert (strips["downwash"] > 0).all()
    assert (strips["strip_force"][:, 2] > 0).all()
    settled = strips["circulation"]
    z = np.full(10, 0.4)  # the wake grown: more lift at the same wash
    assert (aero.strips(q, v, z)["circulation"] > settled).all()


@pytest.mark.usefixtures("interpreted")
def test_memory_settles_on_the_line_without_memory(aerobat: Robot, aero: LiftingLine) -> None:
    q, v = np.zeros(14), np.zeros(14)
    v[2] = -0.3
    system = aero.state_space(q, v)
    normalwash = np.full(10, 0.3)
    z = -np.linalg.solve(system.a, system.b @ normalwash)
    assert np.allclose(aero.state_derivative(q, v, z), 0, atol=1e-9)
    steady = LiftingLine(aerobat, Air(wind=(-3.0, 0.0, 0.0)), lags=NO_STATE)
    assert steady.state_size == 0
    settled, at_once = aero.strips(q, v, z), steady.strips(q, v)
    for name in ("strip_force", "circulation", "downwash", "angle_of_attack"):
        assert np.allclose(settled[name], at_once[name], rtol=1e-9, atol=1e-12), name


def test_state_space_is_the_linear_part_of_the_equations(
    aero: LiftingLine, rng: np.random.Generator
) -> None:
    q, v = rng.normal(scale=0.3, size=14), rng.normal(scale=0.3, size=14)
    system = aero.state_space(q, v)
    shapes = [np.shape(matrix) for matrix in (system.a, system.b, system.c, system.d)]
    assert shapes == [(10, 10)] * 4
    z, step = np.zeros(10), rng.normal(size=10)
    change = aero.state_derivative(q, v, z + step) - aero.state_derivative(q, v, z)
    assert np.allclose(system.a @ step, change, rtol=1e-9, atol=1e-8)
    assert np.linalg.eigvals(system.a).real.max() < 0  # memory fades
    with pytest.raises(ShapeError, match="wind"):
        aero.state_space(q, v, np.zeros(2))


def test_stall_begins_and_completes_at_its_angles(aerobat: Robot) -> None:
    section = Section(stall_begins=0.2, stall_complete=0.5, stalled=SmoothPolar())
    angles = np.array([0.0, 0.1, 0.199, 0.35, 0.501, 1.5])
    flows = [section_flow(ca.DM(9 * np.cos(a)), ca.DM(-9 * np.sin(a))) for a in angles]
    share = [float(section.separated_share(flow, section.parameters)) for flow in flows]
    assert share[:3] == [0.0, 0.0, 0.0]
    assert 0.1 < share[3] < 0.9
    assert share[4:] == [1.0, 1.0]


@pytest.mark.parametrize("lags", [ONE_STATE, TWO_STATE])
def test_a_description_makes_the_same_model(aerobat: Robot, lags) -> None:
    section = Section(profile_drag=0.03, stalled=SmoothPolar())
    aero = LiftingLine(aerobat, Air(density=1.1), lags, section, surface_constant=5.0)
    again = aero_from_description(aerobat, json.loads(json.dumps(aero.describe())))
    assert again == aero
    assert again.structure == aero.structure
    assert np.array_equal(again.parameters, aero.parameters)
    assert len(aero.parameter_names) == len(aero.parameters)


def test_what_cannot_be_is_refused(aerobat: Robot, aero: LiftingLine) -> None:
    with pytest.raises(ParameterError, match="surface_constant"):
        LiftingLine(aerobat, surface_constant=-1.0)
    with pytest.raises(ParameterError, match="stall"):
        Section(stall_begins=0.5, stall_complete=0.4)
    with pytest.raises(ParameterError, match="profile_drag"):
        Section(profile_drag=-0.1)
    with pytest.raises(ParameterError, match="lift_slope"):
        Section(lift_slope=np.inf)
    with pytest.raises(ParameterError, match="-3 degrees are -0.052"):
        Section(zero_lift_angle=-3.0)
    words = aero.describe()
    words["section"] = {"lift_slope": 6.0}
    with pytest.raises(ParameterError, match="section"):
        aero_from_description(aerobat, words)
