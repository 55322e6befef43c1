"""Added mass against Theodorsen's section, in closed form, force and moment."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics import LiftingLine, Section, SmoothPolar
from patagium.aerodynamics.indicial import NO_STATE
from patagium.robot import Body, Robot, Strip

DENSITY, CHORD, WIDTH, SPEED = 1.225, 0.08, 0.3, 4.0
SEMICHORD = CHORD / 2
CYLINDER = np.pi * DENSITY * SEMICHORD**2 * WIDTH  # air carried normal to the chord [kg]


def plate(middle: float) -> Robot:
    """A free plate whose mid-chord is `middle` semichords behind the body's origin."""
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    zero, inertia = (0.0, 0.0, 0.0), (1e-5, 1e-5, 1e-5, 0.0, 0.0, 0.0)
    body = Body("plate", -1, zero, axes, (), tuple(range(6)), 0.01, zero, inertia)
    quarter = ((0.5 - middle) * SEMICHORD, 0.0, 0.0)
    strip = Strip("wing[0]", "wing", 0, False, quarter, axes[0], axes[2], CHORD, WIDTH)
    names, units = ("x", "y", "z", "roll", "pitch", "yaw"), ("m",) * 3 + ("rad",) * 3
    infinite = (np.inf,) * 6
    return Robot(
        "plate", (body,), (strip,), names, units, (), (0.0,) * 6,
        tuple(-x for x in infinite), infinite, 9.81,
    )  # fmt: skip


def test_a_heaving_plate_carries_a_cylinder_of_air() -> None:
    robot = plate(0.0)
    a = robot.coordinates(z=3.0)
    force = pt.AddedMass(robot, factor=0.85).generalized_force(np.zeros(6), np.zeros(6), a)
    np.testing.assert_allclose(force, [0, 0, -0.85 * CYLINDER * 3.0, 0, 0, 0], atol=1e-17)


def test_matrix_about_the_quarter_chord_is_the_textbook_one() -> None:
    matrix = pt.AddedMass(plate(0.5)).mass_matrix(np.zeros(6))
    arm = SEMICHORD / 2
    spin = np.pi * DENSITY / 8 * SEMICHORD**4 * WIDTH + arm**2 * CYLINDER
    expected = np.zeros((6, 6))
    expected[2, 2], expected[4, 4] = CYLINDER, spin
    expected[2, 4] = expected[4, 2] = CYLINDER * arm  # nose down lifts what is behind
    np.testing.assert_allclose(matrix, expected, atol=1e-17)


# axis aft of mid-chord in semichords; heave rate (down) and acceleration, nose-up rate and
# acceleration: Theodorsen's force and moment are linear, nothing here is small
MOTIONS = [
    (0.0, 0.3, 0.0, 0.0, 0.0),
    (0.0, 0.0, 2.0, 0.0, 0.0),
    (0.2, 0.0, 0.0, 1.5, 0.0),
    (-0.5, 0.0, 0.0, 0.0, 30.0),
    (-0.3, 0.3, 2.0, 1.5, 30.0),
]


@pytest.mark.parametrize("motion", MOTIONS)
def test_force_and_moment_without_circulation_are_theodorsens(motion) -> None:
    """pi rho b^2 (h'' + U t' - b a t''), and about the axis with C(k) = 0.

    M = pi rho b^2 (b a h'' - U b (1/2 - a) t' - b^2 (1/8 + a^2) t''), nose up.
    """
    axis, sink, sinking, rise, rising = motion
    robot = plate(-axis)  # mid-chord is ahead of an axis that is aft of it
    model = pt.AddedMass(robot)
    v = robot.coordinates(x=SPEED, z=-sink, pitch=-rise)
    a = robot.coordinates(z=-sinking, pitch=-rising)
    force = model.generalized_force(np.zeros(6), v, a) + model.circulatory_force(np.zeros(6), v)
    b = SEMICHORD
    lift = CYLINDER * (sinking + SPEED * rise - b * axis * rising)
    moment = b * axis * sinking - SPEED * b * (0.5 - axis) * rise
    moment = CYLINDER * (moment - b * b * (0.125 + axis**2) * rising)
    assert force[2] == pytest.approx(lift, rel=1e-12, abs=1e-15)
    assert -force[4] == pytest.approx(moment, rel=1e-12, abs=1e-15)


