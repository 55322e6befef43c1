"""Section polars and the smooth signs they rest on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np
import pytest
from tests.robots import FLAPPER

from patagium.aerodynamics import Air, QuasiSteady
from patagium.aerodynamics.description import aero_from_description
from patagium.aerodynamics.polars import (
    _KINDS,
    DickinsonPolar,
    Polar,
    ReynoldsPolar,
    SmoothPolar,
    polar_from_description,
    register_polar,
    section_flow,
)
from patagium.aerodynamics.smooth_functions import SWITCH_SPEED, smooth_norm, smooth_sign
from patagium.errors import ParameterError
from patagium.robot import load_robot_text


def test_smooth_sign_is_the_sign_beyond_its_width_and_odd() -> None:
    x = np.linspace(-0.3, 0.3, 601)
    s = np.array([float(smooth_sign(ca.DM(k))) for k in x])
    beyond = np.abs(x) >= SWITCH_SPEED
    assert np.array_equal(s[beyond], np.sign(x[beyond]))
    assert np.allclose(s, -s[::-1], atol=1e-15)  # rounding
    assert (np.diff(s) >= -1e-15).all()


def test_smooth_norm_is_the_norm_beyond_its_width_and_never_zero() -> None:
    x = np.linspace(0.0, 0.3, 301)
    n = np.array([float(smooth_norm(ca.DM(k * k))) for k in x])
    beyond = x >= SWITCH_SPEED
    assert np.allclose(n[beyond], x[beyond], rtol=1e-15)  # rounding of a square root
    assert n[0] == pytest.approx(0.3125 * SWITCH_SPEED)
    assert (np.diff(n) >= 0).all()


@pytest.mark.parametrize("function", [smooth_sign, smooth_norm])
def test_three_derivatives_are_continuous_at_the_seam(function: object) -> None:
    x = ca.SX.sym("x")
    value = function(x)  # type: ignore[operator]
    seam = SWITCH_SPEED if function is smooth_sign else SWITCH_SPEED**2
    for order in range(4):
        evaluate = ca.Function("f", [x], [value])
        left, right = float(evaluate(seam * (1 - 1e-9))), float(evaluate(seam * (1 + 1e-9)))
        # the next derivative times the 2e-9 between the two points
        assert left == pytest.approx(right, rel=1e-6, abs=1e-6 * seam**-order)
        value = ca.gradient(value, x)


def test_published_coefficients() -> None:
    polar = DickinsonPolar()
    values = ca.DM(polar.parameters)
    assert float(polar.lift(0.0, values)) == pytest.approx(0.027, abs=5e-4)  # as printed
    assert float(polar.drag(0.0, values)) == pytest.approx(0.393, abs=5e-4)


@pytest.mark.parametrize("polar", [DickinsonPolar(), SmoothPolar()])
@pytest.mark.parametrize("degrees", [-80.0, -30.0, -5.0, 5.0, 30.0, 80.0])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_coefficients_follow_the_incidence(polar: object, degrees: float, direction: float) -> None:
    angle = np.radians(degrees)
    flow = section_flow(ca.DM(9 * np.cos(angle) * direction), ca.DM(-9 * np.sin(angle)))
    lift, drag = polar.coefficients(flow, ca.DM(polar.parameters))  # type: ignore[attr-defined]
    size = abs(angle)
    if isinstance(polar, DickinsonPolar):
        expected = (
            0.225 + 1.58 * np.sin(2.13 * size - np.radians(7.2)),
            1.92 - 1.55 * np.cos(2.04 * size - np.radians(9.82)),
        )
    else:
        expected = (1.81 * np.sin(2 * size), 0.24 + 3.10 * np.sin(size) ** 2)
    assert float(flow.angle_of_attack) == pytest.approx(angle, rel=1e-14)  # rounding
    assert float(lift) == pytest.approx(np.sign(angle) * direction * expected[0], rel=1e-13)
    assert float(drag) == pytest.approx(expected[1], rel=1e-13)


@pytest.mark.parametrize("speed", [0.2, 0.5, 2.0, 30.0])
@pytest.mark.parametrize("degrees", [0.3, 1.5, 6.0, 40.0])
def test_published_coefficients_are_the_same_at_any_speed(speed: float, degrees: float) -> None:
    polar, angle = DickinsonPolar(), np.radians(degrees)
    values = ca.DM(polar.parameters)
    slow, at_one = (
        polar.coefficients(
            section_flow(ca.DM(u * np.cos(angle)), ca.DM(-u * np.sin(angle))), values
        )
        for u in (speed, 1.0)
    )
    assert [float(x) for x in slow] == pytest.approx([float(x) for x in at_one], rel=1e-12)


def test_smooth_polar_is_the_fit_of_the_published_one() -> None:
    a = np.linspace(0, np.pi / 2, 1001)
    lift = 0.225 + 1.58 * np.sin(2.13 * a - np.radians(7.2))
    drag = 1.92 - 1.55 * np.cos(2.04 * a - np.radians(9.82))
    amplitude = lift @ np.sin(2 * a) / (np.sin(2 * a) @ np.sin(2 * a))
    rise, base = np.polyfit(np.sin(a) ** 2, drag, 1)
    assert SmoothPolar().parameters == pytest.approx([amplitude, base, rise], abs=0.006)  # rounded


@pytest.mark.parametrize("reynolds", [100.0, 1400.0, 14_000.0])
@pytest.mark.parametrize("degrees", [-60.0, 0.0, 20.0, 45.0, 90.0])
def test_coefficients_by_reynolds_number_are_the_published_fit(
    reynolds: float, degrees: float
) -> None:
    angle, chord, viscosity = np.radians(degrees), 0.004, 1.5e-5
    speed = reynolds * viscosity / chord
    polar = ReynoldsPolar(viscosity=viscosity)
    flow = section_flow(ca.DM(speed * np.cos(angle)), ca.DM(-speed * np.sin(angle)), chord)
    lift, drag = polar.coefficients(flow, ca.DM(polar.parameters))
    # as in Lee et al. (2016); a limit of rounding
    amplitude = 1.966 - 3.94 * reynolds**-0.429
    expected = 0.031 + 10.48 * reynolds**-0.764
    expected += (1.873 - 3.14 * reynolds**-0.369) * (1 - np.cos(2 * angle))
    assert float(lift) == pytest.approx(amplitude * np.sin(2 * angle), rel=1e-12, abs=1e-12)
    assert float(drag) == pytest.approx(expected, rel=1e-12)


def test_drag_by_reynolds_number_is_positive_however_slow_the_air() -> None:
    polar = ReynoldsPolar()
    for speed in 10 ** np.linspace(-6, 3, 91):
        for angle in np.radians([0.0, 30.0, 60.0, 90.0]):
            flow = section_flow(ca.DM(speed * np.cos(angle)), ca.DM(speed * np.sin(angle)), 1e-3)
            lift, drag = polar.coefficients(flow, ca.DM(polar.parameters))
            assert float(drag) > 0
            assert -1e-3 < -float(lift) < 1.966  # rounding off at Re = 6 leaves lift, and no more


def test_viscosity_takes_nothing_from_the_downwash_of_the_polar_by_reynolds_number() -> None:
    """The downwash was that of a chord of 1 m at 1 m/s, so it depended on the viscosity alone."""
    expected = SmoothPolar(1.966).downwash_factor(ca.DM(SmoothPolar(1.966).parameters))
    for viscosity in (1e-6, 1.47e-5, 0.05):
        polar = ReynoldsPolar(viscosity=viscosity)
        assert float(polar.downwash_factor(ca.DM(polar.parameters))) == float(expected) > 0.09


def test_forces_over_ground_at_one_reynolds_number_go_with_the_square_of_the_speed() -> None:
    """Ground takes from the polar's downwash, whose Reynolds number was not that of the strips."""
    robot, forces = load_robot_text(FLAPPER), []
    for scale in (1.0, 1000.0):
        polar = ReynoldsPolar(viscosity=1.47e-4 * scale)
        model = QuasiSteady(robot, Air(ground=-0.1), polar=polar)
        v = robot.velocities(x=3.0, z=-1.0)[None] * scale
        q = robot.coordinates()[None]
        forces.append(model.batch.generalized_force(q, v) / scale**2)
    assert forces[1] == pytest.approx(forces[0], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    "polar",
    [DickinsonPolar(lift_rate=2.0), SmoothPolar(1.5, 0.1, 2.0), ReynoldsPolar(viscosity=1e-5)],
)
def test_polar_survives_its_description(polar: object) -> None:
    assert polar_from_description(polar.describe()) == polar  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: SmoothPolar(lift_amplitude=np.nan),
        lambda: SmoothPolar(zero_lift_drag=-0.1),
        lambda: SmoothPolar(zero_lift_drag=1.0, drag_rise=-2.0),
        lambda: DickinsonPolar(drag_offset=1.0, drag_amplitude=1.1),
        lambda: ReynoldsPolar(viscosity=0.0),
        lambda: ReynoldsPolar(drag_rise=0.9),
        lambda: polar_from_description({"name": "flat"}),
        lambda: polar_from_description({"name": "smooth", "lift": 1.0}),
    ],
)
def test_impossible_polars_are_refused(wrong: object) -> None:
    with pytest.raises(ParameterError, match="polar|lift_amplitude: expected a finite"):
        wrong()  # type: ignore[operator]


