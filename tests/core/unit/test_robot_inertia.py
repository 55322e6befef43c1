"""Inertia of the shapes, against sums over many small masses."""

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError, RobotFileError
from patagium.robot import load_robot_text
from patagium.robot.model import is_physical
from patagium.robot.schema import Box, Cylinder, Ellipsoid, Plate, PointMass


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
    np.testing.assert_allclose(
        Box(type="box", size=(0.1, 0.2, 0.4)).tensor(3.0), summed, rtol=3e-4, atol=1e-15
    )


def test_ellipsoid_is_its_grid(cloud):
    inside = cloud[np.sum(cloud**2, axis=1) <= 1] * [0.1, 0.2, 0.3]
    expected = 2.0 * _summed(inside)
    # staircase of the grid at the surface
    np.testing.assert_allclose(
        Ellipsoid(type="ellipsoid", semi_axes=(0.1, 0.2, 0.3)).tensor(2.0),
        expected,
        rtol=5e-3,
        atol=1e-15,
    )


def test_slanted_cylinder_is_its_grid(cloud):
    inside = cloud[np.sum(cloud[:, :2] ** 2, axis=1) <= 1] * [0.1, 0.1, 0.4]
    axis = np.array([1.0, 2.0, 2.0]) / 3
    across = np.cross(axis, [1.0, 0, 0]) / np.linalg.norm(np.cross(axis, [1.0, 0, 0]))
    turn = np.stack([across, np.cross(axis, across), axis], axis=1)
    expected = 2.0 * _summed(inside @ turn.T)
    found = Cylinder(type="cylinder", axis=list(axis), radius=0.1, length=0.8).tensor(2.0)
    # staircase of the grid at the surface, relative to the largest entry
    np.testing.assert_allclose(found, expected, atol=3e-3 * found.max())


def test_plate_is_a_box_with_its_chord_along_x():
    horizontal = Plate(type="plate", axis="y", chord=0.1, span=0.2, thickness=0.01).tensor(1.0)
    np.testing.assert_array_equal(horizontal, Box(type="box", size=(0.1, 0.2, 0.01)).tensor(1.0))
    vertical = Plate(type="plate", axis="z", chord=0.1, span=0.2, thickness=0.01).tensor(1.0)
    np.testing.assert_array_equal(vertical, Box(type="box", size=(0.1, 0.01, 0.2)).tensor(1.0))


def test_a_point_has_no_inertia_about_itself():
    assert not PointMass(type="point").tensor(1.0).any()


@pytest.mark.parametrize(
    ("moments", "physical"),
    [((1, 1, 1), True), ((1, 1, 2), True), ((1, 1, 2.01), False), ((-1, 1, 1), False)],
)
def test_moments_of_a_real_body_keep_the_triangle_inequality(moments, physical):
    assert is_physical(np.diag(np.array(moments, float))) is physical


def test_products_of_inertia_count():
    tensor = np.array([[1.0, 0.9, 0], [0.9, 1.0, 0], [0, 0, 0.2]])
    assert not is_physical(tensor)  # principal moments 1.9, 0.1, 0.2


@pytest.mark.parametrize(
    "changed",
    [
        {"left_wing.inertia.yy": -5e-3},
        {"left_wing.inertia.xy": 1.0},
        {"body.mass": 0.4, "body.inertia.zz": 1.0},
    ],
)
def test_an_impossible_inertia_among_the_parameters_is_refused(changed):
    """Only the tensor that a body states was looked at, not what `parameters` made of it."""
    robot = pt.load_robot("ornithopter")
    with pytest.raises(ParameterError, match="inertia.*: expected principal moments of a real"):
        robot.with_parameters(changed)
    block = "\n".join(f"  {name}: {value}" for name, value in changed.items())
    with pytest.raises(RobotFileError, match=r"line \d+, parameters.*principal moments of a real"):
        load_robot_text(f"{robot.source}\nparameters:\n{block}\n")


def test_a_mass_of_zero_with_inertia_among_the_parameters_is_refused():
    """A mass of zero was accepted under `parameters` and refused under `bodies`."""
    robot, expected = pt.load_robot("ornithopter"), "body.mass: expected a mass above 0"
    with pytest.raises(ParameterError, match=expected):
        robot.with_parameters({"body.mass": 0.0})
    with pytest.raises(RobotFileError, match=rf"line \d+, parameters.{expected}"):
        load_robot_text(f"{robot.source}\nparameters: {{body.mass: 0}}\n")
    none = {f"body.inertia.{axis}": 0.0 for axis in ("xx", "yy", "zz", "xy", "xz", "yz")}
    assert robot.with_parameters({"body.mass": 0.0} | none).bodies[0].mass == 0.0


def test_an_inertia_may_change_as_a_whole():
    """One of these moments alone breaks the triangle inequality of a plate, and not by a bit."""
    robot = pt.load_robot("ornithopter")
    names = [f"left_wing.inertia.{axis}" for axis in ("xx", "yy", "zz")]
    moments = robot.bodies[robot.body_index("left_wing")].inertia[:3]
    larger = {name: 2 * value for name, value in zip(names, moments, strict=True)}
    assert robot.with_parameters(larger).source != robot.source
    assert robot.with_parameters({names[2]: 1.02 * moments[2]}).source != robot.source
    with pytest.raises(ParameterError, match=names[2]):
        robot.with_parameters({names[2]: larger[names[2]]})
