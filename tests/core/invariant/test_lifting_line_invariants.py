"""What air with memory may not break: energy over a cycle, mirror, Galileo, finite numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from patagium.aerodynamics import Air, LiftingLine, Section
from patagium.aerodynamics.indicial import ONE_STATE, TWO_STATE
from patagium.aerodynamics.model import aero_functions
from patagium.native import compiler_name
from patagium.robot import Robot, load_robot

FREQUENCY, STEPS = 5.0, 120


@pytest.fixture(scope="module")
def aerobat() -> Robot:
    return load_robot("aerobat")


@pytest.fixture(scope="module")
def aero(aerobat: Robot) -> LiftingLine:
    return LiftingLine(aerobat, lags=ONE_STATE)


def mirror(x: np.ndarray) -> np.ndarray:
    """Coordinates of the aerobat seen in the plane y = 0."""
    sign = [1.0, -1.0, 1.0, -1.0, 1.0, -1.0]
    return np.hstack([x[..., :6] * sign, x[..., 10:14], x[..., 6:10]])


class Gaits:
    """Random periodic motions of all coordinates, two harmonics, through still air."""

    def __init__(self, rng: np.random.Generator, count: int, amplitude: float) -> None:
        size = np.array([0.03] * 3 + [0.2] * 3 + [1.0] * 8) * amplitude
        self.amplitude = rng.normal(size=(2, 2, count, 14)) * size * [[[[1.0]]], [[[0.4]]]]
        self.speed = rng.uniform(0.0, 3.0, size=count)

    def __call__(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        q, v = np.zeros(self.amplitude.shape[2:]), np.zeros(self.amplitude.shape[2:])
        for k, (cosine, sine) in enumerate(self.amplitude, start=1):
            omega = 2 * np.pi * FREQUENCY * k
            phase = omega * time
            q += cosine * np.cos(phase) + sine * np.sin(phase)
            v += omega * (sine * np.cos(phase) - cosine * np.sin(phase))
        v[:, 0] += self.speed
        return q, v


def cycle_work(aero: LiftingLine, gaits: Gaits, cycles: int = 5) -> np.ndarray:
    """Work of the air on the robot over the last of several cycles, (N,) [J]."""
    z, step = np.zeros((len(gaits.speed), aero.state_size)), 1 / (FREQUENCY * STEPS)
    work = np.zeros(len(gaits.speed))
    for k in range(cycles * STEPS):
        state, middle = gaits(k * step), gaits((k + 0.5) * step)
        if k >= (cycles - 1) * STEPS:
            work += aero.batch.strips(*state, z)["power"] * step
        half = z + 0.5 * step * aero.batch.state_derivative(*state, z)
        z = z + step * aero.batch.state_derivative(*middle, half)
    return work


@pytest.mark.parametrize("amplitude", [0.1, 0.6])
def test_no_cycle_in_still_air_gains_energy(
    aero: LiftingLine, rng: np.random.Generator, amplitude: float
) -> None:
    work = cycle_work(aero, Gaits(rng, 100, amplitude))
    assert (work < 0).all()


def test_even_without_drag_small_motion_loses_energy_to_the_wake(
    aerobat: Robot, rng: np.random.Generator
) -> None:
    section = Section(profile_drag=0.0, stall_begins=1.2, stall_complete=1.4)
    aero = LiftingLine(aerobat, lags=ONE_STATE, section=section)
    work = cycle_work(aero, Gaits(rng, 100, 0.1))
    assert (work < 0).all()


def test_left_and_right_are_mirror_images(aero: LiftingLine, rng: np.random.Generator) -> None:
    q, v = rng.normal(scale=0.5, size=(50, 14)), rng.normal(scale=4.0, size=(50, 14))
    z, wind = rng.normal(size=(50, 10)), rng.normal(size=(50, 3))
    force = aero.batch.generalized_force(q, v, z, wind)
    swapped = np.hstack([z[:, 5:], z[:, :5]])
    mirrored = aero.batch.generalized_force(mirror(q), mirror(v), swapped, wind * [1, -1, 1])
    assert np.allclose(mirrored, mirror(force), rtol=0, atol=1e-10 * np.abs(force).max())


def test_wind_is_the_same_as_flying_through_still_air(
    aero: LiftingLine, rng: np.random.Generator
) -> None:
    q, v = rng.normal(scale=0.5, size=(50, 14)), rng.normal(scale=4.0, size=(50, 14))
    z, wind = rng.normal(size=(50, 10)), rng.normal(scale=3.0, size=(50, 3))
    through_air = v.copy()
    through_air[:, :3] -= wind
    for method in (aero.batch.generalized_force, aero.batch.state_derivative):
        blown, flown = method(q, v, z, wind), method(q, through_air, z)
        assert np.allclose(blown, flown, rtol=0, atol=1e-10 * np.abs(flown).max())


def test_turning_or_moving_the_whole_robot_changes_no_strip(
    aero: LiftingLine, rng: np.random.Generator
) -> None:
    q, v = rng.normal(scale=0.3, size=14), rng.normal(scale=3.0, size=14)
    v[3:6] = 0.0
    moved, carried = q.copy(), v.copy()
    moved[:3] += [1e3, -20.0, 5.0]
    moved[5] += 2.0
    cosine, sine = np.cos(2.0), np.sin(2.0)
    carried[:2] = [cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1]]
    here, there = aero.strips(q, v), aero.strips(moved, carried)
    for name in ("circulation", "angle_of_attack", "strip_airspeed", "power"):
        assert np.allclose(here[name], there[name], rtol=1e-10), name


def test_power_is_what_the_generalized_force_does(
    aero: LiftingLine, rng: np.random.Generator
) -> None:
    q, v = rng.normal(scale=0.5, size=(200, 14)), rng.normal(scale=4.0, size=(200, 14))
    z = rng.normal(size=(200, 10))
    power = aero.batch.strips(q, v, z)["power"]
    work = np.einsum("ni,ni->n", aero.batch.generalized_force(q, v, z), v)
    assert np.allclose(work, power, rtol=1e-10, atol=1e-12)


def test_numbers_stay_finite_at_many_states_and_at_rest(
    aero: LiftingLine, rng: np.random.Generator
) -> None:
    count = 100_000 if compiler_name() else 2_000
    v = rng.normal(size=(count, 14)) * 10.0 ** rng.integers(-300, 3, size=(count, 1))
    v *= rng.random((count, 14)) < 0.5  # many components exactly zero, some states at rest
    q = np.where(rng.random((count, 1)) < 0.5, 0.0, rng.normal(size=(count, 14)))
    z = rng.normal(size=(count, 10)) * (rng.random((count, 1)) < 0.7)
    assert np.isfinite(aero.batch.generalized_force(q, v, z)).all()
    assert np.isfinite(aero.batch.state_derivative(q, v, z)).all()
    at_rest = aero.generalized_force(np.zeros(14), np.zeros(14))
    assert not at_rest.any()


def test_force_beyond_stall_opposes_the_motion(aero: LiftingLine) -> None:
    for angle in np.radians([30.0, 45.0, 60.0, 89.0]):
        v = np.zeros(14)
        v[0], v[2] = 4 * np.cos(angle), -4 * np.sin(angle)
        z = np.full(10, 4 * np.sin(angle))
        strips = aero.strips(np.zeros(14), v, z)
        assert strips["power"] < 0
        size = np.linalg.norm(strips["strip_force"], axis=1)
        assert (size < 4.0 * 0.5 * 1.225 * 16 * 0.1 * 0.024).all()  # C < 4


def test_two_lags_remember_longer_than_none(aerobat: Robot) -> None:
    aero = LiftingLine(aerobat, Air(), lags=TWO_STATE)
    slowest = np.linalg.eigvals(aero.state_space(np.zeros(14), np.eye(14)[0] * 3.0).a).real.max()
    assert slowest == pytest.approx(-2 * 3.0 / 0.1 * 0.0455, rel=0.5)  # less what wings share


GULL = """\
name: gull
gravity: 9.81 m/s^2
bodies:
  body: {floating: true, mass: 300 g, shape: {type: box, size: [20 cm, 4 cm, 4 cm]}}
