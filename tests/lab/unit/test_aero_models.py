"""Models of the air as objects: methods, descriptions, refusals."""

from __future__ import annotations

import json

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics import (
    Aerodynamics,
    Air,
    DickinsonPolar,
    OneMinusCosineGust,
    QuasiSteady,
    SmoothPolar,
)
from patagium.aerodynamics.description import aero_from_description
from patagium.aerodynamics.local_flow import strip_motions
from patagium.errors import ParameterError, ShapeError
from patagium.robot import Body, Joint, Robot, Strip, load_robot
from patagium_lab.published.aerodynamics import PUBLISHED_ERRORS, Published

GUST = OneMinusCosineGust((0.0, 1.0, 0.0), 0.0, 0.2)


@pytest.fixture(scope="module")
def aerobat() -> Robot:
    return load_robot("aerobat")


@pytest.fixture(scope="module")
def aero(aerobat: Robot) -> QuasiSteady:
    return QuasiSteady(aerobat, Air(wind=(-3.0, 0.0, 0.0)))


def state(robot: Robot, rng: np.random.Generator, *leading: int) -> tuple[np.ndarray, np.ndarray]:
    shape = (*leading, robot.dof)
    return rng.normal(scale=0.3, size=shape), rng.normal(scale=3.0, size=shape)


def test_methods_give_one_entry_a_coordinate_and_a_strip(
    aero: QuasiSteady, rng: np.random.Generator
) -> None:
    q, v = state(aero.robot, rng)
    strips = aero.strips(q, v)
    assert aero.generalized_force(q, v).shape == (14,)
    assert aero.state_derivative(q, v).shape == (aero.state_size,) == (0,)
    assert {name: np.shape(value) for name, value in strips.items()} == {
        "strip_force": (10, 3),
        "strip_point": (10, 3),
        "angle_of_attack": (10,),
        "effective_angle_of_attack": (10,),
        "strip_airspeed": (10,),
        "power": (),
        "circulation": (10,),
        "downwash": (10,),
    }


def test_batch_is_the_same_state_by_state(aero: QuasiSteady, rng: np.random.Generator) -> None:
    q, v = state(aero.robot, rng, 11)
    wind = rng.normal(size=(11, 3))
    force = aero.batch.generalized_force(q, v, wind=wind)
    strips = aero.batch.strips(q, v, wind=wind)
    assert aero.batch.state_derivative(q, v).shape == (11, 0)
    for k in range(11):
        # one and eight states a pass differ by the rounding of fused products
        assert np.allclose(force[k], aero.generalized_force(q[k], v[k], wind=wind[k]), atol=1e-13)
        for name, value in aero.strips(q[k], v[k], wind=wind[k]).items():
            assert np.allclose(strips[name][k], value, atol=1e-12), name


def test_wind_is_that_of_the_air_at_the_start(aero: QuasiSteady, rng: np.random.Generator) -> None:
    q, v = state(aero.robot, rng)
    given = aero.generalized_force(q, v, wind=(-3.0, 0.0, 0.0))
    assert np.array_equal(aero.generalized_force(q, v), given)
    assert not np.allclose(given, aero.generalized_force(q, v, wind=(0.0, 0.0, 0.0)))


def test_a_robot_of_two_joints_on_a_fixed_mount_has_loads() -> None:
    robot = load_robot("yeo-wing")
    aero = QuasiSteady(robot, Air(wind=(-2.9, 0.0, 0.0)))
    lift = aero.strips(np.zeros(2), np.array([-5.0, -5.0]))["strip_force"][:, 2]
    assert (lift > 0).all()  # a wing that moves down is pushed up


def test_a_robot_of_one_coordinate_and_one_strip_keeps_its_axes() -> None:
    joint = Joint("flap", "revolute", (1.0, 0.0, 0.0), 0)
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    inertia = (1e-5, 1e-5, 1e-5, 0.0, 0.0, 0.0)
    center = (0.0, 0.05, 0.0)
    wing = Body("wing", -1, (0.0, 0.0, 0.0), axes, (joint,), None, 0.01, center, inertia)
    strip = Strip("w[0]", "w", 0, False, center, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.05, 0.1)
    robot = Robot(
        "flap", (wing,), (strip,), ("flap",), ("rad",), (0,), (0.0,), (-np.inf,), (np.inf,), 9.81
    )
    aero = QuasiSteady(robot, Air(wind=(-3.0, 0.0, 0.0)))
    force = aero.generalized_force([0.0], [-20.0])
    assert force.shape == (1,)
    strips = aero.strips([0.0], [-20.0])
    assert strips["strip_force"].shape == (1, 3)
    assert strips["angle_of_attack"].shape == (1,)
    assert force[0] == pytest.approx(0.05 * strips["strip_force"][0, 2], rel=1e-12)  # arm
    many = aero.batch.generalized_force(np.zeros((3, 1)), np.full((3, 1), -20.0))
    assert np.allclose(many, np.tile(force, (3, 1)), rtol=1e-12)
    assert aero.batch.strips(np.zeros((3, 1)), np.zeros((3, 1)))["strip_point"].shape == (3, 1, 3)


