"""Axes of other programs to ours: x forward, y left, z up, of world and body alike.

Aerospace axes (z down) and those of maps (x east) appear here and nowhere below. Attitudes are
unit quaternions [w, x, y, z] that turn components in the body into components in the world.
Neglected: origins; a position stays relative to the point it was measured from.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NAMED = {
    "flu": "x, y, z",
    "nwu": "x, y, z",
    "frd": "x, -y, -z",
    "ned": "x, -y, -z",
    "enu": "y, -x, z",
    "rfu": "y, -x, z",
}
"""Our axes in terms of those of a name: forward, left, up; north, west, up; and so on."""
AXES_WORDS = f"{', '.join(NAMED)}, or ours in terms of them such as 'x, -y, -z'"
_SIGNED = re.compile(r"([+-]?)([xyz])")


def axes_of(words: str) -> Array | None:
    """The rotation from axes to ours, (3, 3); None if the words name none.

    Args:
        words: A name, or our x, y, z in terms of theirs.
    """
    parts = [part.strip() for part in NAMED.get(words.strip().lower(), words).split(",")]
    found = [_SIGNED.fullmatch(part) for part in parts]
    if len(parts) != 3 or not all(found):
        return None
    rotation = np.zeros((3, 3))
    for row, match in enumerate(found):
        if match is not None:
            rotation[row, "xyz".index(match[2])] = -1.0 if match[1] == "-" else 1.0
    return rotation if abs(np.linalg.det(rotation) - 1.0) < 1e-9 else None  # of 0, 1 or -1


def attitude_in_ours(
    components: Array, order: str, world: Array, body: Array, *, inverted: bool = False
) -> Array:
    """An attitude in other axes as our quaternion; R = W R' B^T, scaled to norm one.

    Args:
        components: Quaternion, (N, 4) [-], or roll, pitch, yaw, (N, 3) [rad].
        order: "wxyz", "xyzw" or "rpy".
        world: Rotation of their world axes to ours, (3, 3).
        body: Rotation of their body axes to ours, (3, 3).
        inverted: Whether it turns components in the world into the body's.

    Returns:
        Quaternions, (N, 4) [-], w >= 0 at the first and no jump of sign after it; NaN where
        there is no direction.
    """
    q = from_angles(components) if order == "rpy" else components
    if order == "xyzw":
        q = q[:, [3, 0, 1, 2]]
    with np.errstate(invalid="ignore", divide="ignore"):
        q = q / np.linalg.norm(q, axis=1, keepdims=True)
    if inverted:
        q = conjugate(q)
    q = multiply(multiply(of_matrix(world)[None], q), conjugate(of_matrix(body)[None]))
    return continuous(q)


def from_angles(angles: Array) -> Array:
    """Quaternion of roll, pitch, yaw: about z, then y, then x.

    Args:
        angles: (N, 3) [rad].

    Returns:
        (N, 4) [-].
    """
    half = angles / 2.0
    (cr, cp, cy), (sr, sp, sy) = np.cos(half).T, np.sin(half).T
    return np.column_stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def of_matrix(rotation: Array) -> Array:
    """Quaternion of a rotation of right angles, (3, 3) -> (4,) [-]."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return np.array([w, x, y, z])


def multiply(a: Array, b: Array) -> Array:
    """Product of quaternions, (N, 4) [-]."""
    aw, ax, ay, az = a.T
    bw, bx, by, bz = b.T
    return np.column_stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def conjugate(q: Array) -> Array:
    """The turn back, (N, 4) [-]."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def rotate(q: Array, vector: Array) -> Array:
    """Vectors in body axes as vectors in world axes.

    Args:
        q: Attitudes, (N, 4) [-].
        vector: (N, 3), in any unit.
    """
    pure = np.column_stack([np.zeros(len(vector)), vector])
    return np.asarray(multiply(multiply(q, pure), conjugate(q))[:, 1:])


def continuous(q: Array) -> Array:
    """The same attitudes, each with the sign nearer to the one before it, (N, 4) [-]."""
    if not len(q):
        return q
    flips = np.where(np.einsum("nk,nk->n", q[1:], q[:-1]) < 0, -1.0, 1.0)
    first = -1.0 if q[0, 0] < 0 else 1.0
    return np.asarray(q * (first * np.concatenate([[1.0], np.cumprod(flips)]))[:, None])


def slerp(stamps: Array, q: Array, wanted: Array) -> Array:
    """Attitudes between attitudes, turning at a constant rate about one axis.

    Args:
        stamps: Increasing, (N,) [s].
        q: Continuous attitudes at them, (N, 4) [-].
        wanted: Within the stamps, (K,) [s].

    Returns:
        (K, 4) [-].
    """
    left = np.clip(np.searchsorted(stamps, wanted, side="right") - 1, 0, max(0, len(stamps) - 2))
    right = np.minimum(left + 1, len(stamps) - 1)
    span = np.where(right > left, stamps[right] - stamps[left], 1.0)
    share = ((wanted - stamps[left]) / span)[:, None]
    a, b = q[left], q[right]
    cosine = np.clip(np.einsum("nk,nk->n", a, b), -1.0, 1.0)[:, None]
    b = np.where(cosine < 0, -b, b)
    angle = np.arccos(np.abs(cosine))
    sine = np.sin(angle)
    near = sine < 1e-8  # there the chord is the arc to rounding
    safe = np.where(near, 1.0, sine)
    wa = np.where(near, 1.0 - share, np.sin((1.0 - share) * angle) / safe)
    wb = np.where(near, share, np.sin(share * angle) / safe)
    mixed = wa * a + wb * b
    return np.asarray(mixed / np.linalg.norm(mixed, axis=1, keepdims=True))


def turning_rate(stamps: Array, q: Array) -> Array:
    """Mean angular velocity between attitudes one apart, body axes.

    Args:
        stamps: Increasing, (N,) [s].
        q: (N, 4) [-].

    Returns:
        (N - 1, 3) [rad/s].
    """
    turn = multiply(conjugate(q[:-1]), q[1:])
    turn = np.where(turn[:, :1] < 0, -turn, turn)
    sine = np.linalg.norm(turn[:, 1:], axis=1)
    angle = 2.0 * np.arctan2(sine, turn[:, 0])
    scale = np.where(sine > 0, angle / np.where(sine > 0, sine, 1.0), 2.0)
    return np.asarray(turn[:, 1:] * (scale / np.diff(stamps))[:, None])
