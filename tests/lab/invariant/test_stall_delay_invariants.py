"""What air that separates late may not break: energy over a cycle, shares, finite numbers."""

from __future__ import annotations

import numpy as np
import pytest

from patagium.aerodynamics import Air, LiftingLine, StallDelay, measured_section
from patagium.aerodynamics.indicial import ONE_STATE
from patagium.aerodynamics.sections import Section, StripSection
from patagium.robot import Robot, load_robot_text, preset_text
from patagium_lab.validation.pitching import load_pitching_case

FREQUENCY, STEPS, COUNT = 5.0, 120, 40


@pytest.fixture(scope="module")
def aerobat() -> Robot:
    """The preset with two strips on each part of a wing instead of five: the same equations."""
    return load_robot_text(preset_text("aerobat").replace("strips: 5", "strips: 2"))


def sections() -> list[StripSection]:
    case = load_pitching_case()
    return [Section(), measured_section(case.angle, case.static_lift, case.static_drag)]


def motions(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates and velocities (STEPS, COUNT, 14) of random beats in still air, half a step."""
    size = np.array([0.03] * 3 + [0.2] * 3 + [1.0] * 8) * 0.6
    cosine, sine = rng.normal(size=(2, COUNT, 14)) * size
    phase = np.pi * np.arange(2 * STEPS)[:, None, None] / STEPS
    q = cosine * np.cos(phase) + sine * np.sin(phase)
    v = 2 * np.pi * FREQUENCY * (sine * np.cos(phase) - cosine * np.sin(phase))
    v[..., 0] += rng.uniform(0.0, 3.0, size=COUNT)
    return q, v, np.array(1 / (FREQUENCY * STEPS))


@pytest.mark.parametrize("section", sections(), ids=["plate", "measured"])
@pytest.mark.usefixtures("interpreted")
def test_no_cycle_in_still_air_gains_energy_and_shares_stay_shares(
    aerobat: Robot, rng: np.random.Generator, section: StripSection
) -> None:
    aero = LiftingLine(aerobat, lags=ONE_STATE, section=section, stall_delay=StallDelay())
    q, v, step = motions(rng)
    count = len(aerobat.strips)
    z, work = np.zeros((COUNT, aero.state_size)), np.zeros(COUNT)
    largest = 0.0
    for k in range(3 * STEPS):
        now, middle = 2 * (k % STEPS), 2 * (k % STEPS) + 1
        if k >= 2 * STEPS:
            work += aero.batch.strips(q[now], v[now], z)["power"] * step
        half = z + 0.5 * step * aero.batch.state_derivative(q[now], v[now], z)
        z = z + step * aero.batch.state_derivative(q[middle], v[middle], half)
        share = z[:, -2 * count : -count]
        assert share.min() > -1e-3 and share.max() < 1.001  # error of the midpoint rule
        largest = max(largest, float(share.max()))
    assert largest > 0.9  # and the wings do stall
    assert (work < 0).all()


@pytest.mark.usefixtures("interpreted")
def test_numbers_stay_finite_at_rest_and_at_any_state(
    aerobat: Robot, rng: np.random.Generator
) -> None:
    aero = LiftingLine(aerobat, Air(), ONE_STATE, sections()[1], 13.5, StallDelay())
    count = 20_000
    v = rng.normal(size=(count, 14)) * 10.0 ** rng.integers(-300, 3, size=(count, 1))
    v *= rng.random((count, 14)) < 0.5  # many components exactly zero, some states at rest
    q = np.where(rng.random((count, 1)) < 0.5, 0.0, rng.normal(size=(count, 14)))
    z = rng.normal(size=(count, aero.state_size)) * (rng.random((count, 1)) < 0.7)
    assert np.isfinite(aero.batch.generalized_force(q, v, z)).all()
    assert np.isfinite(aero.batch.state_derivative(q, v, z)).all()


def test_no_force_runs_away_where_a_wing_turns_back(aerobat: Robot) -> None:
    aero = LiftingLine(aerobat, lags=ONE_STATE, stall_delay=StallDelay())
    area = np.array([float(strip.chord * strip.width) for strip in aerobat.strips])
    z, step, angle, q = np.zeros(aero.state_size), 1e-4, np.radians(12.0), np.zeros(14)
    largest = 0.0
    for k in range(1700):  # from 6 m/s back to -6 within 10 ms, while the nose comes up
        speed, v = float(np.interp(k * step, [0.15, 0.16], [6.0, -6.0])), np.zeros(14)
        v[0], v[2] = speed * np.cos(angle), -speed * np.sin(angle)
        v[4] = -40.0 * (k * step > 0.14)
        z = z + step * aero.state_derivative(q, v, z)
        strips = aero.strips(q, v, z)
        pressure = 0.5 * aero.air.density * strips["strip_airspeed"] ** 2
        fast = strips["strip_airspeed"] > 0.35
        force = np.linalg.norm(strips["strip_force"], axis=1)[fast]
        largest = max(largest, (force / (pressure * area)[fast]).max(initial=0.0))
    assert 1.0 < largest < 4.0  # no measured section has more


def test_separation_takes_semichords_not_seconds(aerobat: Robot) -> None:
    shares, count = [], len(aerobat.strips)
    for speed, delay in ((5.0, StallDelay()), (10.0, StallDelay()), (5.0, StallDelay(5.1, 9.0))):
        aero = LiftingLine(aerobat, lags=ONE_STATE, stall_delay=delay)
        v, z = np.zeros(14), np.zeros(aero.state_size)
        v[0], v[2] = speed * np.cos(1.3), -speed * np.sin(1.3)
        step = 0.025 * aerobat.strips[0].chord / (2 * speed)
        for _ in range(240):  # six semichords
            z = z + step * aero.state_derivative(np.zeros(14), v, z)
        shares.append(z[-2 * count : -count])
    assert 0.1 < shares[0].max() < 0.95
    assert np.allclose(shares[0], shares[1], rtol=1e-9)
    assert shares[2].max() < 0.5 * shares[0].max()
