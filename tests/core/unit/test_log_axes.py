import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from patagium.sensing.logs.axes import (
    attitude_in_ours,
    axes_of,
    slerp,
    turning_rate,
)

Array = np.ndarray


def matrix(q: Array) -> Array:
    return Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()


def quaternions(count: int, rng: np.random.Generator) -> Array:
    return Rotation.random(count, rng=rng).as_quat()[:, [3, 0, 1, 2]]


@pytest.mark.parametrize("words", ["flu", "NED", "frd", "enu", "rfu", "x, -y, -z", "y,-x,z"])
def test_axes_are_right_handed_rotations(words: str) -> None:
    rotation = axes_of(words)
    assert rotation is not None
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("words", ["x, y, -z", "x, x, z", "north", "x, y", "", "x, y, w"])
def test_what_is_no_axes_is_told(words: str) -> None:
    assert axes_of(words) is None


def test_north_east_down_is_as_the_compass_has_it() -> None:
    ned, enu = axes_of("ned"), axes_of("enu")
    assert ned is not None and enu is not None
    north_east_down = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(ned @ north_east_down, [1.0, -2.0, -3.0])
    np.testing.assert_allclose(enu @ np.array([2.0, 1.0, -3.0]), ned @ north_east_down)


def test_an_attitude_turns_what_its_axes_turn(rng: np.random.Generator) -> None:
    q, vector = quaternions(20, rng), rng.normal(size=(20, 3))
    world, body = axes_of("ned"), axes_of("frd")
    assert world is not None and body is not None
    ours = attitude_in_ours(q, "wxyz", world, body)
    theirs = np.einsum("nij,nj->ni", matrix(q), vector)
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", matrix(ours), vector @ body.T), theirs @ world.T, atol=1e-13
    )


def test_orders_and_the_way_back_agree(rng: np.random.Generator) -> None:
    q, eye = quaternions(10, rng), np.eye(3)
    one = matrix(attitude_in_ours(q, "wxyz", eye, eye))
    np.testing.assert_allclose(matrix(attitude_in_ours(q[:, [1, 2, 3, 0]], "xyzw", eye, eye)), one)
    back = attitude_in_ours(3.0 * q * [1, -1, -1, -1], "wxyz", eye, eye, inverted=True)
    np.testing.assert_allclose(matrix(back), one, atol=1e-14)
    vectors = Rotation.from_matrix(one).as_rotvec()
    np.testing.assert_allclose(
        matrix(attitude_in_ours(vectors, "rotvec", eye, eye)), one, atol=1e-14
    )


def test_roll_pitch_yaw_turn_about_z_then_y_then_x(rng: np.random.Generator) -> None:
    angles = rng.uniform(-1.5, 1.5, (10, 3))
    expected = Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix()
    np.testing.assert_allclose(
        matrix(attitude_in_ours(angles, "rpy", np.eye(3), np.eye(3))), expected, atol=1e-14
    )


def test_slerp_is_that_of_scipy(rng: np.random.Generator) -> None:
    times = np.sort(rng.uniform(0, 1, 12))
    q = quaternions(12, rng)
    wanted = rng.uniform(times[0], times[-1], 50)
    expected = Slerp(times, Rotation.from_quat(q[:, [1, 2, 3, 0]]))(wanted).as_matrix()
    np.testing.assert_allclose(matrix(slerp(times, q, wanted)), expected, atol=1e-12)


@given(st.floats(-60.0, 60.0), st.integers(0, 2))
def test_a_steady_turn_has_its_rate(rate: float, axis: int) -> None:
    times = np.linspace(0.0, 0.2, 21)
    omega = np.eye(3)[axis] * rate
    turns = np.column_stack(
        [np.cos(rate * times / 2), np.sin(rate * times / 2)[:, None] * np.eye(3)[axis]]
    )
    start = Rotation.from_quat([0.5, -0.5, 0.5, 0.5])
    turned = start * Rotation.from_quat(turns[:, [1, 2, 3, 0]])
    found = turning_rate(times, turned.as_quat()[:, [3, 0, 1, 2]])
    np.testing.assert_allclose(found, np.broadcast_to(omega, found.shape), atol=1e-9)


def test_what_gives_no_rotation_is_missing(rng: np.random.Generator) -> None:
    q, eye = quaternions(6, rng), np.eye(3)
    q[[1, 3, 4]] = [[0.0] * 4, [np.nan, 1.0, 0.0, 0.0], [1e300, 1e300, 0.0, 0.0]]
    found = attitude_in_ours(q, "wxyz", eye, eye)
    assert np.isnan(found).all(axis=1).tolist() == [False, True, False, True, True, False]
    assert np.isnan(attitude_in_ours(np.zeros((2, 4)), "xyzw", eye, eye)).all()
    np.testing.assert_array_equal(attitude_in_ours(np.zeros((1, 3)), "rpy", eye, eye)[0, 0], 1.0)
