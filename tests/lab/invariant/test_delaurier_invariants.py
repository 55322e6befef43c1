"""What DeLaurier's strips may not break: energy, mirror, Galileo, finite numbers."""

from __future__ import annotations

import numpy as np
import pytest

from patagium.aerodynamics import DeLaurier
from patagium.native import compiler_name
from patagium.robot import Robot, load_robot


@pytest.fixture(scope="module")
def aerobat() -> Robot:
    return load_robot("aerobat")


@pytest.fixture(scope="module")
def aero(aerobat: Robot) -> DeLaurier:
    return DeLaurier(aerobat)


def mirror(x: np.ndarray) -> np.ndarray:
    """Coordinates of the aerobat seen in the plane y = 0."""
    sign = [1.0, -1.0, 1.0, -1.0, 1.0, -1.0]
    return np.hstack([x[..., :6] * sign, x[..., 10:14], x[..., 6:10]])


def test_stalled_strips_in_still_air_never_do_work(
    aero: DeLaurier, rng: np.random.Generator
) -> None:
    v = np.zeros((20_000, 14))
    v[:, [0, 2, 4]] = rng.normal(size=(20_000, 3)) * [4.0, 4.0, 5.0]
    z = np.zeros((len(v), aero.state_size))
    strips = aero.batch.strips(np.zeros((len(v), 14)), v, z)
    # memory still empty: the leading edge meets the wash that it will keep at least
    stalled = (np.abs(strips["angle_of_attack"]) > np.radians(15.1)).all(axis=1)
    assert stalled.mean() > 0.2
    assert (strips["power"][stalled] < 0).all()


@pytest.mark.parametrize("amplitude", [0.1, 0.6])
def test_no_cycle_in_still_air_gains_energy(
    aero: DeLaurier, rng: np.random.Generator, amplitude: float
) -> None:
    frequency, steps, count = 5.0, 120, 60
    size = np.array([0.03] * 3 + [0.2] * 3 + [1.0] * 8) * amplitude
    cosine, sine = rng.normal(size=(2, count, 14)) * size
    speed = rng.uniform(0.0, 3.0, size=count)

    def at(k: float) -> tuple[np.ndarray, np.ndarray]:
        phase = 2 * np.pi * k / steps
        q = cosine * np.cos(phase) + sine * np.sin(phase)
        v = 2 * np.pi * frequency * (sine * np.cos(phase) - cosine * np.sin(phase))
        v[:, 0] += speed
        return q, v

    step, z, work = 1 / (frequency * steps), np.zeros((count, aero.state_size)), np.zeros(count)
    for k in range(4 * steps):
        if k >= 3 * steps:
            work += aero.batch.strips(*at(k), z)["power"] * step
        half = z + 0.5 * step * aero.batch.state_derivative(*at(k), z)
        z = z + step * aero.batch.state_derivative(*at(k + 0.5), half)
    assert (work < 0).all()


def test_power_is_what_the_generalized_force_does(
    aero: DeLaurier, rng: np.random.Generator
) -> None:
    q, v = rng.normal(scale=0.5, size=(200, 14)), rng.normal(scale=4.0, size=(200, 14))
    z = rng.normal(size=(200, aero.state_size))
    power = aero.batch.strips(q, v, z)["power"]
    work = np.einsum("ni,ni->n", aero.batch.generalized_force(q, v, z), v)
    assert np.allclose(work, power, rtol=1e-10, atol=1e-12)


def test_left_and_right_are_mirror_images_and_wind_is_flying(
    aero: DeLaurier, rng: np.random.Generator
) -> None:
    q, v = rng.normal(scale=0.5, size=(50, 14)), rng.normal(scale=4.0, size=(50, 14))
    z, wind = rng.normal(size=(50, 10)), rng.normal(size=(50, 3))
    force = aero.batch.generalized_force(q, v, z, wind)
    swapped = np.hstack([z[:, 5:], z[:, :5]])
    mirrored = aero.batch.generalized_force(mirror(q), mirror(v), swapped, wind * [1, -1, 1])
    assert np.allclose(mirrored, mirror(force), rtol=0, atol=1e-10 * np.abs(force).max())
    through_air = v.copy()
    through_air[:, :3] -= wind
    flown = aero.batch.generalized_force(q, through_air, z)
    assert np.allclose(force, flown, rtol=0, atol=1e-10 * np.abs(flown).max())


def test_a_plate_that_flies_backward_is_the_same_plate(rng: np.random.Generator) -> None:
    from patagium_lab.validation.cases.wings import rectangular_wing

    aero = DeLaurier(rectangular_wing(4.0, 3))
    z, middle = np.full(3, 0.2), -0.25  # mid-chord, behind the quarter chord
    ahead = np.array([6.0, 0.0, -0.3, 0.0, 0.8, 0.0])
    ahead[2] += ahead[4] * middle  # velocity of the body's origin, given that of mid-chord
    back = np.array([-6.0, 0.0, -0.3, 0.0, -0.8, 0.0])
    back[2] += back[4] * middle
    force, other = (aero.generalized_force(np.zeros(6), v, z) for v in (ahead, back))
    assert other[2] == pytest.approx(force[2])
    assert other[0] == pytest.approx(-force[0])


def test_numbers_stay_finite_at_a_million_states_and_at_rest(
    aero: DeLaurier, rng: np.random.Generator
) -> None:
    count = 1_000_000 if compiler_name() else 2_000
    chunk = min(count, 100_000)
    for _ in range(count // chunk):
        v = rng.normal(size=(chunk, 14)) * 10.0 ** rng.integers(-300, 3, size=(chunk, 1))
        v *= rng.random((chunk, 14)) < 0.5  # many components exactly zero, some states at rest
        z = rng.normal(size=(chunk, 10)) * (rng.random((chunk, 1)) < 0.7)
        assert np.isfinite(aero.batch.generalized_force(np.zeros(14), v, z)).all()
        assert np.isfinite(aero.batch.state_derivative(np.zeros(14), v, z)).all()
    assert not aero.generalized_force(np.zeros(14), np.zeros(14)).any()
