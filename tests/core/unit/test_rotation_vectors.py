"""Rotations of a filter against those of SciPy, also where they vanish and at half a turn."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from patagium.sensing.motion.frame_model import rotation_matrix, rotation_vector


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1e-3, 0.1, 2.0, 3.1, np.pi - 1e-8])
def test_vectors_and_matrices_are_those_of_scipy(angle: float, rng: np.random.Generator) -> None:
    axis = rng.standard_normal(3)
    vector = angle * axis / np.linalg.norm(axis)
    matrix = rotation_matrix(vector)
    np.testing.assert_allclose(matrix, Rotation.from_rotvec(vector).as_matrix(), atol=1e-15)
    # near half a turn the sine says little: the square root of rounding
    np.testing.assert_allclose(rotation_vector(matrix), vector, atol=1e-15 + 3e-8 * (angle > 3.0))
