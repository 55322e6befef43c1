"""What no model of still air may break: dissipation, symmetry, Galileo, finite numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from patagium.aerodynamics import (
    Air,
    DickinsonPolar,
    QuasiSteady,
    ReynoldsPolar,
    SmoothPolar,
    TablePolar,
)
from patagium.native import compiler_name
from patagium.robot import Robot, load_robot
from patagium_lab.published.aerodynamics import PUBLISHED_ERRORS, Published

TABLE = TablePolar(
    (-1.5, -0.3, 0.0, 0.25, 0.5, 1.5),
    (0.0, -0.9, 0.1, 1.2, 0.7, 0.1),
    (1.3, 0.02, 0.01, 0.0, 0.4, 1.3),
)
QUASI_STEADY = [
    pytest.param({"polar": TABLE}, id="table"),
    pytest.param({"polar": DickinsonPolar()}, id="dickinson"),
    pytest.param({"polar": SmoothPolar()}, id="smooth"),
    pytest.param({"polar": ReynoldsPolar()}, id="reynolds"),
    pytest.param({"polar": DickinsonPolar(), "rotational": True}, id="rotational"),
]


@pytest.fixture(scope="module")
def aerobat() -> Robot:
    return load_robot("aerobat")


@pytest.mark.parametrize("options", QUASI_STEADY)
def test_still_air_never_does_work_on_a_section(
    plate: Robot, rng: np.random.Generator, options: dict
) -> None:
    v = rng.normal(size=(100_000, 6)) * 10.0 ** rng.uniform(-4, 1.5, size=(100_000, 1))
    power = QuasiSteady(plate, **options).batch.strips(np.zeros(6), v)["power"]
    assert (power <= 0).all()
    assert (power < 0).mean() > 0.999  # and it does take energy out


@pytest.mark.parametrize("options", QUASI_STEADY)
@pytest.mark.usefixtures("interpreted")
def test_power_is_what_the_generalized_force_does(
    aerobat: Robot, rng: np.random.Generator, options: dict
) -> None:
    q, v = rng.normal(scale=0.5, size=(200, 14)), rng.normal(scale=4.0, size=(200, 14))
    aero = QuasiSteady(aerobat, **options)
    power = aero.batch.strips(q, v)["power"]
    work = np.einsum("ni,ni->n", aero.batch.generalized_force(q, v), v)
    assert (power < 0).all()
    assert np.allclose(work, power, rtol=1e-11)  # rounding of sums over ten strips


def test_every_error_of_the_published_model_changes_its_force(
    plate: Robot, rng: np.random.Generator
) -> None:
    v = rng.normal(scale=4.0, size=(20, 6))
    clean = Published(plate, errors=()).batch.generalized_force(np.zeros(6), v)
    for name in PUBLISHED_ERRORS:
        force = Published(plate, errors=[name]).batch.generalized_force(np.zeros(6), v)
        assert np.abs(force - clean).max() > 0.01 * np.abs(clean).max(), name


@pytest.mark.parametrize("options", QUASI_STEADY)
def test_left_and_right_are_mirror_images(
    aerobat: Robot, rng: np.random.Generator, options: dict
) -> None:
    q, v = rng.normal(scale=0.5, size=(50, 14)), rng.normal(scale=4.0, size=(50, 14))
    wind = rng.normal(size=(50, 3))
    aero = QuasiSteady(aerobat, **options)
    mirrored = aero.batch.generalized_force(_mirror(q), _mirror(v), wind=wind * [1.0, -1.0, 1.0])
    force = aero.batch.generalized_force(q, v, wind=wind)
    assert np.allclose(mirrored, _mirror(force), rtol=0, atol=1e-12 * np.abs(force).max())


@pytest.mark.parametrize("model", [QuasiSteady, Published])
@pytest.mark.usefixtures("interpreted")
def test_wind_is_the_same_as_flying_through_still_air(
    aerobat: Robot, rng: np.random.Generator, model: type
) -> None:
    q, v = rng.normal(scale=0.5, size=(50, 14)), rng.normal(scale=4.0, size=(50, 14))
    wind = rng.normal(scale=3.0, size=(50, 3))
    aero = model(aerobat)
    through_air = v.copy()
    through_air[:, :3] -= wind
    blown = aero.batch.generalized_force(q, v, wind=wind)
    flown = aero.batch.generalized_force(q, through_air)
    assert np.allclose(blown, flown, rtol=0, atol=1e-12 * np.abs(flown).max())  # rounding


def test_force_grows_with_density_and_the_square_of_speed(
    aerobat: Robot, rng: np.random.Generator
) -> None:
    q, v = rng.normal(scale=0.5, size=14), rng.normal(scale=4.0, size=14)
    aero = Published(aerobat)  # no smoothing: exactly homogeneous
    force = aero.generalized_force(q, v)
    assert np.allclose(aero.generalized_force(q, 3 * v), 9 * force, rtol=1e-12)
    denser = Published(aerobat, Air(density=2 * 1.225))
    assert np.allclose(denser.generalized_force(q, v), 2 * force, rtol=1e-12)


@pytest.mark.parametrize("options", QUASI_STEADY)
def test_numbers_stay_finite_at_a_million_states_and_at_rest(
    plate: Robot, rng: np.random.Generator, options: dict
) -> None:
    count = 1_000_000 if compiler_name() else 10_000
    v = rng.normal(size=(count, 6)) * 10.0 ** rng.integers(-300, 3, size=(count, 1))
    v *= rng.random((count, 6)) < 0.5  # many components exactly zero, some states at rest
    q = np.where(rng.random((count, 1)) < 0.5, 0.0, rng.normal(size=(count, 6)))
    force = QuasiSteady(plate, **options).batch.generalized_force(q, v)
    at_rest = ~v.any(axis=1)
    assert at_rest.any()
    assert np.isfinite(force).all()
    assert not force[at_rest].any()


def test_nothing_jumps_where_the_force_point_changes_side(plate: Robot) -> None:
    forward = np.linspace(-0.3, 0.3, 2001)
    v = np.zeros((2001, 6))
    v[:, 0], v[:, 2], v[:, 4] = forward, 2.0, 5.0
    smooth = QuasiSteady(plate).batch.generalized_force(np.zeros(6), v)
    hard = Published(plate, errors=()).batch.generalized_force(np.zeros(6), v)
    scale = np.abs(smooth).max(axis=0) + 1e-30
    assert (np.abs(np.diff(smooth, axis=0)) / scale).max() < 0.02
    assert (np.abs(np.diff(hard, axis=0)) / scale).max() > 0.5
    beyond = np.abs(forward) > 0.1
    assert np.allclose(smooth[beyond], hard[beyond], rtol=0, atol=1e-12 * scale)


def test_a_robot_without_wings_meets_no_air(plate: Robot) -> None:
    aero = QuasiSteady(replace(plate, name="stone", strips=()))
    assert np.array_equal(aero.generalized_force(np.zeros(6), np.ones(6)), np.zeros(6))
    assert aero.strips(np.zeros(6), np.ones(6))["strip_force"].shape == (0, 3)


def _mirror(x: np.ndarray) -> np.ndarray:
    """Coordinates of the aerobat seen in the plane y = 0."""
    sign = [1.0, -1.0, 1.0, -1.0, 1.0, -1.0]
    return np.hstack([x[..., :6] * sign, x[..., 10:14], x[..., 6:10]])
