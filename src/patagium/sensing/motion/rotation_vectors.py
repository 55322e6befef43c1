"""Rotation matrices and rotation vectors of single rotations, fast enough for a filter.

`scipy.spatial.transform.Rotation` does the same for many rotations at once; for one its checks
take most of the time.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

_SMALL = 1e-6


def rotation_matrix(vector: Array) -> Array:
    """Rotation matrix, (3, 3) [-], of a rotation vector, (3,) [rad]."""
    x, y, z = vector.tolist()
    square = x * x + y * y + z * z
    if square < _SMALL:
        s, c = 1 - square / 6, 0.5 - square / 24
    else:
        angle = sqrt(square)
        s, c = sin(angle) / angle, (1 - cos(angle)) / square
    d = 1 - c * square
    return np.array(
        [
            [d + c * x * x, c * x * y - s * z, c * x * z + s * y],
            [c * x * y + s * z, d + c * y * y, c * y * z - s * x],
            [c * x * z - s * y, c * y * z + s * x, d + c * z * z],
        ]
    )


def rotation_vector(matrix: Array) -> Array:
    """Rotation vector, (3,) [rad], of a rotation matrix, at most half a turn long."""
    m = matrix.tolist()
    axis = np.array([m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]]) / 2
    sine, cosine = sqrt(float(axis @ axis)), (m[0][0] + m[1][1] + m[2][2] - 1) / 2
    if sine > _SMALL:
        return np.asarray(axis * (atan2(sine, cosine) / sine))
    if cosine > 0:
        return axis
    return np.asarray(Rotation.from_matrix(matrix).as_rotvec())