def test_local_flow_is_the_velocity_of_the_strips_through_the_air(aerobat: Robot) -> None:
    def flow(q, v, wind=(0.0, 0.0, 0.0), chord_fraction=0.25):
        arguments = (ca.SX(ca.DM(k)) for k in (q, v, wind))
        ahead = 0.25 - chord_fraction
        return np.array(
            [
                [float(x) for x in (m.forward, m.spanwise, m.normal_ahead(ahead * m.strip.chord))]
                for m in strip_motions(aerobat, *arguments)
            ]
        )

    v = aerobat.coordinates(x=2.0, z=-1.0, left_feather=4.0)
    still = flow(np.zeros(14), v)
    # R = Ry(-feather): a positive rate raises the leading edge about the elbow,
    # which the quarter chord is 25 mm ahead of
    assert np.allclose(still[:5], [2.0, 0.0, -1.0 + 4.0 * 0.025], atol=1e-14)
    assert np.allclose(still[5:], [2.0, 0.0, -1.0], atol=1e-14)
    behind = flow(np.zeros(14), v, (0.5, 0.0, 0.0), 0.75)
    assert np.allclose(behind[:5], [1.5, 0.0, -1.0 - 4.0 * 0.025], atol=1e-14)
    assert np.allclose(flow(np.zeros(14), 2 * v), 2 * still, atol=1e-14)


@pytest.mark.parametrize(
    "make",
    [
        lambda r: QuasiSteady(r, Air(1.0, (1.0, 0.0, 0.0), GUST), polar=SmoothPolar(1.5, 0.2, 2.0)),
        lambda r: QuasiSteady(r, polar=DickinsonPolar(lift_rate=2.0), rotational=True),
        lambda r: Published(r, Air(1.1), errors=("sign", "factor")),
        lambda r: Published(r, errors=()),
    ],
)
def test_model_survives_its_description(make: object, aerobat: Robot) -> None:
    model: Aerodynamics = make(aerobat)  # type: ignore[operator]
    again = aero_from_description(aerobat, json.loads(json.dumps(model.describe())))
    assert again == model


@pytest.mark.parametrize(
    "description",
    [
        {},
        {"model": "vortex_lattice"},
        {"model": "quasi_steady", "air": Air().describe()},
        {"model": "published", "air": Air().describe(), "errors": ["gravity"]},
    ],
)
def test_descriptions_of_nothing_are_refused(aerobat: Robot, description: dict) -> None:
    with pytest.raises(ParameterError, match="expected"):
        aero_from_description(aerobat, description)


@pytest.mark.parametrize(
    "arguments",
    [
        (np.zeros(13), np.zeros(14)),
        (np.zeros(14), np.zeros((2, 14))),
        (np.zeros(14), np.zeros(14), np.zeros(1)),
        (np.zeros(14), np.zeros(14), None, np.zeros(2)),
    ],
)
def test_wrong_shapes_are_refused_by_name(aero: QuasiSteady, arguments: tuple) -> None:
    with pytest.raises(ShapeError, match="expected shape"):
        aero.generalized_force(*arguments)


def test_compiled_code_is_shared_by_models_that_differ_in_numbers_only(aerobat: Robot) -> None:
    first, second = QuasiSteady(aerobat, Air(1.0)), QuasiSteady(aerobat, Air(2.0))
    assert first.structure == second.structure
    others = {Published(aerobat, errors=[name]).structure for name in PUBLISHED_ERRORS}
    assert len(others) == 1
    others |= {QuasiSteady(aerobat, rotational=True).structure}
    others |= {QuasiSteady(aerobat, polar=SmoothPolar()).structure, first.structure}
    assert len(others) == 4