def test_a_registered_polar_is_read_again_and_keeps_its_name() -> None:
    @dataclass(frozen=True)
    class Constant(Polar):
        name: ClassVar = "constant for a test"
        drag: float = 1.0

        def coefficients(self, flow, parameters):
            return 0.0, parameters[0]

    register_polar(register_polar(Constant))  # twice, as in a notebook
    assert polar_from_description(Constant(2.0).describe()) == Constant(2.0)

    class Other(Constant):
        pass

    with pytest.raises(ParameterError, match="one of its own"):
        register_polar(Other)
    _KINDS.remove(Constant)


def test_the_force_point_stays_where_it_is_said_to() -> None:
    robot = load_robot_text(FLAPPER)
    fixed = QuasiSteady(robot, force_point="fixed")
    assert aero_from_description(robot, fixed.describe()) == fixed
    old = {key: value for key, value in fixed.describe().items() if key != "force_point"}
    switching = aero_from_description(robot, old)  # flights older than the choice
    assert aero_from_description(robot, old | {"force_point_switches": False}) == fixed
    assert QuasiSteady(robot) == switching
    with pytest.raises(ParameterError, match="force_point: expected"):
        QuasiSteady(robot, force_point="behind")  # type: ignore[arg-type]
    q = robot.coordinates()
    for speed, apart in ((3.0, 0.0), (-3.0, 0.04)):  # half the chord of 8 cm when moving backward
        v = robot.velocities(x=speed, z=-0.5)
        ahead = [aero.strips(q, v)["strip_point"][0, 0] for aero in (fixed, switching)]
        assert ahead[0] == pytest.approx(0.0, abs=1e-12)
        assert ahead[0] - ahead[1] == pytest.approx(apart, abs=1e-12)


def test_a_force_point_that_moves_goes_with_the_incidence_without_a_jump() -> None:
    robot = load_robot_text(FLAPPER)
    moving, chord = QuasiSteady(robot, polar=ReynoldsPolar(), force_point="moving"), 0.08
    places = []
    for degrees in (*range(10, 90, 10), *np.linspace(85.0, 95.0, 41)):
        angle = np.radians(degrees)
        v = robot.velocities(x=2.0 * np.cos(angle), z=-2.0 * np.sin(angle))
        point = moving.strips(robot.coordinates(), v)["strip_point"][0, 0]
        places.append(0.25 - point / chord)  # behind the leading edge
        if degrees < 86:
            assert places[-1] == pytest.approx(0.05 + 0.82 * degrees / 180, abs=1e-9)  # Dickson
    assert np.abs(np.diff(places[8:])).max() < 0.02
    assert places[28] == pytest.approx(0.5, abs=1e-9)  # across the flow: mid-chord
