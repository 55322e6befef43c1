"""A section in a gust that travels: quadrature along the chord, Kuessner, Sears, Wagner, Miles."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics import (
    AddedMass,
    Air,
    DrydenGust,
    LiftingLine,
    OneMinusCosineGust,
    RampGust,
    RecordedGust,
    Section,
    TravelingGust,
)
from patagium.aerodynamics.gusts import gusts_at_strips, strip_delays
from patagium.dynamics.kinematics import coordinate_rates
from patagium.robot import load_robot
from patagium.simulation import gaits, mounts, simulate
from patagium_lab.validation.cases.wings import INFINITE, rectangular_wing
from patagium_lab.validation.exact_functions import (
    kussner_function,
    sears_function,
    theodorsen_function,
    wagner_function,
)

UPSTREAM, UP = (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
AIRSPEED, SEMICHORD = 10.0, 0.5


class Sine:
    """cos(w t) along z."""

    def __init__(self, frequency):
        self.frequency = frequency

    def velocity_at(self, time):
        return np.outer(np.cos(self.frequency * time), UP)

    def knots(self, first, last):
        step = 2 * np.pi / self.frequency / 64
        return step * np.arange(np.floor(first / step), np.ceil(last / step) + 2)

    def describe(self):
        return {}


def section(gust, time, speed=AIRSPEED):
    """Mean, first moment and rate of a chord whose leading edge lies at x = b, (N,) each."""
    delays = np.zeros((len(time), 4, 1))
    delays[:, 1] = -SEMICHORD / speed
    met = gusts_at_strips(gust.pieces(time.min() - 1.0, time.max() + 1.0), time, delays)
    return met[:, [2, 5, 8], 0].T


@pytest.mark.parametrize("k", [0.1, 0.5, 1.0])
def test_a_sinusoidal_gust_makes_sears_lift_in_size_and_phase(k):
    frequency = k * AIRSPEED / SEMICHORD
    time = 2 * np.pi / frequency * np.arange(16) / 16
    mean, moment, rate = section(TravelingGust(Sine(frequency), UPSTREAM, AIRSPEED), time)
    turn = 2 * np.exp(-1j * frequency * time) / len(time)
    circulatory = theodorsen_function(k) * (turn @ (mean - moment))
    lift = complex(circulatory + turn @ rate * SEMICHORD / (2 * AIRSPEED))
    exact = complex(sears_function(k))
    assert abs(lift) == pytest.approx(abs(exact), rel=1e-6)  # cubics for a cosine
    assert np.angle(lift) == pytest.approx(np.angle(exact), abs=1e-6)


def step_lift(s, speed):
    """Lift over its final value at s semichords after the leading edge met a sharp edge."""
    edge = RampGust(UP, 0.0, 1e-9)
    gust = TravelingGust(edge, UPSTREAM, speed, (SEMICHORD, 0.0, 0.0))
    fine = np.linspace(0.0, s, 4001)
    time = fine * SEMICHORD / AIRSPEED
    delays = np.zeros((len(time), 4, 1))
    delays[:, 0] = SEMICHORD / speed
    delays[:, 1] = -SEMICHORD / speed
    met = gusts_at_strips(gust.pieces(-1.0, 10.0), time, delays)
    drive = met[:, 2, 0] - met[:, 5, 0]
    between = wagner_function(s - (fine[1:] + fine[:-1]) / 2)
    lift = drive[0] * wagner_function(s)[0] + between @ np.diff(drive)
    return lift + met[-1, 8, 0] * SEMICHORD / (2 * AIRSPEED)


@pytest.mark.parametrize("s", [0.5, 1.0, 1.9, 3.0, 8.0])
def test_a_sharp_edge_that_the_air_carries_makes_kussners_lift(s):
    assert step_lift(s, AIRSPEED) == pytest.approx(kussner_function(s)[0], abs=2e-5)  # 4000 steps


@pytest.mark.parametrize("ratio", [0.5, 2.0, 5.0])
def test_a_sharp_edge_at_another_speed_makes_miles_lift(ratio):
    # front at x_f = 1 - ratio s: Q' and the impulse by hand, from thin-airfoil theory
    s = 1.2
    speed = ratio * AIRSPEED
    front = np.linspace(0.0, min(s, 2.0 / ratio), 200_001)
    middle = (front[1:] + front[:-1]) / 2
    y = 1.0 - ratio * middle
    growth = ratio * (1.0 - y) / np.sqrt(1.0 - y * y) / np.pi * np.diff(front)
    lift = growth @ np.interp(s - middle, grid := np.linspace(0, 2, 2001), wagner_function(grid))
    here = 1.0 - ratio * s
    if abs(here) < 1:
        lift += ratio * np.sqrt(1.0 - here * here) / np.pi
    assert step_lift(s, speed) == pytest.approx(lift, abs=2e-3)  # of the root singularity


@pytest.mark.parametrize("spread", [0.04, -0.04, 1e-7, 0.0, -0.4])
@pytest.mark.parametrize("decay_time", [None, 0.1])
@pytest.mark.parametrize(
    "profile",
    [
        OneMinusCosineGust((0.3, -1.0, 2.0), 0.1, 0.3),
        DrydenGust((0.5, 0.3, 0.2), (0.4, 0.2, 0.1), airspeed=3.0, seed=3),
        RampGust((1.0, 0.0, 1.0), 0.2, 0.05),
        RecordedGust(np.linspace(-0.2, 1.4, 30), np.sin(np.arange(90.0)).reshape(30, 3)),
    ],
)
def test_chord_integrals_are_those_of_a_quadrature(profile, decay_time, spread):
    gust = TravelingGust(profile, UPSTREAM, 3.0, decay_time=decay_time)
    time, step = np.array([0.0513, 0.2371, 0.3017, 0.6131]), 1e-6
    delays = np.tile(np.array([0.02, spread, 0.3, 0.2 * spread])[:, None], (len(time), 1, 1))
    met = gusts_at_strips(gust.pieces(-1.0, 2.0), time, delays)[:, :, 0]
    angle = (np.arange(20_000) + 0.5) * np.pi / 20_000
    y = np.cos(angle)

    def met_at(ahead):
        late = 0.02 + 0.3 * ahead * step + spread * (1 + 0.2 * ahead * step) * y
        at = time[:, None] + ahead * step - late
        left = np.exp(-late / decay_time) if decay_time else np.ones_like(y)
        return profile.velocity_at(at.ravel()).reshape(len(time), len(y), 3) * left[:, None]

    now, change = met_at(0), (met_at(1) - met_at(-1)) / (2 * step)
    scale = np.abs(now).max() + 1e-3
    mean, moment = now.mean(axis=1), (now * y[:, None]).mean(axis=1)
    np.testing.assert_allclose(met[:, :3], mean, atol=3e-6 * scale)  # cubics for a cosine
    np.testing.assert_allclose(met[:, 3:6], moment, atol=3e-6 * scale)
    rate = (change * 2 * np.sin(angle)[:, None] ** 2).mean(axis=1)
    # slopes jump from line to line; the quadrature meets each jump within a point
    np.testing.assert_allclose(met[:, 6:], rate, atol=1e-3 * np.abs(change).max() + 1e-9)


def test_delays_and_their_rates_are_those_of_the_chord():
    robot = load_robot("aerobat-beta")
    rng = np.random.default_rng(5)
    q, v = 0.5 * rng.standard_normal(robot.coordinate_count), rng.standard_normal(robot.dof)
    symbols = [ca.SX.sym(name, n) for name, n in (("q", len(q)), ("v", len(v)), ("g", 6))]
    delays = ca.Function("delays", symbols, [strip_delays(robot, *symbols)])
    gust = TravelingGust(RampGust(UP, 0.0, 1.0), (1.0, -2.0, 0.5), 4.0, (0.3, 0.1, -0.2))
    now = np.array(delays(q, v, gust.parameters))
    step = 1e-6
    moved = [
        np.array(delays(q + s * step * np.ravel(coordinate_rates(robot, q, v)), v, gust.parameters))
        for s in (1, -1)
    ]
    change = (moved[0][:2] - moved[1][:2]) / (2 * step)
    np.testing.assert_allclose(now[2:], change, atol=1e-8)  # of central differences
    assert np.abs(now[1]).max() <= 0.5 * max(s.chord for s in robot.strips) / 4.0 + 1e-12


def flown(gust, added=True, speed=AIRSPEED):
    wing = rectangular_wing(INFINITE, 3)
    air = Air(wind=(-speed, 0.0, 0.0), gust=gust)
    model = LiftingLine(wing, air, section=Section(profile_drag=0.0), surface_constant=0.0)
    return simulate(
        wing, model, gaits.still(wing), duration=0.3, time_step=5e-4, mount=mounts.fixed(),
        added_mass=AddedMass(wing, air) if added else None,
    )  # fmt: skip


def test_the_lift_of_a_gust_the_air_carries_acts_at_the_quarter_chord():
    edge = OneMinusCosineGust((0.0, 0.0, 1e-3), 0.0, 0.1)
    flight = flown(TravelingGust(edge, UPSTREAM, AIRSPEED, (0.25, 0.0, 0.0)))
    force = flight["aero_force"].values + flight["added_mass_force"].values
    lift, moment = force[:, 2], force[:, 4]  # about the body's origin, the quarter chord
    assert np.abs(lift).max() > 0
    assert np.abs(moment).max() < 1e-6 * np.abs(lift).max() * SEMICHORD  # cubics for a cosine
    push = flight["added_mass_force"].values[:, 2]
    assert np.abs(push).max() > 0.05 * np.abs(lift).max()


@pytest.mark.usefixtures("interpreted")
def test_a_gust_that_comes_at_once_is_the_uniform_one():
    profile = OneMinusCosineGust((0.2, 0.0, 0.5), 0.01, 0.1)
    uniform, traveling = (
        flown(profile, added=False),
        flown(TravelingGust(profile, UPSTREAM, 1e9), added=False),
    )
    for name in ("aero_force", "aero_state", "wind"):
        one, other = uniform[name].values, traveling[name].values
        scale = np.abs(one).max()
        np.testing.assert_allclose(other, one, rtol=0, atol=3e-6 * scale)  # cubics for a cosine
