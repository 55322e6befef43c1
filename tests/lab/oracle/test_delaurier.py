"""DeLaurier's strips against the closed forms they come from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from patagium.aerodynamics import AddedMass, Air, DeLaurier
from patagium.aerodynamics.model import aero_functions
from patagium_lab.validation.cases.wings import rectangular_wing

SPEED = 10.0


def model(aspect_ratio: float, **numbers: float) -> DeLaurier:
    return DeLaurier(rectangular_wing(aspect_ratio, 3), Air(), **numbers)


def coefficients(aero: DeLaurier, angle: float, lag: float) -> tuple[float, float]:
    """Lift and drag coefficient of the wing at rest, uncompiled."""
    function = aero_functions(aero)[0]
    v = SPEED * np.array([np.cos(angle), 0, -np.sin(angle), 0, 0, 0])
    constants = aero.robot.parameters, aero.parameters
    x, _, z = np.array(function(np.zeros(6), v, np.full(3, lag), np.zeros(3), *constants)).ravel()[
        :3
    ]
    area = sum(strip.chord * strip.width for strip in aero.robot.strips)
    pressure = 0.5 * aero.air.density * SPEED**2 * area
    lift, drag = z * np.cos(angle) + x * np.sin(angle), z * np.sin(angle) - x * np.cos(angle)
    return lift / pressure, drag / pressure


@pytest.mark.parametrize("aspect_ratio", [2.0, 6.0])
def test_steady_lift_and_drag_are_those_of_the_elliptic_wing(aspect_ratio: float) -> None:
    angle = 1e-3
    aero = model(aspect_ratio, friction_drag=0.0, suction_efficiency=1.0)
    lift, drag = coefficients(aero, angle, SPEED * np.sin(angle))
    slope = 2 * np.pi * aspect_ratio / (2 + aspect_ratio)
    assert lift / angle == pytest.approx(slope, rel=1e-5)  # of the angle's square
    # suction on the section of the lagging wash: drag of the lift's tilt, C_L^2/(pi A)
    assert drag / angle**2 == pytest.approx(slope**2 / (np.pi * aspect_ratio), rel=1e-4)


def test_camber_lifts_at_no_incidence_and_pulls_there() -> None:
    aero = model(6.0, friction_drag=0.0, zero_lift_angle=-0.05)
    lift, drag = coefficients(aero, 0.0, 0.05 * SPEED)
    assert lift == pytest.approx(2 * np.pi * 0.75 * 0.05, rel=1e-3)
    assert drag > 0  # induced, camber's pull counted


@pytest.mark.parametrize("k", [0.05, 0.2, 0.8])
def test_harmonic_motion_has_the_published_memory(k: float) -> None:
    aspect_ratio = 5.0
    aero = model(aspect_ratio)
    functions, chord = aero_functions(aero), 1.0
    omega, constants = 2 * k * SPEED / chord, (aero.robot.parameters, aero.parameters)
    size, steps = 1e-4, 400

    def at(phase: float, z: np.ndarray, which: int) -> np.ndarray:
        v = np.array([SPEED, 0, -size * np.cos(phase), 0, 0, 0])
        return np.array(functions[which](np.zeros(6), v, z, np.zeros(3), *constants)).ravel()

    step, z, force = 2 * np.pi / steps, np.zeros(3), np.zeros(steps, complex)
    settle = int(np.ceil(8 * omega / (2 * np.pi) / (2 * SPEED * 0.3 / chord))) + 1
    for n in range((settle + 1) * steps):
        phase = n * step
        if n >= settle * steps:
            force[n % steps] = at(phase, z, 0)[2]
        half = z + step / 2 / omega * at(phase, z, 2)
        z = z + step / omega * at(phase + step / 2, half, 2)
    transfer = 2 * (force * np.exp(-1j * step * np.arange(steps))).mean() / size
    c_1, c_2 = 0.5 * aspect_ratio / (2.32 + aspect_ratio), 0.181 + 0.772 / aspect_ratio
    lag = 1 - c_1 * k**2 / (k**2 + c_2**2) - 1j * c_1 * c_2 * k / (k**2 + c_2**2)
    area = sum(strip.chord * strip.width for strip in aero.robot.strips)
    steady = np.pi * aero.air.density * SPEED * area * aspect_ratio / (2 + aspect_ratio)
    assert transfer / steady == pytest.approx(lag, abs=2e-4)  # of the midpoint rule


def test_beyond_stall_only_the_normal_force_of_crossflow_is_left() -> None:
    aero = model(6.0)
    for angle in np.radians([20.0, 45.0, 90.0]):
        lift, drag = coefficients(aero, angle, SPEED * np.sin(angle))
        normal = 1.98 * np.sin(angle)
        assert lift == pytest.approx(normal * np.cos(angle), abs=1e-12)
        assert drag == pytest.approx(normal * np.sin(angle), abs=1e-12)


def test_with_added_mass_the_pitching_suction_is_whole() -> None:
    aero = model(1e9, friction_drag=0.0, suction_efficiency=1.0)
    wing = replace(aero.robot)
    carried = AddedMass(wing, aero.air)
    v = np.array([SPEED, 0.0, 0.0, 0.0, 0.4, 0.0])  # nose down about the quarter chord
    zero, lag = np.zeros(6), -0.4 * 0.5 * np.ones(3)
    chord_force = aero.generalized_force(zero, v, lag)[0]
    chord_force += carried.generalized_force(zero, v, zero)[0]
    chord_force += carried.circulatory_force(zero, v)[0]
    wash, swing = -0.4 * 0.5, -0.4  # m/s, chord 1
    width = sum(strip.width for strip in wing.strips)
    garrick = np.pi * aero.air.density * width * (wash - swing / 4) ** 2
    assert chord_force == pytest.approx(garrick, rel=1e-3)  # of the speed at a quarter chord