wings:
  - name: left_wing
    segments:
      - body: body
        strips: 3
        span_axis: [0, 0.98, 0.2]
        stations: [{span: 0 cm, leading: 3 cm, trailing: -9 cm},
                   {span: 12 cm, leading: 3 cm, trailing: -7 cm}]
      - body: body
        at: [0, 12 cm, 2.4 cm]
        strips: 1
        stations: [{span: 0 cm, leading: 3 cm, trailing: -9 cm},
                   {span: 20 cm, leading: 1 cm, trailing: -9 cm}]
  - name: tail
    segments:
      - body: body
        at: [-12 cm, 0, -1 cm]
        strips: 4
        stations: [{span: -15 cm, leading: 0 cm, trailing: -8 cm},
                   {span: 15 cm, leading: 0 cm, trailing: -8 cm}]
mirror: [{from: left, to: right}]
"""


@pytest.mark.parametrize("air", [Air(), Air(ground=0.0)])
def test_a_wing_with_a_kink_and_unequal_strips_mirrors(air: Air, tmp_path: Path) -> None:
    """A bound vortex had the core of its first leg, and a leg the span of its first strip.

    The force of the mirrored flight differed from the mirrored force by 2e-4 of itself.
    """
    path = tmp_path / "gull.yaml"
    path.write_text(GULL)
    aero = LiftingLine(load_robot(path), air, lags=ONE_STATE)
    force, _, derivative = aero_functions(aero)  # as CasADi reckons: nothing to compile
    constants = np.zeros(3), aero.robot.parameters, aero.parameters
    sign, image = np.array([1, -1, 1, -1, 1, -1]), [*range(8, 12), *range(7, 3, -1), *range(4)]
    q, v = np.array([0, 0, 0.1, 0.1, -0.1, 0.0]), np.array([10, 2, -0.5, 0.5, 0.3, -0.8])
    z = np.sin(np.arange(12.0))
    for function, mirrored in ((force, lambda x: x * sign), (derivative, lambda x: x[image])):
        here = np.array(function(q, v, z, *constants)).ravel()
        there = np.array(function(q * sign, v * sign, z[image], *constants)).ravel()
        assert np.abs(there - mirrored(here)).max() < 1e-13 * np.abs(here).max()  # rounding
