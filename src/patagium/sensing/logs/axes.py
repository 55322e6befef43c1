"""Conversion from the axes of other programs to ours: x forward, y left, z up in world and body.

Aerospace axes (z down) and those of maps (x east) appear here and nowhere below. Attitudes are
unit quaternions [w, x, y, z] that turn components in the body into components in the world.
Origins are not moved: a position stays relative to the point from which it was measured.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from patagium.arrays import Array, Bools
from patagium.robot.attitude import without_flips
from patagium.sensing.sensors import as_quaternion, from_quaternion

NAMED = {
    "flu": "x, y, z",
    "nwu": "x, y, z",
    "frd": "x, -y, -z",
    "ned": "x, -y, -z",
    "enu": "y, -x, z",
    "rfu": "y, -x, z",
}
"""Our axes in terms of named ones: forward, left, up; north, west, up; and so on."""
AXES_WORDS = f"{', '.join(NAMED)}, or ours in terms of them, right-handed, such as 'x, -y, -z'"
_ROUNDED = 0.02
"""Departure from orthogonality that two decimals leave, at most."""
_SIGNED = re.compile(r"([+-]?)([xyz])")


def axes_of(words: str) -> Array | None:
    """Rotation from named axes to ours, (3, 3) [-]; None if the words name no axes.

    Args:
        words: Name of the axes, or our x, y, z in terms of theirs.
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
    """Attitude in other axes as a quaternion in ours, R = W R' B^T.

    Args:
        components: Quaternion of any length, (N, 4) [-], or roll, pitch, yaw or rotation vector,
            (N, 3) [rad], or rotation matrix row by row, (N, 9) [-].
        order: "wxyz", "xyzw", "rpy", "rotvec" or "matrix".
        world: Rotation W of their world axes to ours, (3, 3) [-].
        body: Rotation B of their body axes to ours, (3, 3) [-].
        inverted: Whether the attitude turns components in the world into the body's.

    Returns:
        Quaternions w, x, y, z, (N, 4) [-], w >= 0 at the first and no jump of sign after it; NaN
        where the components give no rotation.
    """
    found = np.full((len(components), 4), np.nan)
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(components, axis=1)
    valid = np.isfinite(length) & ((length > 0) | (order in ("rpy", "rotvec")))
    if order == "matrix":
        valid &= is_rotation(components)
    if not valid.any():
        return found
    theirs = _ROTATIONS[order](components[valid])
    if inverted:
        theirs = theirs.inv()
    ours = Rotation.from_matrix(world) * theirs * Rotation.from_matrix(body).inv()
    found[valid] = as_quaternion(ours)
    return continuous(found)


_ROTATIONS: dict[str, Callable[[Array], Rotation]] = {
    "wxyz": from_quaternion,
    "xyzw": Rotation.from_quat,
    "rpy": lambda angles: Rotation.from_euler("ZYX", angles[:, ::-1]),
    "rotvec": Rotation.from_rotvec,
    "matrix": lambda rows: Rotation.from_matrix(rows.reshape(-1, 3, 3)),
}
"""Rotations of attitudes by the order of their components."""


def is_rotation(matrices: Array) -> Bools:
    """Whether matrices are rotations: rows of length one at right angles, determinant 1, (N,).

    Args:
        matrices: Entries row by row, (N, 9) [-].
    """
    rows = matrices.reshape(-1, 3, 3)
    with np.errstate(all="ignore"):  # numbers of a damaged log may be of any size
        error = np.abs(rows @ rows.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        return np.asarray((error < _ROUNDED) & (np.linalg.det(rows) > 0))


def continuous(q: Array) -> Array:
    """Quaternions of the same attitudes without jumps of sign, (N, 4) [-]."""
    found = without_flips(q)
    return -found if len(q) and q[0, 0] < 0 else found


def slerp(stamps: Array, q: Array, wanted: Array) -> Array:
    """Attitudes between attitudes, turning at a constant rate about one axis.

    Args:
        stamps: Increasing times of the attitudes, (N,) [s].
        q: Attitudes w, x, y, z without jumps of sign, (N, 4) [-].
        wanted: Times within those of the attitudes, (K,) [s].

    Returns:
        Attitudes at the wanted times, (K, 4) [-].
    """
    if len(stamps) == 1:
        return np.repeat(q, len(wanted), axis=0)
    between = Slerp(stamps, from_quaternion(q))(wanted)
    return np.asarray(between.as_quat()[:, [3, 0, 1, 2]])


def turning_rate(stamps: Array, q: Array) -> Array:
    """Mean angular velocity in body axes between consecutive attitudes, (N - 1, 3) [rad/s].

    Args:
        stamps: Increasing times of the attitudes, (N,) [s].
        q: Attitudes w, x, y, z, (N, 4) [-].
    """
    attitude = from_quaternion(q)
    turn = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
    return np.asarray(turn / np.diff(stamps)[:, None])
