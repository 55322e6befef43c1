"""Inertia of the shapes, against sums over many small masses."""

import numpy as np
import pytest

from patagium.robot import inertia


def _summed(points: np.ndarray) -> np.ndarray:
    """Inertia of a unit mass spread evenly over points."""
    square = np.mean(np.sum(points**2, axis=1))
    return square * np.eye(3) - points.T @ points / len(points)


@pytest.fixture(scope="module")
def cloud() -> np.ndarray:
    """Midpoints of a grid in the cube from -1 to 1."""
    line = (np.arange(60) + 0.5) / 30 - 1
    return np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)


def test_box_is_its_grid(cloud):
    summed = 3.0 * _summed(cloud * [0.05, 0.1, 0.2])
    # a midpoint sum of squares is low by 1 / 60^2
    np.testing.assert_allclose(inertia.box(3.0, (0.1, 0.2, 0.4)), summed, rtol=3e-4, atol=1e-15)


def test_ellipsoid_is_its_grid(cloud):
    inside = cloud[np.sum(cloud**2, axis=1) <= 1] * [0.1, 0.2, 0.3]
    expected = 2.0 * _summed(inside)
    # staircase of the grid at the surface
    np.testing.assert_allclose(
        inertia.ellipsoid(2.0, (0.1, 0.2, 0.3)), expected, rtol=5e-3, atol=1e-15
    )


def test_slanted_cylinder_is_its_grid(cloud):
    inside = cloud[np.sum(cloud[:, :2] ** 2, axis=1) <= 1] * [0.1, 0.1, 0.4]
    axis = np.array([1.0, 2.0, 2.0]) / 3
    across = np.cross(axis, [1.0, 0, 0]) / np.linalg.norm(np.cross(axis, [1.0, 0, 0]))
    turn = np.stack([across, np.cross(axis, across), axis], axis=1)
    expected = 2.0 * _summed(inside @ turn.T)
    found = inertia.cylinder(2.0, axis, 0.1, 0.8)
    # staircase of the grid at the surface, relative to the largest entry
    np.testing.assert_allclose(found, expected, atol=3e-3 * found.max())


def test_plate_is_a_box_with_its_chord_along_x():
    horizontal = inertia.plate(1.0, "y", chord=0.1, span=0.2, thickness=0.01)
    np.testing.assert_array_equal(horizontal, inertia.box(1.0, (0.1, 0.2, 0.01)))
    vertical = inertia.plate(1.0, "z", chord=0.1, span=0.2, thickness=0.01)
    np.testing.assert_array_equal(vertical, inertia.box(1.0, (0.1, 0.01, 0.2)))


def test_a_point_has_no_inertia_about_itself():
    assert not inertia.point().any()


@pytest.mark.parametrize(
    ("moments", "physical"),
    [((1, 1, 1), True), ((1, 1, 2), True), ((1, 1, 2.01), False), ((-1, 1, 1), False)],
)
def test_moments_of_a_real_body_keep_the_triangle_inequality(moments, physical):
    assert inertia.is_physical(np.diag(np.array(moments, float))) is physical


def test_products_of_inertia_count():
    tensor = np.array([[1.0, 0.9, 0], [0.9, 1.0, 0], [0, 0, 0.2]])
    assert not inertia.is_physical(tensor)  # principal moments 1.9, 0.1, 0.2
