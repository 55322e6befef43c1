"""Attitudes as numbers: unit quaternions, Euler angles, and their rates.

A quaternion is Hamilton's, scalar first, and maps body axes to the world's; angles are roll,
pitch, yaw with R = Rz(yaw) Ry(pitch) Rx(roll). q and -q are one attitude. Every function takes
one attitude or many: axes before the last are kept. Angles are singular
at a pitch of 90 degrees, where only yaw - roll or yaw + roll means anything.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array


def quaternion_from_angles(angles: ArrayLike) -> Array:
    """Unit quaternion of Euler angles, (..., 4); continuous in them, not always with qw > 0.

    Args:
        angles: Roll, pitch, yaw, (..., 3) [rad].
    """
    from scipy.spatial.transform import Rotation  # slow to import, rarely needed

    given = np.asarray(angles, float)
    scalar_last: Array = Rotation.from_euler("xyz", given.reshape(-1, 3)).as_quat()
    return np.roll(scalar_last, 1, axis=-1).reshape(*given.shape[:-1], 4)


def rotation_from_angles(angles: ArrayLike) -> Array:
    """Rotation matrices of Euler angles, (..., 3, 3), body axes to world axes.

    R = Rz(yaw) Ry(pitch) Rx(roll); entries below 1e-15 are rounding and become zero, because an
    exact zero is structure of a robot.

    Args:
        angles: Roll, pitch, yaw, (..., 3) [rad].
    """
    three = _components(angles)
    (cr, cp, cy), (sr, sp, sy) = np.cos(three), np.sin(three)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    matrix = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return np.where(np.abs(matrix) < 1e-15, 0.0, matrix)


def _components(vectors: ArrayLike) -> Array:
    """Vectors, (..., 3), by component, (3, ...)."""
    return np.moveaxis(np.asarray(vectors, float), -1, 0)


def body_rates(angles: ArrayLike, rates: ArrayLike) -> Array:
    """Angular velocity in body axes, (..., 3) [rad/s].

    (p, q, r) = (roll' - sin(pitch) yaw', cos(roll) pitch' + cos(pitch) sin(roll) yaw',
    -sin(roll) pitch' + cos(pitch) cos(roll) yaw').

    Args:
        angles: Roll, pitch, yaw, (..., 3) [rad].
        rates: Their rates, (..., 3) [rad/s].
    """
    roll, pitch, _ = _components(angles)
    of_roll, of_pitch, of_yaw = _components(rates)
    level = np.cos(pitch) * of_yaw
    parts = [
        of_roll - np.sin(pitch) * of_yaw,
        np.cos(roll) * of_pitch + np.sin(roll) * level,
        np.cos(roll) * level - np.sin(roll) * of_pitch,
    ]
    return np.stack(parts, axis=-1)


def body_accelerations(angles: ArrayLike, rates: ArrayLike, accelerations: ArrayLike) -> Array:
    """Angular acceleration in body axes, (..., 3) [rad/s^2].

    The rate of `body_rates`: its matrix times the accelerations, and its own change.

    Args:
        angles: Roll, pitch, yaw, (..., 3) [rad].
        rates: Their rates, (..., 3) [rad/s].
        accelerations: Their second derivatives, (..., 3) [rad/s^2].
    """
    roll, pitch, _ = _components(angles)
    of_roll, of_pitch, of_yaw = _components(rates)
    _, w_left, w_up = _components(body_rates(angles, rates))
    sinking = np.sin(pitch) * of_pitch * of_yaw
    change = [
        -np.cos(pitch) * of_pitch * of_yaw,
        of_roll * w_up - np.sin(roll) * sinking,
        -of_roll * w_left - np.cos(roll) * sinking,
    ]
    return np.asarray(body_rates(angles, accelerations) + np.stack(change, axis=-1))


def without_flips(quaternions: Array) -> Array:
    """Quaternions of the same attitudes without jumps of sign, (N, ..., 4) [-].

    Args:
        quaternions: Attitudes in the order of time, (N, ..., 4) [-]; the scalar first or last.
    """
    along = (quaternions[1:] * quaternions[:-1]).sum(axis=-1)
    signs = np.cumprod(np.where(along < 0, -1.0, 1.0), axis=0)
    return np.concatenate([quaternions[:1], quaternions[1:] * signs[..., None]])
