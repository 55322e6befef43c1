"""The published robot against 100 states computed by another program."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from patagium.dynamics import Dynamics
from patagium.robot import load_robot

FILE = Path(__file__).parents[3].parent / "shared" / "data" / "lagrange_vectors.npz"
ROUNDING = 1e-12  # relative to the largest entry of a state, as the vectors' own note expects


@pytest.fixture(scope="module")
def vectors() -> dict[str, np.ndarray]:
    if not FILE.exists():
        pytest.skip(f"the reference vectors {FILE.name} are not beside this checkout")
    with np.load(FILE) as archive:
        return {name: archive[name] for name in archive.files}


@pytest.fixture(scope="module")
def dynamics() -> Dynamics:
    return Dynamics(load_robot("aerobat-published"))


def _assert_close(found: np.ndarray, expected: np.ndarray) -> None:
    """Each state to rounding of its own largest entry."""
    axes = tuple(range(1, expected.ndim))
    largest = np.abs(expected).max(axis=axes)
    worst = (np.abs(found - expected).max(axis=axes) / largest).max()
    assert worst <= ROUNDING


def test_mass_matrix(vectors, dynamics) -> None:
    assert len(vectors["q"]) == 100
    _assert_close(np.array([dynamics.mass_matrix(q) for q in vectors["q"]]), vectors["M"])


def test_coriolis_force(vectors, dynamics) -> None:
    states = zip(vectors["q"], vectors["qd"], strict=True)
    _assert_close(np.array([dynamics.coriolis(q, v) for q, v in states]), vectors["Cqd"])


def test_gravity_force(vectors, dynamics) -> None:
    _assert_close(np.array([dynamics.gravity(q) for q in vectors["q"]]), vectors["G"])


def test_mass_matrix_and_bias_together(vectors, dynamics) -> None:
    mass_matrix, bias = dynamics.batch.mass_matrix_and_bias(vectors["q"], vectors["qd"])
    _assert_close(mass_matrix, vectors["M"])
    _assert_close(bias, vectors["Cqd"] + vectors["G"])


@pytest.mark.parametrize(("side", "mirror"), [("left", 1.0), ("right", -1.0)])
def test_points_on_the_plates(side: str, mirror: float, vectors, dynamics) -> None:
    jacobians = vectors[f"Ba_{side[0].upper()}"]  # (state, point, coordinate, axis)
    velocities = vectors[f"v_{side[0].upper()}"]
    for number, offset in enumerate(vectors["La"]):
        point = dynamics.point(f"{side}_plate", offset * [1.0, mirror, 1.0])
        found = np.array([point.jacobian(q).T for q in vectors["q"]])
        _assert_close(found, jacobians[:, number])
        states = zip(vectors["q"], vectors["qd"], strict=True)
        moving = np.array([point.velocity(q, v) for q, v in states])
        _assert_close(moving, velocities[:, number])
