"""A robot mirrored in y moves as the mirror image does."""

import casadi as ca
import numpy as np
import pytest

from patagium.dynamics import equations
from patagium.robot import Robot, load_robot, preset_names

ODD = {"y", "roll", "yaw", "rudder"}


def _mirrored(robot: Robot, vector: np.ndarray) -> np.ndarray:
    """The coordinates or forces of the mirror image: sides swapped, odd ones negated."""
    image = np.empty_like(vector)
    for i, name in enumerate(robot.dof_names):
        twin = name
        if name.startswith(("left", "right")):
            twin = (
                name.replace("left", "right") if "left" in name else name.replace("right", "left")
            )
        image[robot.index(twin)] = -vector[i] if name in ODD else vector[i]
    return image


@pytest.mark.parametrize("name", preset_names())
def test_forces_of_the_mirrored_motion_are_the_mirrored_forces(name, rng):
    robot = load_robot(name)
    q, v, a = (rng.normal(size=robot.dof) for _ in range(3))

    def forces(*motion: np.ndarray) -> np.ndarray:
        return np.array(ca.DM(equations.inverse(robot, *(ca.SX(k) for k in motion))))[:, 0]

    image = forces(*(_mirrored(robot, k) for k in (q, v, a)))
    expected = _mirrored(robot, forces(q, v, a))
    # rounding of sums over the bodies
    np.testing.assert_allclose(image, expected, atol=1e-13 * np.abs(expected).max())