def test_quasi_steady_thin_airfoil_and_added_mass_are_theodorsens_at_once() -> None:
    """Lift and moment with C(k) = 1: a lifting line without memory or end beside added mass."""
    axis, sink, sinking, rise, rising = 0.2, 0.3e-4, 2.0, 1.5e-4, 30.0
    robot = plate(-axis).with_parameters({"wing[0].width": 1e6})  # two-dimensional
    section = Section(profile_drag=0.0)
    line = LiftingLine(robot, lags=NO_STATE, section=section, surface_constant=0.0)
    model = pt.AddedMass(robot)
    v = robot.coordinates(x=SPEED, z=-sink, pitch=-rise)
    a = robot.coordinates(z=-sinking, pitch=-rising)
    force = model.generalized_force(np.zeros(6), v, a) + model.circulatory_force(np.zeros(6), v)
    force = (force + line.generalized_force(np.zeros(6), v)) / 1e6
    b = SEMICHORD
    wash = sink + b * (0.5 - axis) * rise
    mass = np.pi * DENSITY * b * b
    lift = mass * (sinking + SPEED * rise - b * axis * rising)
    lift = lift + 2 * np.pi * DENSITY * SPEED * b * wash
    moment = b * axis * sinking - SPEED * b * (0.5 - axis) * rise
    moment = mass * (moment - b * b * (0.125 + axis**2) * rising)
    moment = moment + 2 * np.pi * DENSITY * SPEED * b * b * (axis + 0.5) * wash
    assert force[2] == pytest.approx(lift, rel=1e-6)  # small angles
    assert -force[4] == pytest.approx(moment, rel=1e-6)


def test_a_polar_keeps_its_steady_moment() -> None:
    """Steady motion at any incidence, forward or backward: added mass adds nothing."""
    robot = plate(0.3)
    model = pt.AddedMass(robot)
    for angle in (0.1, 0.7, 1.4, 2.5, -0.4):
        v = robot.coordinates(x=SPEED * np.cos(angle), z=-SPEED * np.sin(angle))
        q, still = np.zeros(6), np.zeros(6)
        force = model.generalized_force(q, v, still) + model.circulatory_force(q, v)
        np.testing.assert_allclose(force, 0.0, atol=1e-16)


def test_a_separated_plate_that_turns_has_no_lift_of_circulation() -> None:
    """The force across the path, free of power, goes with the attached flow; the moment stays."""
    robot, rate = plate(-0.5), 20.0
    model = pt.AddedMass(robot)
    for angle in (0.2, 0.5, 1.2, 2.1, 2.9, -0.9):
        along = np.array([np.cos(angle), -np.sin(angle)])
        side = np.sign(np.cos(angle))  # the path is that of the quarter chord which leads
        velocities = SPEED * along + [0.0, -rate * SEMICHORD * (1 + side) / 2]
        v = robot.coordinates(x=velocities[0], z=velocities[1], pitch=-rate)
        force = model.circulatory_force(np.zeros(6), v)
        assert abs(force @ v) < 1e-15
        across = force[0] * along[1] - force[2] * along[0]
        attached = abs(np.sin(angle)) < np.sin(np.radians(30.0))
        wash = SPEED * np.sin(angle) + side * SEMICHORD * rate
        full = CYLINDER * rate * wash * along[1] if attached else 0.0
        assert across == pytest.approx(full, abs=1e-15)


def test_a_plate_let_go_falls_slower_by_the_air_it_carries() -> None:
    robot = plate(0.0)
    airless = SmoothPolar(lift_amplitude=0.0, zero_lift_drag=0.0, drag_rise=0.0)
    flight = pt.simulate(
        robot,
        pt.QuasiSteady(robot, polar=airless),
        pt.gaits.still(robot),
        duration=0.1,
        time_step=1e-3,
        added_mass=pt.AddedMass(robot),
    )
    acceleration = -9.81 * 0.01 / (0.01 + CYLINDER)
    np.testing.assert_allclose(flight.a.sel(dof="z").values, acceleration, rtol=1e-12)
